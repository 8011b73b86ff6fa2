#!/bin/sh
# Makes the packages and uses them as their users do: sh packages.sh SOURCE WORK CARGO_TARGET_DIR
#
# The Debian packages are unpacked, not installed, so that nothing on this machine changes. What is
# installed on it for development is not found: each consumer sees the unpacked tree alone.
set -eu
source=$1 work=$2 target=$3
rm -rf "$work"
mkdir -p "$work"

fail() {
    echo "packages: $*"
    exit 1
}

# Runs a command, and shows what it printed only if it fails.
quietly() {
    "$@" >>"$work/log" 2>&1 || {
        cat "$work/log"
        fail "$* failed"
    }
}

for tool in dpkg-deb dpkg-shlibdeps file pkg-config python3; do
    command -v $tool >/dev/null 2>&1 || {
        echo "SKIPPED: packages, $tool is missing (Debian: dpkg-dev, file, pkg-config, python3)"
        exit 0
    }
done

LAPD_CARGO_TARGET_DIR=$target
export LAPD_CARGO_TARGET_DIR
quietly sh "$source/packaging/make.sh" "$work/packages"

# ---- What the Debian packages say of themselves ----

version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$source/Cargo.toml" | head -n 1)
# Before 1.0 the soname has the minor version.
case $version in
0.*) abi=${version%.*} ;;
*) abi=${version%%.*} ;;
esac
deb=$work/deb
for package in "liblapd$abi" liblapd-dev lapd-tools; do
    file=$(echo "$work/packages/${package}_$version"-*.deb)
    [ -e "$file" ] || fail "$package was not made"
    for field in Maintainer Section Description Depends; do
        [ -n "$(dpkg-deb -f "$file" $field)" ] || fail "$package has no $field"
    done
    dpkg-deb -x "$file" "$deb"
    [ -s "$deb/usr/share/doc/$package/copyright" ] || fail "$package has no copyright"
    echo "$package: $(dpkg-deb -f "$file" Depends)"
done
# No more than what is on every Debian.
dpkg-deb -f "$work/packages/liblapd$abi"_*.deb Depends | tr ',' '\n' | sed 's/^ *//; s/ .*//' |
    while read -r name; do
        case $name in
        libc6 | libgcc-s1) ;;
        *) fail "liblapd$abi needs $name" ;;
        esac
    done
dpkg-deb -f "$work/packages/"liblapd-dev_*.deb Depends | grep -q "liblapd$abi (= " ||
    fail "liblapd-dev does not need its own version of the library"
if command -v lintian >/dev/null 2>&1; then
    lintian --allow-root "$work/packages/"*.deb 2>/dev/null || true
fi

# ---- The archive, where it was not made for ----

mkdir -p "$work/somewhere else"
tar -xzf "$work/packages/"lapd-*.tar.gz -C "$work/somewhere else"
archive=$(echo "$work/somewhere else/lapd-$version"-*)

# ---- Both trees ----

# Only the system's libraries, and lapd itself.
check_libraries() {
    LD_LIBRARY_PATH=$2 ldd "$1" >"$work/ldd" 2>/dev/null
    system='libc|libm|libgcc_s|ld-linux[^.]*|linux-vdso'
    if grep -v -E "^[[:space:]]*([^ ]*/)?($system|liblapd)\.so" "$work/ldd"; then
        fail "$1 needs these libraries"
    fi
    if grep 'not found' "$work/ldd"; then
        fail "$1 does not find its libraries"
    fi
}

# A box of label 1 with one of label 2 in it, 12 voxels wide.
{
    printf 'NRRD0004\ntype: uchar\ndimension: 3\nsizes: 12 12 12\nencoding: raw\n'
    printf 'spacings: 1 1 1\n\n'
    awk 'BEGIN {
        for (z = 0; z < 12; z++) for (y = 0; y < 12; y++) for (x = 0; x < 12; x++) {
            outer = x > 0 && x < 11 && y > 0 && y < 11 && z > 0 && z < 11
            inner = x > 3 && x < 8 && y > 3 && y < 8 && z > 3 && z < 8
            printf "%s", inner ? "2" : outer ? "1" : "0"
        }
    }' | tr '012' '\000\001\002'
} >"$work/box.nrrd"

mkdir "$work/consumer"
cat >"$work/consumer/CMakeLists.txt" <<END
cmake_minimum_required(VERSION 3.22)
project(consumer LANGUAGES C)
find_package(lapd $abi CONFIG REQUIRED NO_DEFAULT_PATH PATHS "\${TREE}")
add_executable(shared "$source/examples/minimal.c")
target_link_libraries(shared PRIVATE lapd::lapd)
add_executable(static "$source/examples/minimal.c")
target_link_libraries(static PRIVATE lapd::lapd_static)
END

# use NAME TREE LIBRARIES SEARCH: builds consumers against the tree, whose libraries are in the
# folder LIBRARIES, and runs what comes out. SEARCH is what LD_LIBRARY_PATH has to be for programs
# of the package.
use() {
    name=$1 tree=$2 libraries=$3 search=$4
    built=$work/built-$name
    mkdir "$built"
    cd "$built"
    quietly cmake -S "$work/consumer" -B "$built/cmake" -DTREE="$tree" -DCMAKE_BUILD_TYPE=Release
    quietly cmake --build "$built/cmake"
    # pkg-config tells of the tree alone, by paths that lead from lapd.pc. What it prints has
    # quotes, which only eval reads.
    PKG_CONFIG_LIBDIR=$libraries/pkgconfig
    export PKG_CONFIG_LIBDIR
    eval "quietly cc -std=c11 '$source/examples/minimal.c' -o '$built/pkg-config' \
        $(pkg-config --cflags --libs lapd)"
    eval "quietly cc -std=c11 '$source/examples/minimal.c' -o '$built/pkg-config-static' \
        $(pkg-config --cflags lapd) '$libraries/liblapd.a' \
        $(pkg-config --libs --static lapd | sed 's/-llapd//')"
    for program in cmake/shared cmake/static pkg-config pkg-config-static; do
        LD_LIBRARY_PATH=$libraries quietly "$built/$program"
        [ -s "$built/ball.vtu" ] || fail "$name: $program wrote no mesh"
        rm "$built/ball.vtu"
        check_libraries "$built/$program" "$libraries"
    done

    mesh_image=$tree/bin/mesh_image
    LD_LIBRARY_PATH=$search
    export LD_LIBRARY_PATH
    [ "$("$mesh_image" --version | head -n 1)" = "$version" ] || fail "$name: --version is wrong"
    "$mesh_image" --help | grep -q 'usage:' || fail "$name: --help prints no usage"
    quietly "$mesh_image" "$work/box.nrrd" -o "$built/box.vtu"
    [ -s "$built/box.vtu" ] || fail "$name: mesh_image wrote no mesh"
    unset LD_LIBRARY_PATH
    check_libraries "$mesh_image" "$search"
    check_libraries "$libraries/liblapd.so.$abi" ""

    # Nothing names the machine that built it, and nothing is left for debuggers.
    find "$tree" -type f >"$work/files"
    while read -r path; do
        for place in "$source" "$target" "$work" "${CARGO_HOME:-$HOME/.cargo}"; do
            if strings -a "$path" | grep -F "$place/"; then
                fail "$path holds a path of this machine"
            fi
        done
    done <"$work/files"
    for path in "$libraries/liblapd.so.$abi" "$libraries/liblapd.a" "$mesh_image"; do
        readelf -S -W "$path" >"$work/sections" 2>/dev/null
        if grep -E '\.(debug_info|debug_line|llvmbc)' "$work/sections" >"$work/left"; then
            head -n 3 "$work/left"
            fail "$path is not stripped"
        fi
    done
    find "$tree" -name THIRD-PARTY.txt | grep -q . || fail "$name: no licences of what is linked"
    cd "$work"
    echo "$name: library $(wc -c <"$libraries/liblapd.so.$abi") bytes," \
        "static $(wc -c <"$libraries/liblapd.a") bytes"
}

# Only an installed library is where the system looks.
libraries=$(dirname "$(find "$deb" -name liblapd.a)")
use deb "$deb/usr" "$libraries" "$libraries"
# The program of the archive finds the library by itself.
use archive "$archive" "$archive/lib" ""
readelf -d "$archive/bin/mesh_image" | grep -q 'R.*PATH.*\[\$ORIGIN/\.\./lib\]' ||
    fail "mesh_image does not look for the library beside itself"
