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

/// Words of the README: more belongs into the guide.
const MAX_README: usize = 1200;

/// All Markdown files below a folder.
fn pages(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && !MADE.iter().any(|made| path.ends_with(made)) {
            pages(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "md") {
            found.push(path);
        }
    }
}

/// Links between pages, and to files of the repository, lead to something.
#[test]
fn links_lead_somewhere() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    pages(root, &mut found);
    let (mut links, mut dead) = (0, Vec::new());
    for page in found {
        let text = fs::read_to_string(&page).unwrap();
        for link in text.split("](").skip(1).filter_map(|rest| rest.split(')').next()) {
            let target = link.split('#').next().unwrap_or_default();
            if target.is_empty() || target.contains("://") {
                continue;
            }
            links += 1;
            if !page.with_file_name(target).exists() {
                dead.push(format!("{}: {link}", page.strip_prefix(root).unwrap().display()));
            }
        }
    }
    assert!(links > 50, "only {links} links were found");
    assert!(dead.is_empty(), "dead links:\n{}", dead.join("\n"));
}

#[test]
fn the_readme_is_short() {
    let readme = Path::new(env!("CARGO_MANIFEST_DIR")).join("README.md");
    let words = fs::read_to_string(readme).unwrap().split_whitespace().count();
    assert!(words <= MAX_README, "README.md has {words} words, {MAX_README} at most");
}

/// The Rust files of a folder, below it too, but for those that are compiled for tests only.
fn sources(path: &Path, found: &mut Vec<PathBuf>) {
    if path.is_dir() {
        fs::read_dir(path).unwrap().for_each(|entry| sources(&entry.unwrap().path(), found));
    } else if !path.ends_with("tests.rs") && !path.ends_with("testing.rs") {
        found.push(path.to_path_buf());
    }
}

/// The code of a file without comments, and without the module of tests at its end.
fn code(path: &Path) -> String {
    let text = fs::read_to_string(path).unwrap();
    let text = text.split("#[cfg(test)]\nmod ").next().unwrap();
    let without = text.lines().map(|line| line.split("//").next().unwrap_or_default());
    without.collect::<Vec<_>>().join("\n")
}

/// The names that follow `crate::`, alone or in braces.
fn used(code: &str) -> Vec<&str> {
    let is_name = |c: char| c.is_alphanumeric() || c == '_';
    let mut found = Vec::new();
    for (at, _) in code.match_indices("crate::") {
        let rest = &code[at + "crate::".len()..];
        let Some(list) = rest.strip_prefix('{') else {
            found.push(rest.split(|c| !is_name(c)).next().unwrap_or_default());
            continue;
        };
        let (mut depth, mut start) = (0, 0);
        for (end, c) in list.char_indices() {
            match c {
                '{' => depth += 1,
                '}' if depth > 0 => depth -= 1,
                ',' | '}' if depth == 0 => {
                    let item = list[start..end].trim_start();
                    found.push(item.split(|c| !is_name(c)).next().unwrap_or_default());
                    start = end + 1;
                    if c == '}' {
                        break;
                    }
                }
                _ => {}
            }
        }
    }
    found
}

/// The names in backticks in the first column of the table after `head`, row by row.
fn listed<'t>(text: &'t str, head: &str) -> Vec<&'t str> {
    let start = text.find(head).unwrap_or_else(|| panic!("no table '{head}'"));
    let table = text[start..].lines().map(|line| line.trim_start_matches("//! "));
    let rows = table.skip(2).take_while(|line| line.starts_with('|'));
    let cells = rows.filter_map(|row| row.split('|').nth(1));
    cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect()
}

/// A module uses only those that the maps in `src/lib.rs` and in docs/reference/architecture.md
/// name before it, so there is no circle of modules.
#[test]
fn modules_use_only_those_before_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let lib = fs::read_to_string(root.join("src/lib.rs")).unwrap();
    let order = listed(&lib, "| module |");
    let architecture = fs::read_to_string(root.join("docs/reference/architecture.md")).unwrap();
    assert_eq!(
        listed(&architecture, "| module |"),
        order,
        "docs/reference/architecture.md and src/lib.rs"
    );
    let names = fs::read_dir(root.join("src")).unwrap().map(|entry| entry.unwrap().path());
    let names = names.filter(|path| !path.ends_with("lib.rs"));
    let names = names.map(|path| path.file_stem().unwrap().to_string_lossy().into_owned());
    let mut names: Vec<String> = names.collect();
    names.sort();
    let mut sorted = order.clone();
    sorted.sort_unstable();
    assert_eq!(sorted, names, "the modules that the map lists, and those that there are");
    let mut wrong = Vec::new();
    for (place, module) in order.iter().enumerate() {
        let mut files = Vec::new();
        let folder = root.join("src").join(module);
        sources(&if folder.is_dir() { folder } else { folder.with_extension("rs") }, &mut files);
        for path in files {
            let code = code(&path);
            let later = used(&code).into_iter().filter(|name| order[place + 1..].contains(name));
            let path = path.strip_prefix(root).unwrap().display();
            wrong.extend(later.map(|name| format!("{path} uses {name}")));
        }
    }
    assert!(wrong.is_empty(), "against the order of the map:\n{}", wrong.join("\n"));
}
