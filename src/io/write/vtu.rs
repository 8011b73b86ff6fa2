//! VTK XML unstructured grid: data appended raw, compressed in blocks by zlib, 64-bit block headers
//! (The VTK User's Guide, "XML file formats").
//!
//! What the cells are and what their arrays tell: [`cells`](super::cells). Where asked for, cell
//! arrays (Float32) tell measures of the tets, NaN for facets. The array `label` stands first:
//! readers that take one integer array for the material take the first.
//!
//! An array is stored as the number of blocks, the size of a block, the
//! size of the last one if that is smaller (else 0), the compressed size of each block, then the
//! blocks. Offsets in the XML and sizes in the headers are known only when the blocks are written;
//! room is left for them and filled in afterwards, so that nothing is held in memory but the blocks
//! at work. Blocks are compressed in parallel, each on its own, so the bytes do not depend on the
//! number of threads.

use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;

use flate2::{Compression, write::ZlibEncoder};

use super::WriteOptions;
use super::cells::Cells;
use super::output::Output;
use super::records::write_batches;
use super::regions::SPACE;
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
pub(super) fn write(
    mesh: &TetMesh,
    options: &WriteOptions<'_>,
    out: &mut Output,
) -> io::Result<()> {
    let cells = Cells::new(mesh, options).map_err(io::Error::other)?;
    let (points, count) = (mesh.points.len(), cells.count());
    let cells = &cells;
    let mut of_cells = vec![
        Array::new(r#"type="Int32" Name="label""#, count, |c| cells.label(c).to_le_bytes()),
        Array::new(
            r#"type="Int32" Name="BoundaryLabels" NumberOfComponents="2""#,
            2 * count,
            |i| cells.labels(i / 2)[i % 2].to_le_bytes(),
        ),
        Array::new(r#"type="Int32" Name="boundary""#, count, |c| cells.boundary(c).to_le_bytes()),
    ];
    if options.measures {
        for (measure, name) in TetMeasure::ALL {
            let value = move |c: usize| {
                let tet = mesh.tets.get(c);
                tet.map_or(f32::NAN, |tet| measure.of(&tet.map(|v| mesh.point(v))) as f32)
            };
            let attributes = format!(r#"type="Float32" Name="{name}""#);
            of_cells.push(Array::new(attributes, count, move |c| value(c).to_le_bytes()));
        }
    }
    let of_points =
        [Array::new(r#"type="Float64" Name="Points" NumberOfComponents="3""#, 3 * points, |i| {
            mesh.points[i / 3][i % 3].to_le_bytes()
        })];
    let of_nodes = [
        Array::new(r#"type="Int64" Name="connectivity""#, cells.node_count(), |i| {
            i64::from(cells.node(i)).to_le_bytes()
        }),
        Array::new(r#"type="Int64" Name="offsets""#, count, |c| cells.end(c).to_le_bytes()),
        Array::new(r#"type="UInt8" Name="types""#, count, |c| [cells.kind(c)]),
    ];
    out.write_all(
        b"<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
          byte_order=\"LittleEndian\" header_type=\"UInt64\" \
          compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n",
    )?;
    write_field_data(out, options, cells)?;
    writeln!(out, r#"<Piece NumberOfPoints="{points}" NumberOfCells="{count}">"#)?;
    // Where the offset of each array will stand.
    let mut places = Vec::new();
    let groups: [(&str, &str, &[Array<'_>]); 3] = [
        (r#"CellData Scalars="label""#, "CellData", &of_cells),
        ("Points", "Points", &of_points),
        ("Cells", "Cells", &of_nodes),
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
    // Last ones first: meshio looks arrays up by their offsets, which it changes one by one, and
    // takes the first in the XML that has an offset, changed or not.
    for array in groups.iter().flat_map(|(_, _, members)| *members).rev() {
        positions.push(out.stream_position()? - data_at);
        array.write(out)?;
    }
    out.write_all(b"\n</AppendedData>\n</VTKFile>\n")?;
    for (place, position) in places.into_iter().zip(positions.into_iter().rev()) {
        out.seek(SeekFrom::Start(place))?;
        write!(out, "\"{position}\"")?;
    }
    Ok(())
}

/// What the whole file says: what the world axes mean, and what regions and boundaries are called.
fn write_field_data(
    out: &mut Output,
    options: &WriteOptions<'_>,
    cells: &Cells<'_>,
) -> io::Result<()> {
    out.write_all(b"<FieldData>\n")?;
    let mut array = |kind: &str, name: &str, values: &[i32]| {
        let count = values.len();
        let values: Vec<String> = values.iter().map(i32::to_string).collect();
        writeln!(
            out,
            "<DataArray type=\"{kind}\" Name=\"{name}\" NumberOfTuples=\"{count}\" \
             format=\"ascii\">{}</DataArray>",
            values.join(" ")
        )
    };
    if let Some(world) = options.world {
        // As numbers: some readers of VTU refuse the whole file for an array of strings.
        let codes: Vec<i32> = world.name().bytes().map(i32::from).collect();
        array("UInt8", SPACE, &codes)?;
    }
    cells.names().try_for_each(|(name, number)| array("Int32", name, &number))?;
    out.write_all(b"</FieldData>\n")
}
