#!/usr/bin/env python3
"""Writes the licences of everything that is linked into the library.

    python3 packaging/licenses.py OUT [--features LIST] [--target TARGET] [--cargo CARGO]

OUT is a folder. It gets THIRD-PARTY.txt, the licences of the crates, and, where the toolchain has
it, RUST-STANDARD-LIBRARY.html, the notices of Rust's standard library.

Needs Python 3.9 alone. cargo is asked offline first, because a build has fetched the crates.
"""

import argparse
import json
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
NAMES = re.compile(r"(licen[sc]e|copying|copyright|notice|unlicense)", re.IGNORECASE)
NOTICES = "RUST-STANDARD-LIBRARY.html"
RULE = "=" * 80


def fail(message):
    sys.exit(f"licenses.py: {message}")


def run(command):
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True)


def ask(cargo, arguments):
    """What cargo prints, asked without the network first."""
    for offline in (["--offline"], []):
        result = run([cargo, *arguments, "--locked", *offline])
        if result.returncode == 0:
            return result.stdout
    return fail(f"cargo {arguments[0]} failed:\n{result.stderr}")


def linked(cargo, features, target):
    """Names and versions of the crates that are linked.

    Macros and what build scripts use run while the library is built, and stay behind.
    """
    arguments = ["tree", "--edges", "normal,no-proc-macro", "--prefix", "none"]
    arguments += ["--features", features, "--format", "{p}"]
    if target:
        arguments += ["--target", target]
    found = set()
    for line in ask(cargo, arguments).splitlines():
        name, version, *rest = line.split()
        if rest != [f"({ROOT})"]:
            found.add((name, version.removeprefix("v")))
    return found


def texts(package):
    """The texts of a crate's licences, by the names of their files."""
    folder = Path(package["manifest_path"]).parent
    paths = {path for path in folder.iterdir() if path.is_file() and NAMES.match(path.name)}
    if package["license_file"]:
        paths.add(folder / package["license_file"])
    return [path.read_text(encoding="utf-8", errors="replace").strip() for path in sorted(paths)]


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("out", type=Path)
    parser.add_argument("--features", default="memory-reserve", help="features of the build")
    parser.add_argument("--target", help="the target of the build, if it is not this machine")
    parser.add_argument("--cargo", default="cargo")
    arguments = parser.parse_args()

    crates = linked(arguments.cargo, arguments.features, arguments.target)
    # Only this tells where the sources are, vendored or not.
    metadata = json.loads(ask(arguments.cargo, ["metadata", "--format-version", "1",
                                                "--features", arguments.features]))
    packages = [package for package in metadata["packages"]
                if (package["name"], package["version"]) in crates]
    packages.sort(key=lambda package: (package["name"], package["version"]))
    if len(packages) != len(crates):
        fail(f"cargo tree names {len(crates)} crates, cargo metadata knows {len(packages)} of them")

    # Many crates have the same text.
    crates_of_text = {}
    for package in packages:
        title = f"{package['name']} {package['version']}"
        found = texts(package)
        if not found:
            fail(f"{title} has no file with its licence; find out what it is, and add it here")
        for text in found:
            crates_of_text.setdefault(text, []).append(title)

    version = run(["rustc", "--version"]).stdout.strip()
    sysroot = Path(run(["rustc", "--print", "sysroot"]).stdout.strip())
    notices = sysroot / "share/doc/rust/COPYRIGHT-library.html"
    arguments.out.mkdir(parents=True, exist_ok=True)
    lines = ["These works of others are linked into lapd.", ""]
    lines += [f"{package['name']} {package['version']}: {package['license']}"
              for package in packages]
    lines += ["", f"The standard library of Rust ({version}): MIT OR Apache-2.0, with parts under"]
    lines += ["other permissive licences."]
    if notices.exists():
        shutil.copyfile(notices, arguments.out / NOTICES)
        lines += [f"{NOTICES} has its notices."]
    else:
        (arguments.out / NOTICES).unlink(missing_ok=True)
        lines += ["Its notices: https://github.com/rust-lang/rust/blob/master/COPYRIGHT"]
    for text, titles in crates_of_text.items():
        lines += ["", RULE, *titles, RULE, "", text]
    path = arguments.out / "THIRD-PARTY.txt"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    print(f"{path}: {len(packages)} crates, {len(crates_of_text)} texts")


if __name__ == "__main__":
    main()
