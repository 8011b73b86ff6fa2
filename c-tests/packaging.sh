#!/bin/sh
# Tests of the package, one at a time: sh packaging.sh TEST SOURCE INSTALLED UNINSTALLED WORK
# CARGO_TARGET_DIR
#
# INSTALLED and UNINSTALLED are the install tree and the build tree of a release build. Tests whose
# name ends in _debug use a debug build of lapd, of which debug_tree makes both under WORK; all
# build in one cargo target folder, so that cargo compiles little more than once for each of the two
# profiles.
set -eu
test=$1 source=$2 installed=$3 uninstalled=$4 work=$5/$1 target=$6
debug=$5/debug_tree
rm -rf "$work"
mkdir -p "$work"

# Debug builds are of the package, not of the code.
CARGO_PROFILE_DEV_OPT_LEVEL=0
export CARGO_PROFILE_DEV_OPT_LEVEL
case $test in
*_debug) build_type=Debug installed=$debug/install uninstalled=$debug/build ;;
*) build_type=Release ;;
esac

# Runs a command, and shows what it printed only if it fails.
quietly() {
    "$@" >>"$work/log" 2>&1 || {
        cat "$work/log"
        exit 1
    }
}

# The four programs of a user, C11 and C++17, shared and static, run.
run_programs() {
    for program in c_lapd c_lapd_static cpp_lapd cpp_lapd_static; do
        "$work/build/$program"
    done
    ldd "$work/build/c_lapd" | grep -q 'liblapd\.so\.[0-9.]* => /'
    for program in c_lapd_static cpp_lapd_static; do
        if ldd "$work/build/$program" | grep liblapd; then
            echo "$program needs the shared library"
            exit 1
        fi
    done
}

# consume WAY [CMAKE_ARGUMENT...]: builds the consumer project, and runs what comes out.
consume() {
    way=$1
    shift
    quietly cmake -S "$source/c-tests/consumer" -B "$work/build" -DCMAKE_BUILD_TYPE=$build_type \
        -DCONSUMER_WAY="$way" \
        -DLAPD_CARGO_TARGET_DIR="$target" "$@"
    quietly cmake --build "$work/build"
    run_programs
}

# The same by hand, with what pkg-config says. $1: where lapd.pc is, $2: where the libraries are.
consume_pkg_config() {
    PKG_CONFIG_PATH=$1
    export PKG_CONFIG_PATH
    [ "$(pkg-config --modversion lapd)" = \
        "$(sed -n 's/^version = "\(.*\)"/\1/p' "$source/Cargo.toml" | head -n 1)" ]
    mkdir "$work/build"
    optimise=-O2
    [ $build_type = Release ] || optimise=-g
    warnings="-Wall -Wextra -Wpedantic -Werror"
    for language in c cpp; do
        if [ $language = c ]; then
            compile="cc -std=c11 $source/c-tests/consumer/main.c"
        else
            compile="c++ -std=c++17 $source/c-tests/consumer/main.cpp"
        fi
        # Word splitting is wanted: pkg-config prints several options.
        quietly $compile $optimise $warnings -o "$work/build/${language}_lapd" \
            $(pkg-config --cflags --libs lapd) \
            "-Wl,-rpath,$(pkg-config --variable=libdir lapd)"
        quietly $compile $optimise $warnings -o "$work/build/${language}_lapd_static" \
            $(pkg-config --cflags lapd) "$2/liblapd.a" \
            $(pkg-config --libs --static lapd | sed 's/-llapd//')
    done
    run_programs
}

case $test in
debug_tree)
    quietly cmake -S "$source" -B "$work/build" -DCMAKE_BUILD_TYPE=Debug \
        -DCMAKE_INSTALL_PREFIX="$work/install" \
        -DCMAKE_INSTALL_LIBDIR=lib -DLAPD_CARGO_TARGET_DIR="$target"
    quietly cmake --build "$work/build"
    quietly cmake --install "$work/build"
    ;;
find_package | find_package_debug)
    consume find_package -DCMAKE_PREFIX_PATH="$installed"
    ;;
uninstalled | uninstalled_debug)
    consume find_package -Dlapd_DIR="$uninstalled"
    ;;
add_subdirectory | add_subdirectory_debug)
    consume add_subdirectory -DCONSUMER_SOURCE="$source"
    ;;
fetch_source | fetch_source_debug)
    consume fetch_source -DCONSUMER_SOURCE="$source"
    ;;
fetch_url_debug)
    # An archive of the tree needs nothing that is not in it. In debug only: cargo compiles what
    # lies in another folder again.
    tar -C "$source" --exclude=./build --exclude=./target --exclude=./.git \
        -czf "$work/lapd.tar.gz" .
    consume fetch_url -DCONSUMER_URL="file://$work/lapd.tar.gz"
    ;;
pkg_config | pkg_config_debug)
    consume_pkg_config "$installed/lib/pkgconfig" "$installed/lib"
    ;;
pkg_config_uninstalled | pkg_config_uninstalled_debug)
    consume_pkg_config "$uninstalled" "$uninstalled/lib"
    ;;
pkg_config_absolute)
    # Folders may be given by absolute paths, outside of the prefix. What lapd.pc says of them is
    # known without building.
    quietly cmake -S "$source" -B "$work/build" -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_INSTALL_PREFIX="$work/prefix" \
        -DCMAKE_INSTALL_LIBDIR="$work/there/lib" \
        -DCMAKE_INSTALL_INCLUDEDIR="$work/elsewhere/include" \
        -DLAPD_CARGO_TARGET_DIR="$target"
    PKG_CONFIG_PATH=$work/build/package
    export PKG_CONFIG_PATH
    [ "$(pkg-config --variable=libdir lapd)" = "$work/there/lib" ]
    [ "$(pkg-config --variable=includedir lapd)" = "$work/elsewhere/include" ]
    [ "$(pkg-config --variable=prefix lapd)" = "$work/prefix" ]
    ;;
moved)
    # An install tree can be moved.
    cp -R "$installed" "$work/elsewhere"
    if grep -rIl "$installed" "$work/elsewhere/lib/cmake" "$work/elsewhere/lib/pkgconfig"; then
        echo "these files name the place of installation"
        exit 1
    fi
    consume find_package -DCMAKE_PREFIX_PATH="$work/elsewhere"
    ;;
version)
    # Another version is not taken.
    cat >"$work/CMakeLists.txt" <<'END'
cmake_minimum_required(VERSION 3.22)
project(version LANGUAGES C)
find_package(lapd 99.0 CONFIG)
if(lapd_FOUND)
    message(FATAL_ERROR "version 99.0 was found")
endif()
END
    cmake -S "$work" -B "$work/build" -DCMAKE_PREFIX_PATH="$installed" >"$work/log" 2>&1 || {
        cat "$work/log"
        exit 1
    }
    ;;
symbols)
    # The shared library exports the functions of the header, and nothing else.
    nm -D --defined-only "$installed/lib/liblapd.so" | awk '{print $3}' |
        sed 's/@.*//' | sort >"$work/exported"
    sed -n 's/^[a-z].*[ *]\(lapd_[a-z0-9_]*\)(.*/\1/p' "$installed/include/lapd.h" |
        grep -v '_fn$' | sort >"$work/declared"
    [ "$(wc -l <"$work/declared")" -gt 50 ]
    diff "$work/exported" "$work/declared"
    ;;
libraries)
    # It needs the system's libraries, hwloc and HDF5 only, and says its own versioned name.
    readelf -d "$installed/lib/liblapd.so" >"$work/dynamic"
    sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' "$work/dynamic" >"$work/needed"
    system=libc:libm:libgcc_s:libpthread:libdl:librt:libutil:libhwloc:libhdf5[a-z_]*
    if grep -v -E "^($(echo $system | tr : "|")|ld-linux[^.]*)\.so\." \
        "$work/needed"; then
        echo "these libraries are not the system's"
        exit 1
    fi
    # Nor does it hold paths of the machine that built it.
    for path in "$source" "$target" "${CARGO_HOME:-$HOME/.cargo}"; do
        if strings "$installed/lib/liblapd.so" | grep -F "$path/"; then
            echo "the library holds the path $path"
            exit 1
        fi
    done
    soname=$(sed -n 's/.*(SONAME).*\[\(.*\)\]/\1/p' "$work/dynamic")
    echo "soname $soname"
    [ "$soname" != liblapd.so ] && [ -e "$installed/lib/$soname" ]
    ;;
*)
    echo "unknown test $test" >&2
    exit 2
    ;;
esac
