//! What XML files say of the files that belong to them.

use std::path::Path;

use crate::error::shown;
use crate::{Error, Result};

/// The name of a file as it stands in the XML file `path`.
///
/// # Errors
/// [`Error::InvalidArgument`] for a name that readers would not find: they take what is behind a
/// colon for the name of an array, or what is before one for a drive, and leave out blanks at ends.
pub(super) fn told_name(file: &Path, path: &Path) -> Result<String> {
    let is_told = |name: &&str| {
        name.trim() == *name
            && !name.contains(|c: char| c == ':' || c.is_control())
            && path.to_str().is_some()
            // Of `..vtm` the folder would be the one that it is in.
            && file.parent() == path.parent()
    };
    let name = file.file_name().and_then(|name| name.to_str()).filter(is_told);
    name.map(escaped).ok_or_else(|| {
        Error::InvalidArgument(format!(
            "{}: its name stands in the XML file as well, so it must be UTF-8, without colons, \
             control characters, and blanks at its ends, and more than dots",
            shown(path)
        ))
    })
}

/// Text as XML takes it. Names of regions and boundaries have nothing to escape.
fn escaped(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_escaped_or_refused() {
        let told = |name: &str| told_name(Path::new(name), Path::new("b/a.vtm"));
        assert_eq!(told("b/a&b <c>.h5").unwrap(), "a&amp;b &lt;c&gt;.h5");
        for bad in ["b/a:b", "b/ a", "b/a\n", "", "b/."] {
            let message = told(bad).unwrap_err().to_string();
            assert!(message.starts_with("b/a.vtm: its name stands"), "{message}");
        }
    }
}
