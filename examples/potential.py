"""A potential in the head, on a mesh of mesh_image: from tissues to a solved field.

    python3 potential.py MESH.vtu OUT.vtu

Solves div(conductivity grad u) = 0 with u = 0 where the mesh is lowest and u = 1 where it is
highest along z, and writes the mesh with `label`, `potential` (per point) and `field` (-grad u, per
tet). Needs `pip install meshio scikit-fem scipy`. The guide's tutorial (docs/guide/tutorial.md)
uses it.
"""

import sys

import meshio
import numpy as np
from skfem import Basis, BilinearForm, ElementTetP0, ElementTetP1, MeshTet, condense, solve
from skfem.helpers import dot, grad
from skfem.utils import solver_iter_pcg

if len(sys.argv) != 3:
    sys.exit(__doc__)
mesh = meshio.read(sys.argv[1])
points, tets = mesh.points, mesh.cells_dict["tetra"]
labels = mesh.cell_data_dict["label"]["tetra"]

# One conductivity (siemens per metre) for even labels, another for odd ones: use a table of yours.
conductivity = np.where(labels % 2 == 0, 0.33, 0.14)

fem = MeshTet(np.ascontiguousarray(points.T), np.ascontiguousarray(tets.T))
basis = Basis(fem, ElementTetP1())
sigma = basis.with_element(ElementTetP0()).interpolate(conductivity)


@BilinearForm
def stiffness(u, v, w):
    return w["sigma"] * dot(grad(u), grad(v))


z = points[:, 2]
height = z.max() - z.min()
low, high = z < z.min() + 0.05 * height, z > z.max() - 0.05 * height
u = high.astype(float)
matrix = stiffness.assemble(basis, sigma=sigma)
u = solve(*condense(matrix, x=u, D=np.flatnonzero(low | high)), solver=solver_iter_pcg())

# The gradient is constant in a tet of four nodes.
corners = points[tets]
edges, differences = corners[:, 1:] - corners[:, :1], (u[tets][:, 1:] - u[tets][:, :1])[..., None]
field = -np.linalg.solve(edges, differences)[..., 0]
cell_data = {"label": [labels], "field": [field]}
meshio.Mesh(points, [("tetra", tets)], {"potential": u}, cell_data).write(sys.argv[2])
print(f"{len(tets)} tets, {len(points)} nodes, potential {u.min():.3f} to {u.max():.3f}")
