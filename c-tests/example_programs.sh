#!/bin/sh
# The smaller example programs, run as a user would: sh example_programs.sh PROGRAM FOLDER WORK,
# where PROGRAM is minimal, itk_to_lapd or vtk_view and FOLDER is where they were built. What was
# not built, for want of ITK or VTK, is SKIPPED.
set -u
program=$1 folder=$2 work=$3
rm -rf "$work"
mkdir -p "$work"
cd "$work" || exit 1
failed=0

fail() {
    echo "FAILED: $*"
    failed=1
}

if [ ! -x "$folder/$program" ]; then
    case $program in
    itk_to_lapd)
        echo "SKIPPED: the example itk_to_lapd, ITK is missing (libinsighttoolkit5-dev: 30 MB)" ;;
    vtk_view)
        echo "SKIPPED: the example vtk_view, VTK is missing (libvtk9-dev xvfb xauth: 170 MB)" ;;
    *) fail "$program was not built" ;;
    esac
    exit $failed
fi

# A box of label 1 with boxes of 2 and 3 in it, 16 voxels wide.
{
    printf 'NRRD0004\ntype: uchar\ndimension: 3\nsizes: 16 16 16\n'
    printf 'encoding: raw\nspacings: 1 1 1\n\n'
    awk 'BEGIN {
        for (z = 0; z < 16; z++) for (y = 0; y < 16; y++) for (x = 0; x < 16; x++) {
            outer = x > 0 && x < 15 && y > 0 && y < 15 && z > 0 && z < 15
            inner = x > 3 && x < 12 && y > 3 && y < 12 && z > 3 && z < 12
            printf "%s", inner ? (x < 8 ? "2" : "3") : outer ? "1" : "0"
        }
    }' | tr '0123' '\000\001\002\003'
} >boxes.nrrd

# expect STATUS ARGUMENT...
expect() {
    wanted=$1
    shift
    $wrapper "$folder/$program" "$@" >out 2>err
    got=$?
    [ "$got" -eq "$wanted" ] || fail "$program $*: exit status $got, wanted $wanted: $(cat err)"
    [ "$wanted" -eq 0 ] || [ "$(wc -l <err)" -eq 1 ] ||
        fail "$program $*: wanted one line on stderr: $(cat err)"
}

wrapper=
case $program in
minimal)
    expect 0
    grep -q '^ball.vtu: [0-9]* vertices, [0-9]* tets$' out || fail "minimal printed: $(cat out)"
    [ -s ball.vtu ] || fail "ball.vtu was not written"
    expect 0 boxes.nrrd boxes.vtu
    [ -s boxes.vtu ] || fail "boxes.vtu was not written"
    expect 2 boxes.nrrd
    expect 1 missing.nrrd a.vtu
    expect 1 boxes.nrrd a.nonsense
    ;;
itk_to_lapd)
    expect 0 boxes.nrrd boxes.vtu 1 2
    [ -s boxes.vtu ] || fail "boxes.vtu was not written"
    expect 2 boxes.nrrd
    expect 1 missing.nrrd a.vtu
    expect 1 boxes.nrrd a.vtu -1
    sed 's/^type: uchar/type: float\nendian: little/; s/^sizes: 16 16 16/sizes: 16 16 4/' \
        boxes.nrrd >float.nrrd
    expect 1 float.nrrd a.vtu
    grep -q 'type float, labels are integers' err || fail "the message about floats: $(cat err)"
    ;;
vtk_view)
    expect 2 boxes.nrrd
    expect 1 missing.nrrd a.png
    if [ -z "${DISPLAY-}" ]; then
        command -v xvfb-run >/dev/null 2>&1 || {
            echo "SKIPPED: the picture of vtk_view, there is no X server (xvfb xauth)"
            exit $failed
        }
        wrapper='xvfb-run -a'
    fi
    expect 0 boxes.nrrd boxes.png 1.5 3
    [ -s boxes.png ] || fail "boxes.png was not written"
    command -v python3 >/dev/null 2>&1 || {
        echo "SKIPPED: the colours of the picture, python3 is missing"
        exit $failed
    }
    # White around, and the three labels in three colours, each on a part of the picture.
    python3 - <<'PICTURE' || failed=1
import collections
import colorsys
import struct
import zlib

data = open("boxes.png", "rb").read()
assert data[:8] == b"\x89PNG\r\n\x1a\n"
width, height, depth, kind = struct.unpack(">IIBB", data[16:26])
assert (width, height, depth, kind) == (1000, 800, 8, 2), (width, height, depth, kind)
at, packed = 8, b""
while at < len(data):
    length, name = struct.unpack(">I4s", data[at : at + 8])
    packed += data[at + 8 : at + 8 + length] if name == b"IDAT" else b""
    at += 12 + length
raw, stride, above = zlib.decompress(packed), 3 * width, bytes(3 * width)
hues, white = collections.Counter(), 0
for y in range(height):
    start = y * (stride + 1)
    filtering, line = raw[start], bytearray(raw[start + 1 : start + 1 + stride])
    for i in range(stride):
        a, b, c = (line[i - 3] if i > 2 else 0), above[i], (above[i - 3] if i > 2 else 0)
        if filtering == 4:
            p = a + b - c
            line[i] = (line[i] + min((a, b, c), key=lambda v: abs(p - v))) & 255
        else:
            line[i] = (line[i] + (0, a, b, (a + b) // 2)[filtering]) & 255
    above = line
    for x in range(0, stride, 12):
        hue, saturation, value = colorsys.rgb_to_hsv(*(v / 255 for v in line[x : x + 3]))
        white += saturation < 0.05 and value > 0.95
        if saturation > 0.4 and value > 0.5:
            hues[round(18 * hue) % 18] += 1
total = height * (width // 4)
print("white", white / total, {20 * hue: count / total for hue, count in hues.items()})
# Golden sections: hues of 0, 222 and 85 degrees.
assert white > total / 5 and all(hues[hue] > total / 100 for hue in (0, 11, 4)), (white, hues)
assert set(hue for hue in hues if hues[hue] > total / 1000) <= {0, 11, 4}, hues
PICTURE
    ;;
esac
exit $failed
