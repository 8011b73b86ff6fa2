//! The bytes of an image file, decompressed where its format says so, with a bound on how many can
//! come.

use std::fs::{File, Metadata};
use std::io::{self, BufRead, BufReader, Cursor, ErrorKind, Read};
use std::path::{Path, PathBuf};

use flate2::bufread::{GzDecoder, ZlibDecoder};

use super::GoOn;
use crate::error::{excerpt, shown};
use crate::memory::Watch;
use crate::system::{files, memory};
use crate::{Error, Result};

/// Deflate codes at most 258 bytes in 2 bits (RFC 1951: a match of full length with one-bit codes):
/// 1032 to 1.
const DEFLATE_RATIO: u64 = 1032;

/// What is read past the voxels of a compressed stream to reach its checksum, at most.
const MAX_EXCESS: u64 = 16 << 20;

/// What an image may take in memory unless the caller says otherwise: so many times the bytes of
/// its file, or this much where that is more; never more than the machine's memory by this.
const USUAL_RATIO: u64 = 1000;
const USUAL_BYTES: u64 = 1 << 30;
const USUAL_PART: u64 = 2;

/// Bytes of a file that are read at once. Deflate makes a thousand times as many of them, and
/// between two reads nobody asks whether to go on.
const BLOCK: usize = 1 << 14;

/// What a file may do, and who is told how far reading is.
#[derive(Clone, Copy)]
pub(super) struct Access<'a> {
    /// Is told which part of the call's work is done; its error ends the call.
    pub(super) go_on: &'a GoOn<'a>,
    /// Headers may name files outside of their folder.
    pub(super) allow_outside: bool,
    /// The most bytes that the image may take in memory, if the caller says.
    pub(super) max_bytes: Option<u64>,
    /// Which part of the call's work the file is: from, and how much.
    pub(super) share: (f64, f64),
}

/// A file that says how far it has been read.
struct Watched<'a> {
    file: File,
    access: Access<'a>,
    memory: Watch,
    read: u64,
    length: u64,
}

impl Read for Watched<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let (from, share) = self.access.share;
        let part = from + share * (self.read as f64 / self.length as f64).min(1.0);
        let going = (self.access.go_on)(part).and_then(|()| self.memory.check());
        going.map_err(io::Error::other)?;
        let count = self.file.read(buffer)?;
        self.read += count as u64;
        Ok(count)
    }
}

/// The members of a gzip file, one after the other. Zeros behind the last one, which tapes and
/// disks leave, are ignored, as gzip does.
struct Members<'a> {
    /// `None` at the end.
    member: Option<GzDecoder<Box<dyn BufRead + 'a>>>,
}

impl<'a> Members<'a> {
    fn new(stream: Box<dyn BufRead + 'a>) -> Self {
        Self { member: Some(GzDecoder::new(stream)) }
    }
}

impl Read for Members<'_> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        while let Some(member) = &mut self.member {
            let count = member.read(buffer)?;
            if count > 0 || buffer.is_empty() {
                return Ok(count);
            }
            let Some(ended) = self.member.take() else { break };
            let mut stream = ended.into_inner();
            loop {
                let ahead = stream.fill_buf()?;
                if ahead.is_empty() {
                    return Ok(0);
                }
                let zeros = ahead.iter().take_while(|&&byte| byte == 0).count();
                let is_all = zeros == ahead.len();
                stream.consume(zeros);
                if !is_all {
                    break;
                }
            }
            self.member = Some(GzDecoder::new(stream));
        }
        Ok(0)
    }
}

/// A stream of bytes that knows its place.
pub(super) struct Source<'a> {
    path: PathBuf,
    access: Access<'a>,
    stream: Box<dyn BufRead + 'a>,
    /// Bytes of the file.
    length: u64,
    /// Bytes consumed of this stream.
    position: u64,
    /// The stream's length if plain, an upper bound of it if compressed.
    bound: u64,
    compressed: bool,
}

impl<'a> Source<'a> {
    /// Opens a file as it is.
    pub(super) fn open(path: &Path, access: Access<'a>) -> Result<Self> {
        Self::of(files::open_at_once(path), path, access)
    }

    /// A regular file, and its bytes, for a decoder that goes to and fro in it.
    #[cfg(feature = "tiff")]
    pub(super) fn open_file(path: &Path) -> Result<(File, u64)> {
        let (file, metadata) = files::open_at_once(path).map_err(|e| Error::io(path, e))?;
        if !metadata.is_file() {
            return Err(Error::format(path, "not a regular file"));
        }
        Ok((file, metadata.len()))
    }

    /// What a decoder makes of a file of `length` bytes: `bound` bytes, if all is well.
    #[cfg(feature = "tiff")]
    pub(super) fn of_decoder(
        path: &Path,
        access: Access<'a>,
        stream: impl BufRead + 'a,
        length: u64,
        bound: u64,
    ) -> Self {
        let stream = Box::new(stream);
        Self { path: path.to_owned(), access, stream, length, position: 0, bound, compressed: true }
    }

    /// What was opened, called `path`.
    fn of(opened: io::Result<(File, Metadata)>, path: &Path, access: Access<'a>) -> Result<Self> {
        let (file, metadata) = opened.map_err(|e| Error::io(path, e))?;
        if !metadata.is_file() {
            return Err(Error::format(path, "not a regular file"));
        }
        let watched =
            Watched { file, access, memory: Watch::new(), read: 0, length: metadata.len() };
        let mut stream = BufReader::with_capacity(BLOCK, watched);
        let start = stream.fill_buf().map_err(|e| failure(path, e))?;
        if start.is_empty() {
            return Err(Error::format(path, "the file is empty"));
        }
        if start.starts_with(b"version https://git-lfs") {
            return Err(Error::format(
                path,
                "this is a Git LFS pointer; the image itself was not downloaded (git lfs pull)",
            ));
        }
        Ok(Self {
            path: path.to_owned(),
            access,
            stream: Box::new(stream),
            length: metadata.len(),
            position: 0,
            bound: metadata.len(),
            compressed: false,
        })
    }

    /// Opens the data file that the header in `self` names: one below the header's own folder,
    /// unless the caller allows others.
    pub(super) fn open_data(&self, name: &str) -> Result<Self> {
        let folder = self.path.parent().unwrap_or(Path::new(""));
        let path = folder.join(name);
        if self.access.allow_outside {
            return Self::open(&path, self.access);
        }
        match files::real_path_below(folder, Path::new(name)) {
            Ok(Some(real)) => Self::of(files::open_real_path(&real), &path, self.access),
            Ok(None) => Err(self.error(format!(
                "the data file '{}' lies outside of the header's folder; --allow-outside \
                 (lapd_context_set_allow_outside) reads it",
                excerpt(name)
            ))),
            Err(e) => Err(Error::io(&path, e)),
        }
    }

    /// Opens a file and decompresses it if it is a gzip file, whatever its name says.
    pub(super) fn open_maybe_gzip(path: &Path, access: Access<'a>) -> Result<Self> {
        let mut source = Self::open(path, access)?;
        Ok(if source.starts_with(&[0x1f, 0x8b])? { source.gunzip() } else { source })
    }

    /// Whether the next bytes are these few.
    pub(super) fn starts_with(&mut self, bytes: &[u8]) -> Result<bool> {
        let ahead = self.stream.fill_buf();
        match ahead {
            Ok(ahead) => Ok(ahead.starts_with(bytes)),
            Err(e) => Err(self.failure(e)),
        }
    }

    /// The rest, decompressed as gzip: several members as one, zeros after the last one ignored.
    pub(super) fn gunzip(self) -> Self {
        self.decompressed(|stream| {
            Box::new(BufReader::with_capacity(1 << 16, Members::new(stream)))
        })
    }

    /// The rest, decompressed as zlib.
    pub(super) fn inflate(self) -> Self {
        self.decompressed(|stream| {
            Box::new(BufReader::with_capacity(1 << 16, ZlibDecoder::new(stream)))
        })
    }

    fn decompressed(
        self,
        decoder: impl FnOnce(Box<dyn BufRead + 'a>) -> Box<dyn BufRead + 'a>,
    ) -> Self {
        let bound = self.remaining().saturating_mul(DEFLATE_RATIO);
        Self { stream: decoder(self.stream), position: 0, bound, compressed: true, ..self }
    }

    /// Refuses an image that would take so many bytes in memory, where that is more than a file
    /// may ask for.
    pub(super) fn check_memory(&self, bytes: u64) -> Result<()> {
        let usual = || {
            let of_file = self.length.saturating_mul(USUAL_RATIO).max(USUAL_BYTES);
            memory::total().map_or(of_file, |total| of_file.min(total / USUAL_PART))
        };
        let max = self.access.max_bytes.unwrap_or_else(usual);
        if bytes <= max {
            return Ok(());
        }
        Err(Error::MemoryLimit(format!(
            "{}: the image takes {bytes} bytes in memory, and this file of {} bytes may ask for \
             {max}; --max-read-bytes (lapd_context_set_max_read_bytes) sets how much it may",
            shown(&self.path),
            self.length
        )))
    }

    /// The file, for errors.
    pub(super) fn path(&self) -> &Path {
        &self.path
    }

    /// An upper bound of the bytes still to come; exact if [`Source::is_compressed`] is false.
    pub(super) fn remaining(&self) -> u64 {
        self.bound.saturating_sub(self.position)
    }

    /// Whether the bytes come out of a decompressor.
    pub(super) fn is_compressed(&self) -> bool {
        self.compressed
    }

    /// An [`Error::Format`] for this file.
    pub(super) fn error(&self, message: impl Into<String>) -> Error {
        Error::format(&self.path, message)
    }

    fn failure(&self, e: io::Error) -> Error {
        match e.kind() {
            ErrorKind::UnexpectedEof if self.compressed => self.error(format!(
                "the compressed data is cut off after {} decompressed bytes",
                self.position
            )),
            ErrorKind::InvalidInput | ErrorKind::InvalidData if self.compressed => {
                self.error(format!("the compressed data is damaged ({e})"))
            }
            _ => failure(&self.path, e),
        }
    }

    /// Fills `buffer` as far as the stream goes; returns the number of bytes.
    pub(super) fn read_up_to(&mut self, buffer: &mut [u8]) -> Result<usize> {
        let mut filled = 0;
        while filled < buffer.len() {
            match self.stream.read(&mut buffer[filled..]) {
                Ok(0) => break,
                Ok(n) => {
                    filled += n;
                    self.position += n as u64;
                }
                Err(e) if e.kind() == ErrorKind::Interrupted => {}
                Err(e) => return Err(self.failure(e)),
            }
        }
        Ok(filled)
    }

    /// Appends to `buffer` up to and including the next `\n`, or to the end of the stream; returns
    /// the number of bytes, at most `limit`.
    pub(super) fn read_line(&mut self, limit: u64, buffer: &mut Vec<u8>) -> Result<usize> {
        let start = buffer.len();
        loop {
            let ahead = match self.stream.fill_buf() {
                Ok(ahead) => ahead,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                Err(e) => return Err(self.failure(e)),
            };
            let most = (limit - (buffer.len() - start) as u64).min(ahead.len() as u64) as usize;
            let end = ahead[..most].iter().position(|&byte| byte == b'\n');
            let count = end.map_or(most, |end| end + 1);
            crate::memory::reserve(buffer, count, "bytes of a header")?;
            buffer.extend_from_slice(&ahead[..count]);
            self.stream.consume(count);
            self.position += count as u64;
            if end.is_some() || count == 0 {
                return Ok(buffer.len() - start);
            }
        }
    }

    /// Skips bytes; `what` names the header field that asks for it and its value.
    pub(super) fn skip(&mut self, count: u64, what: &str) -> Result<()> {
        let past_end = |source: &Self, held: u64| {
            Err(source.error(format!("{what} lies past the end of the data ({held} bytes)")))
        };
        if !self.compressed && count > self.remaining() {
            return past_end(self, self.remaining());
        }
        match io::copy(&mut self.stream.by_ref().take(count), &mut io::sink()) {
            Ok(n) => {
                self.position += n;
                if n < count { past_end(self, n) } else { Ok(()) }
            }
            Err(e) => Err(self.failure(e)),
        }
    }

    /// Moves to where `length` bytes and then `after` more remain to the end; ends the stream
    /// before these last.
    pub(super) fn seek_from_end(mut self, length: u64, after: u64) -> Result<Self> {
        let wanted = length.saturating_add(after);
        let too_short = |source: &Self, held: u64| {
            source.error(format!(
                "{wanted} bytes are to be found at the end of the data, which has {held}"
            ))
        };
        if !self.compressed {
            let Some(before) = self.remaining().checked_sub(wanted) else {
                return Err(too_short(&self, self.remaining()));
            };
            self.skip(before, "byte skip")?;
            self.bound = self.position + length;
            return Ok(self);
        }
        // The length of a compressed stream is known at its end only.
        let limit = wanted.min(self.bound).saturating_add(MAX_EXCESS);
        let mut bytes = Vec::new();
        if let Err(e) = self.stream.by_ref().take(limit).read_to_end(&mut bytes) {
            return Err(self.failure(e));
        }
        let held = bytes.len() as u64;
        if held == limit {
            return Err(self.error(format!("more than {MAX_EXCESS} bytes stand before the voxels")));
        }
        let Some(before) = held.checked_sub(wanted) else {
            return Err(too_short(&self, held));
        };
        bytes.truncate(bytes.len() - after as usize);
        let mut stream = Cursor::new(bytes);
        stream.set_position(before);
        Ok(Self { stream: Box::new(stream), position: before, bound: before + length, ..self })
    }

    /// Passes over `count` bytes, and ends the stream `length` bytes behind them.
    pub(super) fn part(mut self, count: u64, length: u64) -> Result<Self> {
        self.skip(count, "the volume asked for")?;
        let bound = self.position.saturating_add(length).min(self.bound);
        Ok(Self { stream: Box::new(self.stream.take(length)), bound, ..self })
    }

    /// Reads what follows the voxels: a decompressor checks its checksum at the end only. Returns
    /// how many bytes too many there are.
    pub(super) fn drain(&mut self) -> Result<u64> {
        if !self.compressed {
            return Ok(self.remaining());
        }
        io::copy(&mut self.stream.by_ref().take(MAX_EXCESS), &mut io::sink())
            .map_err(|e| self.failure(e))
    }
}

/// A failure of the system to read, or what ends the call.
fn failure(path: &Path, error: io::Error) -> Error {
    error.downcast::<Error>().unwrap_or_else(|error| Error::io(path, error))
}
