//! Tables of labels: names, and colours where there are some.
//!
//! A label a line: its number, its name, and perhaps a colour. So are the tables of 3D Slicer
//! (`.ctbl`), FreeSurfer (`FreeSurferColorLUT.txt`) and ITK-SNAP ("label descriptions"), tables
//! with commas, and lists like `7 liver`:
//!
//! ```text
//! 17  Left-Hippocampus  220 216 20  0
//! 17  220 216 20  1 1 1  "Left hippocampus"
//! 17,Left hippocampus,220,216,20
//! 17 Left hippocampus
//! ```
//!
//! Columns are separated by commas, tabs or semicolons, where the line has them, else by blanks.
//! A name in quotes is the name. Else it is what stands between the label and the next number, so
//! that `7 lobe 2` names label 7 `lobe`; with quotes or a comma it is `lobe 2`. Three numbers or
//! more, 0 to 255, that follow the name, or the label, are red, green and blue. Empty lines,
//! those that begin with `#` or `//`, and a first line whose first column is no number, are left
//! out.

use std::fs;
use std::path::Path;

use crate::error::{excerpt, one_line};
use crate::image::label_names::{LabelName, LabelNames};
use crate::{Error, Result};

/// No table of labels is larger.
const MAX_BYTES: u64 = 16 << 20;

/// Reads a table.
///
/// # Errors
/// [`Error::Io`]; [`Error::Format`] for a file that is no such table, naming the line.
pub fn read_label_table(path: &Path) -> Result<LabelNames> {
    let metadata = fs::metadata(path).map_err(|error| Error::io(path, error))?;
    if !metadata.is_file() {
        return Err(Error::io(path, std::io::Error::other("not a regular file")));
    }
    if metadata.len() > MAX_BYTES {
        return Err(Error::format(
            path,
            format!("{} bytes are too many for a table of labels", metadata.len()),
        ));
    }
    let bytes = fs::read(path).map_err(|error| Error::io(path, error))?;
    let text = String::from_utf8(bytes)
        .map_err(|_| Error::format(path, "a table of labels must be text in UTF-8"))?;
    let names = parse(&text).map_err(|what| Error::format(path, what))?;
    if names.is_empty() {
        return Err(Error::format(path, "the table names no label"));
    }
    Ok(names)
}

/// The names that the lines of a table give; or what is wrong with one of them.
fn parse(text: &str) -> std::result::Result<LabelNames, String> {
    let lines = (1..).zip(text.trim_start_matches('\u{feff}').lines());
    let lines = lines.map(|(number, line)| (number, line.trim()));
    let mut lines =
        lines.filter(|(_, line)| !["", "#", "//"].contains(line) && !is_comment(line)).peekable();
    lines.next_if(|(_, line)| label_and_name(line).is_none() && !starts_with_number(line));
    let mut names = LabelNames::default();
    for (number, line) in lines {
        let (label, name) = label_and_name(line)
            .ok_or_else(|| format!("line {number} is no label with a name: {:?}", excerpt(line)))?;
        names.insert(label, name);
    }
    Ok(names)
}

fn is_comment(line: &str) -> bool {
    line.starts_with('#') || line.starts_with("//")
}

fn starts_with_number(line: &str) -> bool {
    line.starts_with(|c: char| c.is_ascii_digit() || c == '-')
}

/// A column of a line.
struct Column<'a> {
    text: &'a str,
    quoted: bool,
}

impl Column<'_> {
    fn is_number(&self) -> bool {
        !self.quoted && self.text.parse::<f64>().is_ok()
    }

    fn color_part(&self) -> Option<u8> {
        (!self.quoted).then(|| self.text.parse().ok()).flatten()
    }
}

/// What a line says.
fn label_and_name(line: &str) -> Option<(i32, LabelName)> {
    // A comma in a name that stands between blanks separates nothing.
    let has_commas = outside_quotes(line).any(|c| is_comma(&c));
    let by_commas = has_commas.then(|| said_by(line, true)).flatten();
    by_commas.or_else(|| said_by(line, false))
}

/// The same, with columns between commas or between blanks.
fn said_by(line: &str, has_commas: bool) -> Option<(i32, LabelName)> {
    let columns = columns(line, has_commas);
    let (first, rest) = columns.split_first()?;
    let label = first.text.parse().ok()?;
    let name = match rest.iter().find(|column| column.quoted) {
        Some(quoted) => quoted.text.to_owned(),
        // One column, if columns have blanks in them.
        None if has_commas => rest.iter().find(|column| !column.is_number())?.text.to_owned(),
        None => {
            let words = rest.iter().skip_while(|column| column.is_number());
            let words = words.take_while(|column| !column.is_number()).map(|column| column.text);
            words.collect::<Vec<_>>().join(" ")
        }
    };
    let colors = rest.split(|column| !column.is_number()).find(|numbers| numbers.len() >= 3);
    let color = colors.and_then(|numbers| {
        let mut parts = numbers.iter().map_while(Column::color_part);
        Some([parts.next()?, parts.next()?, parts.next()?])
    });
    let name = one_line(name.trim());
    (!name.is_empty()).then_some((label, LabelName { name, color }))
}

fn is_comma(c: &char) -> bool {
    matches!(c, ',' | ';' | '\t')
}

/// The characters that no quotes enclose.
fn outside_quotes(line: &str) -> impl Iterator<Item = char> {
    line.split('"').step_by(2).flat_map(str::chars)
}

/// The columns of a line: between commas, or between blanks.
fn columns(line: &str, has_commas: bool) -> Vec<Column<'_>> {
    let is_gap = |c: char| if has_commas { is_comma(&c) } else { c.is_whitespace() };
    let mut columns = Vec::new();
    // Every second piece is in quotes.
    for (i, piece) in line.split('"').enumerate() {
        if i % 2 == 1 {
            columns.push(Column { text: piece, quoted: true });
        } else {
            let parts = piece.split(is_gap).map(str::trim).filter(|text| !text.is_empty());
            columns.extend(parts.map(|text| Column { text, quoted: false }));
        }
    }
    columns
}

#[cfg(test)]
mod tests {
    use super::*;

    fn one(line: &str) -> Option<(i32, String, Option<[u8; 3]>)> {
        label_and_name(line).map(|(label, LabelName { name, color })| (label, name, color))
    }

    #[test]
    fn lines_of_all_tables() {
        let hippocampus = |name: &str, color| Some((17, name.to_owned(), color));
        let color = Some([220, 216, 20]);
        for (line, expected) in [
            // FreeSurfer, 3D Slicer.
            (
                "17  Left-Hippocampus                        220 216 20  0",
                hippocampus("Left-Hippocampus", color),
            ),
            // ITK-SNAP.
            (
                "   17   220  216   20        1  1  1    \"Left hippocampus\"",
                hippocampus("Left hippocampus", color),
            ),
            ("17,Left hippocampus,220,216,20", hippocampus("Left hippocampus", color)),
            ("17\tLeft hippocampus\t220\t216\t20", hippocampus("Left hippocampus", color)),
            ("17;\"Left, or so\";220;216;20", hippocampus("Left, or so", color)),
            ("17 Left hippocampus", hippocampus("Left hippocampus", None)),
            // MRIcron's lists have a number more.
            ("17 Hippocampus_L 4101", hippocampus("Hippocampus_L", None)),
            ("17,lobe 2", hippocampus("lobe 2", None)),
            ("17 Left,hippocampus", hippocampus("Left,hippocampus", None)),
            ("17 Hippocampus\t220 216 20 0", hippocampus("Hippocampus", color)),
            ("17 \"lobe 2\"", hippocampus("lobe 2", None)),
            ("17", None),
            ("17 220 216 20", None),
            ("x 17", None),
            ("99999999999 x", None),
        ] {
            assert_eq!(one(line), expected, "{line}");
        }
        assert_eq!(one("-3 bone"), Some((-3, "bone".into(), None)));
    }

    #[test]
    fn tables() {
        let text = "\u{feff}label,name\r\n# a comment\r\n\r\n1,liver\r\n2,spleen,1,2,3\r\n";
        let names = parse(text).unwrap();
        let all: Vec<_> = names.iter().map(|(label, name)| (label, &*name.name)).collect();
        assert_eq!(all, [(1, "liver"), (2, "spleen")]);
        assert_eq!(names.get(2).unwrap().color, Some([1, 2, 3]));
        let error = parse("1 liver\nspleen\n").unwrap_err();
        assert_eq!(error, "line 2 is no label with a name: \"spleen\"");
        assert!(parse("1 2 3\n").is_err());
        assert!(parse("// nothing\n").unwrap().is_empty());
    }

    #[test]
    fn files_that_are_no_tables() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.txt");
        let read = |bytes: &[u8]| {
            fs::write(&path, bytes).unwrap();
            read_label_table(&path).map_err(|error| error.to_string())
        };
        assert!(read(b"1 liver\n").is_ok());
        assert!(read(b"").unwrap_err().contains("names no label"));
        assert!(read(b"\xff\xfe1").unwrap_err().contains("UTF-8"));
        assert!(read_label_table(folder.path()).is_err());
    }
}
