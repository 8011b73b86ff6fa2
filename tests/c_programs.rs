//! The headers and the smallest example, by the C and C++ compilers at hand: what a first program
//! that embeds the library needs. Broader tests of the C interface are in c-tests.

use std::path::Path;
use std::process::Command;

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// A call of the compiler with warnings as errors; what it makes goes to `folder`.
fn compiler(is_cpp: bool, standard: &str, folder: &Path) -> Command {
    let target = env!("TARGET_FOR_TESTS");
    let mut build = cc::Build::new();
    build.cpp(is_cpp).target(target).host(target).opt_level(0).out_dir(folder);
    let mut command = build.get_compiler().to_command();
    command.args([standard, "-Wall", "-Wextra", "-Wpedantic", "-Werror"]);
    command.arg(format!("-I{}", root().join("include").display())).current_dir(folder);
    command
}

/// Runs a command, which is to succeed.
fn run(mut command: Command) {
    let what: Vec<_> = std::iter::once(command.get_program()).chain(command.get_args()).collect();
    let what = format!("{what:?}");
    let output = command.output().unwrap_or_else(|error| panic!("{what}: {error}"));
    assert!(
        output.status.success(),
        "{what}\n{}{}",
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr)
    );
}

#[test]
fn headers_compile_alone_in_every_standard() {
    let folder = tempfile::tempdir().unwrap();
    for (is_cpp, header, standards) in [
        (false, "lapd.h", &["-std=c99", "-std=c11", "-std=c17"][..]),
        (true, "lapd.h", &["-std=c++11", "-std=c++17", "-std=c++20"]),
        (true, "lapd.hpp", &["-std=c++17", "-std=c++20"]),
    ] {
        let source = folder.path().join(if is_cpp { "alone.cpp" } else { "alone.c" });
        std::fs::write(&source, format!("#include <{header}>\n")).unwrap();
        for standard in standards {
            let mut command = compiler(is_cpp, standard, folder.path());
            command.arg("-fsyntax-only").arg(&source);
            run(command);
        }
    }
}

#[test]
fn the_smallest_example_runs() {
    let folder = tempfile::tempdir().unwrap();
    // Cargo puts the shared library beside the programs of tests. Its soname has a version.
    let library = std::env::current_exe().unwrap().with_file_name("liblapd.so");
    let (major, minor) = (env!("CARGO_PKG_VERSION_MAJOR"), env!("CARGO_PKG_VERSION_MINOR"));
    let abi = if major == "0" { format!("0.{minor}") } else { major.to_owned() };
    for name in ["liblapd.so".to_owned(), format!("liblapd.so.{abi}")] {
        std::fs::hard_link(&library, folder.path().join(&name))
            .or_else(|_| std::fs::copy(&library, folder.path().join(&name)).map(|_| ()))
            .unwrap_or_else(|error| panic!("{}: {error}", library.display()));
    }
    let mut command = compiler(false, "-std=c11", folder.path());
    command.arg(root().join("examples/minimal.c")).args(["-o", "minimal", "-L.", "-llapd", "-lm"]);
    run(command);
    let mut program = Command::new(folder.path().join("minimal"));
    program.env("LD_LIBRARY_PATH", folder.path()).current_dir(folder.path());
    run(program);
    assert!(folder.path().join("ball.vtu").is_file());
}
