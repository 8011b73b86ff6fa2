#!/usr/bin/env python3
"""Makes the pictures of docs/gallery.md: builds the phantoms, meshes them and the real images that
are given, and draws them.

usage: gallery.py [--mesh-image build/bin/mesh_image] [-o docs/pictures] [--work build/gallery]
[--brain brain.nrrd] [--abdomen abdomen.nrrd]
                  [--only sheet junction helix brain abdomen]

Phantoms come from the formulas below, so anyone can make their pictures; those of the atlases are
left as they are when their image is not given. Needs what render.py needs, and `mesh_image`, which
`sh examples/quickstart.sh` builds.
"""

import argparse
import pathlib
import subprocess
import sys

import numpy as np
import pyvista as pv

import render

render.BYTES = 300_000


def sheet():
    """A wave one voxel thick: where it climbs a step, voxels meet in edges only."""
    x, y = np.meshgrid(np.arange(44), np.arange(44), indexing="ij")
    height = np.rint(9 + 3.2 * np.sin(x / 7) + 2.6 * np.cos(y / 6)).astype(int)
    image = np.zeros((48, 48, 20), np.int16)
    image[x + 2, y + 2, height] = 1
    return image


def junction():
    """Eight cubes that meet in a point, each of its own label."""
    half = (np.indices((20, 20, 20)) >= 10).astype(np.int16)
    return np.pad(1 + half[0] + 2 * half[1] + 4 * half[2], 2)


def helix():
    """A tube two voxels wide."""
    image = np.zeros((40, 40, 46), np.int16)
    for turn in np.linspace(0, 2.75, 4000):
        angle = 2 * np.pi * turn
        at = np.rint([19 + 14 * np.cos(angle), 19 + 14 * np.sin(angle), 4 + 13.3 * turn]).astype(
            int
        )
        image[at[0] : at[0] + 2, at[1] : at[1] + 2, at[2] : at[2] + 2] = 1
    return image


def write_nrrd(path, image):
    """Voxels of 1 mm, x fastest."""
    sizes = " ".join(map(str, image.shape))
    header = (
        f"NRRD0004\ntype: short\ndimension: 3\nsizes: {sizes}\nspacings: 1 1 1\nencoding: raw\n"
        "endian: little\n\n"
    )
    path.write_bytes(header.encode() + image.astype("<i2").tobytes(order="F"))


def mesh(tool, image, out, *options):
    """Points, tets and labels of the mesh of an image file."""
    subprocess.run([tool, str(image), "-o", str(out), "--quiet", *map(str, options)], check=True)
    return render.read(str(out))


def voxels(image, rgb):
    """The outer faces of the voxels that are not 0, as squares."""
    padded = np.pad(image, 1)
    points, colours = [], []
    for axis in range(3):
        moved = np.moveaxis(padded, axis, 0)
        for low, high in ((moved[:-1], moved[1:]), (moved[1:], moved[:-1])):
            at = np.argwhere((high != 0) & (low == 0))
            # Along the axis, and along the two others in their order.
            plane = np.empty((len(at), 4, 3))
            plane[..., 0] = at[:, None, 0] - 0.5
            plane[..., 1:] = at[:, None, 1:] + np.array(
                [[-1.5, -1.5], [-0.5, -1.5], [-0.5, -0.5], [-1.5, -0.5]]
            )
            points.append(np.insert(plane[..., 1:], axis, plane[..., 0], axis=2))
            colours.append(rgb[high[tuple(at.T)]])
    points = np.concatenate(points)
    count = len(points)
    faces = np.column_stack([np.full(count, 4), np.arange(4 * count).reshape(-1, 4)])
    surface = pv.PolyData(points.reshape(-1, 3), faces.ravel())
    surface.cell_data["rgb"] = np.concatenate(colours)
    return surface


def coloured(labels):
    """A table of colours by label."""
    used = np.unique(labels)
    table = np.zeros((used.max() + 1, 3), np.uint8)
    table[used] = render.palette(used)
    return table


def outside(points, tets, labels, table):
    """The facets that bound the tets."""
    triangles, sides = render.border_facets(tets, labels)
    outer = sides[:, 1] == 0
    return render.surface(points, triangles[outer], table[sides[outer, 0]])


def image_and_mesh(tool, work, path, name, image, view, up="z"):
    """Draws the voxels, and beside them their mesh."""
    source = work / f"{name}.nrrd"
    write_nrrd(source, image)
    points, tets, labels = mesh(tool, source, work / f"{name}.vtu", "--delta", 1, "--size", 2)
    table = coloured(labels)
    left, right = voxels(image, table), outside(points, tets, labels, table)
    direction, upwards = render.towards(*view, up)
    side = np.cross(upwards, direction)
    side /= np.linalg.norm(side)
    right.points += side * (1.06 * np.ptp(left.points @ side))
    render.draw(path, left.append_polydata(right), direction, upwards, edge_opacity=0.55)


def apart(tool, work, path):
    """Draws the labels of the junction, moved away from the point where they meet."""
    source = work / "junction.nrrd"
    write_nrrd(source, junction())
    points, tets, labels = mesh(tool, source, work / "junction.vtu", "--delta", 1.5, "--size", 3)
    table = coloured(labels)
    centre = points[tets].mean(axis=(0, 1))
    parts = []
    for label in np.unique(labels):
        own = tets[labels == label]
        part = outside(points, own, np.full(len(own), label), table)
        part.points += 0.45 * (points[own].mean(axis=(0, 1)) - centre)
        parts.append(part)
    direction, upwards = render.towards(28, 24, "z")
    render.draw(path, parts[0].append_polydata(*parts[1:]), direction, upwards, edge_opacity=0.6)


def cut(tool, work, path, name, image, delta, axis, at, view, up):
    """Draws the tets of an atlas behind a plane, whole."""
    points, tets, labels = mesh(
        tool, image, work / f"{name}.vtu", "--delta", delta, "--size", 2 * delta
    )
    direction, upwards = render.towards(*view, up)
    along = points[..., axis]
    plane = along[tets].min() + at * np.ptp(along[tets])
    heights = along[tets].mean(axis=1)
    far = heights < plane if direction[axis] > 0 else heights > plane
    render.draw(
        path,
        outside(points, tets[far], labels[far], coloured(labels)),
        direction,
        upwards,
        edge_opacity=0.35,
    )


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--mesh-image", default="build/bin/mesh_image", metavar="PROGRAM")
    parser.add_argument(
        "-o", default="docs/pictures", metavar="FOLDER", help="where the pictures go"
    )
    parser.add_argument(
        "--work", default="build/gallery", metavar="FOLDER", help="where images and meshes go"
    )
    parser.add_argument("--brain", metavar="IMAGE", help="SPL-PNL brain atlas")
    parser.add_argument("--abdomen", metavar="IMAGE", help="SPL abdominal atlas")
    parser.add_argument(
        "--only", nargs="+", choices=["sheet", "junction", "helix", "brain", "abdomen"]
    )
    args = parser.parse_args()
    out, work, tool = pathlib.Path(args.o), pathlib.Path(args.work), args.mesh_image
    work.mkdir(parents=True, exist_ok=True)
    drawings = {
        "sheet": lambda path: image_and_mesh(tool, work, path, "sheet", sheet(), (38, 38)),
        "junction": lambda path: apart(tool, work, path),
        "helix": lambda path: image_and_mesh(tool, work, path, "helix", helix(), (35, 22)),
        "brain": lambda path: cut(tool, work, path, "brain", args.brain, 2, 2, 0.52, (65, 40), "z"),
        "abdomen": lambda path: cut(
            tool, work, path, "abdomen", args.abdomen, 2.5, 1, 0.52, (65, 30), "z"
        ),
    }
    for name, drawing in drawings.items():
        if args.only and name not in args.only:
            continue
        if name in ("brain", "abdomen") and not getattr(args, name):
            print(
                f"{name}: no image given (--{name}), its picture is left as it is", file=sys.stderr
            )
            continue
        drawing(str(out / f"gallery-{name}.png"))


if __name__ == "__main__":
    main()
