"""A finished mesh: views of the library's arrays, files, and what was measured."""

from __future__ import annotations

import ctypes
import json
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, List, Optional, Tuple

import numpy as np
import numpy.typing as npt

from ._certificate import Certificate
from ._library import Context, InvalidArgument, check, create, library, number, text_of

if TYPE_CHECKING:
    import meshio
    import pyvista
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# lapd_tet_measure
_MEASURES = [
    "min_dihedral",
    "max_dihedral",
    "scaled_jacobian",
    "edge_ratio",
    "radius_ratio",
    "radius_edge",
]


@dataclass(frozen=True)
class WorstTet:
    """A tet of those whose dihedral angles are nearest to 0 or 180 degrees."""

    tet: int
    """Its row in `Mesh.tets`."""
    label: int
    position: Tuple[float, float, float]
    """Its centroid, in the world of the image."""
    min_dihedral: float
    """Its smallest dihedral angle in degrees."""
    max_dihedral: float
    """Its largest dihedral angle in degrees."""


class Mesh:
    """A finished tetrahedral mesh; `lapd.mesh` makes it.

    Its arrays are read-only views of the library's memory, without copying. They keep it alive.
    n is the number of vertices, m that of tets, k that of interface facets.
    """

    NO_TET = 0xFFFFFFFF
    """Stands in `neighbors` and `facet_tets` where there is no tet."""

    def __init__(self, handle: int):
        self._handle = handle

    def __del__(self) -> None:
        library.lapd_mesh_free(self._handle)

    def _array(self, name: str, kind: Any, width: int) -> npt.NDArray[Any]:
        first, count = ctypes.c_void_p(), ctypes.c_size_t()
        function = getattr(library, "lapd_mesh_get_" + name)
        check(function(ctypes.c_void_p(self._handle), ctypes.byref(first), ctypes.byref(count)))
        shape = (count.value, width) if width > 1 else (count.value,)
        size = count.value * width * np.dtype(kind).itemsize
        if size == 0 or first.value is None:
            return np.empty(shape, dtype=kind)
        buffer = (ctypes.c_char * size).from_address(first.value)
        # The array has the buffer, and this the mesh.
        buffer.owner = self
        array = np.frombuffer(buffer, dtype=kind).reshape(shape)
        array.flags.writeable = False
        return array

    @property
    def points(self) -> npt.NDArray[np.float64]:
        """(n, 3): the vertices in the world of the image, and the nodes of second order."""
        return self._array("points", np.float64, 3)

    @property
    def tets(self) -> npt.NDArray[np.uint32]:
        """(m, 4): rows of points; (b - a) x (c - a) . (d - a) > 0."""
        return self._array("tets", np.uint32, 4)

    @property
    def labels(self) -> npt.NDArray[np.int32]:
        """(m,): the label of each tet."""
        return self._array("labels", np.int32, 1)

    @property
    def neighbors(self) -> npt.NDArray[np.uint32]:
        """(m, 4): rows of tets across the facet opposite to vertex i, or NO_TET."""
        return self._array("neighbors", np.uint32, 4)

    @property
    def facets(self) -> npt.NDArray[np.uint32]:
        """(k, 3): the interfaces; normals point from the first to the second label."""
        return self._array("facets", np.uint32, 3)

    @property
    def facet_labels(self) -> npt.NDArray[np.int32]:
        """(k, 2): the labels on both sides, the smaller one first, the background last."""
        return self._array("facet_labels", np.int32, 2)

    @property
    def facet_tets(self) -> npt.NDArray[np.uint32]:
        """(k, 2): rows of the tets on both sides, or NO_TET."""
        return self._array("facet_tets", np.uint32, 2)

    @property
    def facet_walls(self) -> npt.NDArray[np.uint8]:
        """(k,): 1 to 6 where the image cuts the object: x min, x max, y min, ...; else 0."""
        return self._array("facet_walls", np.uint8, 1)

    @property
    def tet_mid_nodes(self) -> npt.NDArray[np.uint32]:
        """(m, 6): rows of points in the middle of edges; no row in a mesh of order 1."""
        return self._array("tet_mid_nodes", np.uint32, 6)

    @property
    def facet_mid_nodes(self) -> npt.NDArray[np.uint32]:
        """(k, 3): rows of points in the middle of edges; no row in a mesh of order 1."""
        return self._array("facet_mid_nodes", np.uint32, 3)

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        measures: bool = False,
        boundary_parts: bool = False,
    ) -> None:
        """Writes the mesh to a file, in the format of its ending.

        measures: a .vtu file gets the measures of the tets as cell arrays.
        boundary_parts: each connected part of a boundary becomes one of its own.

        Raises InvalidArgument for an ending that is not known, FileError.
        """
        options = create("write_options")
        try:
            with Context() as context:
                context.call("write_options_set_measures", options, int(measures))
                context.call("write_options_set_boundary_parts", options, int(boundary_parts))
                context.call("mesh_write_with", self._handle, text_of(path), options)
        finally:
            library.lapd_write_options_free(options)

    def report(self) -> dict[str, Any]:
        """All that is known of the run: counts, times, quality, certificate, labels, defects."""
        with tempfile.TemporaryDirectory() as folder, Context() as context:
            path = Path(folder) / "report.json"
            context.call("mesh_write_report", self._handle, text_of(path), None)
            report: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
            return report

    def certificate(self) -> Certificate:
        """What was measured on the mesh; `print` shows it as a table.

        It has what the parameter `certificate` of `lapd.mesh` asked for: none; sound, the default;
        or full, with distances. What was not measured is None.
        """
        return Certificate.of_report(self.report())

    def measure(self, name: str) -> npt.NDArray[np.float64]:
        """(m,): a measure of each tet.

        name: min_dihedral or max_dihedral, in degrees; scaled_jacobian, edge_ratio or
            radius_ratio, as Verdict and VTK define them, all 1 for a regular tet; radius_edge, the
            circumradius over the shortest edge.

        Raises InvalidArgument for another name.
        """
        if name not in _MEASURES:
            raise InvalidArgument(f"a measure is one of {', '.join(_MEASURES)}, not {name!r}")
        values = np.empty(len(self.tets))
        check(
            library.lapd_mesh_copy_measure(
                ctypes.c_void_p(self._handle),
                ctypes.c_int32(_MEASURES.index(name)),
                values.ctypes.data_as(ctypes.c_void_p),
                ctypes.c_size_t(len(values)),
            )
        )
        return values

    def worst_tets(self, count: int = 10) -> List[WorstTet]:
        """The tets whose dihedral angles are nearest to 0 or 180 degrees, the worst one first.

        count: how many; fewer where the mesh has no more.
        """
        count = number("count", ctypes.c_size_t, count)
        least, largest = self.measure("min_dihedral"), self.measure("max_dihedral")
        rows = np.argsort(np.minimum(least, 180 - largest), kind="stable")[:count].tolist()
        centroids = self.points[self.tets[rows]].mean(axis=1).tolist()
        return [
            WorstTet(t, int(self.labels[t]), tuple(at), float(least[t]), float(largest[t]))
            for t, at in zip(rows, centroids)
        ]

    def plot_quality(self, axes: Optional[Axes] = None, count: int = 6) -> Figure:
        """Draws how good the tets are; returns the figure of matplotlib.

        It has histograms of dihedral angles and of radius ratios, and the worst tets in 3D with
        their angles and places.

        axes: where the histogram of dihedral angles alone is to be drawn, in a figure of yours.
        count: how many of the worst tets are drawn, 1 to 12.

        Raises NotMeasured for a mesh without a certificate, ImportError without matplotlib.
        """
        from . import _plots

        return _plots.quality(self, axes, number("count", ctypes.c_size_t, count))

    def name(self, label: int) -> Optional[str]:
        """The name of a label; None if it has none."""
        text = ctypes.c_char_p()
        check(
            library.lapd_mesh_get_label_name(
                ctypes.c_void_p(self._handle),
                ctypes.c_int32(number("label", ctypes.c_int32, label)),
                ctypes.byref(text),
            )
        )
        return None if text.value is None else text.value.decode()

    def to_meshio(self) -> meshio.Mesh:
        """A meshio.Mesh of tets and facets, with cell data `label`."""
        import meshio

        cells = [("tetra", self.tets), ("triangle", self.facets)]
        labels = [self.labels, self.facet_labels[:, 0]]
        sides = [np.column_stack([self.labels] * 2), self.facet_labels]
        return meshio.Mesh(self.points, cells, cell_data={"label": labels, "BoundaryLabels": sides})

    def to_pyvista(self) -> pyvista.UnstructuredGrid:
        """A pyvista.UnstructuredGrid of the tets, with cell data `label`."""
        import pyvista

        grid = pyvista.UnstructuredGrid({pyvista.CellType.TETRA: self.tets}, self.points)
        grid.cell_data["label"] = self.labels
        return grid

    def __repr__(self) -> str:
        labels = len(np.unique(self.labels))
        return (
            f"<lapd.Mesh: {len(self.points)} vertices, {len(self.tets)} tets of {labels} labels, "
            f"{len(self.facets)} interface facets>"
        )
