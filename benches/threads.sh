#!/bin/sh
# What threads bring, and with what they lose time; docs/notes/benchmarks.md says what is measured.
#
#   sh benches/threads.sh [--runs 5] [--images aal,brain,abdomen] [--tets 1000000,4000000]
#       [--threads 1,2] [--print-only]
#   sh benches/threads.sh managers [--runs 3] [--image abdomen] [--tets 1000000]
#       [--threads 2,4,8,16] [--print-only]
#   sh benches/threads.sh scaling [--runs 3] [--images aal,brain,abdomen] [--tets 4000000]
#       [--tets-per-thread 1000000] [--threads 1,2,4,8,16] [--print-only]
#
# Writes tables into docs/notes/benchmarks.md, and prints them. Images are looked for in LAPD_IMAGES
# or in ../shared/images.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
command -v python3 >/dev/null 2>&1 || {
    echo "benches: python3 was not found; install python3" >&2
    exit 1
}
case "${1:-}" in
managers | scaling) ;;
*) set -- speedup "$@" ;;
esac
sh "$here/peers/build.sh"
exec python3 -B "$here/threads.py" "$@"
