//! `include/lapd.h` is generated from `src/capi` and committed; this test fails when it is stale.
//! Its documentation says of every function what a caller must know and names nothing that is not
//! there, and `include/lapd.hpp` uses all functions.
//!
//! To bring it up to date: `LAPD_UPDATE_HEADER=1 cargo test --test header`.

use std::collections::HashSet;
use std::path::Path;

/// In the order of the header.
const SOURCES: [&str; 21] = [
    "status",
    "about",
    "context",
    "image",
    "names",
    "values",
    "params",
    "level",
    "thin",
    "labels",
    "threads",
    "run",
    "budget",
    "mesh",
    "write",
    "split",
    "certify",
    "report",
    "tables",
    "improvement",
    "second_order",
];

const HEAD: &str = "\
/*
 * lapd: quality tetrahedral Delaunay meshes of segmented 3D images, all tissues at once.
 * SPDX-License-Identifier: MIT OR Apache-2.0
 *
 * Made by cbindgen from src/capi; do not edit.
 *
 * Conventions
 * - Handles (lapd_context, lapd_image, lapd_params, lapd_write_options, lapd_mesh) are
 *   opaque. What a create, read or mesh function hands out belongs to the caller, who frees it once
 *   with the lapd_..._free function of its type.
 * - Functions return a lapd_status; 0 is success. Out-parameters are written on success only, but
 *   for a partial mesh that was asked for, which comes with the status of the limit.
 * - A function that takes a context leaves one line there about what went wrong:
 *   lapd_context_last_error. Functions without one fail only for their own arguments, which the
 *   status tells. There is no global state.
 * - NULL is refused with LAPD_ERROR_INVALID_ARGUMENT wherever the text does not allow it; so are
 *   numbers that are no value of their enum, which is why enums are passed as int32_t.
 * - Strings are UTF-8 and end with NUL. Lengths are in the world units of the image, angles in
 *   degrees.
 * - Structs with a struct_size may grow at their end: set it to sizeof before the call, and
 *   programs and libraries of different versions understand each other. What the library does not
 *   know yet reads 0.
 * - Images change only when their labels are named, meshes only by lapd_mesh_certify and
 *   lapd_mesh_split_interfaces; otherwise any number of threads may use them at once. Parameters
 *   and write options may be read by many threads as long as none changes them. A context belongs
 *   to one thread at a time, but for lapd_context_cancel.
 * - The library prints nothing, reads no environment, installs no signal handler, and does not
 *   end the process: memory that the system refuses is LAPD_ERROR_OUT_OF_MEMORY, in every call of
 *   the process that works at that moment.
 */";

fn generate(root: &Path) -> String {
    let mut config =
        cbindgen::Config::from_file(root.join("cbindgen.toml")).expect("cbindgen.toml is valid");
    config.header = Some(HEAD.into());
    config.after_includes = Some(format!(
        "\n/* The version of this header; lapd_version() is that of the library. */\n\
         #define LAPD_VERSION_MAJOR {}\n#define LAPD_VERSION_MINOR {}\n\
         #define LAPD_VERSION_PATCH {}\n#define LAPD_VERSION \"{}\"",
        env!("CARGO_PKG_VERSION_MAJOR"),
        env!("CARGO_PKG_VERSION_MINOR"),
        env!("CARGO_PKG_VERSION_PATCH"),
        env!("CARGO_PKG_VERSION"),
    ));
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in SOURCES {
        builder = builder.with_src(root.join(format!("src/capi/{source}.rs")));
    }
    let mut header = Vec::new();
    builder.generate().expect("src/capi can be parsed").write(&mut header);
    // cbindgen writes the cast without the parentheses that a macro needs.
    String::from_utf8(header)
        .expect("the header is UTF-8")
        .replace(" (size_t)-1\n", " ((size_t)-1)\n")
}

#[test]
fn header_is_up_to_date() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let path = root.join("include/lapd.h");
    let fresh = generate(root);
    if std::env::var_os("LAPD_UPDATE_HEADER").is_some() {
        std::fs::create_dir_all(root.join("include")).unwrap();
        std::fs::write(&path, &fresh).unwrap();
    }
    let committed = std::fs::read_to_string(&path).expect("include/lapd.h is there");
    let first = committed.lines().zip(fresh.lines()).position(|(a, b)| a != b);
    assert!(
        committed == fresh,
        "include/lapd.h is stale (first difference: line {first:?}); run LAPD_UPDATE_HEADER=1 \
         cargo test --test header"
    );
}

#[test]
fn every_exported_function_and_constant_is_in_the_header() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let header = generate(root);
    let mut exported = 0;
    for entry in std::fs::read_dir(root.join("src/capi")).unwrap() {
        let source = std::fs::read_to_string(entry.unwrap().path()).unwrap();
        // The attribute stands right before its function.
        for item in source.split("#[unsafe(no_mangle)]\n").skip(1) {
            let name = item
                .split("fn ")
                .nth(1)
                .and_then(|rest| rest.split('(').next())
                .expect("a function follows");
            assert!(header.contains(&format!("{name}(")), "{name} is not in the header");
            exported += 1;
        }
        // cbindgen leaves out what it cannot write in C, with no more than a warning.
        for constant in source.split("\npub const ").skip(1) {
            let name = constant.split(':').next().expect("a type follows");
            assert!(header.contains(&format!("#define {name} ")), "{name} is not in the header");
        }
        // It leaves out enums that no function names, too, because they are passed as int32_t.
        for item in source.split("\npub enum ").skip(1) {
            let name = item.split(' ').next().expect("a name follows");
            assert!(
                header.contains(&format!("}} {name};")),
                "{name} is not in the header: cbindgen.toml must list it"
            );
        }
    }
    assert!(exported > 50, "only {exported} exported functions found");
}

/// The comments of a header, and the rest.
fn comments_and_code(header: &str) -> (String, String) {
    let (mut comments, mut code) = (String::new(), String::new());
    let mut rest = header;
    while let Some((before, after)) = rest.split_once("/*") {
        let (comment, behind) = after.split_once("*/").expect("comments end");
        code += before;
        comments += comment;
        rest = behind;
    }
    (comments, code + rest)
}

fn words(text: &str) -> impl Iterator<Item = &str> {
    text.split(|c: char| !c.is_ascii_alphanumeric() && c != '_').filter(|word| !word.is_empty())
}

#[test]
fn comments_name_what_is_declared() {
    let header = generate(Path::new(env!("CARGO_MANIFEST_DIR")));
    let (comments, code) = comments_and_code(&header);
    let declared: HashSet<&str> = words(&code).collect();
    let mut named = 0;
    for word in
        words(&comments).filter(|word| word.starts_with("lapd_") || word.starts_with("LAPD_"))
    {
        // "lapd_params_set_..." and "lapd_params_set_*" stand for all that begin so.
        let known = match word.ends_with('_') {
            true => declared.iter().any(|name| name.starts_with(word)),
            false => declared.contains(word),
        };
        // What lapd_status_name says of a number that is no status.
        assert!(
            known || word == "LAPD_UNKNOWN_STATUS",
            "a comment names {word}, which the header does not declare"
        );
        named += 1;
    }
    assert!(named > 200, "only {named} names found in comments");
}

/// The functions of the header: the text before each, in one line, and its declaration.
fn functions(header: &str) -> Vec<(String, &str)> {
    let declarations =
        header.split_once("extern \"C\" {").expect("the functions stand in a block").1;
    let mut found = Vec::new();
    // Every declaration ends with ");", what precedes it since the last one is its comment.
    for piece in declarations.split_inclusive(");\n").filter(|piece| piece.ends_with(");\n")) {
        let Some((comment, declaration)) = piece.rsplit_once("*/\n") else { continue };
        let words = comment.split_whitespace().filter(|&word| word != "*");
        found.push((words.collect::<Vec<_>>().join(" "), declaration));
    }
    found
}

fn name_of(declaration: &str) -> &str {
    let head = declaration.split('(').next().expect("a declaration has parentheses");
    head.rsplit([' ', '*']).next().expect("it has a name")
}

#[test]
fn every_function_says_what_a_caller_must_know() {
    let header = generate(Path::new(env!("CARGO_MANIFEST_DIR")));
    let functions = functions(&header);
    assert!(functions.len() > 50, "only {} functions found", functions.len());
    for (text, declaration) in functions {
        let name = name_of(declaration);
        assert!(name.starts_with("lapd_") && text.contains("/**"), "{name} has no comment");
        let mut wanted = Vec::new();
        // Who may call it at the same time.
        if !["ny thread", "No other thread"].iter().any(|phrase| text.contains(phrase)) {
            wanted.push("which threads may call it (\"Any thread\", \"No other thread ...\")");
        }
        if declaration.starts_with("lapd_status") && !text.contains("Errors:") {
            wanted.push("its errors (\"Errors: ...\")");
        }
        // A handle or an array that it hands out.
        let handle = ["lapd_context **", "lapd_image **", "lapd_params **", "lapd_mesh **"];
        if handle.iter().any(|out| declaration.contains(out)) && !text.contains("The caller owns") {
            wanted.push("who owns the handle (\"The caller owns ...\")");
        }
        let lends = declaration.contains("const double **")
            || declaration.contains("32_t **")
            || declaration.contains("const char **")
            || declaration.starts_with("const char *");
        if lends && !text.contains("belongs to") && !text.contains("is static") {
            wanted.push("how long what it returns is valid (\"belongs to ...\")");
        }
        let array =
            name.starts_with("lapd_mesh_get_") && declaration.contains("size_t *count") && lends;
        if array && !text.contains("is [count]") {
            wanted.push("the shape of the array (\"is [count][3]\")");
        }
        assert!(wanted.is_empty(), "the comment of {name} does not say {}", wanted.join(", nor "));
    }
}

#[test]
fn lapd_hpp_uses_every_function() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let header = generate(root);
    let hpp = std::fs::read_to_string(root.join("include/lapd.hpp")).unwrap();
    let used: HashSet<&str> = words(&hpp).collect();
    // Views make copies of arrays a matter of the standard library.
    let wanted = functions(&header)
        .into_iter()
        .map(|(_, declaration)| name_of(declaration))
        .filter(|name| !name.starts_with("lapd_mesh_copy_"));
    let missing: Vec<&str> = wanted.filter(|name| !used.contains(name)).collect();
    assert!(missing.is_empty(), "include/lapd.hpp lacks {missing:?}");
}
