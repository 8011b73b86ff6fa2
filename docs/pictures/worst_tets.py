#!/usr/bin/env python3
"""Draws the worst tets of meshes of one image, side by side: a row for each mesh, the tet with the
worst angle first.

usage: worst_tets.py NAME=MESH.vtu [NAME=MESH.vtu ...] [-n COUNT] [-o worst.png]

A tet's worst angle is the dihedral angle that is nearest to 0 or 180 degrees. Each tet is scaled to
the same length of its longest edge and seen along the direction in which it is thinnest, turned a
little. Needs `pip install meshio matplotlib ./python`.
"""

import argparse

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import meshio
import numpy as np

from lapd._plots import draw_tet

EDGES = [(0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2), (1, 2, 0, 3), (1, 3, 0, 2), (2, 3, 0, 1)]


def dihedral_angles(corners):
    """The six dihedral angles of every tet, in degrees."""
    angles = []
    for i, j, k, l in EDGES:
        edge = corners[:, j] - corners[:, i]
        n, m = np.cross(edge, corners[:, k] - corners[:, i]), np.cross(
            edge, corners[:, l] - corners[:, i]
        )
        cosine = np.einsum("ij,ij->i", n, m) / np.linalg.norm(n, axis=1) / np.linalg.norm(m, axis=1)
        angles.append(np.degrees(np.arccos(np.clip(cosine, -1, 1))))
    return np.stack(angles, axis=1)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("meshes", nargs="+", metavar="NAME=MESH.vtu")
    parser.add_argument("-n", type=int, default=8, metavar="COUNT")
    parser.add_argument("-o", default="worst.png", metavar="OUT.png")
    args = parser.parse_args()
    rows = len(args.meshes)
    figure = plt.figure(figsize=(1.5 * args.n, 1.75 * rows), dpi=120)
    for row, argument in enumerate(args.meshes):
        name, _, path = argument.rpartition("=")
        mesh = meshio.read(path)
        corners = mesh.points[mesh.cells_dict["tetra"]]
        angles = dihedral_angles(corners)
        worst = np.argsort(np.minimum(angles, 180 - angles).min(axis=1))[: args.n]
        for column, t in enumerate(worst):
            draw_tet(
                figure.add_subplot(rows, args.n, row * args.n + column + 1, projection="3d"),
                corners[t],
                f"{angles[t].min():.1f}° to {angles[t].max():.1f}°",
            )
        figure.text(0.005, 1 - (row + 0.5) / rows, name, rotation=90, va="center", fontsize=9)
    figure.subplots_adjust(left=0.03, right=1, top=0.95, bottom=0, wspace=0, hspace=0.1)
    figure.savefig(args.o)


if __name__ == "__main__":
    main()
