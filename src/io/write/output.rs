//! A file that appears whole or not at all.

use std::fs;
use std::io::{self, BufWriter, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::time::Duration;

use tempfile::{NamedTempFile, TempPath};

use crate::error::shown;
use crate::memory::Watch;
use crate::monitor::CancelFlag;
use crate::{Error, Result};

const BUFFER: usize = 1 << 18;

/// Names of temporary files.
const PREFIX: &str = ".lapd-";
const SUFFIX: &str = ".tmp";

/// Temporary files that nobody has written to for so long are left over from a process that was
/// killed.
const OLD: Duration = Duration::from_secs(24 * 60 * 60);

/// Removes temporary files of killed processes from a folder. What cannot be removed stays.
fn remove_old(folder: &Path) {
    let is_old = |entry: &fs::DirEntry| {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if !(name.starts_with(PREFIX) && name.ends_with(SUFFIX)) {
            return false;
        }
        let metadata = entry.metadata().ok().filter(|metadata| metadata.is_file());
        let age = metadata.and_then(|metadata| metadata.modified().ok()?.elapsed().ok());
        age.is_some_and(|age| age > OLD)
    };
    for entry in fs::read_dir(folder).into_iter().flatten().flatten().filter(is_old) {
        let _ = fs::remove_file(entry.path());
    }
}

/// A temporary file in the folder of its target. Dropped before [`Output::commit`], it is removed.
pub(crate) struct Output<'a> {
    writer: BufWriter<NamedTempFile>,
    target: PathBuf,
    cancel: Option<&'a CancelFlag>,
    memory: Watch,
}

impl<'a> Output<'a> {
    /// Creates the temporary file for `path`. A symbolic link stays, what it points to is replaced.
    pub fn create(path: &Path) -> Result<Self> {
        Self::create_with(path, remove_old)
    }

    /// The same in a folder that [`in_folder`] has looked through: for many files.
    pub fn create_among_others(path: &Path) -> Result<Self> {
        Self::create_with(path, |_| ())
    }

    fn create_with(path: &Path, look_through: impl FnOnce(&Path)) -> Result<Self> {
        let memory = Watch::new();
        let target = match fs::canonicalize(path) {
            Ok(target) if target.is_file() => target,
            Ok(_) => {
                return Err(Error::io(path, io::Error::other("exists and is no regular file")));
            }
            Err(_) => path.to_owned(),
        };
        let folder = match target.parent() {
            Some(folder) if folder != Path::new("") => folder,
            _ => Path::new("."),
        };
        look_through(folder);
        let mut builder = tempfile::Builder::new();
        builder.prefix(PREFIX).suffix(SUFFIX);
        // Temporary files are private by default; a new mesh gets what the user's umask says, one
        // that replaces another what that had (see `commit`).
        #[cfg(unix)]
        builder.permissions(std::os::unix::fs::PermissionsExt::from_mode(0o666));
        // The error of the builder names the temporary file, which tells a user nothing; the kind
        // tells all.
        let file = builder.tempfile_in(folder).map_err(|error| {
            let message =
                format!("no file can be created in folder {}: {}", shown(folder), error.kind());
            Error::io(path, io::Error::new(error.kind(), message))
        })?;
        let writer = BufWriter::with_capacity(BUFFER, file);
        Ok(Self { writer, target, cancel: None, memory })
    }

    /// Lets a raised flag end [`Output::fill`] at the next write. Refused memory always does.
    pub fn watching(self, cancel: Option<&'a CancelFlag>) -> Self {
        Self { cancel, ..self }
    }

    fn is_cancelled(&self) -> bool {
        self.cancel.is_some_and(CancelFlag::is_cancelled)
    }

    /// Lets `write` write, and names the target in its error; errors of the library that it wraps
    /// come out as they are.
    pub fn fill(&mut self, write: impl FnOnce(&mut Self) -> io::Result<()>) -> Result<()> {
        let result = write(self);
        if self.is_cancelled() {
            return Err(Error::Cancelled);
        }
        result.map_err(|error| {
            error.downcast().unwrap_or_else(|error| Error::io(&self.target, error))
        })
    }

    /// Lets `write` fill the temporary file under its own name, which is of no use in errors: for
    /// libraries that open files themselves.
    #[cfg(feature = "hdf5")]
    pub fn by_path<T>(&self, write: impl FnOnce(&Path) -> T) -> T {
        write(self.writer.get_ref().path())
    }

    /// Gives all files their names, after all are on the disk; see [`Finished::commit`].
    pub fn commit(outputs: Vec<Self>) -> Result<()> {
        let finished = outputs.into_iter().map(Self::finish).collect::<Result<Vec<_>>>()?;
        Finished::commit(finished)
    }

    /// Puts the file on the disk and closes it; it has no name yet.
    pub fn finish(self) -> Result<Finished> {
        let Self { mut writer, target, .. } = self;
        let synced = writer.flush().and_then(|()| writer.get_ref().as_file().sync_data());
        // The mode of a file that is replaced.
        let kept = synced.and_then(|()| match fs::metadata(&target) {
            Ok(old) => writer.get_ref().as_file().set_permissions(old.permissions()),
            Err(_) => Ok(()),
        });
        let file = kept.and_then(|()| writer.into_inner().map_err(|error| error.into_error()));
        let file = file.map_err(|error| Error::io(&target, error))?.into_temp_path();
        Ok(Finished { file, target })
    }
}

/// A temporary file that is whole, on the disk and closed: many of them may wait for each other.
/// Dropped before [`Finished::commit`], it is removed.
pub(crate) struct Finished {
    file: TempPath,
    target: PathBuf,
}

impl Finished {
    /// Gives all files their names, in this order. If a renaming fails, the files before it have
    /// their names already; each of them is whole.
    pub fn commit(all: Vec<Self>) -> Result<()> {
        all.into_iter().try_for_each(|Self { file, target }| {
            file.persist(&target).map_err(|error| Error::io(&target, error.error))
        })
    }
}

/// Makes a folder, and those above it, for what `write` writes. After an error those that were made
/// are removed again, unless there is something in them.
pub(super) fn in_folder(folder: &Path, write: impl FnOnce() -> Result<()>) -> Result<()> {
    let mut made: Vec<&Path> = folder.ancestors().collect();
    made.retain(|above| !above.is_dir() && **above != *"");
    fs::create_dir_all(folder).map_err(|error| Error::io(folder, error))?;
    remove_old(folder);
    let result = write();
    if result.is_err() {
        made.iter().for_each(|folder| drop(fs::remove_dir(folder)));
    }
    result
}

impl Write for Output<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        if self.is_cancelled() {
            return Err(io::Error::other("cancelled"));
        }
        self.memory.check().map_err(io::Error::other)?;
        self.writer.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.writer.flush()
    }
}

impl Seek for Output<'_> {
    fn seek(&mut self, position: SeekFrom) -> io::Result<u64> {
        self.writer.seek(position)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<_> = fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn an_error_leaves_the_old_file_alone() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtu");
        fs::write(&path, "old").unwrap();
        let mut output = Output::create(&path).unwrap();
        output.write_all(b"half").unwrap();
        let error = output.fill(|_| Err(io::Error::other("disk on fire"))).unwrap_err();
        assert!(error.to_string().ends_with("a.vtu: disk on fire"), "{error}");
        assert_eq!(names(folder.path()).len(), 2);
        drop(output);
        assert_eq!(names(folder.path()), ["a.vtu"]);
        assert_eq!(fs::read(&path).unwrap(), b"old");
    }

    #[test]
    fn a_raised_flag_ends_the_writing() {
        let folder = tempfile::tempdir().unwrap();
        let flag = CancelFlag::default();
        let mut output =
            Output::create(&folder.path().join("a.vtu")).unwrap().watching(Some(&flag));
        output.fill(|out| out.write_all(b"before")).unwrap();
        let result = output.fill(|out| {
            flag.cancel();
            out.write_all(b"after")
        });
        assert!(matches!(result, Err(Error::Cancelled)));
        drop(output);
        assert!(names(folder.path()).is_empty());
    }

    #[test]
    fn commit_replaces_all() {
        let folder = tempfile::tempdir().unwrap();
        let paths = ["a", "b"].map(|name| folder.path().join(name));
        fs::write(&paths[1], "old").unwrap();
        let outputs = paths.each_ref().map(|path| {
            let mut output = Output::create(path).unwrap();
            output.write_all(b"new").unwrap();
            output
        });
        Output::commit(outputs.into()).unwrap();
        assert_eq!(names(folder.path()), ["a", "b"]);
        assert!(paths.iter().all(|path| fs::read(path).unwrap() == b"new"));
    }

    #[test]
    fn bad_targets_are_named() {
        let folder = tempfile::tempdir().unwrap();
        let missing = folder.path().join("no/such/folder.vtu");
        let error = Output::create(&missing).err().unwrap().to_string();
        assert!(
            error.starts_with(missing.to_str().unwrap()) && !error.contains(".lapd-"),
            "{error}"
        );
        let error = Output::create(folder.path()).err().unwrap().to_string();
        assert!(error.ends_with("exists and is no regular file"), "{error}");
    }

    #[test]
    fn what_a_killed_process_left_is_removed_a_day_later() {
        let folder = tempfile::tempdir().unwrap();
        let names_and_ages = [(".lapd-old.tmp", 25), (".lapd-new.tmp", 23), ("other.tmp", 99)];
        for (name, hours) in names_and_ages {
            let file = fs::File::create(folder.path().join(name)).unwrap();
            let age = Duration::from_secs(60 * 60 * hours);
            file.set_modified(std::time::SystemTime::now() - age).unwrap();
        }
        Output::commit(vec![Output::create(&folder.path().join("a.vtu")).unwrap()]).unwrap();
        assert_eq!(names(folder.path()), [".lapd-new.tmp", "a.vtu", "other.tmp"]);
    }

    #[cfg(unix)]
    #[test]
    fn a_file_that_is_replaced_keeps_its_mode() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.vtu");
        fs::write(&path, "old").unwrap();
        for mode in [0o600, 0o664, 0o444] {
            fs::set_permissions(&path, PermissionsExt::from_mode(mode)).unwrap();
            let mut output = Output::create(&path).unwrap();
            output.write_all(b"new").unwrap();
            Output::commit(vec![output]).unwrap();
            assert_eq!(fs::metadata(&path).unwrap().permissions().mode() & 0o777, mode);
            assert_eq!(fs::read(&path).unwrap(), b"new");
        }
    }

    #[cfg(unix)]
    #[test]
    fn links_stay_and_permissions_follow_the_umask() {
        use std::os::unix::fs::PermissionsExt;
        let folder = tempfile::tempdir().unwrap();
        let (link, real) = (folder.path().join("link"), folder.path().join("real"));
        fs::write(&real, "old").unwrap();
        std::os::unix::fs::symlink(&real, &link).unwrap();
        let expected = fs::metadata(&real).unwrap().permissions().mode();
        Output::commit(vec![Output::create(&link).unwrap()]).unwrap();
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read(&real).unwrap(), b"");
        assert_eq!(fs::metadata(&real).unwrap().permissions().mode(), expected);
    }
}
