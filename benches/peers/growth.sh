#!/bin/sh
# How our rate changes with the number of tets: one image, finer and finer; docs/notes/benchmarks.md
# says what is measured.
#
#   sh benches/peers/growth.sh [--runs 3] [--image abdomen] [--threads 1] [--from 250000]
#       [--to 16000000] [--print-only]
#
# Writes the table into docs/notes/benchmarks.md, and prints it. Images are looked for in
# LAPD_IMAGES or in ../shared/images.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
command -v python3 >/dev/null 2>&1 || {
    echo "benches/peers: python3 was not found; install python3" >&2
    exit 1
}
sh "$here/build.sh"
exec python3 -B "$here/peers.py" growth "$@"
