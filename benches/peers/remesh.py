#!/usr/bin/env python3
"""Our improvement beside other programs that improve or remesh the same refined mesh: gmsh, Mmg,
and CGAL's tetrahedral remeshing. Prints the table of docs/notes/comparison.md.

    remesh.py MESH_IMAGE CGAL_REMESH IMAGE [--delta 3] [--size 6] [--only NAME,NAME]

MESH_IMAGE is our command, CGAL_REMESH the program of cgal_remesh.cpp. Needs numpy, vtk, gmsh and
mmgpy from PyPI; what is not installed is left out, and said. All on one thread, with one spacing.
"""

import argparse
import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

# Facets of a tet, and for each edge the two facets at it.
FACETS = np.array([[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]])
PAIRS = [(i, j) for i in range(4) for j in range(i)]
# What stands for the background in a file where label 0 means outside.
OUTSIDE = 1_000_000


def read_medit(path):
    """Points, tets and labels of a MEDIT file."""
    tokens = Path(path).read_text().split()
    arrays, at = {}, 0
    widths = {"Vertices": 4, "Triangles": 4, "Tetrahedra": 5, "Edges": 3}
    while at < len(tokens):
        width = widths.get(tokens[at])
        if width is None:
            at += 1
            continue
        count = int(tokens[at + 1])
        values = np.array(tokens[at + 2 : at + 2 + width * count], dtype=float)
        arrays[tokens[at]] = values.reshape(count, width)
        at += 2 + width * count
    tets = arrays["Tetrahedra"].astype(np.int64)
    return arrays["Vertices"][:, :3], tets[:, :4] - 1, tets[:, 4]


def normals(points, facets):
    a, b, c = (points[facets[..., k]] for k in range(3))
    cross = np.cross(b - a, c - a)
    return cross / np.maximum(np.linalg.norm(cross, axis=-1, keepdims=True), 1e-300)


def dihedrals(points, tets):
    """The six dihedral angles of each tet, in degrees."""
    normal = normals(points, tets[:, FACETS])
    cosines = [-np.einsum("ij,ij->i", normal[:, i], normal[:, j]) for i, j in PAIRS]
    return np.degrees(np.arccos(np.clip(np.stack(cosines, axis=1), -1, 1)))


def volumes(points, tets):
    a, b, c, d = (points[tets[:, k]] for k in range(4))
    return np.abs(np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)) / 6


def interfaces(tets, labels):
    """The facets between tets of different labels, and those on the outside."""
    facets = np.sort(tets[:, FACETS].reshape(-1, 3), axis=1)
    owners = np.repeat(labels, 4)
    order = np.lexsort(facets.T[::-1])
    facets, owners = facets[order], owners[order]
    same = (facets[1:] == facets[:-1]).all(axis=1)
    twice = np.concatenate([same, [False]])
    second = np.concatenate([[False], same])
    other = np.where(twice, np.roll(owners, -1), 0)
    return facets[~second & (owners != other)]


def facet_angle(points, facets):
    """The smallest angle of any facet, in degrees."""
    least = 180.0
    for k in range(3):
        a, b, c = (points[facets[:, (k + i) % 3]] for i in range(3))
        u, v = b - a, c - a
        cosine = np.einsum("ij,ij->i", u, v) / np.linalg.norm(u, axis=1) / np.linalg.norm(v, axis=1)
        least = min(least, np.degrees(np.arccos(np.clip(cosine, -1, 1))).min())
    return least


class Surface:
    """Distances to the interfaces of the refined mesh."""

    def __init__(self, points, facets):
        from vtkmodules.util import numpy_support as support
        from vtkmodules.vtkCommonCore import vtkPoints
        from vtkmodules.vtkCommonDataModel import (
            vtkCellArray,
            vtkGenericCell,
            vtkPolyData,
            vtkStaticCellLocator,
        )

        cells, places, data = vtkCellArray(), vtkPoints(), vtkPolyData()
        places.SetData(support.numpy_to_vtk(np.ascontiguousarray(points), deep=True))
        ids = np.hstack([np.full((len(facets), 1), 3), facets]).ravel().astype(np.int64)
        cells.ImportLegacyFormat(support.numpy_to_vtkIdTypeArray(ids, deep=True))
        data.SetPoints(places)
        data.SetPolys(cells)
        self.data, self.locator, self.cell = data, vtkStaticCellLocator(), vtkGenericCell()
        self.locator.SetDataSet(data)
        self.locator.BuildLocator()

    def distances(self, points):
        from vtkmodules.vtkCommonCore import mutable

        found, cell, sub, squared = [0.0] * 3, mutable(0), mutable(0), mutable(0.0)
        all_squared = np.empty(len(points))
        for i, point in enumerate(points):
            self.locator.FindClosestPoint(point, found, self.cell, cell, sub, squared)
            all_squared[i] = squared
        return np.sqrt(all_squared)


def measure(name, seconds, mesh, refined, surface, voxel):
    points, tets, labels = mesh
    kept = (labels != 0) & (labels != OUTSIDE)
    tets, labels = tets[kept], labels[kept]
    angles = dihedrals(points, tets)
    least, largest = angles.min(axis=1), angles.max(axis=1)
    facets = interfaces(tets, labels)
    vertices = np.unique(facets)
    off = surface.distances(points[vertices]) / voxel
    before = np.bincount(refined[2], volumes(refined[0], refined[1]))
    after = np.bincount(labels, volumes(points, tets), minlength=len(before))
    large = before >= 1000 * voxel**3
    change = np.abs(after[: len(before)][large] / before[large] - 1).max()
    return {
        "name": name,
        "tets": len(tets),
        "seconds": seconds,
        "least": least.min(),
        "largest": largest.max(),
        "below 10": 100 * ((least < 10) | (largest > 170)).mean(),
        "below 15": int(((least < 15) | (largest > 165)).sum()),
        "facet angle": facet_angle(points, facets),
        "off, mean": off.mean(),
        "off, max": off.max(),
        "label": 100 * change,
        "labels lost": int((before > 0).sum() - (after[: len(before)] > 0).sum()),
    }


def by_gmsh(path, method):
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.option.setNumber("General.NumThreads", 1)
    gmsh.open(str(path))
    start = time.perf_counter()
    gmsh.model.mesh.optimize(method, force=True)
    seconds = time.perf_counter() - start
    numbers, places, _ = gmsh.model.mesh.getNodes()
    index = np.zeros(int(numbers.max()) + 1, dtype=np.int64)
    index[numbers.astype(np.int64)] = np.arange(len(numbers))
    tets, labels = [], []
    for dimension, tag in gmsh.model.getEntities(3):
        _, nodes = gmsh.model.mesh.getElementsByType(4, tag)
        own = index[nodes.astype(np.int64)].reshape(-1, 4)
        # Tags of regions are the labels in the order of the file.
        name = gmsh.model.getPhysicalGroupsForEntity(dimension, tag)
        tets.append(own)
        labels.append(np.full(len(own), name[0] if len(name) else tag))
    gmsh.finalize()
    return seconds, (places.reshape(-1, 3), np.concatenate(tets), np.concatenate(labels))


def by_mmg(path, folder, **options):
    import mmgpy

    out = folder / "mmg.mesh"
    start = time.perf_counter()
    mmgpy.mmg3d.remesh(
        input_mesh=str(path), output_mesh=str(out), options={"verbose": -1, **options}
    )
    return time.perf_counter() - start, read_medit(out)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh_image")
    parser.add_argument("cgal_remesh")
    parser.add_argument("image")
    parser.add_argument("--delta", default="3")
    parser.add_argument("--size", default="6")
    parser.add_argument("--only", default="")
    given = parser.parse_args()
    folder = Path(tempfile.mkdtemp())

    def ours(out, *options):
        command = [given.mesh_image, given.image, "--delta", given.delta, "--size", given.size]
        command += [
            "--adaptive",
            "off",
            "--threads",
            "1",
            "--quiet",
            "--report",
            folder / "report.json",
            *options,
        ]
        for path in out:
            command += ["-o", folder / path]
        subprocess.run(command, check=True)
        return json.loads((folder / "report.json").read_text())

    report = ours(["refined.mesh", "refined.msh"], "--improve", "none")
    voxel = min(report["image"]["spacing"]) if "image" in report else 1.0
    refined = read_medit(folder / "refined.mesh")
    surface = Surface(refined[0], interfaces(refined[1], refined[2]))
    edges = refined[1][:, [0, 1]]
    edge = np.median(np.linalg.norm(refined[0][edges[:, 0]] - refined[0][edges[:, 1]], axis=1))
    rows = []

    def add(name, work):
        if given.only and name not in given.only.split(","):
            return
        try:
            seconds, mesh = work()
            rows.append(measure(name, seconds, mesh, refined, surface, voxel))
            print(rows[-1], file=sys.stderr)
        except Exception as error:  # What others cannot do is a row of the table, too.
            print(f"{name}: {error}", file=sys.stderr)

    def by_us():
        seconds = ours(["improved.mesh"])["seconds"]["improve"]
        return seconds, read_medit(folder / "improved.mesh")

    def by_cgal(*options):
        ours(["whole.mesh"], "--improve", "none", "--background")
        command = [given.cgal_remesh, folder / "whole.mesh", str(edge), folder / "cgal.mesh"]
        printed = subprocess.run([*command, *options], check=True, capture_output=True, text=True)
        return float(printed.stdout.split()[-1]), read_medit(folder / "cgal.mesh")

    add("refined", lambda: (report["seconds"]["refine"], refined))
    add("lapd", by_us)
    add("gmsh", lambda: by_gmsh(folder / "refined.msh", ""))
    # Mmg 5.8.0 aborts where it may change these interfaces.
    add("Mmg, interfaces kept", lambda: by_mmg(folder / "refined.mesh", folder, optim=1, nosurf=1))
    add("CGAL remeshing", by_cgal)
    add("CGAL remeshing, interfaces kept", lambda: by_cgal("keep"))
    columns = ["tets", "seconds", "least", "largest", "below 10", "below 15", "facet angle"]
    columns += ["off, mean", "off, max", "label", "labels lost"]
    print("| | " + " | ".join(columns) + " |")
    print("|---|" + "---:|" * len(columns))
    for row in rows:
        cells = [f"{row[c]:.3g}" if isinstance(row[c], float) else str(row[c]) for c in columns]
        print(f"| {row['name']} | " + " | ".join(cells) + " |")


if __name__ == "__main__":
    main()
