//! Writers of finished meshes. The ending of the name chooses the format:
//!
//! | ending | format | regions | boundaries |
//! |---|---|---|---|
//! | `.vtu` | VTK XML, appended raw data in zlib blocks | cell array `label` | triangles |
//! | `.vtk` | VTK legacy 4.2, binary | cell scalars `label` | triangles |
//! | `.vtm` | VTK XML multi-block: an index, files in a folder | a block each | a block each |
//! | `.vtkhdf` | VTKHDF 1.0, with the feature `hdf5` | cell array `label` | triangles |
//! | `.mesh` | MEDIT, ascii | reference is the label | a reference each |
//! | `.node`, `.ele`, `.face` | TetGen; all three files | first attribute | a marker each |
//! | `.msh`, `.msh4`, `.msh41` | Gmsh MSH 4.1, binary | a group each | a group each |
//! | `.msh2`, `.msh22` | Gmsh MSH 2.2, binary | a group each | a group each |
//! | `.inp` | Abaqus, ascii | C3D4, an element set each | an element-based surface each |
//! | `.exo`, `.ex2`, `.e` | Exodus II, netCDF | an element block each | side sets |
//! | `.foam` | OpenFOAM's `constant/polyMesh` beside it | a cell zone each | patches, face zones |
//! | `.mfem` | MFEM mesh v1.3, ascii | an attribute each | an attribute each |
//! | `.feb` | FEBio 4.0, XML | elements and a domain each | a surface each |
//! | `.bdf`, `.nas` | Nastran bulk data, ascii | a PSOLID each | a PSHELL each |
//! | `.unv` | I-DEAS universal file, ascii | a group each | a group each |
//! | `.xdmf` | XDMF with `.h5` beside it, with the feature `hdf5` | `label` | `boundary` |
//! | `.stl` | binary STL | no | all facets |
//! | `.ply` | PLY, binary | no | all, properties `first_label` and `second_label` |
//! | `.off` | OFF, ascii | no | all facets |
//!
//! What regions and boundaries are, and how they are called: `regions`. Boundaries are numbered
//! from 1; the files that use the numbers list them, in comment lines, as field data, or as the
//! names of physical groups. Labels may be any 32-bit integers. Only Gmsh's tags must be positive:
//! there the tag of a positive label is the label, labels of 0 and below get the numbers after the
//! largest label, 0 first, then -1 and so on, boundaries the numbers after these.
//!
//! Meshes of second order go to `.vtu`, `.vtk`, `.vtm`, `.vtkhdf`, `.mesh`, `.msh`, `.msh2`,
//! `.inp`, `.exo`, `.feb`, `.bdf`, `.unv` and `.xdmf`, with all nodes of tets and facets; the nodes
//! on edges come in the order of [`MidNodes`](crate::mesh::MidNodes) but in Gmsh's files, where the
//! last two of a tet change places. STL, PLY and OFF hold the flat facets between vertices. The
//! others are refused.
//!
//! The order of the vertices of tets is that of [`TetMesh`] in every format, normals of facets
//! point from the first to the second label. Coordinates are the mesh's; binary formats hold them
//! as they are (STL in single precision), ascii ones in the shortest form that reads back to the
//! same number (Abaqus in at most 20 characters, Nastran in 16). STL, PLY and OFF leave out what is
//! no vertex of a facet.
//!
//! Data go to a temporary file in the folder of the target, are synced, and take the target's name
//! in the end, so that a file of that name is always whole: the new one, or after an error the old
//! one. Records are made in parallel batches and written in order; nothing is held in memory but a
//! few batches, and what the format needs besides (`groups`, `subset`, `regions`). Equal meshes
//! give equal bytes.
//!
//! [`write_timeline`] writes in the same way what the threads of a run did when.

mod abaqus;
mod cells;
mod exodus;
mod febio;
mod gmsh;
mod groups;
#[cfg(feature = "hdf5")]
mod hdf;
mod medit;
mod mfem;
mod nastran;
mod netcdf;
mod off;
mod openfoam;
mod output;
mod ply;
mod records;
mod regions;
mod stl;
mod subset;
mod tetgen;
mod trace;
mod unv;
mod vtk;
#[cfg(feature = "hdf5")]
mod vtkhdf;
mod vtm;
mod vtu;
#[cfg(feature = "hdf5")]
mod xdmf;
mod xml;

use std::path::Path;

use crate::error::shown;
use crate::image::{LabelNames, WorldAxes};
use crate::mesh::TetMesh;
use crate::monitor::CancelFlag;
use crate::{Error, Result};
pub(crate) use output::Output;

pub use trace::write_timeline;

/// A file format for meshes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshFormat {
    /// VTK XML unstructured grid.
    Vtu,
    /// VTK legacy unstructured grid.
    Vtk,
    /// VTK XML multi-block, a file for each region and boundary.
    Vtm,
    /// VTKHDF unstructured grid.
    VtkHdf,
    /// MEDIT ascii.
    Medit,
    /// TetGen's three files.
    TetGen,
    /// Gmsh MSH 4.1, binary.
    Msh41,
    /// Gmsh MSH 2.2, binary.
    Msh22,
    /// Abaqus input file.
    Abaqus,
    /// Exodus II, netCDF with 64-bit offsets.
    Exodus,
    /// OpenFOAM's polyMesh beside ParaView's mark of a case.
    OpenFoam,
    /// MFEM mesh v1.3.
    Mfem,
    /// FEBio's input file 4.0.
    Febio,
    /// Nastran bulk data.
    Nastran,
    /// I-DEAS universal file.
    Unv,
    /// XDMF with HDF5.
    Xdmf,
    /// Binary STL of the interfaces.
    Stl,
    /// Binary PLY of the interfaces.
    Ply,
    /// OFF of the interfaces.
    Off,
}

/// Every ending that is known.
const ENDINGS: [(&str, MeshFormat); 27] = [
    ("vtu", MeshFormat::Vtu),
    ("vtk", MeshFormat::Vtk),
    ("vtm", MeshFormat::Vtm),
    ("vtkhdf", MeshFormat::VtkHdf),
    ("mesh", MeshFormat::Medit),
    ("node", MeshFormat::TetGen),
    ("ele", MeshFormat::TetGen),
    ("face", MeshFormat::TetGen),
    ("msh", MeshFormat::Msh41),
    ("msh4", MeshFormat::Msh41),
    ("msh41", MeshFormat::Msh41),
    ("msh2", MeshFormat::Msh22),
    ("msh22", MeshFormat::Msh22),
    ("inp", MeshFormat::Abaqus),
    ("exo", MeshFormat::Exodus),
    ("ex2", MeshFormat::Exodus),
    ("e", MeshFormat::Exodus),
    ("foam", MeshFormat::OpenFoam),
    ("mfem", MeshFormat::Mfem),
    ("feb", MeshFormat::Febio),
    ("bdf", MeshFormat::Nastran),
    ("nas", MeshFormat::Nastran),
    ("unv", MeshFormat::Unv),
    ("xdmf", MeshFormat::Xdmf),
    ("stl", MeshFormat::Stl),
    ("ply", MeshFormat::Ply),
    ("off", MeshFormat::Off),
];

impl MeshFormat {
    /// The format that the ending of `path` stands for, upper or lower case. Nothing is opened, so
    /// a bad name can be refused before any work is done.
    ///
    /// # Errors
    /// [`Error::InvalidArgument`] for another ending, naming those that are known;
    /// [`Error::Unsupported`] for one that this library was built without.
    pub fn from_path(path: &Path) -> Result<Self> {
        let ending = path.extension().and_then(|ending| ending.to_str()).unwrap_or_default();
        let found = ENDINGS.iter().find(|(known, _)| known.eq_ignore_ascii_case(ending));
        match found {
            Some((_, Self::Xdmf | Self::VtkHdf)) if cfg!(not(feature = "hdf5")) => {
                Err(Error::Unsupported(format!(
                    "{}: this library was built without HDF5, which .xdmf and .vtkhdf need; build \
                     it with LAPD_HDF5 (the feature hdf5), or write .vtu or .msh",
                    shown(path)
                )))
            }
            Some(&(_, format)) => Ok(format),
            None => {
                let known = ENDINGS.map(|(known, _)| format!(".{known}")).join(" ");
                Err(Error::InvalidArgument(format!(
                    "{}: unknown ending for a mesh, known are {known}",
                    shown(path)
                )))
            }
        }
    }
}

/// What a file is to hold beside the mesh.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct WriteOptions<'a> {
    /// In `.vtu`: the measures of the tets, a cell array for each of
    /// [`TetMeasure::ALL`](crate::geometry::measures::TetMeasure::ALL). Other formats have no place
    /// for them.
    pub measures: bool,
    /// What the world axes mean, where that is known. It is told as `SPACE=LPS`: in the head of
    /// `.vtk` and `.stl` and in a comment of `.ply`, where 3D Slicer looks for it; in a comment of
    /// `.mesh`, `.node`, `.ele`, `.face` and `.inp`; in a section of comments of `.msh` and
    /// `.msh2`; and in `.vtu`, `.vtm` and `.vtkhdf` as the field array `SPACE` of its characters'
    /// codes.
    pub world: Option<WorldAxes>,
    /// Names of labels; files name regions and boundaries by them. PLY holds the colours.
    pub names: Option<&'a LabelNames>,
    /// Each connected part of a boundary becomes a boundary of its own.
    pub parts: bool,
}

impl WriteOptions<'_> {
    /// `SPACE=LPS`, with something before and behind it; nothing where the axes are not known.
    fn space(&self, before: &str, behind: &str) -> String {
        self.world
            .map_or_else(String::new, |world| format!("{before}SPACE={}{behind}", world.name()))
    }
}

/// Writes a file of one format.
type Write<'a> = dyn Fn(&TetMesh, &WriteOptions<'_>, &mut Output) -> std::io::Result<()> + 'a;

/// Writes `mesh` to `path` in the format of its ending; see the module's table. An existing file is
/// replaced.
///
/// # Errors
/// [`Error::InvalidArgument`] for an unknown ending; [`Error::LimitReached`] when the mesh has more
/// vertices or tets than the format can number; [`Error::OutOfMemory`]; [`Error::Io`]. The
/// temporary files are gone then and no file is half written.
pub fn write_mesh(mesh: &TetMesh, path: &Path) -> Result<()> {
    write_mesh_watching(mesh, path, WriteOptions::default(), None)
}

/// As [`write_mesh`], with options, until a flag is raised. Only the wait for the disk at the end
/// is not cut short.
///
/// # Errors
/// Those of [`write_mesh`]; [`Error::Cancelled`].
pub fn write_mesh_watching(
    mesh: &TetMesh,
    path: &Path,
    options: WriteOptions<'_>,
    cancel: Option<&CancelFlag>,
) -> Result<()> {
    if options.measures && MeshFormat::from_path(path)? != MeshFormat::Vtu {
        return Err(Error::InvalidArgument(format!(
            "{}: only .vtu files can hold measures of tets",
            shown(path)
        )));
    }
    let single = |write: &Write<'_>| {
        let mut output = Output::create(path)?.watching(cancel);
        output.fill(|out| write(mesh, &options, out))?;
        Output::commit(vec![output])
    };
    match MeshFormat::from_path(path)? {
        MeshFormat::Vtu => single(&vtu::write),
        MeshFormat::Vtk => {
            vtk::check_limits(mesh, path)?;
            single(&vtk::write)
        }
        MeshFormat::Vtm => vtm::write(mesh, &options, path, cancel),
        MeshFormat::Medit => single(&medit::write),
        MeshFormat::TetGen => tetgen::write(mesh, &options, path, cancel),
        MeshFormat::Msh41 => single(&gmsh::write_4_1),
        MeshFormat::Msh22 => {
            gmsh::check_limits_2_2(mesh, path)?;
            single(&gmsh::write_2_2)
        }
        MeshFormat::Abaqus => {
            abaqus::check_limits(mesh, path)?;
            single(&abaqus::write)
        }
        MeshFormat::Exodus => {
            exodus::check_limits(mesh, path)?;
            single(&exodus::write)
        }
        MeshFormat::OpenFoam => openfoam::write(mesh, &options, path, cancel),
        MeshFormat::Mfem => {
            mfem::check_limits(mesh, path)?;
            single(&mfem::write)
        }
        MeshFormat::Febio => {
            febio::check_limits(mesh, path)?;
            single(&febio::write)
        }
        MeshFormat::Nastran => {
            nastran::check_limits(mesh, path)?;
            single(&nastran::write)
        }
        MeshFormat::Unv => {
            unv::check_limits(mesh, path)?;
            single(&unv::write)
        }
        #[cfg(feature = "hdf5")]
        MeshFormat::Xdmf => xdmf::write(mesh, &options, path, cancel),
        #[cfg(feature = "hdf5")]
        MeshFormat::VtkHdf => vtkhdf::write(mesh, &options, path, cancel),
        // Their endings are refused.
        #[cfg(not(feature = "hdf5"))]
        MeshFormat::Xdmf | MeshFormat::VtkHdf => MeshFormat::from_path(path).map(|_| ()),
        MeshFormat::Stl => single(&stl::write),
        MeshFormat::Ply => {
            check_count(path, "PLY", "vertices", mesh.points.len(), i32::MAX as usize)?;
            single(&ply::write)
        }
        MeshFormat::Off => single(&off::write),
    }
}

/// Refuses a mesh of second order, of which a format has no place.
fn refuse_second_order(mesh: &TetMesh, path: &Path, files: &str) -> Result<()> {
    if mesh.mid_nodes.is_some() {
        return Err(Error::InvalidArgument(format!(
            "{}: {files} are written for tets of order 1 only; .vtu .vtk .vtm .vtkhdf .xdmf .mesh \
             .msh .msh2 .inp .exo .feb .bdf .unv have order 2",
            shown(path)
        )));
    }
    Ok(())
}

/// Refuses more of a thing than a format can number.
fn check_count(path: &Path, format: &str, things: &str, count: usize, max: usize) -> Result<()> {
    if count > max {
        let path = shown(path);
        return Err(Error::LimitReached(format!(
            "{path}: {count} {things} are too many for {format}, {max} are the most"
        )));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn endings() {
        assert_eq!(MeshFormat::from_path(Path::new("a.b/c.VTU")).unwrap(), MeshFormat::Vtu);
        for bad in ["a.msh1", "a", "vtu", "a.vtu/b", ""] {
            let message = MeshFormat::from_path(Path::new(bad)).unwrap_err().to_string();
            assert!(
                message.starts_with(bad)
                    && message.contains(".vtu .vtk .vtm .vtkhdf .mesh .node .ele .face .msh "),
                "{message}"
            );
            assert!(!message.contains('\n'));
        }
    }

    #[test]
    fn too_many_are_refused() {
        assert!(check_count(Path::new("a.inp"), "Abaqus", "tets", 9, 9).is_ok());
        let error = check_count(Path::new("a.inp"), "Abaqus", "tets", 10, 9).unwrap_err();
        assert!(matches!(error, Error::LimitReached(_)));
        assert_eq!(error.to_string(), "a.inp: 10 tets are too many for Abaqus, 9 are the most");
    }
}
