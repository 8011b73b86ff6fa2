#!/bin/sh
# Our refinement and CGAL's on the same image at about as many tets, in turn, so that whatever else the machine does slows both.
#
#   sh benches/cgal/compare.sh IMAGE DELTA SIZE FACET_SIZE FACET_DISTANCE CELL_SIZE [RUNS]
#
# DELTA and SIZE are ours, the three after them CGAL's criteria (README.md has a table); RUNS is 3 unless given. Both use one thread, CGAL
# with Parallel_tag. Needs build/bin/mesh_image and build/cgal/cgal_mesh_3. Prints every run, then medians, the best, and their ratios; million
# tets per second are those of the labels' tets, over the time of refinement alone and, for ours, with the oracle that CGAL has not.
set -eu

root=$(cd "$(dirname "$0")/../.." && pwd)
if [ $# -lt 6 ] || [ $# -gt 7 ]; then
    sed -n 's/^#   //p' "$0" >&2
    exit 2
fi
image=$1 delta=$2 size=$3 facet_size=$4 facet_distance=$5 cell_size=$6 runs=${7:-3}
for program in "$root/build/bin/mesh_image" "$root/build/cgal/cgal_mesh_3"; do
    [ -x "$program" ] || {
        echo "compare.sh: $program was not built, see README.md" >&2
        exit 1
    }
done
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# number NAME FILE: the first number of that name in a report.
number() {
    sed -n "s/.*\"$1\": \([0-9][0-9.e+-]*\).*/\1/p" "$2" | head -n 1
}

printf '%-6s %10s %10s %12s %12s %12s\n' run tets facets 'refine s' 'M tets/s' 'with oracle'
# row NAME REPORT: one line, kept for the medians. CGAL builds nothing before it refines: its time with the oracle is the same.
row() {
    tets=$(number tets "$2") seconds=$(number refine "$2") oracle=$(number distance "$2")
    facets=$(number interface_facets "$2")
    echo "$1 $tets $facets $seconds ${oracle:-0}" |
        awk '{ printf "%-6s %10d %10d %12.3f %12.3f %12.3f\n", $1, $2, $3, $4, $2 / $4 / 1e6, $2 / ($4 + $5) / 1e6 }' |
        tee -a "$work/rows"
}
run=0
while [ "$run" -lt "$runs" ]; do
    run=$((run + 1))
    "$root/build/bin/mesh_image" "$image" -o "$work/mesh.vtu" --delta "$delta" --size "$size" --threads 1 --quiet \
        --report "$work/ours.json"
    row lapd "$work/ours.json"
    "$root/build/cgal/cgal_mesh_3" "$image" --facet-size "$facet_size" --facet-distance "$facet_distance" \
        --cell-size "$cell_size" --parallel --threads 1 --report "$work/cgal.json"
    row CGAL "$work/cgal.json"
done

# median NAME COLUMN
median() {
    awk -v name="$1" -v column="$2" '$1 == name { print $column }' "$work/rows" | sort -g |
        awk '{ value[NR] = $1 } END { print NR % 2 ? value[(NR + 1) / 2] : (value[NR / 2] + value[NR / 2 + 1]) / 2 }'
}
# The best run is the one that other work on the machine disturbed least.
best() {
    awk -v name="$1" -v column="$2" '$1 == name && $column > most { most = $column } END { print most }' "$work/rows"
}
for name in lapd CGAL; do
    echo "median $name: $(median $name 2) tets, $(median $name 4) s, $(median $name 5) M tets/s, with oracle $(median $name 6);" \
        "best $(best $name 5), $(best $name 6)"
done
for of in median best; do
    echo "$of $($of lapd 5) $($of CGAL 5) $($of lapd 6) $($of CGAL 6) $($of lapd 2) $($of CGAL 2)" |
        awk '{ printf "%s lapd / CGAL: %.2f in tets/s (%.2f with oracle), %.3f in tets\n", $1, $2 / $3, $4 / $5, $6 / $7 }'
done
