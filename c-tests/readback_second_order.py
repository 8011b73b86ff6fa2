"""Meshes of second order, read back by programs that are not ours, as readback.py does with others.

All nodes of tets and facets are compared with the arrays of the library. Gmsh bounds the
determinants of Jacobians itself and must find every tet valid, which a wrong order of nodes would
prevent, too.
"""

import re

import numpy as np

from readback_calculix import solve
from readback_readers import (
    febio,
    gmsh_open,
    label_of,
    vtk_blocks,
    vtk_distinct_points,
    vtk_joined,
    vtk_output,
)


class Nodes:
    """Points, tets of ten nodes with labels, facets of six with pairs of labels."""

    def __init__(self, points, tets, labels=None, facets=None, pairs=None):
        self.points, self.tets, self.labels = points, tets, labels
        self.facets, self.pairs = facets, pairs


def vtk_volume(path):
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    grid = vtk_output(path)
    kinds = vtk_to_numpy(grid.GetCellTypes())
    tets = int((kinds == vtk.VTK_QUADRATIC_TETRA).sum())
    assert (kinds[tets:] == vtk.VTK_QUADRATIC_TRIANGLE).all()
    nodes = vtk_to_numpy(grid.GetCells().GetConnectivityArray())
    cells, facets = nodes[: 10 * tets].reshape(-1, 10), nodes[10 * tets :].reshape(-1, 6)
    points = vtk_to_numpy(grid.GetPoints().GetData())
    # VTK tells which nodes an edge has: its ends, and one that is near their middle.
    for t in range(0, len(cells), 97):
        tet = grid.GetCell(t)
        for edge in (tet.GetEdge(i).GetPointIds() for i in range(6)):
            a, b, node = (points[edge.GetId(i)] for i in range(3))
            off, length = np.linalg.norm(node - (a + b) / 2), np.linalg.norm(b - a)
            assert off <= 0.25 * length, f"order of nodes in tet {t}"
    labels = vtk_to_numpy(grid.GetCellData().GetArray("label"))[:tets]
    return Nodes(points, cells, labels, facets)


def vtk_multi_block(path):
    """Points and cells in an order of their own."""
    blocks = vtk_blocks(path)
    points, places = vtk_distinct_points(blocks)
    labels = [
        label_of(name)
        for kind, name, grid in blocks
        if kind == "regions"
        for _ in range(grid.GetNumberOfCells())
    ]
    tets, facets = vtk_joined(blocks, "regions", 10), vtk_joined(blocks, "boundaries", 6)
    return Nodes(points, places[tets], np.array(labels), places[facets])


def meshio_volume(path):
    import meshio

    mesh = meshio.read(path)
    # Abaqus files have surfaces, not triangles.
    facets = set() if path.suffix == ".inp" else {"triangle6"}
    assert {block.type for block in mesh.cells} == {"tetra10"} | facets
    tets = np.concatenate([block.data for block in mesh.cells if block.type == "tetra10"])
    return Nodes(mesh.points, tets if path.suffix != ".inp" else tets[np.lexsort(tets.T)])


def gmsh_elements(dimension):
    """Elements of all entities in the order of their numbers. Gmsh has the nodes of the last two
    edges the other way round."""
    import gmsh

    kinds, numbers, nodes = gmsh.model.mesh.getElements(dimension, -1)
    assert list(kinds) == [{2: 9, 3: 11}[dimension]], kinds
    nodes = nodes[0].astype(np.int64).reshape(len(numbers[0]), -1)[np.argsort(numbers[0])] - 1
    if dimension == 3:
        nodes = nodes[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]
    return np.sort(numbers[0]), nodes


def gmsh_volume(path):
    """Both versions of MSH, and MEDIT. Gmsh must find all tets valid."""
    import gmsh

    points = gmsh_open(path)
    numbers, tets = gmsh_elements(3)
    least = gmsh.model.mesh.getElementQualities(numbers, "minDetJac")
    assert (least > 0).all(), f"{(least <= 0).sum()} tets are not valid"
    return Nodes(points, tets, facets=gmsh_elements(2)[1])


def vtk_exodus(path):
    """Blocks one after the other, as they are in the file."""
    import vtk
    from vtk.util.numpy_support import vtk_to_numpy

    reader = vtk.vtkExodusIIReader()
    reader.SetFileName(str(path))
    reader.SetSqueezePoints(False)
    reader.Update()
    blocks = reader.GetOutput().GetBlock(0)
    grids = [blocks.GetBlock(i) for i in range(blocks.GetNumberOfBlocks())]
    for grid in grids:
        assert set(vtk_to_numpy(grid.GetCellTypes())) == {vtk.VTK_QUADRATIC_TETRA}
    nodes = [vtk_to_numpy(grid.GetCells().GetConnectivityArray()) for grid in grids]
    tets = np.concatenate(nodes).reshape(-1, 10)
    return Nodes(vtk_to_numpy(grids[0].GetPoints().GetData()), tets[np.lexsort(tets.T)])


def febio_volume(path):
    """As XML."""
    seen = febio(path)
    return Nodes(seen.points, seen.tets[np.lexsort(seen.tets.T)])


READERS = [
    ("python", ".feb", febio_volume),
    ("vtk", ".exo", vtk_exodus),
    ("gmsh", ".unv", gmsh_volume),
    ("gmsh", ".bdf", gmsh_volume),
    ("vtk", ".vtu", vtk_volume),
    ("vtk", ".vtk", vtk_volume),
    ("vtk", ".vtm", vtk_multi_block),
    ("vtk", ".vtkhdf", vtk_volume),
    ("meshio", ".vtu", meshio_volume),
    ("meshio", ".vtk", meshio_volume),
    ("meshio", ".inp", meshio_volume),
    ("gmsh", ".msh", gmsh_volume),
    ("gmsh", ".msh2", gmsh_volume),
    ("gmsh", ".mesh", gmsh_volume),
]


def compare(seen, reference, ending):
    if ending == ".vtm":
        compare_unordered(seen, reference)
        return
    assert np.allclose(seen.points, reference.points, rtol=1e-9, atol=0), "points differ"
    wanted = reference.tets
    if ending in (".inp", ".exo", ".feb"):
        wanted = wanted[np.lexsort(wanted.T)]
    assert np.array_equal(seen.tets, wanted), "tets differ"
    if seen.labels is not None:
        assert np.array_equal(seen.labels, reference.labels)
    if seen.facets is not None:
        assert np.array_equal(seen.facets, reference.facets), "facets differ"


def compare_unordered(seen, reference):
    """By coordinates, which are all different, as the rows of sorted cells."""
    there, here = (np.lexsort(mesh.points.T) for mesh in (reference, seen))
    assert np.array_equal(seen.points[here], reference.points[there]), "points differ"
    number = np.empty(len(here), dtype=np.int64)
    number[here] = there
    for got, wanted in (
        (np.column_stack([number[seen.tets], seen.labels]), [reference.tets, reference.labels]),
        (number[seen.facets], [reference.facets]),
    ):
        wanted = np.column_stack(wanted)
        rows = [cells[np.lexsort(cells.T)] for cells in (got, wanted)]
        assert np.array_equal(*rows), "cells differ"


def calculix(path, volume):
    """CalculiX's volume of all tets, which it integrates by a rule of four points, is ours but for
    the error of that rule."""
    labels = sorted(set(re.findall(r"ELSET=label_(\S+)", path.read_text())))
    lines = [f"*INCLUDE, INPUT={path.name}", "*MATERIAL, NAME=ELASTIC", "*ELASTIC", "1000., 0.3"]
    lines += [f"*SOLID SECTION, ELSET=label_{label}, MATERIAL=ELASTIC" for label in labels]
    lines += ["*BOUNDARY", "1, 1, 3", "2, 1, 3", "3, 1, 3"]
    lines += ["*STEP", "*STATIC", "*CLOAD", "4, 1, 1."]
    for label in labels:
        lines += [f"*EL PRINT, ELSET=label_{label}, TOTALS=ONLY", "EVOL"]
    total_volume = r"total volume for set LABEL_\S+ and time.*\s+(-?\d\.\d+E[+-]\d+)"
    found = re.findall(total_volume, solve(path.parent, lines))
    assert len(found) == len(labels)
    total = sum(float(value) for value in found)
    assert abs(total / volume - 1) < 1e-3, (total, volume)
