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

/// Sources that pages name are there. Names in capitals stand for others.
#[test]
fn sources_that_pages_name_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    pages(root, &mut found);
    let (mut count, mut gone) = (0, Vec::new());
    for page in found.iter().filter(|page| !page.ends_with("CHANGELOG.md")) {
        let text = fs::read_to_string(page).unwrap();
        let is_in_path = |c: char| c.is_alphanumeric() || "/_.-".contains(c);
        for path in text.split(|c| !is_in_path(c)).filter(|path| path.starts_with("src/")) {
            let path = path.trim_end_matches(['.', '-', '/']);
            count += 1;
            if !path.contains(char::is_uppercase) && !root.join(path).exists() {
                gone.push(format!("{}: {path}", page.strip_prefix(root).unwrap().display()));
            }
        }
    }
    assert!(count > 20, "only {count} names of sources were found");
    assert!(gone.is_empty(), "no such sources:\n{}", gone.join("\n"));
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

/// Sentences that end within a line of Markdown, before its last one. Dots in code, after initials
/// and in abbreviations end none.
fn inner_sentence_ends(line: &str) -> usize {
    let mut in_code = false;
    let mut ends = 0;
    for (at, c) in line.char_indices() {
        in_code ^= c == '`';
        let rest = &line[at..];
        let next = rest.strip_prefix(". ").and_then(|next| next.chars().next());
        if in_code || !next.is_some_and(|next| next.is_uppercase()) {
            continue;
        }
        let word = line[..at].rsplit([' ', '(']).next().unwrap_or_default();
        let is_short = ["e.g", "i.e", "vs", "etc", "al", "Fig", "No", "p", "pp"].contains(&word);
        let is_initial = word.chars().count() == 1;
        let open = line[..at].matches('(').count() > line[..at].matches(')').count();
        ends += usize::from(!is_short && !is_initial && !open);
    }
    ends
}

/// A line of Markdown fits, or is a single sentence. Tables and code may be wider.
#[test]
fn markdown_has_short_lines_or_one_sentence_in_each() {
    const MAX: usize = 120;
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut found = Vec::new();
    pages(root, &mut found);
    let mut wrong = Vec::new();
    for page in found {
        let text = fs::read_to_string(&page).unwrap();
        let mut fenced = false;
        for (line, number) in text.lines().zip(1..) {
            fenced ^= line.trim_start().starts_with("```");
            let is_free = fenced || line.starts_with("    ") || line.trim_start().starts_with('|');
            if !is_free && line.chars().count() > MAX && inner_sentence_ends(line) > 0 {
                wrong.push(format!("{}:{number}", page.strip_prefix(root).unwrap().display()));
            }
        }
    }
    assert!(wrong.is_empty(), "several sentences in a long line:\n{}", wrong.join("\n"));
}

/// What errors and warnings are made by; the text comes next.
const MAKERS: [&str; 14] = [
    "InvalidArgument(",
    "Unsupported(",
    "LimitReached(",
    "TimeLimit(",
    "MemoryLimit(",
    "Error::format(",
    "Failure::invalid(",
    ".error(",
    "#[error(",
    "warnings.push(",
    "warning = format!(",
    "lines.push(",
    "let message =\n",
    "(DefectKind::",
];

/// The string literal that begins next in `code`, within some lines, as it reads.
fn next_literal(code: &str) -> Option<String> {
    let near = code.char_indices().nth(300).map_or(code, |(end, _)| &code[..end]);
    let start = near.find('"')? + 1;
    let mut text = String::new();
    let mut chars = code[start..].chars();
    loop {
        match chars.next()? {
            '"' => return Some(text),
            '\\' => match chars.next()? {
                // The line goes on behind the indentation.
                '\n' => {
                    let rest = chars.as_str().trim_start();
                    chars = rest.chars();
                }
                'n' => text.push('\n'),
                c => text.push(c),
            },
            c => text.push(c),
        }
    }
}

/// Whether a message has the parts of a text between its dots, one after the other.
fn is_told_by(message: &str, text: &str) -> bool {
    let mut rest = message;
    text.split("...")
        .map(str::trim)
        .filter(|part| !part.is_empty())
        .all(|part| rest.find(part).map(|at| rest = &rest[at + part.len()..]).is_some())
}

/// Every message that the sources make is explained in docs/guide/troubleshooting.md, and what is
/// explained there is a message of the sources.
#[test]
fn messages_are_explained() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let page = fs::read_to_string(root.join("docs/guide/troubleshooting.md")).unwrap();
    let cells = page.lines().filter(|line| line.starts_with("| `"));
    let cells = cells.filter_map(|line| line.split('|').nth(1));
    let texts: Vec<&str> = cells.flat_map(|cell| cell.split('`').skip(1).step_by(2)).collect();
    assert!(texts.len() > 100, "only {} texts are explained", texts.len());
    let mut files = Vec::new();
    sources(&root.join("src"), &mut files);
    let mut messages = Vec::new();
    let mut all = String::new();
    for path in files {
        let code = code(&path);
        // What only programs in Rust can do wrong is explained where they read.
        let is_for_rust = ["phantom.rs", "volume.rs", "machine.rs", "simulation"];
        if !is_for_rust.iter().any(|part| path.to_string_lossy().contains(part)) {
            for maker in MAKERS {
                for (at, _) in code.match_indices(maker) {
                    messages.extend(next_literal(&code[at + maker.len()..]));
                }
            }
        }
        let mut rest = &*code;
        while let Some(at) = rest.find('"') {
            let literal = next_literal(&rest[at..]).unwrap_or_default();
            all.push_str(&literal);
            all.push('\n');
            rest = &rest[at + 1..];
        }
    }
    // Names of fields and types, and texts that only pass another one on.
    let words = |message: &str| message.split_whitespace().filter(|w| !w.contains('{')).count();
    messages.retain(|message| words(message) > 2);
    let unexplained: Vec<&String> = messages
        .iter()
        .filter(|message| !texts.iter().any(|text| is_told_by(message, text)))
        .collect();
    assert!(unexplained.is_empty(), "not in the page:\n{unexplained:#?}");
    let stale: Vec<&&str> =
        texts.iter().filter(|text| !all.lines().any(|message| is_told_by(message, text))).collect();
    assert!(stale.is_empty(), "of no source:\n{stale:#?}");
}
