#!/bin/sh
# Tests of the package, one at a time: sh packaging.sh TEST SOURCE INSTALLED WORK [CARGO_TARGET_DIR]
set -eu
test=$1 source=$2 installed=$3 work=$4/$1 target=${5-}
rm -rf "$work"
mkdir -p "$work"

# Builds the consumer project with more CMake arguments, and runs what comes out.
consume() {
    cmake -S "$source/c-tests/consumer" -B "$work/build" "$@" --log-level=WARNING >"$work/log" 2>&1 &&
        cmake --build "$work/build" >>"$work/log" 2>&1 || {
        cat "$work/log"
        exit 1
    }
    for program in c_lapd c_lapd_static cpp_lapd cpp_lapd_static; do
        "$work/build/$program"
    done
    ldd "$work/build/c_lapd" | grep -q 'liblapd\.so\.[0-9.]* => /'
    if ldd "$work/build/c_lapd_static" | grep liblapd; then
        echo "the static program needs the shared library"
        exit 1
    fi
}

case $test in
find_package)
    consume -DCMAKE_PREFIX_PATH="$installed"
    ;;
moved)
    # An install tree can be moved.
    cp -R "$installed" "$work/elsewhere"
    if grep -rIl "$installed" "$work/elsewhere/lib/cmake" "$work/elsewhere/lib/pkgconfig"; then
        echo "these files name the place of installation"
        exit 1
    fi
    consume -DCMAKE_PREFIX_PATH="$work/elsewhere"
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
add_subdirectory)
    consume -DCONSUMER_SOURCE="$source" -DLAPD_CARGO_TARGET_DIR="$target"
    ;;
pkg_config)
    PKG_CONFIG_PATH=$installed/lib/pkgconfig
    export PKG_CONFIG_PATH
    [ "$(pkg-config --modversion lapd)" = "$(sed -n 's/^version = "\(.*\)"/\1/p' "$source/Cargo.toml" | head -n 1)" ]
    # Word splitting is wanted: pkg-config prints several options.
    cc -std=c11 -Wall -Wextra -Wpedantic -Werror "$source/c-tests/consumer/main.c" -o "$work/shared" \
        $(pkg-config --cflags --libs lapd)
    LD_LIBRARY_PATH=$installed/lib "$work/shared"
    cc -std=c11 "$source/c-tests/consumer/main.c" -o "$work/static" $(pkg-config --cflags lapd) \
        "$installed/lib/liblapd.a" $(pkg-config --libs --static lapd | sed 's/-llapd//')
    "$work/static"
    ;;
symbols)
    # The shared library exports the functions of the header, and nothing else.
    nm -D --defined-only "$installed/lib/liblapd.so" | awk '{print $3}' | sed 's/@.*//' | sort >"$work/exported"
    sed -n 's/^[a-z].*[ *]\(lapd_[a-z0-9_]*\)(.*/\1/p' "$installed/include/lapd.h" | grep -v '_fn$' | sort >"$work/declared"
    [ "$(wc -l <"$work/declared")" -gt 50 ]
    diff "$work/exported" "$work/declared"
    ;;
libraries)
    # It needs the system's libraries only, and says its own versioned name.
    readelf -d "$installed/lib/liblapd.so" >"$work/dynamic"
    sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' "$work/dynamic" >"$work/needed"
    if grep -v -E '^(libc|libm|libgcc_s|libpthread|libdl|librt|libutil|ld-linux[^.]*)\.so\.' "$work/needed"; then
        echo "these libraries are not the system's"
        exit 1
    fi
    soname=$(sed -n 's/.*(SONAME).*\[\(.*\)\]/\1/p' "$work/dynamic")
    echo "soname $soname"
    [ "$soname" != liblapd.so ] && [ -e "$installed/lib/$soname" ]
    ;;
*)
    echo "unknown test $test" >&2
    exit 2
    ;;
esac
