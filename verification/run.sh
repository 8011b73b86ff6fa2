#!/bin/sh
# Checks of the parallel code that take longer than tests, or need more than a stable toolchain:
#
#   loom        models of locks, contention, begging and the end, in all orders of steps
#               (verification/loom)
#   conflicts   tests/podm.rs and tests/lapd.rs with locks that refuse at random, at every step of
#               an operation
#   features    tests of the cargo features simulation, and hwloc where it is installed (Debian:
#               libhwloc-dev, libudev-dev): unit tests, which then are also those of src/simulation
#               and src/system/hwloc.rs
#   sanitizer   tests/podm.rs and tests/lapd.rs under ThreadSanitizer, standard library included;
#               needs its sources: rustup component add rust-src
#
# Usage: sh verification/run.sh [PART...]; without arguments all. Ends with 0 if all passed. What
# was not checked is said in lines that start with SKIPPED.
#
# ThreadSanitizer knows the atomics and their order. It finds what two threads do to plain memory:
# lists, gifts, scratch, chunks when they are made and freed, callbacks. The records of vertices and
# tets are atomics throughout, so that a wrong step of the locking protocol is no data race; that is
# what the other two parts and the validator are for.
set -eu
cd "$(dirname "$0")/.."
if [ $# -eq 0 ]; then
    set -- loom conflicts features sanitizer
fi

# One build for all parts, that of c-tests/run.sh.
features=simulation,force-conflicts
if pkg-config --exists hwloc libudev; then
    features=$features,hwloc
else
    echo "SKIPPED: the feature hwloc, libhwloc-dev or libudev-dev is missing"
fi

sanitizer() {
    if [ ! -e "$(rustc --print sysroot)/lib/rustlib/src/rust/library/Cargo.lock" ]; then
        echo "SKIPPED: ThreadSanitizer, the sources of the standard library are missing" \
            "(rustup component add rust-src)"
        return
    fi
    host=$(rustc -vV | sed -n 's/^host: //p')
    # Times are compared in other builds.
    RUSTC_BOOTSTRAP=1 RUSTFLAGS=-Zsanitizer=thread LAPD_STRESS_RUNS=60 \
        CARGO_TARGET_DIR=target/sanitizer \
        cargo test --locked -Zbuild-std --target "$host" --test podm --test lapd -- \
        --test-threads=1 --skip crawl
}

for part in "$@"; do
    echo "== $part"
    case $part in
    loom) cargo test --locked --release --manifest-path verification/loom/Cargo.toml ;;
    conflicts)
        LAPD_FORCE_CONFLICTS=1 cargo test --locked --features "$features" --test podm --test lapd
        ;;
    features) cargo test --locked --features "$features" --lib -- --show-output ;;
    sanitizer) sanitizer ;;
    *)
        echo "run.sh: no part $part; there are loom, conflicts, features, sanitizer" >&2
        exit 2
        ;;
    esac
done
