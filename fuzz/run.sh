#!/bin/sh
# Fuzzes each target for some seconds, two at a time, by a stable toolchain: libFuzzer, with the
# compiler's coverage pass. With nightly, `cargo fuzz run TARGET` does the same under a sanitizer.
#
#   sh fuzz/run.sh [SECONDS] [TARGET ...]        60 seconds for each of all targets
#
# They begin with what fuzz/seeds.py writes, the committed corpus included. What was found to be of
# interest is kept in build/fuzz/corpus/TARGET. An input that fails is in build/fuzz, and the script
# ends with an error.
set -eu
cd "$(dirname "$0")/.."
root=$(pwd)
PATH=$PATH:${CARGO_HOME:-$HOME/.cargo}/bin
seconds=${1:-60}
[ $# -eq 0 ] || shift
[ $# -gt 0 ] || set -- read_nrrd read_nifti read_metaimage read_inr read_npy read_tiff \
    c_calls

work=$root/build/fuzz
mkdir -p "$work"
coverage="-Cpasses=sancov-module -Cllvm-args=-sanitizer-coverage-level=4"
coverage="$coverage -Cllvm-args=-sanitizer-coverage-inline-8bit-counters"
coverage="$coverage -Cllvm-args=-sanitizer-coverage-pc-table --cfg fuzzing"
# A target of its own, so that build scripts and macros are built without coverage.
host=$(rustc -vV | sed -n 's/^host: //p')
RUSTFLAGS=$coverage cargo build --quiet --release --locked --manifest-path fuzz/Cargo.toml \
    --target "$host" --target-dir "$work/target"

python3 fuzz/seeds.py "$work/seeds"

# One target; its log tells how many inputs were tried.
fuzz() {
    mkdir -p "$work/corpus/$1"
    (cd "$work" && "target/$host/release/$1" "corpus/$1" "seeds/$1" \
        -max_total_time="$seconds" -timeout=20 -rss_limit_mb=3000 -max_len=4096 \
        -artifact_prefix="$work/$1-" >"$1.log" 2>&1) || {
        tail -n 30 "$work/$1.log"
        echo "fuzz: $1 failed, see $work/$1.log"
        return 1
    }
    echo "fuzz: $1 $(sed -n 's/^Done \([0-9]*\) runs in.*/\1 inputs/p' "$work/$1.log"), none failed"
}

failed=0
while [ $# -gt 0 ]; do
    fuzz "$1" &
    first=$!
    shift
    if [ $# -gt 0 ]; then
        fuzz "$1" || failed=1
        shift
    fi
    wait $first || failed=1
done
exit $failed
