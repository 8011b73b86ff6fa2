//! Text headers: fields by name, and numbers out of their values.

use std::collections::HashMap;
use std::fmt::Display;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use super::source::Source;
use crate::error::excerpt;
use crate::{Error, Result};

/// The longest header read. Segmentations of 3D Slicer describe every segment in it.
pub(super) const MAX_HEADER: u64 = 16 << 20;

/// Named header values. Names are compared without case and blanks.
pub(super) struct Fields {
    path: PathBuf,
    values: HashMap<String, String>,
    /// What the format leaves to programs: names as they are.
    pairs: HashMap<String, String>,
}

fn key(name: &str) -> String {
    name.chars().filter(|c| !c.is_whitespace()).map(|c| c.to_ascii_lowercase()).collect()
}

impl Fields {
    pub(super) fn new(path: &Path) -> Self {
        Self { path: path.to_owned(), values: HashMap::new(), pairs: HashMap::new() }
    }

    /// Takes a value in; the same name twice is an error.
    pub(super) fn insert(&mut self, name: &str, value: &str) -> Result<()> {
        match self.values.insert(key(name), value.trim().to_owned()) {
            None => Ok(()),
            Some(_) => Err(self.error(format!("header field '{}' is given twice", name.trim()))),
        }
    }

    /// Takes in a key/value pair, which means nothing to the format.
    pub(super) fn insert_pair(&mut self, name: &str, value: &str) {
        self.pairs.insert(name.trim().to_owned(), value.trim().to_owned());
    }

    /// The value of a pair.
    pub(super) fn pair(&self, name: &str) -> Option<&str> {
        self.pairs.get(name).map(String::as_str)
    }

    pub(super) fn get(&self, name: &str) -> Option<&str> {
        self.values.get(&key(name)).map(String::as_str)
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
        let list: Vec<T> = value
            .split_whitespace()
            .map(|word| {
                word.parse().map_err(|_| {
                    self.error(format!(
                        "header field '{name}': '{}' is not a number that fits",
                        excerpt(word)
                    ))
                })
            })
            .collect::<Result<_>>()?;
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
    Ok((n > 0).then(|| String::from_utf8_lossy(&line).trim_end_matches(['\n', '\r']).to_owned()))
}
