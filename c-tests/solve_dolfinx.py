"""The flux through a box of materials, by DOLFINx on a Gmsh or XDMF file: run by solvers.py with
Debian's Python, which DOLFINx belongs to.

    python3 solve_dolfinx.py MESH.msh|MESH.xdmf NAME=CONDUCTIVITY ...

Prints the flux between the boundaries whose names end in wall_x_min and wall_x_max.
"""

import logging
import sys
import xml.etree.ElementTree as ElementTree

logging.disable(logging.INFO)

import ufl
from dolfinx import fem
from dolfinx.io import XDMFFile
from mpi4py import MPI
from petsc4py import PETSc


def read_gmsh(path):
    import gmsh
    from dolfinx.io import gmshio

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    gmsh.open(path)
    names = {group: gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
    return names, *gmshio.model_to_mesh(gmsh.model, MPI.COMM_WORLD, 0, gdim=3)


def read_xdmf(path):
    with XDMFFile(MPI.COMM_WORLD, path, "r") as file:
        mesh = file.read_mesh(name="mesh")
        cells = file.read_meshtags(mesh, name="mesh")
        mesh.topology.create_connectivity(2, 3)
        facets = file.read_meshtags(mesh, name="boundaries")
    names = {}
    for grid in ElementTree.parse(path).iter("Grid"):
        dimension = 3 if grid.get("Name") == "mesh" else 2
        for entry in grid.iter("Information"):
            names[dimension, int(entry.get("Name"))] = entry.get("Value")
    return names, mesh, cells, facets


path, conductivity = sys.argv[1], dict(word.split("=") for word in sys.argv[2:])
read = read_xdmf if path.endswith(".xdmf") else read_gmsh
names, mesh, cells, facets = read(path)

space = fem.FunctionSpace(mesh, ("CG", 1))
of_cells = fem.Function(fem.FunctionSpace(mesh, ("DG", 0)))
conditions = []
for (dimension, tag), name in names.items():
    if dimension == 3:
        of_cells.x.array[cells.find(tag)] = float(conductivity[name])
    elif name.endswith(("wall_x_min", "wall_x_max")):
        nodes = fem.locate_dofs_topological(space, 2, facets.find(tag))
        value = PETSc.ScalarType(name.endswith("max"))
        conditions.append(fem.dirichletbc(value, nodes, space))
u, v = ufl.TrialFunction(space), ufl.TestFunction(space)
problem = fem.petsc.LinearProblem(
    of_cells * ufl.dot(ufl.grad(u), ufl.grad(v)) * ufl.dx,
    fem.Constant(mesh, PETSc.ScalarType(0)) * v * ufl.dx,
    bcs=conditions,
    petsc_options={"ksp_type": "preonly", "pc_type": "lu"},
)
found = problem.solve()
flux = fem.form(of_cells * ufl.dot(ufl.grad(found), ufl.grad(found)) * ufl.dx)
print(f"{fem.assemble_scalar(flux):.17g}")
