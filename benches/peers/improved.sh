#!/bin/sh
# Our mesher with its removal of slivers against CGAL's Mesh_3 with its perturbation and exudation,
# both as they come; docs/notes/benchmarks.md has the tables. Images are looked for in LAPD_IMAGES
# or in ../shared/images.
#
#   sh benches/peers/improved.sh [--images aal,brain,abdomen] [--threads 1] [--tets 500000]
#       [--print-only]
set -eu
here=$(cd "$(dirname "$0")" && pwd)
command -v python3 >/dev/null 2>&1 || {
    echo "benches/peers: python3 was not found; install python3" >&2
    exit 1
}
sh "$here/build.sh" peers
exec python3 -B "$here/peers.py" improved "$@"
