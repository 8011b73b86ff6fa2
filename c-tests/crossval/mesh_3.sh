#!/bin/sh
# lapd and CGAL's Mesh_3 on one image with the same bounds: prints a table, and fails where ours
# loses more labels than CGAL's or its mean surface distances are larger.
#
#   sh mesh_3.sh MESH_IMAGE CGAL_MESH_3 MEASURE WORK IMAGES NAME DELTA SIZE [FACET_SIZE
#       FACET_DISTANCE]
#
# NAME is aal, brain, abdomen, abdomen_3mm (looked for in LAPD_IMAGES, or in IMAGES), or balls, a
# phantom made here. Bounds are the same where both meshers have them: 30 degrees for facets, 2 for
# radius over edge, SIZE for circumradii, a quarter of DELTA for the facet distance. CGAL's facet
# size, which lapd has not, gives its mesh at least about as many tets as ours; FACET_SIZE and
# FACET_DISTANCE replace the two.
set -eu
mesh_image=$1 cgal_mesh_3=$2 measure=$3 work=$4 images=${LAPD_IMAGES:-$5} name=$6 delta=$7 size=$8
shift 8
facet_size=${1:-$(awk "BEGIN { print 1.14 * $delta }")}
facet_distance=${2:-$(awk "BEGIN { print 0.25 * $delta }")}
mkdir -p "$work"

# Three labels of 32^3 voxels: a ball of two halves inside a larger one.
balls() {
    printf 'NRRD0004\ntype: uchar\ndimension: 3\nsizes: 32 32 32\n'
    printf 'encoding: raw\nspacings: 1 1 1\n\n'
    awk 'BEGIN {
        for (z = -15.5; z < 16; z++) for (y = -15.5; y < 16; y++) for (x = -15.5; x < 16; x++) {
            r = x * x + y * y + z * z
            printf "%s", r < 49 ? (x < 0 ? "3" : "2") : r < 169 ? "1" : "0"
        }
    }' | tr '0123' '\000\001\002\003'
}
case $name in
balls)
    image=$work/balls.nrrd
    balls >"$image"
    ;;
aal) image=/usr/share/mricron/templates/aal.nii.gz ;;
brain | abdomen) image=$images/spl/$name.nrrd ;;
abdomen_3mm) image=$images/formats/$name.nii.gz ;;
*)
    echo "mesh_3.sh: unknown image $name" >&2
    exit 2
    ;;
esac
if [ ! -e "$image" ]; then
    echo "SKIPPED: comparison with Mesh_3 on $name, no file $image"
    exit 0
fi

"$mesh_image" "$image" -o "$work/ours.mesh" --delta "$delta" --size "$size" \
    --report "$work/ours.json" --quiet
"$cgal_mesh_3" "$image" -o "$work/cgal.mesh" --facet-size "$facet_size" \
    --facet-distance "$facet_distance" --cell-size "$size" \
    --parallel --threads 1 --report "$work/cgal.json"
echo "$name: lapd with delta $delta, size $size; Mesh_3 with facet size $facet_size," \
    "facet distance $facet_distance, cell size $size"
status=0
"$measure" "$image" "$work/ours.mesh" "$work/cgal.mesh" "$work/ours.json" || status=$?
rm -f "$work/ours.mesh" "$work/cgal.mesh"
exit "$status"
