//! Everything that is linked into the library is under a permissive licence; tools used by tests
//! alone may be weakly copyleft.

use std::collections::{BTreeSet, HashMap};
use std::process::Command;

use serde_json::Value;

/// Allowed in what is shipped.
const SHIPPED: [&str; 9] = [
    "MIT",
    "Apache-2.0",
    "BSD-2-Clause",
    "BSD-3-Clause",
    "ISC",
    "Zlib",
    "0BSD",
    "Unlicense",
    "Unicode-3.0",
];
/// Allowed besides in what tests use (cbindgen).
const TESTS_ONLY: [&str; 1] = ["MPL-2.0"];

fn metadata() -> Value {
    let rustc = Command::new(option_env!("RUSTC").unwrap_or("rustc"))
        .arg("-vV")
        .output()
        .expect("rustc runs");
    let version = String::from_utf8(rustc.stdout).unwrap();
    let host =
        version.lines().find_map(|line| line.strip_prefix("host: ")).expect("rustc names its host");
    let output = Command::new(env!("CARGO"))
        .args([
            "metadata",
            "--format-version",
            "1",
            "--locked",
            "--all-features",
            "--filter-platform",
            host,
        ])
        .current_dir(env!("CARGO_MANIFEST_DIR"))
        .output()
        .expect("cargo runs");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    serde_json::from_slice(&output.stdout).expect("cargo metadata is JSON")
}

/// The packages reached from `root`; through development dependencies too if `tests`.
fn reachable(metadata: &Value, tests: bool) -> BTreeSet<String> {
    let nodes: HashMap<&str, &Value> = metadata["resolve"]["nodes"]
        .as_array()
        .unwrap()
        .iter()
        .map(|node| (node["id"].as_str().unwrap(), node))
        .collect();
    let mut found = BTreeSet::new();
    let mut open = vec![metadata["resolve"]["root"].as_str().expect("the package is the root")];
    while let Some(id) = open.pop() {
        if !found.insert(id.to_owned()) {
            continue;
        }
        for dependency in nodes[id]["deps"].as_array().unwrap() {
            let kinds = dependency["dep_kinds"].as_array().unwrap();
            if tests || kinds.iter().any(|kind| kind["kind"] != "dev") {
                open.push(dependency["pkg"].as_str().unwrap());
            }
        }
    }
    found
}

fn refused(metadata: &Value, tests: bool) -> Vec<String> {
    let reached = reachable(metadata, tests);
    let allowed =
        |licence: &str| SHIPPED.contains(&licence) || (tests && TESTS_ONLY.contains(&licence));
    let mut lines = Vec::new();
    for package in metadata["packages"].as_array().unwrap() {
        if !reached.contains(package["id"].as_str().unwrap()) {
            continue;
        }
        let text = package["license"].as_str().unwrap_or("");
        let fits = spdx::Expression::parse_mode(text, spdx::ParseMode::LAX).is_ok_and(|e| {
            e.evaluate(|request| request.license.id().is_some_and(|id| allowed(id.name)))
        });
        if !fits {
            lines.push(format!("{} {}: {text:?}", package["name"], package["version"]));
        }
    }
    lines
}

#[test]
fn licences_of_all_dependencies_are_allowed() {
    let metadata = metadata();
    assert!(reachable(&metadata, false).len() > 5, "the dependency tree was not read");
    assert_eq!(refused(&metadata, false), Vec::<String>::new(), "in what is shipped");
    assert_eq!(refused(&metadata, true), Vec::<String>::new(), "in what tests use");
}
