"""Every mesh format, written by the example program and read back by programs that are not ours.

    python3 readback.py MESH_IMAGE LIBRARY WORK ENVIRONMENT

meshio, gmsh, VTK and trimesh read the files, and what they see is compared with the arrays that
LIBRARY, the installed shared library, hands out for the same image and parameters: points to the
last bit, tets with labels, orientation and volumes, facets with their pairs of labels, and that
normals point from the first to the second. CalculiX solves a problem on the Abaqus file.
ENVIRONMENT is a Python virtual environment with requirements.txt, which is made when it is missing.
Without network, or where one of the programs cannot be loaded, a line says what was SKIPPED. Exit
status 1 if anything differs.
"""

import ctypes
import importlib
import json
import shutil
import subprocess
import sys
from pathlib import Path

# Nothing is to be written beside the sources.
sys.dont_write_bytecode = True

from environment import enter_environment, skip

if len(sys.argv) != 5:
    sys.exit(__doc__)
mesh_image, library_path, work = (Path(argument).absolute() for argument in sys.argv[1:4])
enter_environment(Path(sys.argv[4]).absolute(), "reading meshes back")

import numpy as np
import readback_calculix
import readback_second_order
from readback_readers import READERS as ALL_READERS
from readback_readers import Seen, vtk_blocks, vtk_field, vtk_output

DELTA, SIZE = 1.5, 3.0
# LAPD_WORLD_AS_STORED
AS_STORED = 0


def written(readers):
    """The readers whose files this library writes."""
    version = subprocess.run([mesh_image, "--version"], check=True, stdout=subprocess.PIPE)
    if b"hdf5" in version.stdout:
        return readers
    skip("reading .vtkhdf back, the library was built without HDF5 (libhdf5-dev)")
    return [reader for reader in readers if reader[1] != ".vtkhdf"]


READERS = written(ALL_READERS)
SECOND_ORDER_READERS = written(readback_second_order.READERS)


# ---- The images ----


def phantom(labels):
    """An ellipsoid of the first label, in it two halves of a ball of the next two labels, and a
    box of the last one on the image's edge."""
    z, y, x = np.mgrid[:24, :26, :28]
    image = np.zeros(x.shape, dtype="<i4")
    outer, left, right, box = labels
    image[(x - 14.2) ** 2 / 12**2 + (y - 12.7) ** 2 / 11**2 + (z - 12.1) ** 2 / 9**2 < 1] = outer
    ball = (x - 13.4) ** 2 + (y - 12.2) ** 2 + (z - 11.8) ** 2 < 36
    image[ball & (x < 13)] = left
    image[ball & (x >= 13)] = right
    image[:5, 8:20, 9:21] = box
    return image


def write_nrrd(path, image):
    sizes = " ".join(str(n) for n in reversed(image.shape))
    place = (
        "space: left-posterior-superior\nspace directions: (0.9,0,0) (0,1,0) (0,0,1.1)\nspace "
        "origin: (0,0,0)\n"
    )
    header = (
        f"NRRD0004\ntype: int\ndimension: 3\n{place}sizes: {sizes}\nendian: little\nencoding: raw\n"
        "\n"
    )
    path.write_bytes(header.encode() + image.tobytes())


# ---- The arrays to compare with ----


class Library:
    """The few functions of lapd.h that are needed here."""

    def __init__(self, path):
        self.lapd = ctypes.CDLL(str(path))
        self.lapd.lapd_context_last_error.restype = ctypes.c_char_p
        self.context = self.new("context_create")

    def call(self, name, *arguments):
        status = getattr(self.lapd, "lapd_" + name)(*arguments)
        assert status == 0, self.lapd.lapd_context_last_error(self.context)

    def new(self, name, *arguments):
        handle = ctypes.c_void_p()
        self.call(name, *arguments, ctypes.byref(handle))
        return handle

    def mesh(self, image_path, background, order=1):
        image = self.new("image_read", self.context, str(image_path).encode(), AS_STORED)
        params = self.new("params_create")
        self.call("params_set_delta", self.context, params, ctypes.c_double(DELTA))
        self.call("params_set_size", self.context, params, ctypes.c_double(SIZE))
        self.call("params_set_background", self.context, params, ctypes.c_int32(background))
        self.call("params_set_order", self.context, params, ctypes.c_int32(order))
        self.call("params_set_curved", self.context, params, ctypes.c_int32(order == 2))
        return self.new("mesh_image", self.context, image, params)

    def array(self, mesh, name, kind, width):
        rows, count = ctypes.POINTER(kind)(), ctypes.c_size_t()
        self.call("mesh_get_" + name, mesh, ctypes.byref(rows), ctypes.byref(count))
        flat = np.ctypeslib.as_array(rows, (count.value * width,)).copy()
        return flat.reshape(-1, width) if width > 1 else flat

    def reference(self, image_path, background):
        mesh = self.mesh(image_path, background)
        seen = Seen(
            self.array(mesh, "points", ctypes.c_double, 3),
            self.array(mesh, "tets", ctypes.c_uint32, 4).astype(np.int64),
            self.array(mesh, "labels", ctypes.c_int32, 1),
            self.array(mesh, "facets", ctypes.c_uint32, 3).astype(np.int64),
            np.column_stack(
                [
                    self.array(mesh, "facet_labels", ctypes.c_int32, 2),
                    self.array(mesh, "facet_walls", ctypes.c_uint8, 1),
                ]
            ),
        )
        self.lapd.lapd_mesh_free(mesh)
        seen.volumes = signed_volumes(seen)
        return seen

    def second_order_reference(self, image_path):
        mesh = self.mesh(image_path, False, order=2)
        corners = {
            "tet": self.array(mesh, "tets", ctypes.c_uint32, 4),
            "facet": self.array(mesh, "facets", ctypes.c_uint32, 3),
        }
        middles = {
            "tet": self.array(mesh, "tet_mid_nodes", ctypes.c_uint32, 6),
            "facet": self.array(mesh, "facet_mid_nodes", ctypes.c_uint32, 3),
        }
        tets, facets = (
            np.hstack([corners[kind], middles[kind]]).astype(np.int64) for kind in ("tet", "facet")
        )
        points, labels = self.array(mesh, "points", ctypes.c_double, 3), self.array(
            mesh, "labels", ctypes.c_int32, 1
        )
        self.lapd.lapd_mesh_free(mesh)
        return readback_second_order.Nodes(points, tets, labels, facets)


def signed_volumes(mesh):
    a, b, c, d = (mesh.points[mesh.tets[:, i]] for i in range(4))
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6


# ---- The comparison ----


def sorted_rows(*columns):
    rows = np.column_stack([np.asarray(column, dtype=np.int64) for column in columns])
    return rows[np.lexsort(rows.T[::-1])]


def in_reference_order(seen, reference):
    """`seen` with the numbers that the reference gives to the same points, which are all
    different."""
    there, here = np.lexsort(reference.points.T), np.lexsort(seen.points.T)
    number = np.empty(len(here), dtype=np.int64)
    number[here] = there
    points = np.empty_like(seen.points)
    points[number] = seen.points
    return Seen(
        points,
        number[seen.tets],
        seen.labels,
        number[seen.facets],
        seen.pairs,
        seen.volumes,
        in_order=False,
    )


def compare_tets(seen, reference):
    assert len(seen.tets) == len(reference.tets)
    assert (signed_volumes(seen) > 0).all(), "inverted tets"
    if seen.labels is None:
        assert np.array_equal(seen.tets, reference.tets)
    else:
        assert len(seen.labels) == len(seen.tets)
        got, wanted = (sorted_rows(mesh.tets, mesh.labels) for mesh in (seen, reference))
        assert np.array_equal(got, wanted), "tets and labels differ"
        if seen.in_order:
            assert np.array_equal(seen.tets, reference.tets) and np.array_equal(
                seen.labels, reference.labels
            )
    if seen.volumes is not None:
        assert (seen.volumes > 0).all(), "the reader finds inverted tets"
        got, wanted = (mesh.volumes[np.lexsort(mesh.tets.T)] for mesh in (seen, reference))
        # Some formats hold fewer digits of a point; facets have areas of some square units.
        off = 0.0
        if seen.points.shape == reference.points.shape:
            off = np.abs(seen.points - reference.points).max()
        assert np.allclose(got, wanted, rtol=1e-9, atol=1e-12 + 10 * off)


def compare_facets(seen, reference):
    assert len(seen.facets) == len(seen.pairs) == len(reference.facets)
    # A facet may begin with any of its vertices, as long as its normal stays.
    turned = [
        np.stack([np.roll(f, -f.argmin()) for f in mesh.facets]) for mesh in (seen, reference)
    ]
    # Some readers do not tell walls.
    pairs = reference.pairs[:, : seen.pairs.shape[1]]
    assert np.array_equal(
        sorted_rows(turned[0], seen.pairs), sorted_rows(turned[1], pairs)
    ), "facets or pairs differ"
    if seen.in_order:
        assert np.array_equal(seen.facets, reference.facets) and np.array_equal(seen.pairs, pairs)


def compare_sides(seen):
    """The tet behind a facet has its first label, the one before it has its second, or, without
    a tet, that is background. Facets stand wherever two labels meet."""
    outward = seen.tets[:, [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]].reshape(-1, 3)
    count = int(seen.tets.max()) + 1

    def key(triangles):
        first = triangles.argmin(axis=1)
        a, b, c = (
            np.take_along_axis(triangles, (first[:, None] + i) % 3, axis=1)[:, 0] for i in range(3)
        )
        return (a * count + b) * count + c

    sides = dict(zip(key(outward).tolist(), np.repeat(seen.labels, 4).tolist()))
    assert len(sides) == 4 * len(seen.tets), "two tets on one side of a facet"
    behind = [sides.get(k, 0) for k in key(seen.facets).tolist()]
    before = [sides.get(k, 0) for k in key(seen.facets[:, ::-1]).tolist()]
    assert np.array_equal(
        np.column_stack([behind, before]), seen.pairs[:, :2]
    ), "labels on the sides of facets"
    reverse = key(outward[:, ::-1]).tolist()
    boundary = sum(
        sides.get(k, 0) != label for k, label in zip(reverse, np.repeat(seen.labels, 4).tolist())
    )
    unpaired = sum(
        sides.get(k) is None for k in key(seen.facets[:, ::-1]).tolist() + key(seen.facets).tolist()
    )
    assert boundary + unpaired == 2 * len(seen.facets), "interfaces without facets"


def compare_volume_mesh(seen, reference, ending, report):
    assert (
        seen.points.dtype.kind == "f"
        and seen.points.dtype.itemsize == 8
        and seen.points.shape == reference.points.shape
    )
    if ending == ".inp":
        # Points stand in order here; small numbers are rounded to 20 characters.
        assert np.allclose(seen.points, reference.points, rtol=1e-11, atol=0)
        small = np.abs(reference.points) < 0.1
        assert np.array_equal(seen.points[~small], reference.points[~small])
    elif ending == ".bdf":
        # To 16 characters.
        assert np.allclose(seen.points, reference.points, rtol=1e-9, atol=0)
    elif ending in (".exo", ".feb", ".foam"):
        # Points stand in order, tets by region.
        assert np.array_equal(seen.points, reference.points), "points differ"
        if ending == ".foam":
            # Cells stand in order, and have faces, not vertices.
            assert (signed_volumes(seen) > 0).all(), "inverted cells"
            rows = [np.sort(mesh.tets, axis=1) for mesh in (seen, reference)]
            assert np.array_equal(*rows), "cells differ"
            seen.tets = reference.tets
    else:
        if not seen.in_order:
            seen = in_reference_order(seen, reference)
        assert np.array_equal(seen.points, reference.points), "points differ"
    compare_tets(seen, reference)
    if seen.facets is not None:
        compare_facets(seen, reference)
        compare_sides(seen)
    if seen.labels is not None:
        volumes = signed_volumes(seen)
        labels = set(seen.labels.tolist()) - {0}
        assert labels == {row["label"] for row in report["labels"]}
        for row in report["labels"]:
            of_label = seen.labels == row["label"]
            assert of_label.sum() == row["tets"], row
            assert abs(volumes[of_label].sum() / row["mesh_volume"] - 1) < 1e-9, row


def compare_surface(seen, reference, ending):
    """Corners of the facets, in the order of the mesh. Single precision is STL's, or VTK's."""
    corners = seen.points[seen.facets]
    wanted = reference.points[reference.facets]
    single = ending == ".stl" or seen.points.dtype == np.float32
    assert (
        np.array_equal(corners.astype(np.float32), wanted.astype(np.float32))
        if single
        else np.array_equal(corners, wanted)
    )
    if ending != ".stl":
        assert len(seen.points) == len(np.unique(reference.facets)), "vertices that no facet has"
    if seen.pairs is not None:
        assert np.array_equal(seen.pairs, reference.pairs[:, :2])


def check_stl_normals(path, reference):
    """The readers compute normals from the corners; those in the file must agree. 50 bytes per
    facet: normal, corners, 2 bytes."""
    record = np.dtype([("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    normals = np.frombuffer(path.read_bytes(), dtype=record, offset=84)["normal"]
    a, b, c = (reference.points[reference.facets[:, i]] for i in range(3))
    cross = np.cross(b - a, c - a)
    assert np.allclose(normals, cross / np.linalg.norm(cross, axis=1)[:, None], atol=1e-6)


def check_space(folder, usable):
    """Every format that has a place for it says what the world axes mean, where 3D Slicer looks,
    or in a comment."""
    endings = {ending for _, ending, _ in READERS}
    names_of_grids = [f"mesh{ending}" for ending in (".vtu", ".vtkhdf") if ending in endings]
    wanted = {
        ".stl": lambda data: data[:80],
        ".ply": lambda data: data.split(b"end_header")[0],
        ".vtk": lambda data: data.splitlines()[1],
        **dict.fromkeys([".mesh", ".node", ".inp", ".msh", ".msh2"], lambda data: data),
    }
    for ending, part in wanted.items():
        assert b"SPACE=LPS" in part((folder / f"mesh{ending}").read_bytes()), ending
    if "vtk" in usable:
        grids = [vtk_output(folder / name) for name in names_of_grids]
        grids += [grid for _, _, grid in vtk_blocks(folder / "mesh.vtm")]
        for grid in grids:
            assert bytes(vtk_field(grid)["SPACE"].astype("u1")) == b"LPS"


def compare(seen, reference, ending, report):
    if seen.tets is None:
        compare_surface(seen, reference, ending)
    else:
        compare_volume_mesh(seen, reference, ending, report)


def comparison_finds_faults(reference, report):
    """Each of these meshes has a fault that must be found."""

    def copy():
        arrays = (
            reference.points,
            reference.tets,
            reference.labels,
            reference.facets,
            reference.pairs,
            reference.volumes,
        )
        return Seen(*(array.copy() for array in arrays))

    faulty = [copy() for _ in range(6)]
    faulty[0].points[3, 1] = np.nextafter(faulty[0].points[3, 1], np.inf)
    faulty[1].tets[5] = faulty[1].tets[5][[1, 0, 2, 3]]
    faulty[2].labels[[0, -1]] = reference.labels[reference.labels != reference.labels[0]][0]
    faulty[3].facets[2] = faulty[3].facets[2][::-1]
    faulty[4].pairs[7] = faulty[4].pairs[7][::-1]
    faulty[5].volumes[8] *= -1
    compare(copy(), reference, ".msh", report)
    for number, seen in enumerate(faulty):
        try:
            compare(seen, reference, ".msh", report)
        except AssertionError:
            continue
        raise AssertionError(f"fault {number} was not found")


# ---- The runs ----


def usable_programs():
    usable = {"python"}
    for name in ["meshio", "gmsh", "vtk", "trimesh"]:
        try:
            importlib.import_module(name)
            usable.add(name)
        except (ImportError, OSError) as error:
            skip(f"reading meshes back with {name}, which cannot be loaded: {error}")
    if "gmsh" in usable:
        import gmsh

        gmsh.initialize(interruptible=False)
        gmsh.option.setNumber("General.Terminal", 0)
    if shutil.which("ccx"):
        usable.add("ccx")
    else:
        skip("meshes in CalculiX, there is no program ccx (Debian: calculix-ccx)")
    return usable


def attempt(program, path, comparison):
    """1 if the comparison finds a difference."""
    try:
        comparison(path)
        print(f"  ok      {path.suffix:6} {program}")
        return 0
    except Exception as error:  # Whatever a reader raises, the next one has its turn.
        print(f"  FAILED  {path.suffix:6} {program}: {type(error).__name__} {error}")
        return 1


def run_case(name, labels, background, library, usable):
    folder = work / name
    folder.mkdir(parents=True, exist_ok=True)
    image = folder / "image.nrrd"
    write_nrrd(image, phantom(labels))
    endings = sorted({ending for _, ending, _ in READERS})
    outputs = [argument for ending in endings for argument in ("-o", folder / f"mesh{ending}")]
    options = [
        "--delta",
        str(DELTA),
        "--size",
        str(SIZE),
        "--report",
        folder / "report.json",
        "--quiet",
    ]
    subprocess.run(
        [mesh_image, image, *outputs, *options, *(["--background"] if background else [])],
        check=True,
    )
    reference = library.reference(image, background)
    assert len(np.unique(reference.labels)) == 4 + background
    assert set(reference.pairs[:, 2]) == {0, 5}, "the last label's box ends at a wall"
    report = json.loads((folder / "report.json").read_text())
    comparison_finds_faults(reference, report)
    check_stl_normals(folder / "mesh.stl", reference)
    check_space(folder, usable)
    print(
        f"{name}: labels {sorted(set(reference.labels.tolist()))}, {len(reference.tets)} tets, "
        f"{len(reference.facets)} facets"
    )
    failed = 0
    for program, ending, read in READERS:
        if program in usable:
            failed += attempt(
                program,
                folder / f"mesh{ending}",
                lambda path, read=read: compare(read(path), reference, path.suffix, report),
            )
    if "ccx" in usable:
        failed += attempt(
            "ccx", folder / "mesh.inp", lambda path: readback_calculix.check(path, reference)
        )
    return failed


def run_second_order(library, usable):
    folder = work / "second_order"
    folder.mkdir(parents=True, exist_ok=True)
    image = folder / "image.nrrd"
    write_nrrd(image, phantom([1, 2, 3, 7]))
    endings = sorted({ending for _, ending, _ in SECOND_ORDER_READERS})
    outputs = [argument for ending in endings for argument in ("-o", folder / f"mesh{ending}")]
    options = [
        "--delta",
        str(DELTA),
        "--size",
        str(SIZE),
        "--order",
        "2",
        "--curved",
        "--report",
        folder / "report.json",
        "--quiet",
    ]
    subprocess.run([mesh_image, image, *outputs, *options], check=True)
    reference = library.second_order_reference(image)
    report = json.loads((folder / "report.json").read_text())["second_order"]
    print(
        f"second order: {len(reference.tets)} tets, {report['curved']} of {report['nodes']} nodes "
        "curved"
    )
    failed = 0
    for program, ending, read in SECOND_ORDER_READERS:
        if program in usable:
            failed += attempt(
                program,
                folder / f"mesh{ending}",
                lambda path, read=read: readback_second_order.compare(
                    read(path), reference, path.suffix
                ),
            )
    if "ccx" in usable:
        failed += attempt(
            "ccx",
            folder / "mesh.inp",
            lambda path: readback_second_order.calculix(path, report["volume"]),
        )
    return failed


CASES = [
    ("tissues", [1, 2, 3, 7], False),
    ("background", [3, 1, 2, 4], True),
    ("sparse", [-5, 12, 1_000_003, 40], True),
    ("extreme", [-(2**31), 2**31 - 1, -1, 2**31 - 2], False),
]

usable_now = usable_programs()
lapd = Library(library_path)
failures = sum(run_case(*case, lapd, usable_now) for case in CASES) + run_second_order(
    lapd, usable_now
)
sys.exit(1 if failures else 0)
