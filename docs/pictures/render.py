#!/usr/bin/env python3
"""Draws a labelled tetrahedral mesh: its interfaces, and a cut through its tets.

usage: render.py MESH.vtu [-o PREFIX] [--only interfaces|cut] [--axis x|y|z] [--at 0.5] [--view
AZIMUTH ELEVATION] [--up x|-x|y|-y|z|-z]

Writes two pictures: PREFIX-interfaces.png, the interfaces of all labels but those whose centre lies
in the octant towards the camera, each label in its colour; and PREFIX-cut.png, the tets beyond a
plane, whole and with their edges. MESH is a VTU or VTK file with the cell array `label`; MEDIT's
.mesh works too.

Needs Python 3.9 or later and `pip install pyvista pillow` (and meshio for .mesh). It needs no
display: VTK draws through EGL or OSMesa, on Debian from `apt install libegl1 libgl1-mesa-dri
libxrender1`.
"""

import argparse
import os
import pathlib
import sys

if not os.environ.get("DISPLAY"):
    os.environ.setdefault(
        "VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow"
    )  # before VTK is loaded; else it warns of a missing X server

import numpy as np
import pyvista as pv
from PIL import Image

WIDTH = 1200  # of a picture in pixels; less where it would take too many bytes
BYTES = 400_000  # the most that a picture takes
FACES = np.array(
    [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]
)  # face i of a tet lies opposite to its vertex i


def read(path):
    """Points (n, 3), tets (m, 4) and labels (m,) of a mesh file; label 0, the outside, is left
    out."""
    if path.endswith(".mesh"):
        import meshio

        mesh = meshio.read(path)
        index = next(i for i, block in enumerate(mesh.cells) if block.type == "tetra")
        points, tets, labels = (
            mesh.points,
            mesh.cells[index].data,
            mesh.cell_data["medit:ref"][index],
        )
    else:
        mesh = pv.read(path)
        if "label" not in mesh.cell_data:
            sys.exit(f"{path}: no cell array named label")
        is_tet = mesh.celltypes == pv.CellType.TETRA
        points, tets, labels = (
            mesh.points,
            mesh.cells_dict[pv.CellType.TETRA],
            mesh.cell_data["label"][is_tet],
        )
    inside = labels != 0
    return (
        np.asarray(points, float),
        np.asarray(tets)[inside].astype(np.int64),
        np.asarray(labels)[inside],
    )


def border_facets(tets, labels):
    """Facets between two different labels or at the border of the tets given: (f, 3) vertices and
    (f, 2) labels, 0 where there is no tet.

    The first label is that of the tet whose facet it is, so never 0.
    """
    facets = tets[:, FACES].reshape(-1, 3)
    owner = np.repeat(np.arange(len(tets)), 4)
    key = np.sort(facets, axis=1)
    order = np.lexsort(key.T)
    twin = np.zeros(len(order), bool)  # the facet at this place of the order equals the next one
    twin[:-1] = (key[order[1:]] == key[order[:-1]]).all(axis=1)
    first = np.flatnonzero(twin)
    paired = twin.copy()
    paired[first + 1] = True
    alone = order[~paired]
    one, two = order[first], order[first + 1]
    differ = labels[owner[one]] != labels[owner[two]]
    one, two = one[differ], two[differ]
    triangles = np.concatenate([facets[alone], facets[one]])
    sides = np.concatenate(
        [
            np.stack([labels[owner[alone]], np.zeros(len(alone), labels.dtype)], axis=1),
            np.stack([labels[owner[one]], labels[owner[two]]], axis=1),
        ]
    )
    return triangles, sides


def palette(labels):
    """A soft colour (u8, 3) for every one of the sorted labels, far from those of its
    neighbours: hues by the golden angle in OKLCH."""
    rank = np.arange(len(labels))
    hue = np.deg2rad(25 + 137.508 * rank)
    lightness = np.array([0.78, 0.88, 0.70, 0.83])[rank % 4]
    chroma = np.array([0.13, 0.09, 0.14, 0.10])[(rank // 2) % 4]
    p, q = chroma * np.cos(hue), chroma * np.sin(hue)
    lms = np.stack(
        [
            lightness + 0.3963377774 * p + 0.2158037573 * q,
            lightness - 0.1055613458 * p - 0.0638541728 * q,
            lightness - 0.0894841775 * p - 1.2914855480 * q,
        ],
        axis=1,
    )
    to_rgb = [
        [4.0767416621, -3.3077115913, 0.2309699292],
        [-1.2684380046, 2.6097574011, -0.3413193965],
        [-0.0041960863, -0.7034186147, 1.7076147010],
    ]
    linear = lms**3 @ np.transpose(to_rgb)
    linear = np.clip(linear, 0, 1)
    return (
        255 * np.where(linear < 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    ).astype(np.uint8)


def surface(points, triangles, rgb):
    faces = np.column_stack([np.full(len(triangles), 3), triangles])
    mesh = pv.PolyData(points, faces.ravel())
    mesh.cell_data["rgb"] = rgb
    return mesh.remove_unused_points()


def towards(azimuth, elevation, up):
    """Unit vectors from the centre to the camera and upwards. Azimuth 0 looks along the axis
    after `up`'s in the cycle x, y, z."""
    sign, axis = (-1.0 if up.startswith("-") else 1.0), "xyz".index(up[-1])
    a, e = np.deg2rad([azimuth, elevation])
    direction = np.zeros(3)
    direction[axis], direction[(axis + 1) % 3], direction[(axis + 2) % 3] = (
        sign * np.sin(e),
        np.cos(e) * np.cos(a),
        np.cos(e) * np.sin(a),
    )
    upwards = np.zeros(3)
    upwards[axis] = sign
    return direction, upwards


def draw(path, mesh, direction, upwards, edge_opacity):
    """Draws the mesh so that it fills a picture of WIDTH pixels, as high as it needs, and writes
    it with a palette, which keeps files small."""
    side = np.cross(upwards, direction)
    side /= np.linalg.norm(side)
    above = np.cross(direction, side)
    across, along = mesh.points @ side, mesh.points @ above
    centre = (
        side * (across.min() + across.max()) / 2
        + above * (along.min() + along.max()) / 2
        + direction * (mesh.center @ direction)
    )
    width, height = 1.04 * np.ptp(across), 1.04 * np.ptp(along)

    plotter = pv.Plotter(
        off_screen=True, window_size=(WIDTH, round(WIDTH * height / width)), lighting="none"
    )
    plotter.set_background("white")
    plotter.add_mesh(
        mesh,
        scalars="rgb",
        rgb=True,
        show_edges=True,
        edge_color="#20202a",
        edge_opacity=edge_opacity,
        line_width=1,
        ambient=0.4,
        diffuse=0.72,
        specular=0,
    )
    far = 100 * mesh.length
    for towards_light, intensity in (
        (0.5 * side + 0.7 * above + direction, 0.72),
        (-0.8 * side + 0.2 * above + direction, 0.3),
    ):
        plotter.add_light(
            pv.Light(
                position=centre + far * towards_light,
                focal_point=centre,
                intensity=intensity,
                positional=False,
            )
        )
    plotter.camera_position = [centre + 2 * mesh.length * direction, centre, above]
    plotter.enable_parallel_projection()
    plotter.camera.parallel_scale = height / 2
    plotter.camera.clipping_range = (0.5 * mesh.length, 3.5 * mesh.length)
    plotter.enable_anti_aliasing("ssaa")
    picture = Image.fromarray(plotter.screenshot(return_img=True))
    plotter.close()
    while True:
        picture.quantize(
            256, method=Image.Quantize.MAXCOVERAGE, kmeans=3, dither=Image.Dither.NONE
        ).save(path, optimize=True)
        if os.path.getsize(path) <= BYTES:
            break
        picture = picture.resize(
            (picture.width * 9 // 10, picture.height * 9 // 10), Image.Resampling.LANCZOS
        )
    print(f"{path}: {picture.width}x{picture.height}, {os.path.getsize(path) // 1024} KB")


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("mesh")
    parser.add_argument(
        "-o", metavar="PREFIX", help="beginning of the pictures' names (default: the mesh's name)"
    )
    parser.add_argument("--only", choices=["interfaces", "cut"])
    parser.add_argument("--axis", choices="xyz", default="x", help="axis across the cut")
    parser.add_argument(
        "--at",
        type=float,
        default=0.5,
        help="where the cut lies between the mesh's two ends along that axis",
    )
    parser.add_argument(
        "--view",
        type=float,
        nargs=2,
        default=(35, 28),
        metavar=("AZIMUTH", "ELEVATION"),
        help="direction to the camera, degrees",
    )
    parser.add_argument("--up", choices=["x", "-x", "y", "-y", "z", "-z"], default="z")
    args = parser.parse_args()
    prefix = args.o or str(pathlib.Path(args.mesh).with_suffix(""))
    points, tets, labels = read(args.mesh)
    used = np.unique(labels)
    table = palette(used)

    def colour(of):
        return table[np.searchsorted(used, of)]

    direction, upwards = towards(*args.view, args.up)

    if args.only != "cut":
        centres = points[tets].mean(axis=1)
        middle = (points[tets].min(axis=(0, 1)) + points[tets].max(axis=(0, 1))) / 2
        tets_of = np.bincount(np.searchsorted(used, labels))
        label_centres = np.stack(
            [np.bincount(np.searchsorted(used, labels), centres[:, i]) / tets_of for i in range(3)],
            axis=1,
        )
        near = ((label_centres - middle) * np.where(direction < 0, -1, 1) > 0).all(axis=1)
        kept = ~near[np.searchsorted(used, labels)]
        triangles, sides = border_facets(tets[kept], labels[kept])
        draw(
            f"{prefix}-interfaces.png",
            surface(points, triangles, colour(sides[:, 0])),
            direction,
            upwards,
            edge_opacity=0.2,
        )
    if args.only != "interfaces":
        axis = "xyz".index(args.axis)
        heights = points[tets].mean(axis=1)[:, axis]
        low, high = points[tets][..., axis].min(), points[tets][..., axis].max()
        plane = low + args.at * (high - low)
        far = heights < plane if direction[axis] > 0 else heights > plane
        triangles, sides = border_facets(tets[far], labels[far])
        outer = sides[:, 1] == 0
        draw(
            f"{prefix}-cut.png",
            surface(points, triangles[outer], colour(sides[outer, 0])),
            direction,
            upwards,
            edge_opacity=0.75,
        )


if __name__ == "__main__":
    main()
