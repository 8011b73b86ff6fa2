"""The code of docs/guide/python-tutorial.md, which makes the pictures of that page.

    cd docs/pictures && python python_tutorial.py

Needs `pip install ./python matplotlib pillow pyvista scikit-fem scipy`. Pictures and torso.vtu go
where it is run.
"""

import os
import sys

if sys.platform == "linux" and not os.environ.get("DISPLAY"):
    # Before VTK is loaded, which else warns of a missing X server.
    os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import matplotlib
from PIL import Image

os.environ.setdefault("PYVISTA_OFF_SCREEN", "true")
matplotlib.use("Agg")

# 1. Labels
import numpy as np

names = {
    1: "body",
    2: "liver",
    3: "spleen",
    4: "kidney_right",
    5: "kidney_left",
    6: "aorta",
    7: "vertebrae",
}
spacing = np.array([3.0, 3.0, 5.0])  # mm
shape = (112, 80, 48)
origin = -spacing * (np.array(shape) - 1) / 2  # the middle of the image is at 0, 0, 0

index = np.indices(shape).reshape(3, -1).T
x, y, z = (origin + index * spacing).T.reshape(3, *shape)


def ellipsoid(centre, radii):
    return sum(((p - c) / r) ** 2 for p, c, r in zip((x, y, z), centre, radii)) < 1


labels = np.zeros(shape, dtype=np.uint8)
labels[(x / 150) ** 2 + (y / 105) ** 2 < 1] = 1
labels[ellipsoid((-62, -22, 30), (62, 52, 60))] = 2
labels[ellipsoid((95, 35, 30), (26, 38, 45))] = 3
labels[ellipsoid((-62, 45, -45), (24, 22, 50))] = 4
labels[ellipsoid((62, 45, -35), (24, 22, 50))] = 5
labels[(x - 12) ** 2 + (y - 28) ** 2 < 11**2] = 6
labels[(x / 24) ** 2 + ((y - 62) / 20) ** 2 < 1] = 7

# 2. A look at the labels
import matplotlib.pyplot as plt
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch

colours = ["white", "#ecc9ae", "#a8503c", "#7d6bb3", "#d08a3c", "#e0b23c", "#c8283c", "#8d9fb0"]

figure, (axial, coronal) = plt.subplots(1, 2, figsize=(9.5, 3.4), layout="constrained")
for axes, cut, up in [(axial, labels[:, :, 22], 1), (coronal, labels[:, 51], 2)]:
    ends = [origin[i] + side * spacing[i] for i in (0, up) for side in (-0.5, shape[i] - 0.5)]
    style = {"cmap": ListedColormap(colours), "vmin": 0, "vmax": 7, "interpolation": "nearest"}
    axes.imshow(cut.T, extent=ends, origin="lower", **style)
    axes.set_xlabel("x (mm), to the left")
axial.invert_yaxis()  # the front is above
axial.set(ylabel="y (mm), to the back", title="axial, z = -7.5 mm")
coronal.set(ylabel="z (mm), to the head", title="coronal, y = 34.5 mm")
patches = [Patch(color=colours[label], label=name) for label, name in names.items()]
coronal.legend(handles=patches, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
figure.savefig("python-tutorial-labels.png", dpi=100)

# 3. The mesh
import lapd

mesh = lapd.mesh(labels, spacing=spacing, origin=origin, delta=8, names=names, certificate="full")
print(mesh)
print(mesh.certificate())

# 4. Regions and boundaries
volumes = {row.name: row.mesh_volume / 1000 for row in mesh.certificate().labels}  # ml
print({name: round(volume) for name, volume in volumes.items()})

label_of = {name: label for label, name in names.items()}
label_of["background"] = 0


def boundary(first, second):
    """Which facets lie between two labels: the smaller one first, the background last."""
    return (mesh.facet_labels == (label_of[first], label_of[second])).all(axis=1)


between = boundary("body", "liver")
skin = boundary("body", "background") & (mesh.facet_walls == 0)
print(between.sum(), "facets between body and liver,", skin.sum(), "of skin")
mesh.write("torso.vtu")

# 5. A potential
from skfem import Basis, BilinearForm, ElementTetP0, ElementTetP1, MeshTet, condense, solve
from skfem.helpers import dot, grad
from skfem.utils import solver_iter_pcg

siemens_per_m = {
    "body": 0.2,
    "liver": 0.06,
    "spleen": 0.1,
    "kidney_right": 0.15,
    "kidney_left": 0.15,
    "aorta": 0.7,
    "vertebrae": 0.04,
}
conductivity = np.array([siemens_per_m[names[label]] for label in mesh.labels.tolist()])

centres = mesh.points[mesh.facets].mean(axis=1)
patch = skin & (np.abs(centres[:, 0] + 40) < 40) & (np.abs(centres[:, 2]) < 40)
front, back = patch & (centres[:, 1] < 0), patch & (centres[:, 1] > 0)
at_front, at_back = np.unique(mesh.facets[front]), np.unique(mesh.facets[back])

fem = MeshTet(
    np.ascontiguousarray(mesh.points.T), np.ascontiguousarray(mesh.tets.T, dtype=np.int64)
)
basis = Basis(fem, ElementTetP1())
sigma = basis.with_element(ElementTetP0()).interpolate(conductivity)


@BilinearForm
def stiffness(u, v, w):
    return w["sigma"] * dot(grad(u), grad(v))


matrix = stiffness.assemble(basis, sigma=sigma)
potential = np.zeros(len(mesh.points))
potential[at_front] = 1
fixed = np.concatenate([at_front, at_back])
potential = solve(*condense(matrix, x=potential, D=fixed), solver=solver_iter_pcg())
print(f"potential {potential.min():.3f} to {potential.max():.3f} V")

# 6. The cut through the mesh
import pyvista as pv

grid = mesh.to_pyvista()
grid.point_data["potential (V)"] = potential
upper = grid.extract_cells(grid.cell_centers().points[:, 2] > -7.5)

plotter = pv.Plotter(window_size=(620, 440))
plotter.add_mesh(
    upper,
    scalars="label",
    cmap=colours[1:],
    clim=(0.5, 7.5),
    show_edges=True,
    edge_opacity=0.4,
    ambient=0.35,
    diffuse=0.75,
    show_scalar_bar=False,
)
plotter.camera_position = [(-150, -560, -780), (0, 0, 40), (0, 0, 1)]
plotter.camera.zoom(1.7)
figure, axes = plt.subplots(figsize=(8.2, 4.4), layout="constrained")
axes.imshow(plotter.screenshot())
axes.set_axis_off()
axes.legend(handles=patches, frameon=False, loc="center left", bbox_to_anchor=(1, 0.5))
figure.savefig("python-tutorial-mesh.png", dpi=100)

# 7. The potential in the cut
electrodes = pv.PolyData.from_regular_faces(mesh.points, mesh.facets[front | back])

plotter = pv.Plotter(window_size=(760, 480))
plotter.add_mesh(
    grid.slice("z", origin=(0, 0, -7.5)),
    scalars="potential (V)",
    cmap="viridis",
    n_colors=20,
    lighting=False,
    scalar_bar_args={"vertical": True, "position_x": 0.86, "position_y": 0.2, "height": 0.6},
)
for label in names:
    outline = grid.extract_cells(mesh.labels == label).slice("z", origin=(0, 0, -8))
    outline = outline.extract_feature_edges(feature_edges=False, manifold_edges=False)
    plotter.add_mesh(outline, color="black", line_width=1.5)
plotter.add_mesh(electrodes.slice("z", origin=(0, 0, -8.5)), color="#e0302c", line_width=7)
plotter.add_text("front: 1 V", position=(0.34, 0.935), viewport=True, font_size=11)
plotter.add_text("back: 0 V", position=(0.34, 0.015), viewport=True, font_size=11)
plotter.camera_position = [(20, 0, -800), (20, 0, 0), (0, -1, 0)]
plotter.enable_parallel_projection()
plotter.camera.parallel_scale = 130
plotter.screenshot("python-tutorial-potential.png")

# 8. How good the tets are
mesh.plot_quality().savefig("python-tutorial-quality.png", dpi=100)

# Few colours make small files.
for name in ("labels", "mesh", "potential", "quality"):
    path = f"python-tutorial-{name}.png"
    Image.open(path).convert("RGB").quantize(256, method=Image.Quantize.FASTOCTREE).save(
        path, optimize=True
    )
