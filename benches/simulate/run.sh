#!/bin/sh
# Refinement by more workers than this machine has cores, simulated in virtual time; docs/scaling.md says what that means, and has what comes out.
#
#   sh benches/simulate/run.sh [PART...] [--images abdomen,brain] [--tets 20000] [--rounds 1] [--jobs 2] [--print-only]
#
#   check      one and two simulated workers beside one and two real threads
#   blacklight the paper's Tables 1 and 2: constants fitted to its rows of PODM, its rows of LAPD predicted
#   size       how losses shrink when each worker has more tets
#   today      a machine of two sockets, 16 memory nodes and 256 cores; and one of 1024 cores
#
# Without a part all. Writes tables into docs/scaling.md and plots into docs/pictures. At 20,000 tets for each worker blacklight takes half an hour on two cores, the rest as long again; runs
# that were made before with the same binary and options are not repeated (build/simulate). Plots need matplotlib.
set -eu
cd "$(dirname "$0")/../.."
command -v python3 >/dev/null 2>&1 || {
    echo "benches: python3 was not found; install python3" >&2
    exit 1
}
cargo build --locked --release --features simulation --example simulate
exec python3 -B benches/simulate/study.py "$@"
