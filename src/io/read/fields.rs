//! Text headers: fields by name, and numbers out of their values.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::source::Source;
use crate::error::excerpt;
use crate::{Error, Result, memory};

/// The longest header read. Segmentations of 3D Slicer describe every segment in it.
pub(super) const MAX_HEADER: u64 = 16 << 20;

/// Named header values. Names are compared without case and blanks.
pub(super) struct Fields {
    path: PathBuf,
    values: HashMap<String, String>,
    /// What the format leaves to programs: names as they are.
    pairs: HashMap<String, String>,
}

/// What is counted where there is no memory for a header.
const WHAT: &str = "bytes or fields of a header";

fn key(name: &str) -> Result<String> {
    let mut key = memory::text(name, WHAT)?;
    key.retain(|c| !c.is_whitespace());
    key.make_ascii_lowercase();
    Ok(key)
}

impl Fields {
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), values: HashMap::new(), pairs: HashMap::new() }
    }

    /// Takes a value in; the same name twice is an error.
    pub(super) fn insert(&mut self, name: &str, value: &str) -> Result<()> {
        let value = memory::text(value.trim(), WHAT)?;
        match memory::insert(&mut self.values, key(name)?, value, WHAT)? {
            None => Ok(()),
            Some(_) => Err(self.error(format!("header field '{}' is given twice", name.trim()))),
        }
    }

    /// Takes in a key/value pair, which means nothing to the format.
    pub(super) fn insert_pair(&mut self, name: &str, value: &str) -> Result<()> {
        let [name, value] = [name, value].map(|text| memory::text(text.trim(), WHAT));
        memory::insert(&mut self.pairs, name?, value?, WHAT).map(drop)
    }

    /// The value of a pair.
    pub(super) fn pair(&self, name: &str) -> Option<&str> {
        self.pairs.get(name).map(String::as_str)
    }

    pub(super) fn get(&self, name: &str) -> Option<&str> {
        // Names that are asked for are short.
        self.values.get(&key(name).ok()?).map(String::as_str)
    }

    pub(super) fn required(&self, name: &str) -> Result<&str> {
        self.get(name).ok_or_else(|| self.error(format!("header field '{name}' is missing")))
    }

    /// One number, or `None` when the field is missing.
    pub(super) fn number<T: FromStr + Copy>(&self, name: &str) -> Result<Option<T>> {
        Ok(self.numbers(name, Some(1))?.map(|list| list[0]))
    }

    /// A list of numbers separated by blanks, of the length given if one is.
    pub(super) fn numbers<T: FromStr>(
        &self,
        name: &str,
        count: Option<usize>,
    ) -> Result<Option<Vec<T>>> {
        let Some(value) = self.get(name) else { return Ok(None) };
        let mut list = Vec::new();
        for word in value.split_whitespace() {
            memory::reserve(&mut list, 1, "numbers of a header")?;
            list.push(word.parse().map_err(|_| {
                self.error(format!(
                    "header field '{name}': '{}' is not a number that fits",
                    excerpt(word)
                ))
            })?);
        }
        match count {
            Some(count) if count != list.len() => Err(self.error(format!(
                "header field '{name}' must give {count} number(s), got {}: '{}'",
                list.len(),
                excerpt(value)
            ))),
            _ => Ok(Some(list)),
        }
    }

    /// An error about a value that is not known or not supported.
    pub(super) fn refuse(&self, name: &str, why: impl Display) -> Error {
        self.error(format!(
            "header field '{name}: {}': {why}",
            excerpt(self.get(name).unwrap_or_default())
        ))
    }

    /// An error about the last line that was read. It isn't quoted: the file may be any other.
    pub(super) fn no_field(&self, read: Place, form: &str) -> Error {
        self.error(format!("line {} of the header is not of the form '{form}'", read.lines))
    }

    pub(super) fn error(&self, message: impl Into<String>) -> Error {
        Error::format(&self.path, message)
    }
}

/// How much of a header has been read.
#[derive(Clone, Copy, Default)]
pub(super) struct Place {
    pub(super) bytes: u64,
    lines: u64,
}

/// Next line of a text header without its line ending; `None` at the end of the file.
pub(super) fn header_line(source: &mut Source, read: &mut Place) -> Result<Option<String>> {
    let mut line = Vec::new();
    let n = source.read_line(MAX_HEADER.saturating_sub(read.bytes), &mut line)? as u64;
    read.bytes += n;
    read.lines += 1;
    if read.bytes >= MAX_HEADER {
        return Err(source.error(format!("the header does not end within {MAX_HEADER} bytes")));
    }
    let ending = line.iter().rev().take_while(|byte| b"\r\n".contains(byte)).count();
    line.truncate(line.len() - ending);
    // What is no UTF-8 is rare, and in text that means nothing to a format.
    let text = String::from_utf8(line)
        .unwrap_or_else(|error| String::from_utf8_lossy(error.as_bytes()).into_owned());
    Ok((n > 0).then_some(text))
}
