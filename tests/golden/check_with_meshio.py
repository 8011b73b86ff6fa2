"""Reads the files of tests/writers.rs with meshio and compares them with the mesh they were made
from."""

import sys
from pathlib import Path

import meshio
import numpy as np

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.1, 0.2, 1.5], [0, 0, -1e-7], [-1, 0, 0]])
TETS = np.array([[0, 1, 2, 3], [0, 2, 1, 4], [0, 2, 5, 3]])
LABELS = np.array([7, -2, 0])
FACETS = np.array([[0, 1, 2], [1, 2, 3], [0, 1, 3], [0, 3, 2], [2, 1, 4], [0, 4, 1], [0, 2, 4]])
BOUNDARIES = np.array([3, 4, 4, 4, 1, 2, 1])
NAMES = ["label_-2__background", "label_-2__wall_y_min", "label_-2__label_7", "label_7__background"]

folder = Path(sys.argv[1])
for name, key in [
    ("small.vtu", "label"),
    ("small.vtk", "label"),
    ("small.mesh", "medit:ref"),
    ("small.node", "tetgen:ref"),
]:
    mesh = meshio.read(folder / name)
    assert np.array_equal(mesh.points, POINTS), name
    assert np.array_equal(mesh.cells_dict["tetra"], TETS), name
    values = mesh.cell_data_dict[key] if key in mesh.cell_data_dict else mesh.cell_data_dict
    assert np.array_equal(np.ravel(values["tetra"]), LABELS), (name, values)

for name in ["small.vtu", "small.vtk"]:
    mesh = meshio.read(folder / name)
    assert np.array_equal(mesh.cells_dict["triangle"], FACETS), name
    sides = [[-2, 7], [7, 0], [7, 0], [7, 0], [-2, 0], [-2, 0], [-2, 0]]
    assert np.array_equal(mesh.cell_data_dict["BoundaryLabels"]["triangle"], sides), name
    assert np.array_equal(mesh.cell_data_dict["boundary"]["triangle"], BOUNDARIES), name
    numbers = {key: np.ravel(value).tolist() for key, value in mesh.field_data.items()}
    regions = {"label_7": [7, 3], "label_-2": [-2, 3], "background": [0, 3]}
    # meshio leaves the field data of legacy files out.
    expected = {**regions, **{name: [i, 2] for i, name in enumerate(NAMES, 1)}}
    assert numbers == (expected if name.endswith("u") else {}), (name, numbers)

mesh = meshio.read(folder / "small.mesh")
assert np.array_equal(mesh.cells_dict["triangle"], FACETS)
assert np.array_equal(mesh.cell_data_dict["medit:ref"]["triangle"], BOUNDARIES)

stl = meshio.read(folder / "small.stl")
assert np.array_equal(stl.points[stl.cells_dict["triangle"]], POINTS.astype(np.float32)[FACETS])

# Version 2.2 keeps the order of the mesh; version 4.1 and Abaqus have tets by label. Tags of Gmsh
# are positive, and those of surfaces come after those of volumes.
TAGS = {7: 7, -2: 9, 0: 8}
for name in ["small.msh", "small.msh2", "small.inp"]:
    mesh = meshio.read(folder / name, file_format="abaqus" if name.endswith("inp") else "gmsh")
    vertices = [np.flatnonzero((POINTS == point).all(axis=1))[0] for point in mesh.points]
    order = [0, 1, 2] if name == "small.msh2" else [1, 2, 0]
    assert np.array_equal(np.take(vertices, mesh.cells_dict["tetra"]), TETS[order]), name
    if name.endswith("inp"):
        blocks = {
            name: [i for i, part in enumerate(parts) if len(part)]
            for name, parts in mesh.cell_sets.items()
        }
        assert blocks == {"label_-2": [0], "background": [1], "label_7": [2]}, blocks
    else:
        assert mesh.cell_data_dict["gmsh:physical"]["tetra"].tolist() == [
            TAGS[label] for label in LABELS[order]
        ], name
        facets = np.take(vertices, mesh.cells_dict["triangle"])
        order = np.arange(7) if name == "small.msh2" else np.argsort(BOUNDARIES, kind="stable")
        assert np.array_equal(facets, FACETS[order]), name
        surfaces = max(TAGS.values()) + BOUNDARIES[order]
        assert np.array_equal(mesh.cell_data_dict["gmsh:physical"]["triangle"], surfaces), name
        names = {key: value.tolist() for key, value in mesh.field_data.items()}
        assert names == {
            "label_7": [7, 3],
            "label_-2": [9, 3],
            "background": [8, 3],
            **{name: [i, 2] for i, name in enumerate(NAMES, 10)},
        }, names

off = meshio.read(folder / "small.off")
assert np.array_equal(off.points[off.cells_dict["triangle"]], POINTS[FACETS])
