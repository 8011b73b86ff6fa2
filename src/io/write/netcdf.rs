//! NetCDF files in the classic format with 64-bit offsets (Unidata, "NetCDF classic format
//! specification", CDF-2).
//!
//! Dimensions, attributes and variables first, each variable with the place of its data; then the
//! data, variable by variable, big-endian. Sizes are known beforehand, so data are streamed. There
//! are no records: a dimension of length 0 is the one that has none yet.

use std::io::{self, Write};

use super::output::Output;

/// Types of values.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Char = 2,
    Int = 4,
    Double = 6,
}

impl Kind {
    fn bytes(self) -> u64 {
        match self {
            Self::Char => 1,
            Self::Int => 4,
            Self::Double => 8,
        }
    }
}

/// Values of attributes.
pub(super) enum Value {
    Text(String),
    Int(i32),
    Float(f32),
}

/// Writes the data of a variable.
type WriteData<'a> = Box<dyn Fn(&mut Output<'_>) -> io::Result<()> + 'a>;

/// A variable.
struct Variable<'a> {
    name: String,
    dimensions: Vec<usize>,
    kind: Kind,
    attribute: Option<(&'static str, Value)>,
    write: WriteData<'a>,
}

/// A file to be.
#[derive(Default)]
pub(super) struct NetCdf<'a> {
    /// Names and lengths.
    dimensions: Vec<(String, usize)>,
    attributes: Vec<(&'static str, Value)>,
    variables: Vec<Variable<'a>>,
}

/// Marks of the lists of the header.
const DIMENSIONS: u32 = 10;
const VARIABLES: u32 = 11;
const ATTRIBUTES: u32 = 12;

/// The most bytes that the data of a variable can have.
pub(super) const MAX_BYTES: u64 = u32::MAX as u64 - 3;

impl<'a> NetCdf<'a> {
    /// Adds a dimension and returns its number; a length of 0 is that of records.
    pub fn dimension(&mut self, name: impl Into<String>, length: usize) -> usize {
        self.dimensions.push((name.into(), length));
        self.dimensions.len() - 1
    }

    /// Adds an attribute of the file.
    pub fn attribute(&mut self, name: &'static str, value: Value) {
        self.attributes.push((name, value));
    }

    /// Adds a variable over dimensions, the last of them changing fastest; `write` writes as many
    /// bytes as it has.
    pub fn variable(
        &mut self,
        name: impl Into<String>,
        dimensions: &[usize],
        kind: Kind,
        attribute: Option<(&'static str, Value)>,
        write: impl Fn(&mut Output<'_>) -> io::Result<()> + 'a,
    ) {
        let (name, dimensions) = (name.into(), dimensions.to_vec());
        self.variables.push(Variable { name, dimensions, kind, attribute, write: Box::new(write) });
    }

    /// The bytes of a variable's data, without what fills them up to whole words.
    fn bytes(&self, variable: &Variable<'_>) -> u64 {
        let lengths = variable.dimensions.iter().map(|&dimension| self.dimensions[dimension].1);
        variable.kind.bytes() * lengths.map(|length| length as u64).product::<u64>()
    }

    /// Writes the file.
    pub fn write(&self, out: &mut Output<'_>) -> io::Result<()> {
        // What stands before the data does not depend on where these are.
        let size = self.header(0).len() as u64;
        out.write_all(&self.header(size))?;
        for variable in &self.variables {
            (variable.write)(out)?;
            let bytes = self.bytes(variable);
            out.write_all(&[0; 3][..(bytes.next_multiple_of(4) - bytes) as usize])?;
        }
        Ok(())
    }

    /// The header of a file whose data begin at `place`.
    fn header(&self, mut place: u64) -> Vec<u8> {
        let mut header = b"CDF\x02\0\0\0\0".to_vec();
        push_list(&mut header, DIMENSIONS, self.dimensions.len());
        for (name, length) in &self.dimensions {
            push_text(&mut header, name);
            push(&mut header, *length as u32);
        }
        push_list(&mut header, ATTRIBUTES, self.attributes.len());
        self.attributes.iter().for_each(|attribute| push_attribute(&mut header, attribute));
        push_list(&mut header, VARIABLES, self.variables.len());
        for variable in &self.variables {
            push_text(&mut header, &variable.name);
            push(&mut header, variable.dimensions.len() as u32);
            variable.dimensions.iter().for_each(|&d| push(&mut header, d as u32));
            push_list(&mut header, ATTRIBUTES, usize::from(variable.attribute.is_some()));
            variable.attribute.iter().for_each(|value| push_attribute(&mut header, value));
            push(&mut header, variable.kind as u32);
            let bytes = self.bytes(variable).next_multiple_of(4);
            // Of a variable of records: the bytes of one.
            let of_record = if bytes == 0 { variable.kind.bytes() } else { bytes };
            push(&mut header, of_record.min(u64::from(u32::MAX)) as u32);
            header.extend_from_slice(&place.to_be_bytes());
            place += bytes;
        }
        header
    }
}

fn push(header: &mut Vec<u8>, number: u32) {
    header.extend_from_slice(&number.to_be_bytes());
}

/// An empty list has no mark.
fn push_list(header: &mut Vec<u8>, mark: u32, count: usize) {
    push(header, if count == 0 { 0 } else { mark });
    push(header, count as u32);
}

fn push_text(header: &mut Vec<u8>, text: &str) {
    push(header, text.len() as u32);
    header.extend_from_slice(text.as_bytes());
    header.resize(header.len().next_multiple_of(4), 0);
}

fn push_attribute(header: &mut Vec<u8>, (name, value): &(&'static str, Value)) {
    const INT: u32 = Kind::Int as u32;
    const FLOAT: u32 = 5;
    push_text(header, name);
    match value {
        Value::Text(text) => {
            push(header, Kind::Char as u32);
            push_text(header, text);
        }
        Value::Int(number) => {
            [INT, 1, *number as u32].into_iter().for_each(|word| push(header, word));
        }
        Value::Float(number) => {
            [FLOAT, 1, number.to_bits()].into_iter().for_each(|word| push(header, word));
        }
    }
}
