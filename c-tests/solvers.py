"""Solvers of their own open our files and solve on them, by the names of regions and boundaries.

    python3 solvers.py MESH_IMAGE WORK ENVIRONMENT

A box of two materials fills its image; the potential is 0 on one wall and 1 on the other. The
flux between them is known: with the materials one behind the other, and side by side. scikit-fem
(by .msh), DOLFINx (by .msh and .xdmf) and MFEM (by .mfem) must find it to 1e-9 where interfaces are
where voxels end, and CalculiX (by .inp) to the digits that it prints. OpenFOAM checks the polyMesh
and solves on it; pyNastran and pyfebio, which know the input of their solvers, read .bdf and .feb.
Without network, or where a program is missing, a line says what was SKIPPED. Exit status 1 if
anything differs.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

# Nothing is to be written beside the sources.
sys.dont_write_bytecode = True

from environment import enter_environment, skip

if len(sys.argv) != 4:
    sys.exit(__doc__)
mesh_image, work = (Path(argument).absolute() for argument in sys.argv[1:3])
enter_environment(Path(sys.argv[3]).absolute(), "solvers on our files")

import meshio
import numpy as np
from readback_calculix import solve as solve_with_calculix
from readback_readers import foam_cells
from skfem import Basis, BilinearForm, ElementTetP1, MeshTet, condense, solve
from skfem.helpers import dot, grad

DIMS, SPACING = (24, 16, 12), (1.0, 1.25, 0.75)
CONDUCTIVITY = {"left": 1.0, "right": 3.0}
LENGTH = DIMS[0] * SPACING[0]
AREA = DIMS[1] * SPACING[1] * DIMS[2] * SPACING[2]
ENDINGS = ["msh", "mfem", "inp", "bdf", "feb", "foam"]
features = subprocess.run([mesh_image, "--version"], check=True, stdout=subprocess.PIPE, text=True)
HAS_XDMF = "hdf5" in features.stdout
if HAS_XDMF:
    ENDINGS.append("xdmf")
else:
    skip("the flux by DOLFINx on XDMF, the library was built without HDF5 (libhdf5-dev)")


def mesh_box(name, axis, at, *options):
    """Labels 1 and 2, left and right, in front of voxel `at` along an axis and behind it."""
    folder = work / name
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    labels = np.where(np.indices(DIMS)[axis] < at, 1, 2).astype("<u1")
    x, y, z = SPACING
    header = (
        "NRRD0004\ntype: uchar\ndimension: 3\nspace: left-posterior-superior\nspace directions: "
        f"({x},0,0) (0,{y},0) (0,0,{z})\nspace origin: (0,0,0)\nsizes: {DIMS[0]} {DIMS[1]} "
        f"{DIMS[2]}\nencoding: raw\n\n"
    )
    (folder / "box.nrrd").write_bytes(header.encode() + labels.tobytes(order="F"))
    (folder / "names.txt").write_text("1 left\n2 right\n")
    outputs = [argument for ending in ENDINGS for argument in ("-o", folder / f"mesh.{ending}")]
    lengths = ["--delta", "2.2", "--size", "4.4"]
    command = [mesh_image, folder / "box.nrrd", "--names", folder / "names.txt", *lengths]
    subprocess.run([*command, "--quiet", *options, *outputs], check=True)
    return folder


def exact_flux(axis, at):
    left, right = CONDUCTIVITY.values()
    part = at / DIMS[axis]
    if axis == 0:
        return AREA / LENGTH / (part / left + (1 - part) / right)
    return AREA / LENGTH * (part * left + (1 - part) * right)


def flux_of_scikit_fem(folder):
    mesh = meshio.read(folder / "mesh.msh")
    names = {tuple(number): name for name, number in mesh.field_data.items()}
    groups = mesh.cell_data_dict["gmsh:physical"]
    conductivity = np.array([CONDUCTIVITY[names[tag, 3]] for tag in groups["tetra"]])
    boundary = np.array([names[tag, 2] for tag in groups["triangle"]])
    basis = Basis(
        MeshTet(
            np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.cells_dict["tetra"].T)
        ),
        ElementTetP1(),
    )
    per_point = np.repeat(conductivity[:, None], basis.dx.shape[1], axis=1)
    matrix = BilinearForm(lambda u, v, w: w["k"] * dot(grad(u), grad(v))).assemble(
        basis, k=per_point
    )
    low, high = (
        np.unique(mesh.cells_dict["triangle"][np.char.endswith(boundary, wall)])
        for wall in ("wall_x_min", "wall_x_max")
    )
    fixed = np.zeros(len(mesh.points))
    fixed[high] = 1
    potential = solve(
        *condense(matrix, np.zeros_like(fixed), x=fixed, D=np.concatenate([low, high]))
    )
    return potential @ (matrix @ potential)


def flux_of_mfem(folder):
    """By the sets of attributes: PyMFEM has MFEM's own reader of meshes."""
    import mfem.ser as mfem

    mesh = mfem.Mesh(str(folder / "mesh.mfem"), 1, 1)
    count = mesh.attributes.Max()
    values = mfem.Vector(count)
    for name, conductivity in CONDUCTIVITY.items():
        for attribute in mesh.attribute_sets.GetAttributeSet(name).ToList():
            values[attribute - 1] = conductivity
    space = mfem.FiniteElementSpace(mesh, mfem.H1_FECollection(1, 3))
    potential = mfem.GridFunction(space)
    potential.Assign(0.0)
    ends = mfem.intArray([0] * mesh.bdr_attributes.Max())
    for wall, value in (("wall_x_min", 0.0), ("wall_x_max", 1.0)):
        marker = mfem.intArray([0] * mesh.bdr_attributes.Max())
        for name in mesh.bdr_attribute_sets.GetAttributeSetNames():
            if name.endswith(wall):
                for attribute in mesh.bdr_attribute_sets.GetAttributeSet(name).ToList():
                    marker[attribute - 1] = ends[attribute - 1] = 1
        potential.ProjectBdrCoefficient(mfem.ConstantCoefficient(value), marker)
    fixed = mfem.intArray()
    space.GetEssentialTrueDofs(ends, fixed)
    form = mfem.BilinearForm(space)
    coefficient = mfem.PWConstCoefficient(values)
    form.AddDomainIntegrator(mfem.DiffusionIntegrator(coefficient))
    form.Assemble()
    load = mfem.LinearForm(space)
    load.Assemble()
    matrix, right, found = mfem.SparseMatrix(), mfem.Vector(), mfem.Vector()
    form.FormLinearSystem(fixed, potential, load, matrix, found, right)
    mfem.PCG(matrix, mfem.GSSmoother(matrix), right, found, 0, 2000, 1e-30, 0.0)
    form.RecoverFEMSolution(found, load, potential)
    whole = mfem.BilinearForm(space)
    whole.AddDomainIntegrator(mfem.DiffusionIntegrator(coefficient))
    whole.Assemble()
    whole.Finalize()
    return whole.InnerProduct(potential, potential)


# Debian's Python, which DOLFINx belongs to; None where it is not there.
DOLFINX = "/usr/bin/python3"
if subprocess.run([DOLFINX, "-c", "import dolfinx"], check=False, capture_output=True).returncode:
    DOLFINX = None


def flux_of_dolfinx(folder, ending):
    """Debian's Python gets our module of Gmsh, which is one file and a library."""
    import gmsh

    module = work / "gmsh_module"
    module.mkdir(exist_ok=True)
    for source in (gmsh.__file__, gmsh.libpath):
        link = module / Path(source).name
        link.unlink(missing_ok=True)
        link.symlink_to(source)
    script = Path(__file__).with_name("solve_dolfinx.py")
    run = subprocess.run(
        [
            DOLFINX,
            script,
            folder / f"mesh.{ending}",
            *(f"{n}={k}" for n, k in CONDUCTIVITY.items()),
        ],
        check=True,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(module), "PYTHONDONTWRITEBYTECODE": "1"},
        stdout=subprocess.PIPE,
        text=True,
    )
    return float(run.stdout.split()[-1])


def flux_of_calculix(folder):
    lines = ["*INCLUDE, INPUT=mesh.inp"]
    for name, conductivity in CONDUCTIVITY.items():
        lines += [f"*MATERIAL, NAME=M_{name}", "*CONDUCTIVITY", f"{conductivity}"]
        lines += [f"*SOLID SECTION, ELSET={name}, MATERIAL=M_{name}"]
    text = (folder / "mesh.inp").read_text()
    walls = re.findall(r"^\*NSET, NSET=(\S+__wall_x_(min|max))\n([\d,\n]+)", text, re.MULTILINE)
    # Nodes where both materials meet the wall count once.
    high = {
        int(node) for _, side, nodes in walls if side == "max" for node in re.findall(r"\d+", nodes)
    }
    lines += ["*NSET, NSET=HIGH", *(f"{node}," for node in sorted(high))]
    lines += ["*STEP", "*HEAT TRANSFER, STEADY STATE", "*BOUNDARY"]
    lines += [f"{name}, 11, 11, {float(side == 'max')}" for name, side, _ in walls]
    lines += ["*NODE PRINT, NSET=HIGH, TOTALS=ONLY", "RFL"]
    printed = solve_with_calculix(folder, lines, "a nonlinear geometric analysis is requested")
    return float(re.search(r"total heat generation.*\n\s*\n\s+(\S+)", printed)[1])


def head(kind, name, location="system"):
    return (
        f"FoamFile {{ version 2.0; format ascii; class {kind}; location {location}; "
        f"object {name}; }}"
        "\n"
    )


CASE = {
    "system/controlDict": "application laplacianFoam; startFrom startTime; startTime 0; stopAt "
    "endTime; endTime 1; deltaT 1; writeControl timeStep; writeInterval 1; writePrecision 12;",
    "system/fvSchemes": "ddtSchemes { default steadyState; } gradSchemes { default Gauss linear; } "
    "divSchemes { default none; } laplacianSchemes { default Gauss linear corrected; } "
    "interpolationSchemes { default linear; } snGradSchemes { default corrected; }",
    "system/fvSolution": "solvers { T { solver PCG; preconditioner DIC; tolerance 1e-10; relTol 0; "
    "} } SIMPLE { nNonOrthogonalCorrectors 20; }",
    "constant/transportProperties": "DT DT [0 2 -1 0 0 0 0] 1;",
    "0/T": 'dimensions [0 0 0 1 0 0 0]; internalField uniform 0; boundaryField { ".*" { type '
    'zeroGradient; } ".*wall_x_min" { type fixedValue; value uniform 0; } ".*wall_x_max" { type '
    "fixedValue; value uniform 1; } }",
}


def run_openfoam(folder):
    """checkMesh must find nothing wrong, and the potential in one material must be a ramp, as far
    as finite volumes on tets of a sixth of the box go."""
    for name, text in CASE.items():
        path = folder / name
        path.parent.mkdir(exist_ok=True)
        kind = "volScalarField" if name == "0/T" else "dictionary"
        path.write_text(head(kind, path.name, path.parent.name) + text + "\n")
    environment = {**os.environ, "WM_PROJECT_DIR": "/usr/share/openfoam"}

    def run(*command):
        done = subprocess.run(
            command,
            check=False,
            cwd=folder,
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
        )
        assert done.returncode == 0, done.stdout
        return done.stdout

    checked = run("checkMesh", "-allTopology", "-constant")
    assert "Mesh OK." in checked, checked
    for name in CONDUCTIVITY:
        assert re.search(rf"\b{name}\b", checked), checked
    run("laplacianFoam")
    text = (folder / "1/T").read_text()
    count, values = re.search(r"nonuniform List<scalar>\s+(\d+)\s+\((.*?)\)", text, re.S).groups()
    values = np.array(values.split(), dtype=float)
    points, _, _, tets = foam_cells(folder / "constant/polyMesh")
    assert int(count) == len(values) == len(tets)
    x = points[tets].mean(axis=1)[:, 0]
    ramp = (x + SPACING[0] / 2) / LENGTH
    return np.abs(values - ramp).max()


def read_nastran(folder):
    from pyNastran.bdf.bdf import BDF

    model = BDF(debug=False)
    model.read_bdf(str(folder / "mesh.bdf"))
    mesh = meshio.read(folder / "mesh.msh")
    tets, facets = (len(mesh.cells_dict[kind]) for kind in ("tetra", "triangle"))
    assert model.card_count["CTETRA"] == tets and model.card_count["CTRIA3"] == facets
    volume = sum(
        element.Volume() for element in model.elements.values() if element.type == "CTETRA"
    )
    assert abs(volume / (LENGTH * AREA) - 1) < 1e-9, volume


def read_febio(folder):
    """pyfebio's classes have the types, attributes and numbers of nodes that FEBio 4.0 wants."""
    import pyfebio

    def rows(elements):
        return np.array([[float(x) for x in element.text.split(",")] for element in elements])

    model = pyfebio.model.Model.from_xml((folder / "mesh.feb").read_bytes())
    names = [elements.name for elements in model.mesh_.elements]
    assert names == list(CONDUCTIVITY), names
    assert [material.name for material in model.material_.all_materials] == names
    domains = [(domain.name, domain.mat) for domain in model.meshdomains_.solid_domains]
    assert domains == [(name, name) for name in names], domains
    (nodes,) = model.mesh_.nodes
    assert [node.id for node in nodes.all_nodes] == list(range(1, len(nodes.all_nodes) + 1))
    points, mesh = rows(nodes.all_nodes), meshio.read(folder / "mesh.msh")
    tets = np.concatenate([rows(part.all_elements) for part in model.mesh_.elements])
    a, b, c, d = (points[tets[:, i].astype(np.int64) - 1] for i in range(4))
    volumes = np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a) / 6
    assert len(tets) == len(mesh.cells_dict["tetra"]) and (volumes > 0).all()
    assert abs(volumes.sum() / (LENGTH * AREA) - 1) < 1e-9, volumes.sum()
    tags = mesh.cell_data_dict["gmsh:physical"]["triangle"]
    expected = {
        name: int((tags == n).sum()) for name, (n, dim) in mesh.field_data.items() if dim == 2
    }
    surfaces = {surface.name: len(surface.all_tri3) for surface in model.mesh_.surfaces}
    assert surfaces == expected, (surfaces, expected)


failures = 0


def expect(what, error, bound):
    global failures
    failed = not error <= bound
    failures += failed
    print(f"  {'FAILED' if failed else 'ok':7} {what}: off by {error:.1e}, at most {bound:.0e}")


def attempt(what, call):
    global failures
    try:
        call()
        print(f"  ok      {what}")
    except Exception as error:  # Whatever a program raises, the next one has its turn.
        failures += 1
        print(f"  FAILED  {what}: {type(error).__name__} {error}")


if not shutil.which("ccx"):
    skip("the flux by CalculiX, there is no program ccx (Debian: calculix-ccx)")
if not DOLFINX:
    skip("the flux by DOLFINx, Debian's Python does not have it (python3-dolfinx)")
if not shutil.which("checkMesh"):
    skip("meshes in OpenFOAM, there is no program checkMesh (Debian: openfoam)")
for name, axis, at in [("behind", 0, 10), ("beside", 1, 6)]:
    # Voxel faces are exact; smooth surfaces are found to some 1e-4 of a voxel.
    for surface, bound in [("voxel", 1e-9), ("smooth", 1e-4)]:
        folder = mesh_box(f"{name}_{surface}", axis, at, "--surface", surface)
        print(f"{name}, {surface} surfaces:")
        flux = exact_flux(axis, at)
        expect("flux by scikit-fem, .msh", abs(flux_of_scikit_fem(folder) / flux - 1), bound)
        expect("flux by MFEM, .mfem", abs(flux_of_mfem(folder) / flux - 1), bound)
        if DOLFINX:
            for ending in ["msh", "xdmf"] if HAS_XDMF else ["msh"]:
                error = abs(flux_of_dolfinx(folder, ending) / flux - 1)
                expect(f"flux by DOLFINx, .{ending}", error, bound)
        if shutil.which("ccx"):
            error = abs(abs(flux_of_calculix(folder)) / flux - 1)
            expect("flux by CalculiX, .inp", error, max(bound, 1e-5))
        if shutil.which("checkMesh"):
            expect("potential by OpenFOAM, .foam", run_openfoam(folder), 0.05)
        attempt("read by pyNastran, .bdf", lambda: read_nastran(folder))
        attempt("read by pyfebio, .feb", lambda: read_febio(folder))
sys.exit(1 if failures else 0)
