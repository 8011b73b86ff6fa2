#!/bin/sh
# Tests of the example program: options, exit codes, messages, report. sh example.sh MESH_IMAGE WORK
set -u
mesh_image=$1 work=$2
rm -rf "$work"
mkdir -p "$work"
cd "$work" || exit 1
failed=0

fail() {
    echo "FAILED: $*"
    failed=1
}

# expect STATUS LINES ARGUMENT...: exit status, and the number of lines on stderr.
expect() {
    wanted=$1 lines=$2
    shift 2
    "$mesh_image" "$@" >out 2>err
    got=$?
    [ "$got" -eq "$wanted" ] || fail "mesh_image $*: exit status $got, wanted $wanted: $(cat err)"
    [ "$(wc -l <err)" -eq "$lines" ] || fail \
        "mesh_image $*: wanted $lines lines on stderr: $(cat err)"
}

# A box of label 1 with one of label 2 in it, 12 voxels wide. $1: lines of the header that place it.
phantom() {
    printf 'NRRD0004\ntype: uchar\ndimension: 3\nsizes: 12 12 12\nencoding: raw\n%s\n\n' "$1"
    awk 'BEGIN {
        for (z = 0; z < 12; z++) for (y = 0; y < 12; y++) for (x = 0; x < 12; x++) {
            outer = x > 0 && x < 11 && y > 0 && y < 11 && z > 0 && z < 11
            inner = x > 3 && x < 8 && y > 3 && y < 8 && z > 3 && z < 8
            printf "%s", inner ? "2" : outer ? "1" : "0"
        }
    }' | tr '012' '\000\001\002'
}
phantom 'spacings: 1 1 1' >box.nrrd

# Bad usage: status 2, a message and a hint.
expect 2 2
expect 2 2 box.nrrd
expect 2 2 -o a.vtu
expect 2 2 box.nrrd box.nrrd -o a.vtu
expect 2 2 box.nrrd -o
expect 2 2 box.nrrd -o a.vtu --nonsense
expect 2 2 box.nrrd -o a.vtu --delta
expect 2 2 box.nrrd -o a.vtu --delta x
expect 2 2 box.nrrd -o a.vtu --delta 1x
expect 2 2 box.nrrd -o a.vtu --delta -1
expect 2 2 box.nrrd -o a.vtu --delta nan
expect 2 2 box.nrrd -o a.vtu --size 0
expect 2 2 box.nrrd -o a.vtu --radius-edge 1
expect 2 2 box.nrrd -o a.vtu --facet-angle 40
expect 2 2 box.nrrd -o a.vtu --label-size 1
expect 2 2 box.nrrd -o a.vtu --label-size 1=
expect 2 2 box.nrrd -o a.vtu --label-size 1=-2
expect 2 2 box.nrrd -o a.vtu --keep 1,
expect 2 2 box.nrrd -o a.vtu --keep ''
expect 2 2 box.nrrd -o a.vtu --keep 99999999999
expect 2 2 box.nrrd -o a.vtu --surface round
expect 2 2 box.nrrd -o a.vtu --adaptive sideways
expect 2 2 box.nrrd -o a.vtu --layer-order 0,
expect 2 2 box.nrrd -o a.vtu --layer-order=-1
expect 2 2 box.nrrd -o a.vtu --layer-order 0 --isovalue 1
expect 2 2 box.nrrd -o a.vtu --isovalue 1,
expect 2 2 box.nrrd -o a.vtu --isovalue 1,x
expect 2 2 box.nrrd -o a.vtu --isovalue 1 --probabilities
expect 2 2 box.nrrd -o a.vtu --isovalue 0.5,1.5 --labels 4
expect 2 2 box.nrrd -o a.vtu --labels 4
expect 2 2 box.nrrd -o a.vtu --gaussian 6
expect 2 2 box.nrrd -o a.vtu --max-vertices -3
expect 2 2 box.nrrd -o a.vtu --time-limit -1
expect 2 2 box.nrrd -o a.vtu --time-limit nan
expect 2 2 box.nrrd -o a.vtu --max-memory -1
expect 2 2 box.nrrd -o a.vtu --tets 0
expect 2 2 box.nrrd -o a.vtu --tets many
expect 2 2 box.nrrd -o a.vtu --volume -1
expect 2 2 box.nrrd -o a.vtu --spacing 1,2
expect 2 2 box.nrrd -o a.vtu --spacing 1,0,1
expect 2 2 box.nrrd -o a.vtu --max-memory 1Q
expect 2 2 box.nrrd -o a.vtu --max-memory 1MB
expect 2 2 box.nrrd -o a.vtu --max-memory 99999999999G
for threads in 0 255; do
    expect 2 2 box.nrrd -o a.vtu --threads $threads
    grep -q -e "--threads: threads must lie in 1 to 254, got $threads\$" err || fail \
        "--threads $threads: $(cat err)"
done
expect 2 2 box.nrrd -o a.vtu --threads -1
expect 2 2 box.nrrd -o a.vtu --threads 2x
expect 2 2 box.nrrd -o a.vtu --contention never
expect 2 2 box.nrrd -o a.vtu --begging nobody
expect 2 2 box.nrrd -o a.vtu --algorithm other
expect 2 2 box.nrrd -o a.vtu --timeline
expect 2 2 box.nrrd -o a.vtu --topology 'many:2'
expect 2 2 box.nrrd -o a.vtu --frame
expect 2 2 box.nrrd -o a.vtu --frame las
# A name that no format has costs no run, and no other output is written.
expect 2 2 box.nrrd -o a.vtu -o a.nonsense --report a.json
grep -q -e '-o: a.nonsense: unknown ending for a mesh, known are .vtu ' err || fail \
    "a.nonsense: $(cat err)"
[ ! -e a.json ] || fail "bad usage wrote a report"
expect 2 2 box.nrrd -o a.vtu --improve much
expect 2 2 box.nrrd -o a.vtu --coarsen -1
expect 2 2 box.nrrd -o a.vtu --coarsen 31
grep -q 'coarsening keeps facet angles above 0 and not above 30 degrees, got 31' err || fail \
    "--coarsen 31: $(cat err)"
expect 1 1 box.nrrd -o a.vtu --coarsen 15 --improve interior --quiet
grep -q 'coarsening needs improvement full' err || fail "--coarsen without: $(cat err)"
expect 2 2 box.nrrd -o a.vtu --across 0.5
grep -q 'elements across a layer must lie in 1 to 100, got 0.5' err || fail \
    "--across 0.5: $(cat err)"
expect 2 2 box.nrrd -o a.vtu --least-size -1
expect 2 2 box.nrrd -o a.vtu --gradation 0
expect 2 2 box.nrrd -o a.vtu --target-dihedral nan
expect 2 2 box.nrrd -o a.vtu --target-dihedral 40
grep -q 'target dihedral angle must lie above 0 and not above 30 degrees, got 40' err || fail \
    "40 degrees: $(cat err)"
[ ! -e a.vtu ] || fail "bad usage wrote a mesh"

# Failures: status 1, one line that names the file.
expect 1 1 missing.nrrd -o a.vtu --quiet
grep -q missing.nrrd err || fail "the message does not name the file"
head -c 300 box.nrrd >cut.nrrd
expect 1 1 cut.nrrd -o a.vtu --quiet
grep -q cut.nrrd err || fail "the message does not name the file"
cp box.nrrd box.nonsense
expect 1 1 box.nonsense -o a.vtu --quiet
grep -q 'box.nonsense: no reader for this name ending' err || fail "box.nonsense: $(cat err)"
expect 1 1 box.nrrd -o no/such/folder/a.vtu --quiet
expect 1 1 box.nrrd -o a.vtu --report no/such/folder/a.json --quiet
expect 1 1 box.nrrd -o a.vtu --timeline no/such/folder/t.json --threads 2 --quiet
expect 1 1 box.nrrd -o a.vtu --max-vertices 9 --quiet
rm -f a.vtu

# Success: status 0, nothing on stderr.
expect 0 0 --help
grep -q 'usage:' out || fail "--help prints no usage"
grep -q -e '--delta' out || fail "--help does not say what --delta is"
expect 0 0 --version
expect 0 0 box.nrrd -o a.vtu
grep -q 'tets' out || fail "no table"
grep -q 'certificate' out || fail "no certificate"
! grep -q '^[0-9]* threads' out || fail "the table speaks of threads where there is one"
[ -s a.vtu ] || fail "a.vtu was not written"
expect 0 0 box.nrrd -o b.vtu -o b.mesh -o b.stl --delta 1 --size 2 --label-size 2=1 --radius-edge \
    2.5 --facet-angle 25 \
    --threads 1 --algorithm podm --contention local --begging levels --improve interior \
    --target-dihedral 12 --surface smooth --max-vertices 1000000 --quiet
[ -s b.vtu ] && [ -s b.mesh ] && [ -s b.stl ] || fail "not all outputs were written"
[ ! -s out ] || fail "--quiet printed: $(cat out)"
expect 0 0 box.nrrd --estimate
grep -q '^tets ' out && grep -q '^peak MiB ' out && grep -q '^seconds ' out || fail \
    "--estimate does not tell all: $(cat out)"
expect 0 0 box.nrrd -o n.vtu --tets 4000 --quiet --report n.json
awk -F '[:,]' '/^ *"tets":/ { n = $2 } END { exit !(n >= 3600 && n <= 4400) }' n.json || fail \
    "--tets 4000 gave $(grep -m1 '"tets"' n.json)"
expect 0 0 box.nrrd --estimate --spacing 1,2,0.5 --volume 0
expect 0 0 box.nrrd -o k.vtu --keep 2 --report k.json --quiet
expect 0 0 box.nrrd -o v.vtu --surface voxel --report v.json --quiet
expect 0 0 box.nrrd -o g.vtu --background --report g.json --quiet
expect 0 0 box.nrrd --report m.json --memory --quiet
expect 0 0 box.nrrd --delta 4 --size 8 --adaptive topology --report topology.json --quiet
expect 0 0 box.nrrd --delta 4 --size 8 --adaptive off --report off.json --quiet
# The frame of the world: the same box in one that the file names, turned, and where the file names
# none.
phantom 'space: left-posterior-superior
space directions: (1,0,0) (0,1,0) (0,0,1)
space origin: (100,0,0)' >lps.nrrd
expect 0 0 lps.nrrd --report stored.json -o stored.mesh --quiet
expect 0 0 lps.nrrd --report turned.json -o turned.mesh --frame ras --quiet
expect 0 1 box.nrrd --report unturned.json --frame ras --quiet
grep -q 'warning: the file does not say what its axes mean: coordinates stay as stored, not RAS' \
    err || fail "--frame ras: $(cat err)"
# Several threads, which the table has two lines about.
for contention in local global random aggressive; do
    expect 0 0 box.nrrd -o t.vtu --threads 3 --contention $contention --begging flat --quiet
done
expect 0 0 box.nrrd -o t.vtu --threads 3 --bind --topology '' --quiet
# Layers of a segmentation: two segments that overlap by half; names.
{
    printf 'NRRD0005\ntype: uchar\ndimension: 4\nsizes: 2 9 6 6\n'
    printf 'kinds: list domain domain domain\nspacings: nan 1 1 1\nencoding: text\n'
    printf 'Segment0_Name:=left\nSegment0_LabelValue:=1\nSegment0_Layer:=0\n'
    printf 'Segment1_Name:=the "right"\nSegment1_LabelValue:=2\nSegment1_Layer:=1\n\n'
    awk 'BEGIN { for (n = 0; n < 9 * 6 * 6; n++) print n % 9 < 6 ? 1 : 0, n % 9 < 3 ? 0 : 2 }'
} >layers.seg.nrrd
expect 0 1 layers.seg.nrrd --report layers.json --quiet
expect 0 1 layers.seg.nrrd --report layers10.json --layer-order 1,0 --quiet
expect 1 1 layers.seg.nrrd --report layers11.json --layer-order 1,1 --quiet
expect 1 1 layers.seg.nrrd --report mapped.json --map --quiet
expect 0 1 box.nrrd --report mapped.json --map --quiet
expect 0 0 box.nrrd --report l.json --threads 3 --algorithm lapd --count-accesses --delta 0.3
grep -q "accesses to other nodes' memory" out || fail \
    "the table says nothing about accesses: $(cat out)"
expect 0 0 box.nrrd --report t.json --timeline timeline.json --threads 2 --delta 0.3
grep -q '^2 threads$' out && grep -q 'rollbacks [0-9]*, .* % of operations' out && grep -q \
    'time lost' out ||
    fail "the table says nothing about 2 threads: $(cat out)"

# The report, of a file whose name is a trial for JSON.
odd=$(printf 'odd "name" \\ \t \303\244 \377.nrrd')
cp box.nrrd "$odd"
expect 0 0 "$odd" -o odd.vtu --report odd.json --quiet
for left in *.tmp; do
    [ ! -e "$left" ] || fail "$left was left behind"
done
if command -v python3 >/dev/null 2>&1; then
    python3 - <<'END' || failed=1
import json

def load(name):
    with open(name, encoding="utf-8") as file:
        return json.load(file)

odd, keep, background = (load(name + ".json") for name in "odd k g".split())
memory, threads, lapd = (load(name + ".json") for name in "m t l".split())
worlds = [load(name + ".json")["world"] for name in "stored turned unturned odd".split()]
assert worlds == ["LPS", "RAS", "unknown", "unknown"], worlds

def mean_x(name):
    with open(name, encoding="utf-8") as file:
        words = file.read().split()
    first = words.index("Vertices") + 2
    count = int(words[first - 1])
    return sum(float(x) for x in words[first : first + 4 * count : 4]) / count

assert abs(mean_x("stored.mesh") - 105.5) < 2 and abs(mean_x("turned.mesh") + 105.5) < 2
assert odd["input"] == 'odd "name" \\ \t \u00e4 \ufffd.nrrd', odd["input"]
keys = """version input world delta size threads algorithm tets vertices interface_facets
        all_tets peak_rss_bytes oracle_bytes seconds operations overhead thread_reports
        quality certificate labels""".split()
assert all(key in odd for key in keys), [key for key in keys if key not in odd]
inner = {
    "seconds": "read prepare refine extract improve certify write total",
    "operations": """insertions removals rollbacks exact_predicates in_sphere_tests tets_created
        cavity_tets inspections label_lookups crossing_lookups by_rule insertions_per_vertex
        removals_per_vertex mean_cavity exact_share inspections_per_tet lookups_per_tet""",
    "overhead": """rollback_s contention_s idle_s rollbacks_by_rule stale waits begs gifts remote_s
        remote_accesses local_accesses access_hops""",
    "quality": """min_dihedral max_dihedral max_radius_edge min_facet_angle dihedral_histogram
        scaled_jacobian edge_ratio radius_ratio""",
    "improvement": """target_dihedral tolerance below_before left edge_removals max_interface_move
        non_delaunay_facets contractions tets_before facets_below tets_mended left_tets""",
    "certificate": """non_delaunay_facets inverted_tets hausdorff_mesh_to_image
        hausdorff_image_to_mesh unmet""",
}
for key, names in inner.items():
    assert all(name in odd[key] for name in names.split()), key
assert len(odd["quality"]["dihedral_histogram"]) == 18
assert sorted(odd["certificate"]["unmet"]) == ["R1", "R2", "R3", "R4", "R5", "R6"]
assert [odd[name] for name in "delta size threads algorithm".split()] == [1.5, 3, 1, "podm"]
assert [row["label"] for row in odd["labels"]] == [1, 2]
assert odd["tets"] == sum(row["tets"] for row in odd["labels"]) > 0
assert odd["peak_rss_bytes"] > 1 << 20
assert odd["oracle_bytes"] >= 4 * 10**3 and "memory_bytes" not in odd
phases = "prepare refine extract improve".split()
peaks = [memory["memory_bytes"]["peak_" + phase] for phase in phases]
assert 1 << 20 < peaks[0] <= peaks[1] <= peaks[2] <= peaks[3] <= memory["peak_rss_bytes"], memory
assert memory["memory_bytes"]["read"] > 1 << 20, memory
assert [row["label"] for row in keep["labels"]] == [2], keep["labels"]

# Sampling that follows topology tells what it found, and comes to an end.
topology, off = load("topology.json"), load("off.json")
found = topology["topology_differences"]
assert found and found[-1] == 0 and off["topology_differences"] is None, found
assert all(row["euler_mesh"] == row["euler_image"] for row in topology["labels"]), topology
assert background["all_tets"] >= background["tets"] > 0

# Accesses are counted where asked for.
accesses = lapd["overhead"]["local_accesses"]
assert lapd["algorithm"] == "lapd" and accesses > lapd["operations"]["in_sphere_tests"]
assert accesses == sum(thread["local_accesses"] for thread in lapd["thread_reports"])
assert threads["overhead"]["local_accesses"] == threads["overhead"]["remote_accesses"] == 0

# What single threads did sums up.
for name, volumes in ("layers", (108, 216)), ("layers10", (216, 108)):
    rows = load(name + ".json")["labels"]
    rows = [(row["label"], row["name"], round(row["mesh_volume"])) for row in rows]
    assert rows == [(1, "left", volumes[0]), (2, 'the "right"', volumes[1])], rows
assert load("mapped.json")["values"] == {"1": "1", "2": "2"}
assert len(odd["thread_reports"]) == 1
assert not any(odd["overhead"][name] for name in "rollback_s waits begs gifts".split())
assert threads["threads"] == len(threads["thread_reports"]) == 2
for name in "insertions removals tets_created rollbacks".split():
    total = sum(thread[name] for thread in threads["thread_reports"])
    assert total == threads["operations"][name], (name, total, threads["operations"])
for name in "rollback_s contention_s idle_s stale waits begs gifts".split():
    total = sum(thread[name] for thread in threads["thread_reports"])
    assert abs(total - threads["overhead"][name]) <= 1e-9, (name, total, threads["overhead"])
assert sum(threads["overhead"]["rollbacks_by_rule"].values()) == threads["operations"]["rollbacks"]

# The timeline: a row for each thread; spans in the order of time, none reaching into the next, none
# after the end.
events = load("timeline.json")["traceEvents"]
rows = {event["tid"]: event["args"]["name"] for event in events if event["name"] == "thread_name"}
assert rows == {0: "thread 0", 1: "thread 1"}, rows
for row in rows:
    end = 0
    spans = [event for event in events if event["ph"] == "X" and event["tid"] == row]
    assert spans, f"thread {row} has no spans"
    for span in spans:
        assert span["name"] in ("sampling", "refining", "rolling back", "waiting", "begging"), span
        assert span["dur"] >= 0 and span["ts"] >= end - 1e-3, (end, span)
        end = span["ts"] + span["dur"]
    assert end <= 1e6 * threads["seconds"]["refine"], (end, threads["seconds"])
assert {event["ph"] for event in events} == {"M", "X"}
END
else
    echo "SKIPPED: the JSON report, python3 is missing"
fi

# The same box as a scan, as a map of probability, and smoothed.
expect 0 0 box.nrrd --isovalue 0.5,1.5 --labels 7,-1 --quiet --report scan.json
grep -q '"label": -1,' scan.json && grep -q '"label": 7,' scan.json || fail \
    "labels of a scan: $(cat scan.json)"
expect 1 1 box.nrrd --isovalue 5 --quiet --report none.json
grep -q 'no voxel has an intensity of 5 or more; the image has 0 to 2' err || fail \
    "isovalue 5: $(cat err)"
expect 1 1 box.nrrd box.nrrd --probabilities --quiet --report none.json
grep -q 'is 2: without a map of label 0' err || fail "--probabilities: $(cat err)"
expect 0 0 box.nrrd --gaussian 1 --quiet --report smooth.json

# Limits: one line and status 1, or with --partial a mesh and a word about it.
for limit in "--max-vertices 5000" "--time-limit 0.2" "--max-memory 24M"; do
    # Word splitting is wanted: option and value.
    expect 1 1 box.nrrd -o limited.vtu --delta 0.05 --size 0.1 --quiet $limit
    grep -q 'limit of .* was reached' err || fail "$limit: $(cat err)"
    [ ! -e limited.vtu ] || fail "$limit left a mesh"
    "$mesh_image" box.nrrd -o limited.vtu --delta 0.05 --size 0.1 --quiet --partial --report \
        limited.json $limit 2>err ||
        fail "$limit --partial: $(cat err)"
    grep -q 'the mesh is partial: .*limit of' err || fail "$limit --partial: $(cat err)"
    [ -s limited.vtu ] || fail "$limit --partial wrote no mesh"
    grep -q '"limit_reached": "LAPD_ERROR_' limited.json || fail "$limit: the report is silent"
    rm -f limited.vtu limited.json
done

# Ctrl-C: one line, status 1. An image that takes long enough.
if command -v timeout >/dev/null 2>&1; then
    timeout --preserve-status -s INT 1 "$mesh_image" box.nrrd -o slow.vtu --delta 0.05 --size 0.1 \
        --quiet >out 2>err
    case $? in
    0) echo "SKIPPED: Ctrl-C, the run took less than a second" ;;
    1)
        [ "$(cat err)" = "mesh_image: cancelled" ] || fail "Ctrl-C: $(cat err)"
        [ ! -e slow.vtu ] || fail "Ctrl-C left a mesh"
        ;;
    *) fail "Ctrl-C: wrong exit status" ;;
    esac
else
    echo "SKIPPED: Ctrl-C, timeout is missing"
fi
exit $failed
