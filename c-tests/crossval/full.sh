#!/bin/sh
# The cross-validation at full resolution: AAL, brain and abdomen against CGAL and TetGen, and the
# tables of the comparison with Mesh_3. Takes ten to twenty minutes.
#
#   sh c-tests/crossval/full.sh
#
# after c-tests/run.sh, which builds what is needed. Images are looked for in LAPD_IMAGES or in
# ../shared/images. The facet sizes and distances give CGAL's meshes about as many tets as ours
# have.
set -u
root=$(cd "$(dirname "$0")/../.." && pwd)
bin=$root/build/c-tests/crossval
status=0
for image in 'aal 1 2 0.982 0.22' 'abdomen 1.25 2.5 0.98 0.221' 'brain 1 2 0.898 0.202'; do
    # Word splitting is wanted: name, delta, size, facet size, facet distance.
    set -- $image
    for program in delaunay tetgen surfaces; do
        echo "== $program $1"
        "$bin/crossval_$program" "$1" "$2" "$3" || status=1
    done
    echo "== Mesh_3 $1"
    sh "$root/c-tests/crossval/mesh_3.sh" "$root/build/bin/mesh_image" "$bin/peers/cgal_mesh_3" \
        "$bin/crossval_measure" "$bin/mesh_3.full" \
        "$root/../shared/images" "$@" || status=1
done
exit $status
