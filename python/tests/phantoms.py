"""Images, and what the tests ask of meshes."""

import importlib

import numpy as np


def ball(kind=np.uint8):
    x, y, z = np.mgrid[-10:11, -9:10, -8:9]
    labels = np.zeros(x.shape, dtype=kind)
    labels[x**2 + y**2 + z**2 < 49] = 1
    labels[(x**2 + y**2 + z**2 < 49) & (x > 0)] = 3
    return labels


def write_nrrd(path, labels, spacing=(1, 1, 1)):
    x, y, z = spacing
    header = (
        "NRRD0004\ntype: uint8\ndimension: 3\nspace: right-anterior-superior\nspace directions: "
        f"({x},0,0) (0,{y},0) (0,0,{z})\nspace origin: (0,0,0)\nsizes: "
        f"{' '.join(map(str, labels.shape))}\nencoding: raw\n\n"
    )
    path.write_bytes(header.encode() + labels.astype("<u1").tobytes(order="F"))


def volumes(mesh):
    a, b, c, d = (mesh.points[mesh.tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


def same(one, other):
    return np.array_equal(one.points, other.points) and np.array_equal(one.tets, other.tets)


def has(name):
    try:
        importlib.import_module(name)
        return True
    except ImportError:
        return False
