#!/usr/bin/env python3
"""Makes the pictures of docs/guide/parameters.md: cuts through meshes of the AAL atlas by several
values of a parameter.

usage: parameters.py [--mesh-image build/bin/mesh_image] [-o docs/pictures] [--only NAME]
                     [--work build/parameters]

The atlas is that of Debian's mricron-data. Needs numpy, matplotlib and meshio, and `mesh_image`,
which `sh examples/quickstart.sh` builds.
"""

import argparse
import json
import pathlib
import subprocess

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import meshio
import numpy as np
from matplotlib.collections import PolyCollection
from PIL import Image

ATLAS = "/usr/share/mricron/templates/aal.nii.gz"
# The cut: a plane of constant y, and what is shown of it, in mm.
AT = -10.3
WIDE = (-70, -5, -30, 45)
NEAR = (-50, -22, -20, 12)
EDGES = np.array([[0, 1], [0, 2], [0, 3], [1, 2], [1, 3], [2, 3]])


def section(points, tets):
    """The polygons, in x and z, in which a plane of constant y cuts tets, and which tets these
    are."""
    height = points[:, 1] - AT
    sides = height[tets] > 0
    cut = np.flatnonzero(sides.any(axis=1) & ~sides.all(axis=1))
    polygons = []
    for t in cut:
        ends = tets[t][EDGES]
        crossed = ends[(height[ends[:, 0]] > 0) != (height[ends[:, 1]] > 0)]
        part = height[crossed[:, 0]] / (height[crossed[:, 0]] - height[crossed[:, 1]])
        a, b = points[crossed[:, 0]], points[crossed[:, 1]]
        at = (a + part[:, None] * (b - a))[:, [0, 2]]
        around = at - at.mean(axis=0)
        polygons.append(at[np.argsort(np.arctan2(around[:, 1], around[:, 0]))])
    return polygons, cut


def draw(axes, path, title, window):
    """Draws the cut through a mesh."""
    mesh = meshio.read(path)
    block = next(i for i, cells in enumerate(mesh.cells) if cells.type == "tetra")
    tets, labels = mesh.cells[block].data, mesh.cell_data["medit:ref"][block]
    polygons, cut = section(mesh.points, tets)
    colours = plt.get_cmap("tab20")((labels[cut] * 7) % 20 / 19.5)
    axes.add_collection(
        PolyCollection(polygons, facecolors=colours, edgecolors="#20202a", linewidths=0.3)
    )
    axes.set_xlim(window[:2])
    axes.set_ylim(window[2:])
    axes.set_aspect("equal")
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_title(f"{title}\n{len(tets):,} tets".replace(",", " "), fontsize=9)


def picture(arguments, name, panels, window):
    """Meshes with each panel's options, and draws all panels."""
    rows = len(panels) // 3
    figure, grid = plt.subplots(
        rows, 3, figsize=(9.6, 4.1 * rows), squeeze=False, layout="constrained"
    )
    for number, (axes, options) in enumerate(zip(grid.flat, panels)):
        path = arguments.work / f"{name}-{number}.mesh"
        command = [arguments.mesh_image, ATLAS, "-o", str(path), "--quiet", *options.split()]
        subprocess.run(command, check=True, stderr=subprocess.DEVNULL)
        draw(axes, path, options, window)
    save(figure, arguments.output / f"parameters-{name}.png")


def kept(report):
    """What a mesh keeps of its image, in two lines."""
    made = json.loads(report.read_text())
    rows = made["components"]
    faults = sum(row["fate"] != "kept" for row in rows)
    large = [row for row in rows if row["image_voxels"] >= 100]
    right = sum(row["euler_mesh"] == row["euler_image"] for row in large)
    return (
        f"delta {made['delta']:.2f} mm; {faults} of {len(rows)} parts lost, merged or torn\n"
        f"Euler number right for {right} of {len(large)}"
    )


def budgets(arguments, numbers):
    """Meshes of so many tets, and what each keeps."""
    figure, grid = plt.subplots(2, 2, figsize=(8.4, 9.4), squeeze=False, layout="constrained")
    for axes, tets in zip(grid.flat, numbers):
        path, report = (arguments.work / f"tets-{tets}.{ending}" for ending in ("mesh", "json"))
        options = f"--tets {tets} --adaptive topology --coarsen 15"
        command = [arguments.mesh_image, ATLAS, "-o", str(path), "--report", str(report)]
        subprocess.run(
            [*command, "--certificate", "sound", "--quiet", *options.split()],
            check=True,
            stderr=subprocess.DEVNULL,
        )
        draw(axes, path, options, WIDE)
        axes.set_xlabel(kept(report), fontsize=9)
    save(figure, arguments.output / "parameters-tets.png")


def save(figure, path):
    figure.savefig(path, dpi=110, bbox_inches="tight", pad_inches=0.05)
    plt.close(figure)
    # Few colours make small files.
    Image.open(path).convert("RGB").quantize(48).save(path, optimize=True)


def main():
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("--mesh-image", default="build/bin/mesh_image")
    parser.add_argument("-o", "--output", type=pathlib.Path, default=pathlib.Path("docs/pictures"))
    parser.add_argument("--work", type=pathlib.Path, default=pathlib.Path("build/parameters"))
    parser.add_argument("--only", help="one picture: delta, size, surface, across or tets")
    arguments = parser.parse_args()
    arguments.work.mkdir(parents=True, exist_ok=True)
    wanted = [arguments.only] if arguments.only else ["delta", "size", "surface", "across", "tets"]
    deltas = [f"--delta {delta}" for delta in (2, 4, 8)]
    adaptive = [f"{delta} --no-adaptive" for delta in deltas]
    if "delta" in wanted:
        picture(arguments, "delta", deltas + adaptive, WIDE)
    sizes = [f"--delta 4 --no-adaptive --size {size}" for size in (2, 4, 8)]
    if "size" in wanted:
        picture(arguments, "size", sizes, WIDE)
    surfaces = ["--surface voxel", "--surface smooth", "--gaussian 1.5"]
    if "surface" in wanted:
        picture(arguments, "surface", [f"--delta 1 {surface}" for surface in surfaces], NEAR)
    coarse = "--delta 4 --adaptive topology"
    across = [coarse, f"{coarse} --across 1", f"{coarse} --across 2"]
    if "across" in wanted:
        picture(arguments, "across", across, NEAR)
    if "tets" in wanted:
        budgets(arguments, [50_000, 150_000, 500_000, 2_000_000])


main()
