"""The flux through a box of materials, by DOLFINx on a Gmsh file: run by solvers.py with Debian's
Python, which DOLFINx belongs to.

    python3 solve_dolfinx.py MESH.msh NAME=CONDUCTIVITY ...

Prints the flux between the boundaries whose names end in wall_x_min and wall_x_max.
"""

import logging
import sys

logging.disable(logging.INFO)

import gmsh
import ufl
from dolfinx import fem
from dolfinx.io import gmshio
from mpi4py import MPI
from petsc4py import PETSc

path, conductivity = sys.argv[1], dict(word.split("=") for word in sys.argv[2:])
gmsh.initialize(interruptible=False)
gmsh.option.setNumber("General.Terminal", 0)
gmsh.open(path)
names = {group: gmsh.model.getPhysicalName(*group) for group in gmsh.model.getPhysicalGroups()}
mesh, cells, facets = gmshio.model_to_mesh(gmsh.model, MPI.COMM_WORLD, 0, gdim=3)

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
