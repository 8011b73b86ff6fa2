#!/bin/sh
# The paper's experiments (section 5) with threads: both algorithms beside each other;
# docs/notes/benchmarks.md says what is measured.
#
#   sh benches/experiments.sh weak [--runs 3] [--images abdomen,brain] [--tets-per-thread 1000000]
#       [--threads 1,2,4,8,16] [--print-only]
#   sh benches/experiments.sh nodes [--runs 3] [--images abdomen,brain] [--tets 1000000]
#       [--nodes 2,4,8,12] [--threads-per-node 1] [--print-only]
#
# weak: Tables 1 and 2, and the overheads of Fig. 7b, to the number of cores. nodes: accesses to
# other nodes' memory on synthetic machines; needs hwloc (Debian: libhwloc-dev, libudev-dev). Writes
# tables into docs/notes/benchmarks.md, and prints them. Images are looked for in LAPD_IMAGES or in
# ../shared/images.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
command -v python3 >/dev/null 2>&1 || {
    echo "benches: python3 was not found; install python3" >&2
    exit 1
}
case "${1:-}" in
nodes) sh "$here/peers/build.sh" hwloc ;;
weak) sh "$here/peers/build.sh" ;;
*) set -- --help ;;
esac
exec python3 -B "$here/experiments.py" "$@"
