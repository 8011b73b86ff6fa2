#!/bin/sh
# Makes a Python wheel that runs on any Linux with glibc 2.17 or later (manylinux_2_17), as PyPI
# takes them.
#
#   sh packaging/wheel.sh [OUT]    OUT is the folder for it, build/wheel if left out
#
# Needs a Rust toolchain and python3 with venv; Zig's linker, which knows older versions of glibc,
# and what links by it (ziglang, cargo-zigbuild) come from PyPI into an environment of their own.
# LAPD_CARGO_TARGET_DIR says where cargo builds.
set -eu

root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "${1:-$root/build/wheel}"
out=$(cd "${1:-$root/build/wheel}" && pwd)
target=${LAPD_CARGO_TARGET_DIR:-$root/target}
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin

command -v cargo >/dev/null 2>&1 || {
    echo "wheel.sh: cargo was not found; install a Rust toolchain (https://rustup.rs)" >&2
    exit 1
}
host=$(rustc -vV | sed -n 's/^host: //p')
machine=${host%%-*}
python3 -m venv "$out/environment" || {
    echo "wheel.sh: python3 cannot make environments; install its module venv" >&2
    exit 1
}
python=$out/environment/bin/python
"$python" -m pip install --quiet --disable-pip-version-check ziglang cargo-zigbuild auditwheel \
    wheel 'setuptools>=77'
PATH=$out/environment/bin:$PATH
cargo zigbuild --release --locked --lib --features memory-reserve --target "$host.2.17" \
    --manifest-path "$root/Cargo.toml" --target-dir "$target"
library=$target/$host/release/liblapd.so
strip -o "$out/liblapd.so" "$library"
python3 "$root/packaging/licenses.py" "$out/licenses"
rm -f "$out"/*.whl
LAPD_PREBUILT=$out/liblapd.so LAPD_LICENSES=$out/licenses "$python" -m pip wheel \
    --quiet --disable-pip-version-check --no-deps --no-build-isolation -w "$out" \
    --config-settings=--build-option=--plat-name="manylinux_2_17_$machine" "$root/python"
"$python" -m auditwheel show "$out"/*.whl
