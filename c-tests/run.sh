#!/bin/sh
# Installs what is missing and runs every test, Rust and C. Ends with a line "N passed, N failed, N
# skipped"; the exit status is 0 only if none failed. What was not tested is said in lines that
# start with SKIPPED.
#
#   sh c-tests/run.sh          without ITK, VTK, OpenFOAM, DOLFINx, if not installed
#   sh c-tests/run.sh --all    installs these as well, 360 MB
#
# Logs are kept in build/logs. Real images are looked for in LAPD_IMAGES or in ../shared/images.
set -u

case $* in
'' | --all) all=$* ;;
*)
    echo "run.sh: unknown arguments '$*'; the only option is --all" >&2
    exit 2
    ;;
esac
root=$(cd "$(dirname "$0")/.." && pwd)
cd "$root" || exit 1
build=$root/build
logs=$build/logs
mkdir -p "$logs"
rm -f "$logs"/*
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin
# What is compiled once need not be kept in parts.
CARGO_INCREMENTAL=0
export CARGO_INCREMENTAL
cores=$(nproc 2>/dev/null || echo 1)
passed=0
failed=0
skipped=$logs/skipped
: >"$skipped"

have() {
    command -v "$1" >/dev/null 2>&1
}

skip() {
    echo "SKIPPED: $*" | tee -a "$skipped"
}

# begin NAME COMMAND...: runs a command beside what follows; "step NAME finish NAME" waits for it.
begin() {
    name=$1
    shift
    { "$@" >"$logs/$name.beside" 2>&1; echo $? >"$logs/$name.status"; } &
    eval "beside_$name=$!"
}
finish() {
    eval "wait \$beside_$1"
    cat "$logs/$1.beside"
    return "$(cat "$logs/$1.status")"
}

# step NAME COMMAND...: runs a command, shows its output only if it fails. Counts as one test,
# beside those that it may run.
step() {
    name=$1
    shift
    start=$(date +%s)
    if "$@" >"$logs/$name.log" 2>&1; then
        passed=$((passed + 1))
        printf 'ok      %-14s %4d s\n' "$name" $(($(date +%s) - start))
    else
        failed=$((failed + 1))
        printf 'FAILED  %-14s %4d s: %s\n' "$name" $(($(date +%s) - start)) "$*"
        # Of tests that failed, what they said; the end alone may be of later ones that passed.
        {
            grep -h -A 12 ' panicked at ' "$logs/$name.log" | head -n 60
            tail -n 60 "$logs/$name.log"
        } | sed 's/^/    /'
        return 1
    fi
}

# ---- What is needed ----

have cargo || {
    echo "run.sh: cargo was not found; install a Rust toolchain first (https://rustup.rs)" >&2
    exit 1
}
missing=
have cc || missing="$missing gcc libc6-dev"
have c++ || missing="$missing g++"
have make || missing="$missing make"
have cmake || missing="$missing cmake"
have pkg-config || missing="$missing pkg-config"
have nm || missing="$missing binutils"
have clang-format || missing="$missing clang-format"
have doxygen || missing="$missing doxygen"
have python3 || missing="$missing python3"
# What readback.py and solvers.py need: CalculiX, virtual environments, and the libraries that the
# gmsh module from PyPI links to.
have ccx || missing="$missing calculix-ccx"
python3 -c 'import ensurepip' >/dev/null 2>&1 || missing="$missing python3-venv"
for pair in libGL.so.1=libgl1 libGLU.so.1=libglu1-mesa libgomp.so.1=libgomp1 \
    libXcursor.so.1=libxcursor1 libXft.so.2=libxft2 \
    libXinerama.so.1=libxinerama1; do
    PATH=$PATH:/sbin ldconfig -p | grep -q "${pair%=*}" || missing="$missing ${pair#*=}"
done
pkg-config --exists hwloc libudev 2>/dev/null || missing="$missing libhwloc-dev libudev-dev"
pkg-config --exists hdf5-serial 2>/dev/null || pkg-config --exists hdf5 2>/dev/null ||
    missing="$missing libhdf5-dev"
if [ -n "$all" ]; then
    ls /usr/lib/*/cmake/ITK-5* >/dev/null 2>&1 || missing="$missing libinsighttoolkit5-dev"
    ls /usr/lib/*/cmake/vtk-9* >/dev/null 2>&1 || missing="$missing libvtk9-dev"
    have checkMesh || missing="$missing openfoam"
    [ -e /usr/share/doc/python3-dolfinx ] || missing="$missing python3-dolfinx"
    have xvfb-run || missing="$missing xvfb xauth libgl1-mesa-dri"
fi
have abidiff || missing="$missing abigail-tools"
have valgrind || missing="$missing valgrind"
[ -e /usr/share/mricron/templates/aal.nii.gz ] || missing="$missing mricron-data"
[ -e /usr/include/CGAL/version.h ] || missing="$missing libcgal-dev"
[ -e /usr/include/tbb/version.h ] || missing="$missing libtbb-dev"
[ -e /usr/include/tetgen.h ] || missing="$missing libtet1.5-dev"
if [ -n "$missing" ]; then
    echo "installing$missing"
    sudo=
    [ "$(id -u)" -eq 0 ] || sudo=sudo
    install_packages() {
        # Word splitting is wanted: one word for each package.
        $sudo apt-get update -q &&
            DEBIAN_FRONTEND=noninteractive $sudo apt-get install -q -y \
                --no-install-recommends $missing
    }
    step apt install_packages
fi

# Every dependency of every feature, so that nothing asks the registry later: the test of licences
# reads them all, also those that nothing here compiles. A registry that does not answer is asked
# twice more.
fetch() {
    host=$(rustc -vV | sed -n 's/^host: //p')
    for pause in 10 60; do
        cargo fetch --locked --target "$host" && return
        sleep $pause
    done
    cargo fetch --locked --target "$host"
}
step fetch fetch

# What tests in Python need, meshio among it.
python=$build/readback-venv
step python-env python3 c-tests/environment.py "$python"
grep -h '^SKIPPED' "$logs/python-env.log" | tee -a "$skipped"

# HDF5 for XDMF and VTKHDF. Debian has variants beside each other: cargo is told where that without
# MPI is, as CMakeLists.txt tells it.
hdf5=OFF
if pkg-config --exists hdf5-serial 2>/dev/null; then
    HDF5_DIR=$(pkg-config --libs-only-L hdf5-serial | sed 's/^-L//; s/ .*//')
    export HDF5_DIR
    hdf5=ON
elif pkg-config --exists hdf5 2>/dev/null; then
    hdf5=ON
else
    skip "XDMF and VTKHDF, libhdf5-dev is missing"
fi

# The package, which is built and installed as users do. Whole-program optimisation keeps one core
# busy; the other one goes on.
build_package() {
    cmake -S . -B "$build/cmake" -DCMAKE_BUILD_TYPE=Release -DLAPD_HDF5=$hdf5 \
        -DCMAKE_INSTALL_PREFIX="$build/install" -DCMAKE_INSTALL_LIBDIR=lib \
        -DLAPD_CARGO_TARGET_DIR="$root/target" && cmake --build "$build/cmake" &&
        cmake --install "$build/cmake"
}
begin package build_package

# One build of the library serves the tests of all features.
features=simulation,force-conflicts
if pkg-config --exists hwloc libudev; then
    features=$features,hwloc
else
    skip "the feature hwloc, libhwloc-dev or libudev-dev is missing"
fi
[ $hdf5 = OFF ] || features=$features,hdf5

# ---- Form ----

if cargo fmt --version >/dev/null 2>&1; then
    step rustfmt cargo fmt --check
else
    skip "rustfmt, this toolchain has none (rustup component add rustfmt)"
fi
if have clang-format; then
    step clang-format clang-format --dry-run -Werror include/*.hpp examples/*.c examples/*.cpp \
        examples/*.hpp examples/*.h c-tests/*.c c-tests/*.cpp \
        c-tests/*.h c-tests/consumer/*.c c-tests/consumer/*.cpp c-tests/crossval/*.cpp \
        c-tests/crossval/*.hpp
else
    skip "clang-format is missing"
fi
if cargo clippy --version >/dev/null 2>&1; then
    step clippy cargo clippy --quiet --locked --all-targets -- -D warnings
    step clippy-features cargo clippy --quiet --locked --all-targets \
        --features "$features,memory-reserve" -- -D warnings
else
    skip "clippy, this toolchain has none (rustup component add clippy)"
fi

# ---- The pages of the interfaces ----

if have doxygen; then
    step api-pages sh docs/api/build.sh
else
    skip "the pages of the interfaces, doxygen is missing"
fi

# ---- Rust: unit tests, the stale header, licences, real images ----

build_tests_of_rust() {
    cargo test --locked --features "$features" --no-run
}
conflicts() {
    LAPD_FORCE_CONFLICTS=1 cargo test --locked --features "$features" --no-fail-fast \
        --test podm --test lapd
}
cargo_tests() {
    PATH=$python/bin:$PATH cargo test --locked --features "$features" --no-fail-fast -- \
        --show-output
}
step cargo-build build_tests_of_rust
# The same tests of threads once more while locks are refused at random (verification/run.sh).
begin conflicts conflicts
step cargo-test cargo_tests
sum() {
    sed -n "s/^test result: .* \([0-9][0-9]*\) $1;.*/\1/p" "$logs/cargo-test.log" |
        awk '{ n += $1 } END { print n + 0 }'
}
passed=$((passed + $(sum passed)))
failed=$((failed + $(sum failed)))
grep -h '^ *SKIPPED' "$logs/cargo-test.log" | sort -u | tee -a "$skipped"

step conflicts finish conflicts
# Models of the coordination between workers, in all orders of steps.
step loom sh verification/run.sh loom

# ---- C: build and install as users do, then the tests ----

build_examples() {
    cmake -S examples -B "$build/examples" -DCMAKE_BUILD_TYPE=Release \
        -DCMAKE_PREFIX_PATH="$build/install" \
        -DCMAKE_RUNTIME_OUTPUT_DIRECTORY="$build/bin" -DCMAKE_C_FLAGS=-Werror &&
        cmake --build "$build/examples"
}
build_tests() {
    cmake -S c-tests -B "$build/c-tests" -DCMAKE_PREFIX_PATH="$build/install" \
        -DLAPD_INSTALLED="$build/install" \
        -DLAPD_BUILD_TREE="$build/cmake" -DLAPD_CARGO_TARGET_DIR="$root/target" \
        -DMESH_IMAGE="$build/bin/mesh_image" &&
        cmake --build "$build/c-tests" --parallel "$cores"
}
if step package finish package && step examples build_examples && step c-build build_tests; then
    step ctest ctest --test-dir "$build/c-tests" --output-on-failure --timeout 300 \
        --parallel "$cores"
    c_total=$(grep -c -E '^ *[0-9]+/[0-9]+ Test +#[0-9]+:' "$logs/ctest.log")
    c_passed=$(grep -c -E '^ *[0-9]+/[0-9]+ Test +#[0-9]+:.* Passed ' "$logs/ctest.log")
    passed=$((passed + c_passed))
    failed=$((failed + c_total - c_passed))
    grep -h '^SKIPPED' "$build/c-tests/Testing/Temporary/LastTest.log" | tee -a "$skipped"
else
    skip "the C tests, because the build failed"
fi

# ---- Sum ----

echo "$passed passed, $failed failed, $(wc -l <"$skipped") skipped"
[ "$failed" -eq 0 ]
