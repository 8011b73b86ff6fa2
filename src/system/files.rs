//! Files that strangers name: opened without waiting, and only below a folder.

use std::fs::{File, Metadata, OpenOptions, canonicalize};
use std::io;
use std::path::{Component, Path, PathBuf};

/// Opens a file for reading, and tells what it is. Never waits: a pipe without a writer is opened
/// like a file, and what was opened is what is told of, so that nobody can put another thing in its
/// place between the two.
///
/// # Errors
/// What the system says.
pub fn open_at_once(path: &Path) -> io::Result<(File, Metadata)> {
    open(path, false)
}

/// As [`open_at_once`], of a path without links: if its last part has become a link, that is an
/// error. (Folders that are replaced meanwhile are not noticed.)
///
/// # Errors
/// What the system says.
pub fn open_real_path(path: &Path) -> io::Result<(File, Metadata)> {
    open(path, true)
}

fn open(path: &Path, is_real: bool) -> io::Result<(File, Metadata)> {
    let mut options = OpenOptions::new();
    options.read(true);
    #[cfg(unix)]
    {
        use rustix::fs::OFlags;
        use std::os::unix::fs::OpenOptionsExt;
        // Regular files read as ever with this flag.
        let flags = OFlags::NONBLOCK;
        let flags = if is_real { flags | OFlags::NOFOLLOW } else { flags };
        options.custom_flags(flags.bits() as i32);
    }
    #[cfg(not(unix))]
    let _ = is_real;
    let file = options.open(path)?;
    let metadata = file.metadata()?;
    Ok((file, metadata))
}

/// The real path, without links, of the file that is called `name` from `folder`; `None` where it
/// is not below the folder, whether it exists or not.
///
/// # Errors
/// What the system says, for names within the folder.
pub fn real_path_below(folder: &Path, name: &Path) -> io::Result<Option<PathBuf>> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let is_plain =
        name.components().all(|part| matches!(part, Component::Normal(_) | Component::CurDir));
    let folder = canonicalize(folder)?;
    match canonicalize(folder.join(name)) {
        Ok(path) => Ok(Some(path).filter(|path| path.starts_with(&folder))),
        // Whether something exists elsewhere is nobody's business.
        Err(_) if !is_plain => Ok(None),
        Err(error) => Err(error),
    }
}
