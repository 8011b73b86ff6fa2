//! VTK XML unstructured grid: data appended raw, compressed in blocks by zlib, 64-bit block headers
//! (The VTK User's Guide, "XML file formats").
//!
//! Where asked for, cell arrays (Float32) tell measures of the tets.
//!
//! The cell array `label` (Int32) stands first: readers that take one integer array for the
//! material take the first. An array is stored as the number of blocks, the size of a block, the
//! size of the last one if that is smaller (else 0), the compressed size of each block, then the
//! blocks. Offsets in the XML and sizes in the headers are known only when the blocks are written;
//! room is left for them and filled in afterwards, so that nothing is held in memory but the blocks
//! at work. Blocks are compressed in parallel, each on its own, so the bytes do not depend on the
//! number of threads.

use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;

use flate2::{Compression, write::ZlibEncoder};

use super::WriteOptions;
use super::output::Output;
use super::records::write_batches;
use super::vtk::cell_type;
use crate::geometry::measures::TetMeasure;
use crate::mesh::TetMesh;

/// Uncompressed bytes of a block; a multiple of the size of every kind of value.
const BLOCK: usize = 1 << 18;

/// Room for the decimal digits of an offset.
const DIGITS: usize = 20;

/// Appends the bytes of a range of values.
type PushValues<'a> = dyn Fn(Range<usize>, &mut Vec<u8>) + Sync + 'a;

/// An array of the file: its XML attributes, its length, and the bytes of its values.
struct Array<'a> {
    attributes: String,
    values: usize,
    value_size: usize,
    push: Box<PushValues<'a>>,
}

impl<'a> Array<'a> {
    fn new<const N: usize>(
        attributes: impl Into<String>,
        values: usize,
        value: impl Fn(usize) -> [u8; N] + Sync + 'a,
    ) -> Self {
        let push = move |range: Range<usize>, bytes: &mut Vec<u8>| {
            range.for_each(|i| bytes.extend_from_slice(&value(i)));
        };
        Self { attributes: attributes.into(), values, value_size: N, push: Box::new(push) }
    }

    /// Writes headers and blocks; the file ends behind them afterwards.
    fn write(&self, out: &mut Output) -> io::Result<()> {
        let total = self.values * self.value_size;
        let blocks = total.div_ceil(BLOCK);
        let mut header = vec![blocks as u64, BLOCK as u64, (total % BLOCK) as u64];
        let header_at = out.stream_position()?;
        out.write_all(&vec![0; 8 * (header.len() + blocks)])?;
        let block_values = BLOCK / self.value_size;
        let compress = |block: usize, compressed: &mut Vec<u8>| {
            let start = block * block_values;
            let mut bytes = Vec::with_capacity(BLOCK);
            (self.push)(start..(start + block_values).min(self.values), &mut bytes);
            let mut encoder = ZlibEncoder::new(compressed, Compression::fast());
            encoder.write_all(&bytes)?;
            encoder.finish().map(|_| ())
        };
        write_batches(blocks, compress, |block| {
            header.push(block.len() as u64);
            out.write_all(block)
        })?;
        let end = out.stream_position()?;
        out.seek(SeekFrom::Start(header_at))?;
        for word in header {
            out.write_all(&word.to_le_bytes())?;
        }
        out.seek(SeekFrom::Start(end)).map(|_| ())
    }
}

/// Writes the file; where measures are asked for, with an array for each of [`TetMeasure::ALL`].
pub(super) fn write(mesh: &TetMesh, options: &WriteOptions, out: &mut Output) -> io::Result<()> {
    let (points, tets) = (mesh.points.len(), mesh.tets.len());
    let (nodes, kind) = (mesh.nodes_per_tet(), cell_type(mesh));
    let mut arrays = vec![
        Array::new(r#"type="Int32" Name="label""#, tets, |t| mesh.labels[t].to_le_bytes()),
        Array::new(r#"type="Float64" Name="Points" NumberOfComponents="3""#, 3 * points, |i| {
            mesh.points[i / 3][i % 3].to_le_bytes()
        }),
        Array::new(r#"type="Int64" Name="connectivity""#, nodes * tets, |i| {
            i64::from(mesh.tet_nodes(i / nodes)[i % nodes]).to_le_bytes()
        }),
        Array::new(r#"type="Int64" Name="offsets""#, tets, |t| (nodes * (t + 1)).to_le_bytes()),
        Array::new(r#"type="UInt8" Name="types""#, tets, |_| [kind]),
    ];
    const WITHOUT_MEASURES: usize = 5;
    if options.measures {
        for (measure, name) in TetMeasure::ALL {
            let value = move |t: usize| measure.of(&mesh.tets[t].map(|v| mesh.point(v))) as f32;
            arrays.push(Array::new(format!(r#"type="Float32" Name="{name}""#), tets, move |t| {
                value(t).to_le_bytes()
            }));
        }
    }
    let [label, position, connectivity, offsets, types] = &arrays[..WITHOUT_MEASURES] else {
        unreachable!()
    };
    let of_cells: Vec<&Array<'_>> =
        std::iter::once(label).chain(&arrays[WITHOUT_MEASURES..]).collect();
    // In the order of the data.
    let order: Vec<&Array<'_>> =
        of_cells.iter().copied().chain([position, connectivity, offsets, types]).collect();
    out.write_all(
        b"<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
          byte_order=\"LittleEndian\" header_type=\"UInt64\" \
          compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n",
    )?;
    if let Some(world) = options.world {
        // As numbers: some readers of VTU refuse the whole file for an array of strings.
        let codes = world.name().bytes().map(|byte| byte.to_string()).collect::<Vec<_>>().join(" ");
        write!(
            out,
            "<FieldData>\n<DataArray type=\"UInt8\" Name=\"SPACE\" NumberOfTuples=\"3\" \
             format=\"ascii\">"
        )?;
        writeln!(out, "{codes}</DataArray>\n</FieldData>")?;
    }
    writeln!(out, r#"<Piece NumberOfPoints="{points}" NumberOfCells="{tets}">"#)?;
    // Where the offset of each array will stand.
    let mut places = Vec::new();
    let groups: [(&str, &str, &[&Array<'_>]); 3] = [
        (r#"CellData Scalars="label""#, "CellData", &of_cells),
        ("Points", "Points", &[position]),
        ("Cells", "Cells", &[connectivity, offsets, types]),
    ];
    for (open, close, members) in groups {
        writeln!(out, "<{open}>")?;
        for array in members {
            write!(out, r#"<DataArray {} format="appended" offset="#, array.attributes)?;
            places.push(out.stream_position()?);
            writeln!(out, "{:DIGITS$}  />", "")?;
        }
        writeln!(out, "</{close}>")?;
    }
    out.write_all(b"</Piece>\n</UnstructuredGrid>\n<AppendedData encoding=\"raw\">\n_")?;
    let data_at = out.stream_position()?;
    let mut positions = Vec::new();
    for array in order {
        positions.push(out.stream_position()? - data_at);
        array.write(out)?;
    }
    out.write_all(b"\n</AppendedData>\n</VTKFile>\n")?;
    for (place, position) in places.into_iter().zip(positions) {
        out.seek(SeekFrom::Start(place))?;
        write!(out, "\"{position}\"")?;
    }
    Ok(())
}
