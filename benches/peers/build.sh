#!/bin/sh
# Builds what the benches beside it and ../threads.sh run: our library and mesh_image, as users
# install them, under build/; with `peers`, CGAL's programs too.
#
#   sh benches/peers/build.sh [peers | hwloc]
#
# With `hwloc` the library knows synthetic machines.
set -eu

root=$(cd "$(dirname "$0")/../.." && pwd)
build=$root/build
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin

# need COMMAND PACKAGE
need() {
    command -v "$1" >/dev/null 2>&1 || {
        echo "benches/peers: $1 was not found; install $2" >&2
        exit 1
    }
}
# header FILE PACKAGE
header() {
    echo "#include <$1>" | c++ -E -x c++ - >/dev/null 2>&1 || {
        echo "benches/peers: there is no header $1; install $2" >&2
        exit 1
    }
}
# quietly COMMAND...: shows what it said only if it fails.
quietly() {
    "$@" >"$build/peers.log" 2>&1 || {
        tail -n 40 "$build/peers.log" >&2
        echo "benches/peers: failed: $*" >&2
        exit 1
    }
}

need cargo "a Rust toolchain (https://rustup.rs)"
need cmake cmake
need make make
need cc gcc
need c++ g++
mkdir -p "$build"
hwloc=OFF
if [ "${1:-}" = hwloc ]; then
    header hwloc.h libhwloc-dev
    header libudev.h libudev-dev
    hwloc=ON
fi
quietly cmake -S "$root" -B "$build/cmake" -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_INSTALL_PREFIX="$build/install" -DCMAKE_INSTALL_LIBDIR=lib \
    -DLAPD_CARGO_TARGET_DIR="$root/target" -DLAPD_HWLOC=$hwloc
quietly cmake --build "$build/cmake"
quietly cmake --install "$build/cmake"
quietly cmake -S "$root/examples" -B "$build/examples" -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_PREFIX_PATH="$build/install" \
    -DCMAKE_RUNTIME_OUTPUT_DIRECTORY="$build/bin"
quietly cmake --build "$build/examples" --target mesh_image

if [ "${1:-}" = peers ]; then
    header CGAL/version.h libcgal-dev
    header tbb/version.h libtbb-dev
    quietly cmake -S "$root/benches/peers" -B "$build/peers" -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_PREFIX_PATH="$build/install"
    quietly cmake --build "$build/peers"
fi
