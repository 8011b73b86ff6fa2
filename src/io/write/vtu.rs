//! VTK XML unstructured grid: data appended raw, compressed in blocks by zlib, 64-bit block headers
//! (The VTK User's Guide, "XML file formats").
//!
//! What the cells are and what their arrays tell: [`cells`](super::cells). Where asked for, cell
//! arrays (Float32) tell measures of the tets, NaN for facets. The array `label` stands first:
//! readers that take one integer array for the material take the first.
//!
//! An array is stored as the number of blocks, the size of a block, the size of the last one if
//! that is smaller (else 0), the compressed size of each block, then the blocks. Offsets in the XML
//! and sizes in the headers are known only when the blocks are written; room is left for them and
//! filled in afterwards, so that nothing is held in memory but the blocks at work. Blocks are
//! compressed in parallel, each on its own, so the bytes do not depend on the number of threads.

use std::io::{self, Seek, SeekFrom, Write};
use std::ops::Range;
use std::sync::{Mutex, MutexGuard, PoisonError};

use flate2::{Compress, Compression, FlushCompress, Status};

use super::WriteOptions;
use super::cells::Cells;
use super::output::Output;
use super::records::write_batches;
use super::regions::SPACE;
use crate::geometry::measures::TetMeasure;
use crate::mesh::TetMesh;

/// Uncompressed bytes of a block; a multiple of the size of every kind of value.
const BLOCK: usize = 1 << 17;

/// Room for the decimal digits of an offset.
const DIGITS: usize = 20;

/// What compresses blocks, one at a time; kept, because it is some hundred KB that want clearing.
struct Encoder {
    stream: Compress,
    bytes: Vec<u8>,
}

/// Encoders that are idle, one for each thread in the end.
#[derive(Default)]
pub(super) struct Encoders(Mutex<Vec<Encoder>>);

impl Encoders {
    fn idle(&self) -> MutexGuard<'_, Vec<Encoder>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Appends the bytes that `push` makes, as a zlib stream.
    fn compress(&self, to: &mut Vec<u8>, push: impl FnOnce(&mut Vec<u8>)) -> io::Result<()> {
        let idle = self.idle().pop();
        let mut encoder = idle.unwrap_or_else(|| Encoder {
            stream: Compress::new(Compression::fast(), true),
            bytes: Vec::new(),
        });
        let Encoder { stream, bytes } = &mut encoder;
        push(bytes);
        loop {
            // It fills what room there is.
            to.reserve(bytes.len() / 4 + 64);
            let left = &bytes[stream.total_in() as usize..];
            let status = stream.compress_vec(left, to, FlushCompress::Finish);
            if status.map_err(io::Error::other)? == Status::StreamEnd {
                break;
            }
        }
        stream.reset();
        bytes.clear();
        self.idle().push(encoder);
        Ok(())
    }
}

/// The attributes of arrays.
pub(super) const LABEL: &str = r#"type="Int32" Name="label""#;
pub(super) const LABELS: &str = r#"type="Int32" Name="BoundaryLabels" NumberOfComponents="2""#;
pub(super) const BOUNDARY: &str = r#"type="Int32" Name="boundary""#;
pub(super) const POINTS: &str = r#"type="Float64" Name="Points" NumberOfComponents="3""#;
pub(super) const NODES: &str = r#"type="Int64" Name="connectivity""#;
pub(super) const ENDS: &str = r#"type="Int64" Name="offsets""#;
pub(super) const KINDS: &str = r#"type="UInt8" Name="types""#;

/// Appends the bytes of a range of values.
type PushValues<'a> = dyn Fn(Range<usize>, &mut Vec<u8>) + Sync + 'a;

/// An array of the file: its XML attributes, its length, and the bytes of its values.
pub(super) struct Array<'a> {
    attributes: String,
    values: usize,
    value_size: usize,
    push: Box<PushValues<'a>>,
}

impl<'a> Array<'a> {
    /// An array whose values are known one by one.
    pub fn new<const N: usize>(
        attributes: impl Into<String>,
        values: usize,
        value: impl Fn(usize) -> [u8; N] + Sync + 'a,
    ) -> Self {
        Self::of_ranges::<N>(attributes, values, move |range, bytes| {
            range.for_each(|i| bytes.extend_from_slice(&value(i)));
        })
    }

    /// An array of values of `N` bytes, which come by ranges.
    pub fn of_ranges<const N: usize>(
        attributes: impl Into<String>,
        values: usize,
        push: impl Fn(Range<usize>, &mut Vec<u8>) + Sync + 'a,
    ) -> Self {
        Self { attributes: attributes.into(), values, value_size: N, push: Box::new(push) }
    }

    /// Writes headers and blocks; the file ends behind them afterwards.
    fn write(&self, encoders: &Encoders, out: &mut Output) -> io::Result<()> {
        let total = self.values * self.value_size;
        let blocks = total.div_ceil(BLOCK);
        let mut header = vec![blocks as u64, BLOCK as u64, (total % BLOCK) as u64];
        let header_at = out.stream_position()?;
        out.write_all(&vec![0; 8 * (header.len() + blocks)])?;
        let block_values = BLOCK / self.value_size;
        let compress = |block: usize, compressed: &mut Vec<u8>| {
            let start = block * block_values;
            let values = start..(start + block_values).min(self.values);
            encoders.compress(compressed, |bytes| (self.push)(values, bytes))
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

/// An unstructured grid: how many points and cells it has, and its arrays.
pub(super) struct Grid<'a> {
    pub points: usize,
    pub cells: usize,
    pub of_cells: Vec<Array<'a>>,
    pub of_points: Vec<Array<'a>>,
    /// What the cells are made of.
    pub of_nodes: Vec<Array<'a>>,
}

impl Grid<'_> {
    /// Writes the file, which has names of regions and boundaries, each with its number and its
    /// dimension.
    pub fn write<'n>(
        &self,
        options: &WriteOptions<'_>,
        names: impl Iterator<Item = (&'n str, [i32; 2])>,
        encoders: &Encoders,
        out: &mut Output,
    ) -> io::Result<()> {
        out.write_all(
            b"<?xml version=\"1.0\"?>\n<VTKFile type=\"UnstructuredGrid\" version=\"1.0\" \
              byte_order=\"LittleEndian\" header_type=\"UInt64\" \
              compressor=\"vtkZLibDataCompressor\">\n<UnstructuredGrid>\n",
        )?;
        write_field_data(options, names, out)?;
        let Self { points, cells, .. } = self;
        writeln!(out, r#"<Piece NumberOfPoints="{points}" NumberOfCells="{cells}">"#)?;
        // Where the offset of each array will stand.
        let mut places = Vec::new();
        let groups: [(&str, &str, &[Array<'_>]); 3] = [
            (r#"CellData Scalars="label""#, "CellData", &self.of_cells),
            ("Points", "Points", &self.of_points),
            ("Cells", "Cells", &self.of_nodes),
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
        // Last ones first: meshio looks arrays up by their offsets, which it changes one by one,
        // and takes the first in the XML that has an offset, changed or not.
        for array in groups.iter().flat_map(|(_, _, members)| *members).rev() {
            positions.push(out.stream_position()? - data_at);
            array.write(encoders, out)?;
        }
        out.write_all(b"\n</AppendedData>\n</VTKFile>\n")?;
        for (place, position) in places.into_iter().zip(positions.into_iter().rev()) {
            out.seek(SeekFrom::Start(place))?;
            write!(out, "\"{position}\"")?;
        }
        Ok(())
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
        Array::new(LABEL, count, |c| cells.label(c).to_le_bytes()),
        Array::new(LABELS, 2 * count, |i| cells.labels(i / 2)[i % 2].to_le_bytes()),
        Array::new(BOUNDARY, count, |c| cells.boundary(c).to_le_bytes()),
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
        vec![Array::new(POINTS, 3 * points, |i| mesh.points[i / 3][i % 3].to_le_bytes())];
    let of_nodes = vec![
        Array::new(NODES, cells.node_count(), |i| i64::from(cells.node(i)).to_le_bytes()),
        Array::new(ENDS, count, |c| cells.end(c).to_le_bytes()),
        Array::new(KINDS, count, |c| [cells.kind(c)]),
    ];
    let grid = Grid { points, cells: count, of_cells, of_points, of_nodes };
    grid.write(options, cells.names(), &Encoders::default(), out)
}

/// What the whole file says: what the world axes mean, and what regions and boundaries are called.
fn write_field_data<'n>(
    options: &WriteOptions<'_>,
    mut names: impl Iterator<Item = (&'n str, [i32; 2])>,
    out: &mut Output,
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
    names.try_for_each(|(name, number)| array("Int32", name, &number))?;
    out.write_all(b"</FieldData>\n")
}
