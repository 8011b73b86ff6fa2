//! Rules of the house: what can be read off the sources without running them.

use std::fs;
use std::path::{Path, PathBuf};

/// Columns of the longest line of code, comments or scripts.
const MAX_COLUMNS: usize = 100;

/// Endings of files that people write. Markdown has rules of its own.
const ENDINGS: [&str; 14] = [
    "rs",
    "c",
    "h",
    "hpp",
    "cpp",
    "py",
    "sh",
    "awk",
    "cmake",
    "in",
    "toml",
    "supp",
    "yml",
    "clang-format",
];

/// Folders that are not written by people, or are made when something is built.
const MADE: [&str; 5] = [".git", "build", "target", "proptest-regressions", "golden"];

/// All files below a folder that people write.
fn written(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            if !MADE.contains(&&*name) {
                written(&path, found);
            }
        } else if name == "CMakeLists.txt"
            || ENDINGS.iter().any(|e| name.ends_with(&format!(".{e}")))
        {
            found.push(path);
        }
    }
}

#[test]
fn lines_fit_a_hundred_columns() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    written(root, &mut files);
    assert!(files.len() > 200, "only {} files were found", files.len());
    let mut long = Vec::new();
    for path in files {
        let text = fs::read_to_string(&path).unwrap();
        for (line, number) in text.lines().zip(1..) {
            let columns = line.chars().count();
            if columns > MAX_COLUMNS {
                let path = path.strip_prefix(root).unwrap().display();
                long.push(format!("{path}:{number}: {columns} columns"));
            }
        }
    }
    assert!(long.is_empty(), "longer than {MAX_COLUMNS} columns:\n{}", long.join("\n"));
}
