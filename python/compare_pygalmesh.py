"""Meshes one label image by lapd and by pygalmesh, and prints both side by side as a table.

    python compare_pygalmesh.py IMAGE DELTA [FACTOR]

IMAGE is what nibabel reads. lapd has DELTA, and twice that as size. The criteria of pygalmesh are
multiples of DELTA, times FACTOR (1 by default): choose it so that both get about as many tets.
pygalmesh runs as by default, which removes slivers, and once without that. All run on one thread,
on an array in memory. Needs `pip install nibabel pygalmesh ./python`; pygalmesh is built from
source, and needs the headers of CGAL and Eigen.
"""

import sys
import time

import nibabel
import numpy as np
import pygalmesh

import lapd

# Of the distance between samples: facet size, facet distance, cell size.
MULTIPLES = np.array([1.16, 0.26, 2.0])


def dihedral_range(points, tets):
    """The smallest and the largest dihedral angle in degrees."""
    low, high = 180.0, 0.0
    corners = points[tets]
    for i, j, k, m in [(0, 1, 2, 3), (0, 2, 1, 3), (0, 3, 1, 2)] + [
        (1, 2, 0, 3),
        (1, 3, 0, 2),
        (2, 3, 0, 1),
    ]:
        edge = corners[:, j] - corners[:, i]
        one = np.cross(edge, corners[:, k] - corners[:, i])
        other = np.cross(edge, corners[:, m] - corners[:, i])
        lengths = np.linalg.norm(one, axis=1) * np.linalg.norm(other, axis=1)
        cosine = np.einsum("ij,ij->i", one, other) / lengths
        angles = np.degrees(np.arccos(np.clip(cosine, -1, 1)))
        low, high = min(low, angles.min()), max(high, angles.max())
    return low, high


def by_lapd(voxels, spacing, delta):
    mesh = lapd.mesh(voxels, spacing=spacing, delta=delta, adaptive="thickness", threads=1)
    return mesh.points, mesh.tets, mesh.labels


def by_pygalmesh(voxels, spacing, delta, **options):
    facet_size, facet_distance, cell_size = (float(value) for value in MULTIPLES * delta)
    mesh = pygalmesh.generate_from_array(
        voxels,
        spacing,
        min_facet_angle=30.0,
        max_radius_surface_delaunay_ball=facet_size,
        max_facet_distance=facet_distance,
        max_circumradius_edge_ratio=2.0,
        max_cell_circumradius=cell_size,
        verbose=False,
        **options,
    )
    return mesh.points, mesh.cells_dict["tetra"], mesh.cell_data_dict["medit:ref"]["tetra"]


def refined_by_pygalmesh(voxels, spacing, delta):
    return by_pygalmesh(voxels, spacing, delta, perturb=False, exude=False)


def main():
    if len(sys.argv) not in (3, 4):
        sys.exit(__doc__)
    image, delta = nibabel.load(sys.argv[1]), float(sys.argv[2])
    factor = float(sys.argv[3]) if len(sys.argv) == 4 else 1.0
    voxels = np.asarray(image.dataobj)
    voxels = np.asfortranarray(voxels, dtype=np.uint8 if voxels.max() < 256 else np.uint16)
    spacing = tuple(float(step) for step in image.header.get_zooms()[:3])
    wanted = set(np.unique(voxels).tolist()) - {0}
    print("| | tets | seconds | labels lost | dihedral angles |")
    print("|---|---:|---:|---:|---|")
    for name, run, step in [
        ("lapd", by_lapd, delta),
        ("pygalmesh", by_pygalmesh, factor * delta),
        ("pygalmesh, perturb=False, exude=False", refined_by_pygalmesh, factor * delta),
    ]:
        start = time.perf_counter()
        points, tets, labels = run(voxels, spacing, step)
        seconds = time.perf_counter() - start
        low, high = dihedral_range(points, tets)
        lost = len(wanted - set(labels.tolist()))
        angles = f"{low:.2f}° to {high:.2f}°"
        print(f"| {name} | {len(tets)} | {seconds:.2f} | {lost} of {len(wanted)} | {angles} |")


if __name__ == "__main__":
    main()
