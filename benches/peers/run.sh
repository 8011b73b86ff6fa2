#!/bin/sh
# Our mesher against CGAL's Mesh_3 and CGAL's Delaunay triangulation, in turn, on the same images;
# docs/notes/benchmarks.md says what is measured.
#
#   sh benches/peers/run.sh [--runs 5] [--images aal,brain,abdomen] [--threads 1] [--tets 1000000]
#       [--print-only]
#
# Writes the tables into docs/notes/benchmarks.md, and prints them. Images are looked for in
# LAPD_IMAGES or in ../shared/images.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
command -v python3 >/dev/null 2>&1 || {
    echo "benches/peers: python3 was not found; install python3" >&2
    exit 1
}
sh "$here/build.sh" peers
exec python3 -B "$here/peers.py" compare "$@"
