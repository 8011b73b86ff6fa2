"""Reads the files of tests/writers.rs with meshio and compares them with the mesh they were made from."""

import sys
from pathlib import Path

import meshio
import numpy as np

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.1, 0.2, 1.5], [0, 0, -1e-7], [-1, 0, 0]])
TETS = np.array([[0, 1, 2, 3], [0, 2, 1, 4], [0, 2, 5, 3]])
LABELS = np.array([7, -2, 0])
FACETS = np.array([[0, 2, 1], [1, 2, 3], [0, 1, 3], [0, 3, 2], [2, 4, 1], [0, 1, 4], [0, 4, 2]])
PAIRS = np.array([2, 3, 3, 3, 1, 1, 1])

folder = Path(sys.argv[1])
for name, key in [("small.vtu", "label"), ("small.vtk", "label"), ("small.mesh", "medit:ref"), ("small.node", "tetgen:ref")]:
    mesh = meshio.read(folder / name)
    assert np.array_equal(mesh.points, POINTS), name
    assert np.array_equal(mesh.cells_dict["tetra"], TETS), name
    values = mesh.cell_data_dict[key] if key in mesh.cell_data_dict else mesh.cell_data_dict
    assert np.array_equal(np.ravel(values["tetra"]), LABELS), (name, values)

mesh = meshio.read(folder / "small.mesh")
assert np.array_equal(mesh.cells_dict["triangle"], FACETS)
assert np.array_equal(mesh.cell_data_dict["medit:ref"]["triangle"], PAIRS)

stl = meshio.read(folder / "small.stl")
assert np.array_equal(stl.points[stl.cells_dict["triangle"]], POINTS.astype(np.float32)[FACETS])
