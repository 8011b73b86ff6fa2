#!/bin/sh
# From a fresh clone to a mesh: installs what is missing, builds, installs under build/, meshes an
# image.
#
#   sh examples/quickstart.sh                     the AAL atlas of Debian's mricron-data, delta 1,
#                                                 size 2
#   sh examples/quickstart.sh IMAGE [OPTION ...]  an image of yours; options as mesh_image --help
#                                                 says
#
# Needs Debian (or another system with apt) and a Rust toolchain. Writes build/out/NAME.vtu and
# NAME.json.
set -eu

root=$(cd "$(dirname "$0")/.." && pwd)
build=$root/build
atlas=/usr/share/mricron/templates/aal.nii.gz
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin

say() {
    printf '\n== %s\n' "$*"
}

have() {
    command -v "$1" >/dev/null 2>&1
}

have cargo || {
    echo "quickstart: cargo was not found; install a Rust toolchain first (https://rustup.rs)" >&2
    exit 1
}

missing=
have cc || missing="$missing gcc libc6-dev"
have make || missing="$missing make"
have cmake || missing="$missing cmake"
# With hwloc the library knows what cores share, and --topology works.
have pkg-config || missing="$missing pkg-config"
pkg-config --exists hwloc libudev 2>/dev/null || missing="$missing libhwloc-dev libudev-dev"
# With HDF5 it writes XDMF and VTKHDF.
pkg-config --exists hdf5-serial 2>/dev/null || pkg-config --exists hdf5 2>/dev/null ||
    missing="$missing libhdf5-dev"
if [ $# -eq 0 ]; then
    [ -e "$atlas" ] || missing="$missing mricron-data"
fi
if [ -n "$missing" ]; then
    say "Installing$missing"
    sudo=
    if [ "$(id -u)" -ne 0 ]; then
        have sudo || {
            echo "quickstart: please install these packages as root:$missing" >&2
            exit 1
        }
        sudo=sudo
    fi
    $sudo apt-get update -q >"${TMPDIR:-/tmp}/lapd-apt.$$" 2>&1 &&
        # Word splitting is wanted: one word for each package.
        DEBIAN_FRONTEND=noninteractive $sudo apt-get install -q -y --no-install-recommends \
            $missing \
            >>"${TMPDIR:-/tmp}/lapd-apt.$$" 2>&1 || {
        tail -n 20 "${TMPDIR:-/tmp}/lapd-apt.$$" >&2
        exit 1
    }
    rm -f "${TMPDIR:-/tmp}/lapd-apt.$$"
fi

say "Building the library (about two minutes)"
hdf5=OFF
if pkg-config --exists hdf5-serial 2>/dev/null || pkg-config --exists hdf5 2>/dev/null; then
    hdf5=ON
fi
cmake -S "$root" -B "$build/cmake" -DCMAKE_BUILD_TYPE=Release -DLAPD_HDF5=$hdf5 \
    -DCMAKE_INSTALL_PREFIX="$build/install" \
    -DCMAKE_INSTALL_LIBDIR=lib -DLAPD_CARGO_TARGET_DIR="$root/target" --log-level=WARNING >/dev/null
cmake --build "$build/cmake"
cmake --install "$build/cmake" >/dev/null

say "Building the example"
cmake -S "$root/examples" -B "$build/examples" -DCMAKE_BUILD_TYPE=Release \
    -DCMAKE_PREFIX_PATH="$build/install" \
    -DCMAKE_RUNTIME_OUTPUT_DIRECTORY="$build/bin" --log-level=WARNING >/dev/null
cmake --build "$build/examples" --target mesh_image >/dev/null

if [ $# -eq 0 ]; then
    set -- "$atlas" --delta 1 --size 2
fi
image=$1
shift
name=$(basename "$image")
name=${name%.gz}
name=${name%.*}
mkdir -p "$build/out"

say "Meshing $image"
"$build/bin/mesh_image" "$image" -o "$build/out/$name.vtu" --report "$build/out/$name.json" "$@"

say "Written"
echo "$build/out/$name.vtu    the mesh, for ParaView and others"
echo "$build/out/$name.json   the report"
