#!/bin/sh
# Makes the packages: lapd-VERSION-linux-MACHINE.tar.gz, liblapd0.1, liblapd-dev and lapd-tools.
#
#   sh packaging/make.sh [OUT]    OUT is the folder for them, build/packages if left out
#
# Needs Debian or a system made from it, a Rust toolchain, a C compiler, make, CMake 3.22 or later,
# python3, dpkg-dev and file. They need no more than the C library: hwloc is left out.
# LAPD_CARGO_TARGET_DIR says where cargo builds, LAPD_CONTACT who makes the packages.
set -eu

root=$(cd "$(dirname "$0")/.." && pwd)
mkdir -p "${1:-$root/build/packages}"
out=$(cd "${1:-$root/build/packages}" && pwd)
target=${LAPD_CARGO_TARGET_DIR:-$root/target}
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin

fail() {
    echo "make.sh: $*" >&2
    exit 1
}

for pair in cargo=rustc cc=gcc make=make cmake=cmake python3=python3 dpkg-shlibdeps=dpkg-dev \
    file=file readelf=binutils; do
    command -v "${pair%=*}" >/dev/null 2>&1 ||
        fail "${pair%=*} was not found; install it (Debian: apt-get install ${pair#*=})"
done

# make GENERATOR CMAKE_ARGUMENT...: builds, and packs what is installed. The second tree finds the
# library compiled.
make_packages() {
    generator=$1
    shift
    cmake -S "$root" -B "$out/tree/$generator" -DCMAKE_BUILD_TYPE=Release -DLAPD_PACKAGES=ON \
        -DLAPD_HWLOC=OFF -DLAPD_CARGO_TARGET_DIR="$target" \
        ${LAPD_CONTACT:+"-DCPACK_PACKAGE_CONTACT=$LAPD_CONTACT"} "$@"
    cmake --build "$out/tree/$generator"
    cpack --config "$out/tree/$generator/CPackConfig.cmake" -G "$generator" -B "$out/tree/cpack"
}

rm -rf "$out/tree"
# With the prefix /usr CMake uses Debian's folders, lib/x86_64-linux-gnu among them.
make_packages DEB -DCMAKE_INSTALL_PREFIX=/usr
make_packages TGZ -DCMAKE_INSTALL_PREFIX=/opt/lapd -DCMAKE_INSTALL_LIBDIR=lib
rm -f "$out"/*.deb "$out"/*.tar.gz
mv "$out"/tree/cpack/*.deb "$out"/tree/cpack/*.tar.gz "$out"
rm -rf "$out/tree"
echo "made:"
ls -l "$out"/*.deb "$out"/*.tar.gz
