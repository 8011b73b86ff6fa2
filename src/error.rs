//! The one error type. Every variant maps to one stable status code of the C interface.

use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// What can go wrong. Each message is one line that names the thing and the value.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// An argument or parameter is out of its range.
    #[error("{0}")]
    InvalidArgument(String),
    /// The option exists in the interface, but not yet in this version, not in this build (cargo
    /// features), or not on this system.
    #[error("{0}")]
    Unsupported(String),
    /// The file could not be opened, read or written.
    #[error("{}: {source}", shown(path))]
    Io {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file was read, but what it holds is not a valid image of its format.
    #[error("{}: {message}", shown(path))]
    Format {
        /// The file.
        path: PathBuf,
        /// What is wrong with it, with the value.
        message: String,
    },
    /// The image has no voxel with a label other than 0, so there is nothing to mesh.
    #[error("the image holds no label other than 0: nothing to mesh")]
    EmptyImage,
    /// The caller's limit of vertices was reached, or one of the library's own: that of the ids, or
    /// of what a file format can number.
    #[error("{0}")]
    LimitReached(String),
    /// The caller's limit of time was reached.
    #[error("{0}")]
    TimeLimit(String),
    /// The caller's limit of memory was reached.
    #[error("{0}")]
    MemoryLimit(String),
    /// The caller cancelled the run.
    #[error("cancelled")]
    Cancelled,
    /// Memory for the named things could not be had. Made without asking for any.
    #[error("out of memory: {count} {what}")]
    OutOfMemory {
        /// How many of them.
        count: usize,
        /// What they are.
        what: &'static str,
    },
    /// An invariant of the library broke; this is a bug of lapd.
    #[error("internal error: {0}")]
    Internal(String),
}

/// A path for a message of one line: characters that would steer a terminal are shown as `?`.
pub fn shown(path: &Path) -> String {
    one_line(&path.to_string_lossy())
}

/// A text without control characters, which are shown as `?`.
pub fn one_line(text: &str) -> String {
    text.chars().map(|c| if c.is_control() { '?' } else { c }).collect()
}

/// As much of a text as fits a message, on one line.
pub fn excerpt(text: &str) -> String {
    let mut short: String = text.chars().take(60).collect();
    if short.len() < text.len() {
        short.push_str("...");
    }
    one_line(&short)
}

/// `Result` with the crate's error.
pub type Result<T> = std::result::Result<T, Error>;

impl Error {
    /// An [`Error::Io`] for `path`; memory that was refused is [`Error::OutOfMemory`] here, too.
    pub fn io(path: &Path, source: std::io::Error) -> Self {
        match source.kind() {
            ErrorKind::OutOfMemory => Self::OutOfMemory { count: 1, what: "buffer of a file" },
            _ => Self::Io { path: path.to_owned(), source },
        }
    }

    /// An [`Error::Format`] for `path`.
    pub fn format(path: &Path, message: impl Into<String>) -> Self {
        Self::Format { path: path.to_owned(), message: message.into() }
    }

    /// The [`Error::TimeLimit`] of this many seconds.
    pub fn time_limit(seconds: f64) -> Self {
        Self::TimeLimit(format!("the time limit of {seconds} seconds was reached"))
    }

    /// Whether this is a limit, of which a partial mesh may come.
    pub fn is_limit(&self) -> bool {
        matches!(self, Self::LimitReached(_) | Self::TimeLimit(_) | Self::MemoryLimit(_))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_files_keep_a_message_on_its_line() {
        let path = Path::new("a\nb\x1b[31m.nrrd");
        let errors =
            [Error::format(path, "wrong"), Error::io(path, std::io::Error::other("wrong"))];
        for error in errors {
            assert_eq!(error.to_string(), "a?b?[31m.nrrd: wrong");
        }
    }
}
