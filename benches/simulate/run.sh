#!/bin/sh
# Refinement by more workers than this machine has cores, simulated in virtual time;
# docs/notes/scaling.md says what that means, and has what comes out.
#
#   sh benches/simulate/run.sh [PART...] [--images abdomen,brain] [--tets 32000] [--meshes 3]
#       [--rounds 3] [--jobs 2] [--print-only]
#
#   check      one and two simulated workers beside one and two real threads
#   blacklight the paper's Tables 1 and 2: constants fitted to its rows of PODM, its rows of LAPD
#       predicted
#   size       how losses shrink when each worker has more tets
#   today      a machine of two sockets, 16 memory nodes and 256 cores; and one of 1024 cores
#
# Without a part all. Writes tables into docs/notes/scaling.md and plots into docs/pictures. --tets
# is for each of the 192 or 256 workers of a table's largest row. With 32,000 each of the --meshes
# of blacklight's 28 rows takes half a minute to a minute of one core, and its fit some more of
# them; each run is kept (build/simulate) but those of check, which time real threads, so that a
# study that was interrupted goes on, and one that was completed only writes. A look at whether all
# works, in a minute:
#
#   sh benches/simulate/run.sh blacklight --tets 500 --rounds 1 --print-only
#
# Plots need matplotlib.
set -eu
cd "$(dirname "$0")/../.."
command -v python3 >/dev/null 2>&1 || {
    echo "benches: python3 was not found; install python3" >&2
    exit 1
}
cargo build --locked --release --features simulation --example simulate
exec python3 -B benches/simulate/study.py "$@"
