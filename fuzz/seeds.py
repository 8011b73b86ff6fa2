"""Writes the files from which the fuzzers begin: small valid ones of every format, and those of the
corpus.

The corpus of a target, corpus/TARGET.txt, has inputs in base64: the lines of one up to an empty
line. An input that made a target fail belongs into it. `seeds.py --keep FOLDER N TARGET` takes in
N files of a folder, of all lengths; those that libFuzzer has merged (-merge=1) say most.
"""

import base64
import gzip
import struct
import sys
from pathlib import Path

CORPUS = Path(__file__).parent / "corpus"
VOXELS = bytes([0, 0, 1, 1, 0, 2, 2, 1])
NRRD = """NRRD0005
type: {type}
dimension: 3
space: left-posterior-superior
sizes: 2 2 2
space directions: (1,0,0) (0,1,0) (0,0,2)
space origin: (1,2,3)
kinds: domain domain domain
encoding: {encoding}
{more}
"""
SEGMENTS = """Segment0_ID:=a
Segment0_LabelValue:=1
Segment0_Layer:=0
Segment0_Name:=liver
"""
META = """ObjectType = Image
NDims = 3
DimSize = 2 2 2
ElementSpacing = 1 1 2
Offset = 0 0 0
TransformMatrix = 1 0 0 0 1 0 0 0 1
CompressedData = {compressed}
ElementType = MET_UCHAR
ElementDataFile = LOCAL
"""
INR = """#INRIMAGE-4#{{
XDIM=2
YDIM=2
ZDIM=2
VDIM=1
VX=1
VY=1
VZ=2
TYPE={type}
PIXSIZE={bits}
SCALE=2**0
CPU=decm
"""


def nrrd(kind, encoding, data, more=""):
    return NRRD.format(type=kind, encoding=encoding, more=more).encode() + data


def inr(kind, bits, data):
    head = INR.format(type=kind, bits=bits)
    return (head + "\n" * (252 - len(head)) + "##}\n").encode() + data


def nifti(code, bits, data):
    head = bytearray(352)
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, 2, 2, 2, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, code, bits)
    struct.pack_into("<8f", head, 76, 1, 1, 1, 2, 0, 0, 0, 0)
    struct.pack_into("<3f", head, 108, 352, 1, 0)
    struct.pack_into("<2h", head, 252, 0, 1)
    struct.pack_into("<12f", head, 280, 1, 0, 0, 5, 0, 1, 0, 6, 0, 0, 2, 7)
    head[344:348] = b"n+1\0"
    return bytes(head) + data


def npy(descr, order, data):
    head = f"{{'descr': '{descr}', 'fortran_order': {order}, 'shape': (2, 2, 2), }}".ljust(117)
    return b"\x93NUMPY\x01\0" + struct.pack("<H", 118) + head.encode() + b"\n" + data


def tiff(pages, compression=1):
    """Pages of 2 x 2 pixels of a byte, one strip each."""
    out = bytearray(struct.pack("<2sHI", b"II", 42, 8))
    for n, pixels in enumerate(pages):
        tags = [(256, 2), (257, 2), (258, 8), (259, compression), (262, 1), (277, 1), (278, 2)]
        tags += [(279, len(pixels))]
        start = len(out) + 2 + 12 * (len(tags) + 1) + 4
        tags.insert(6, (273, start))
        following = start + len(pixels) + len(pixels) % 2 if n + 1 < len(pages) else 0
        out += struct.pack("<H", len(tags))
        for tag, value in tags:
            out += struct.pack("<HHII", tag, 4, 1, value)
        out += struct.pack("<I", following) + pixels + b"\0" * (len(pixels) % 2)
    return bytes(out)


def seeds():
    """Seeds by target."""
    floats = struct.pack("<8f", *VOXELS)
    text = " ".join(map(str, VOXELS)).encode()
    return {
        "read_nrrd": [
            nrrd("uint8", "raw", VOXELS),
            nrrd("uint8", "gzip", gzip.compress(VOXELS)),
            nrrd("uint8", "ascii", text),
            nrrd("float", "raw", floats, "endian: little\n"),
            nrrd("uint8", "raw", VOXELS, SEGMENTS),
        ],
        "read_nifti": [
            nifti(2, 8, VOXELS),
            nifti(16, 32, floats),
            nifti(4, 16, struct.pack("<8h", *VOXELS)),
        ],
        "read_metaimage": [
            META.format(compressed=False).encode() + VOXELS,
            META.format(compressed=True).encode() + gzip.zlib.compress(VOXELS),
        ],
        "read_inr": [
            inr("unsigned fixed", "8 bits", VOXELS),
            inr("float", "32 bits", floats),
        ],
        "read_npy": [
            npy("|u1", False, VOXELS),
            npy("<f4", True, floats),
        ],
        "read_tiff": [
            tiff([VOXELS[:4], VOXELS[4:]]),
            tiff([gzip.zlib.compress(VOXELS[:4]), gzip.zlib.compress(VOXELS[4:])], 8),
        ],
        "c_calls": [bytes([2, 0, 40, 1, 80, 5, 5, 5, 40, 40, 40, 0, 0, 0] + [1, 2, 0, 1] * 40)],
    }


def corpus(target):
    """Inputs that were found to be of interest."""
    path = CORPUS / f"{target}.txt"
    if not path.exists():
        return []
    blocks = path.read_text().split("\n\n")
    return [base64.b64decode(block) for block in blocks if block.strip()]


def keep(folder, count, target):
    """Adds files of a folder, evenly from the shortest to the longest, to a corpus."""
    files = [file.read_bytes() for file in Path(folder).iterdir()]
    files.sort(key=lambda data: (len(data), data))
    chosen = files[:: max(1, len(files) // int(count))][: int(count)]
    inputs = corpus(target)
    inputs += [data for data in chosen if data not in inputs]
    CORPUS.mkdir(exist_ok=True)
    texts = [base64.encodebytes(data).decode() for data in inputs]
    (CORPUS / f"{target}.txt").write_text("\n".join(texts))


def main():
    if sys.argv[1] == "--keep":
        keep(*sys.argv[2:])
        return
    for target, files in seeds().items():
        folder = Path(sys.argv[1]) / target
        folder.mkdir(parents=True, exist_ok=True)
        for number, data in enumerate(files + corpus(target)):
            (folder / f"seed-{number}").write_bytes(data)


main()
