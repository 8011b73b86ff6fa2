//! The layout of a report: JSON that a person can read, too.

use std::io::Write;

use serde_json::ser::{CompactFormatter, Formatter};

/// A line for each member of the outermost object, and for each entry of the tables in it.
#[derive(Default)]
pub(super) struct Outline {
    depth: usize,
    is_table: bool,
}

impl Outline {
    fn separate<W: ?Sized + Write>(&self, out: &mut W, first: bool) -> std::io::Result<()> {
        match (self.depth, first) {
            (1, true) => out.write_all(b"\n  "),
            (1, false) => out.write_all(b",\n  "),
            (2, true) if self.is_table => out.write_all(b"\n    "),
            (2, false) if self.is_table => out.write_all(b",\n    "),
            (_, true) => Ok(()),
            (_, false) => out.write_all(b", "),
        }
    }

    fn open(&mut self, is_table: bool) {
        self.depth += 1;
        if self.depth == 2 {
            self.is_table = is_table;
        }
    }

    fn close<W: ?Sized + Write>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.depth -= 1;
        match self.depth {
            0 => out.write_all(b"\n"),
            1 if self.is_table => out.write_all(b"\n  "),
            _ => Ok(()),
        }
    }
}

impl Formatter for Outline {
    fn begin_array<W: ?Sized + Write>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.open(true);
        CompactFormatter.begin_array(out)
    }

    fn end_array<W: ?Sized + Write>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.close(out)?;
        CompactFormatter.end_array(out)
    }

    fn begin_array_value<W: ?Sized + Write>(
        &mut self,
        out: &mut W,
        first: bool,
    ) -> std::io::Result<()> {
        self.separate(out, first)
    }

    fn begin_object<W: ?Sized + Write>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.open(false);
        CompactFormatter.begin_object(out)
    }

    fn end_object<W: ?Sized + Write>(&mut self, out: &mut W) -> std::io::Result<()> {
        self.close(out)?;
        CompactFormatter.end_object(out)
    }

    fn begin_object_key<W: ?Sized + Write>(
        &mut self,
        out: &mut W,
        first: bool,
    ) -> std::io::Result<()> {
        self.separate(out, first)
    }

    fn begin_object_value<W: ?Sized + Write>(&mut self, out: &mut W) -> std::io::Result<()> {
        out.write_all(b": ")
    }
}
