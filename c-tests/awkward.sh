#!/bin/sh
# Every file of the folders awkward and formats of the real images, through the example program:
# each ends within 5 s of processor time and 2 GiB of address space, either in a mesh whose report
# is flawless (exit status 0), or in one line on stderr that says what is wrong and no mesh (exit
# status 1). Warnings may come on top. sh awkward.sh MESH_IMAGE WORK IMAGES
set -u
mesh_image=$1 work=$2 images=${LAPD_IMAGES:-$3}
if [ ! -d "$images/awkward" ]; then
    echo "SKIPPED: awkward images, no folder $images/awkward"
    exit 0
fi
images=$(cd "$images" && pwd)
have_python=yes
command -v python3 >/dev/null 2>&1 || {
    have_python=no
    echo "SKIPPED: the reports of awkward images, python3 is missing"
}
rm -rf "$work"
mkdir -p "$work"
cd "$work" || exit 1
failed=0
files=0

fail() {
    echo "FAILED: $*"
    failed=1
}

# The exit status that a file must give; empty where either will do.
wanted_status() {
    case $1 in
    ok.nii.gz | nifti_checkerboard.nii.gz | nifti_single_slice.nii.gz | \
        nifti_negative_label.nii.gz) echo 0 ;;
    BallBinary*minus_five.nhdr) echo 1 ;;
    BallBinary*.nrrd | BallBinary*.nhdr | BallBinary*.nii.gz | abdomen_3mm.nii.gz) echo 0 ;;
    # What is missing, cut off or contradicts itself is never meshed in part.
    empty* | *truncated* | lfs_pointer* | *all_background* | *bad_magic* | *dim0_is_0* | \
        *nonintegral* | *singular*) echo 1 ;;
    *past_end* | *mismatch* | *header_only* | *overflow* | *unknown_encoding* | *.raw | LICENSE*) \
        echo 1 ;;
    esac
}

check_report() {
    [ "$have_python" = no ] || python3 - "$1" <<'END'
import json
import sys

with open(sys.argv[1], encoding="utf-8") as file:
    report = json.load(file)
certificate = report["certificate"]
for flaw in "non_delaunay_facets inverted_tets orphan_vertices open_edges".split():
    assert certificate[flaw] == 0, (flaw, certificate[flaw])
assert not any(certificate["unmet"].values()), certificate["unmet"]
assert report["tets"] > 0 and report["quality"]["max_radius_edge"] <= 4.000001, report["quality"]
# All that is left below the target is listed.
improvement = report["improvement"]
assert report["quality"]["min_dihedral"] >= 14.9999 or improvement["left"] > 0, improvement
assert report["quality"]["min_facet_angle"] >= 29.99999, report["quality"]
# delta is one and a half voxels.
assert certificate["hausdorff_mesh_to_image"] <= report["delta"], certificate
mesh = sum(row["mesh_volume"] for row in report["labels"])
image = sum(row["image_volume"] for row in report["labels"])
assert 0.5 * image < mesh < 1.05 * image, (mesh, image)
END
}

for image in "$images"/awkward/* "$images"/formats/*; do
    name=$(basename "$image")
    files=$((files + 1))
    rm -f mesh.vtu report.json
    (
        # KiB, and seconds of processor time, which other work on the machine does not count to;
        # timeout is for what hangs.
        ulimit -v 2097152
        ulimit -t 5
        exec timeout -s KILL 60 "$mesh_image" "$image" -o mesh.vtu --report report.json --quiet \
            >out 2>err
    )
    status=$?
    wanted=$(wanted_status "$name")
    [ "$status" -eq "${wanted:-$status}" ] || fail \
        "$name: exit status $status, wanted $wanted: $(cat err)"
    [ ! -s out ] || fail "$name: --quiet printed: $(cat out)"
    errors=$(grep -c -v '^mesh_image: warning: ' err)
    case $status in
    0)
        [ "$errors" -eq 0 ] || fail "$name: exit status 0, but: $(cat err)"
        [ -s mesh.vtu ] || fail "$name: no mesh was written"
        check_report report.json || fail "$name: see above"
        ;;
    1)
        [ "$errors" -eq 1 ] || fail "$name: wanted one line on stderr: $(cat err)"
        grep -q '^mesh_image: ..........' err || fail "$name: the message says nothing: $(cat err)"
        [ ! -e mesh.vtu ] || fail "$name: a mesh was written in spite of: $(cat err)"
        ;;
    *) fail "$name: exit status $status: $(cat err)" ;;
    esac
    echo "$status $name: $(cat err)"
done
[ "$files" -gt 2 ] || fail "only $files files in $images"
exit $failed
