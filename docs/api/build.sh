#!/bin/sh
# Builds the pages of the interfaces: build/api/c by Doxygen (C and C++), build/api/rust by rustdoc.
# A warning of either ends it, and so does a link that leads nowhere.
#
#   sh docs/api/build.sh
#
# Needs doxygen, python3 and a Rust toolchain.
set -eu
cd "$(dirname "$0")/../.."
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin

rm -rf build/api
mkdir -p build/api
doxygen docs/api/Doxyfile
RUSTDOCFLAGS="-D warnings" cargo doc --quiet --locked --no-deps --lib
cp -R "${CARGO_TARGET_DIR:-target}/doc" build/api/rust
python3 docs/api/check_links.py build/api/c build/api/rust/lapd
echo "build/api/c/index.html and build/api/rust/lapd/index.html"
