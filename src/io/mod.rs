//! Writers of finished meshes. The ending of the name chooses the format:
//!
//! | ending | format | tets | interface facets |
//! |---|---|---|---|
//! | `.vtu` | VTK XML, appended raw data in zlib blocks | cell array `label` | no |
//! | `.vtk` | VTK legacy 4.2, binary | cell scalars `label` | no |
//! | `.mesh` | MEDIT, ascii | reference is the label | reference per pair of labels |
//! | `.node`, `.ele`, `.face` | TetGen; any of the three names gives all three | first attribute is the label | boundary marker per pair of labels |
//! | `.stl` | binary STL | no | all, normals from first to second label |
//!
//! Pairs of labels are numbered from 1 in increasing order of (first label, second label); the files that use the numbers list them
//! in comment lines. The order of the vertices of tets is that of [`TetMesh`] in every format (VTK's, MEDIT's and TetGen's alike).
//! Coordinates are the mesh's; binary formats hold them as they are (STL in single precision), ascii ones in the shortest form that
//! reads back to the same number.
//!
//! Data go to a temporary file in the folder of the target, are synced, and take the target's name in the end, so that a file of that
//! name is always whole: the new one, or after an error the old one. Records are made in parallel batches and written in order;
//! nothing is held in memory but a few batches. Equal meshes give equal bytes.

mod medit;
mod output;
mod records;
mod stl;
mod tetgen;
mod vtk;
mod vtu;

use std::path::Path;

use crate::mesh::TetMesh;
use crate::{Error, Result};
use output::Output;

/// A file format for meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// VTK XML unstructured grid.
    Vtu,
    /// VTK legacy unstructured grid.
    Vtk,
    /// MEDIT ascii.
    Medit,
    /// TetGen's three files.
    TetGen,
    /// Binary STL of the interfaces.
    Stl,
}

/// Every ending that is known.
const ENDINGS: [(&str, MeshFormat); 7] = [
    ("vtu", MeshFormat::Vtu),
    ("vtk", MeshFormat::Vtk),
    ("mesh", MeshFormat::Medit),
    ("node", MeshFormat::TetGen),
    ("ele", MeshFormat::TetGen),
    ("face", MeshFormat::TetGen),
    ("stl", MeshFormat::Stl),
];

impl MeshFormat {
    /// The format that the ending of `path` stands for, upper or lower case. Nothing is opened, so a bad name can be refused before
    /// any work is done.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for another ending, naming those that are known.
    pub fn from_path(path: &Path) -> Result<Self> {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        ENDINGS.iter().find(|(known, _)| known.eq_ignore_ascii_case(ending)).map(|&(_, format)| format).ok_or_else(
            || {
                let known = ENDINGS.map(|(known, _)| format!(".{known}")).join(" ");
                Error::InvalidArgument(format!("{}: unknown ending for a mesh, known are {known}", path.display()))
            },
        )
    }
}

/// Writes `mesh` to `path` in the format of its ending; see the module's table. An existing file is replaced.
///
/// # Errors
/// [`Error::InvalidArgument`] for an unknown ending; [`Error::LimitReached`] when the mesh has more vertices or tets than the
/// format can number; [`Error::Io`]. The temporary files are gone then and no file is half written.
pub fn write_mesh(mesh: &TetMesh, path: &Path) -> Result<()> {
    let single = |write: fn(&TetMesh, &mut Output) -> std::io::Result<()>| {
        let mut output = Output::create(path)?;
        output.fill(|out| write(mesh, out))?;
        Output::commit(vec![output])
    };
    match MeshFormat::from_path(path)? {
        MeshFormat::Vtu => single(vtu::write),
        MeshFormat::Vtk => {
            vtk::check_limits(mesh, path)?;
            single(vtk::write)
        }
        MeshFormat::Medit => single(medit::write),
        MeshFormat::TetGen => tetgen::write(mesh, path),
        MeshFormat::Stl => single(stl::write),
    }
}

/// The pairs of labels that meet at interfaces, numbered from 1 in increasing order.
struct LabelPairs(Vec<[i32; 2]>);

impl LabelPairs {
    fn new(mesh: &TetMesh) -> Self {
        let mut pairs = Vec::new();
        for pair in &mesh.facet_labels {
            // There are few pairs, and neighbouring facets mostly have the same.
            if pairs.last() != Some(pair) {
                pairs.push(*pair);
            }
        }
        pairs.sort_unstable();
        pairs.dedup();
        Self(pairs)
    }

    /// The number of a pair that the mesh has.
    fn number(&self, pair: &[i32; 2]) -> usize {
        self.0.partition_point(|known| known < pair) + 1
    }

    /// The table, a comment line for each number.
    fn comments(&self) -> String {
        let lines = self
            .0
            .iter()
            .enumerate()
            .map(|(i, [first, second])| format!("# facets {}: labels {first} {second}\n", i + 1));
        lines.collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings() {
        assert_eq!(MeshFormat::from_path(Path::new("a.b/c.VTU")).unwrap(), MeshFormat::Vtu);
        for bad in ["a.msh", "a", "vtu", "a.vtu/b", ""] {
            let message = MeshFormat::from_path(Path::new(bad)).unwrap_err().to_string();
            assert!(message.starts_with(bad) && message.contains(".vtu .vtk .mesh .node .ele .face .stl"), "{message}");
            assert!(!message.contains('\n'));
        }
    }

    #[test]
    fn pairs_are_numbered_in_order() {
        let mesh = TetMesh { facet_labels: vec![[3, 1], [2, 0], [3, 1], [1, 0], [3, 0]], ..TetMesh::default() };
        let pairs = LabelPairs::new(&mesh);
        assert_eq!(mesh.facet_labels.iter().map(|pair| pairs.number(pair)).collect::<Vec<_>>(), [4, 2, 4, 1, 3]);
        assert_eq!(pairs.comments().lines().nth(3), Some("# facets 4: labels 3 1"));
    }
}
