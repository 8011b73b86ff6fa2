"""Pictures of the quality of a mesh. The figures are those of the report and of `Mesh.measure`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Mapping, Optional, Sequence

import numpy as np
import numpy.typing as npt

from ._library import InvalidArgument, NotMeasured

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


COLOURS = ["#2f6db5", "#e0803c", "#3f9b64", "#b24a72", "#7d6bb3", "#8a7a3d"]
# Facet i of a tet lies opposite to its vertex i.
_FACETS = [[1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1]]
_COLUMNS, _MOST = 6, 12


def quality(mesh: Any, axes: Optional[Axes], count: int) -> Figure:
    """What `Mesh.plot_quality` draws."""
    if not 1 <= count <= _MOST:
        raise InvalidArgument(f"count is 1 to {_MOST}, not {count}")
    pyplot = _pyplot()
    report = mesh.report()
    measured = report["quality"]
    if measured is None:
        raise NotMeasured("the mesh has no certificate; mesh with certificate='sound' or 'full'")
    if axes is not None:
        dihedral_histogram(axes, {"": report})
        return axes.get_figure()
    rows = -(-count // _COLUMNS)
    figure: Figure = pyplot.figure(figsize=(10, 3.5 + 2.1 * rows), layout="constrained")
    above, below = figure.subfigures(2, 1, height_ratios=[3.5, 2.1 * rows])
    left, right = above.subplots(1, 2)
    dihedral_histogram(left, {"": report})
    _radius_ratio_histogram(right, measured["radius_ratio"])
    below.suptitle("the worst tets: dihedral angles, label, place", fontsize=9)
    for place, worst in enumerate(mesh.worst_tets(count)):
        x, y, z = worst.position
        name = mesh.name(worst.label) or f"label {worst.label}"
        title = (
            f"{worst.min_dihedral:.1f}° to {worst.max_dihedral:.1f}°\n{name}\n"
            f"({x:.4g}, {y:.4g}, {z:.4g})"
        )
        one = below.add_subplot(rows, _COLUMNS, place + 1, projection="3d")
        draw_tet(one, mesh.points[mesh.tets[worst.tet]], title)
    return figure


def _pyplot() -> Any:
    try:
        from matplotlib import pyplot
    except ImportError:
        raise ImportError("lapd draws with matplotlib: pip install matplotlib") from None
    return pyplot


def dihedral_histogram(axes: Axes, reports: Mapping[str, Mapping[str, Any]]) -> None:
    """Draws the dihedral angles of reports, each as its share of all angles, beside each other.

    reports: the reports by the names that the legend has.
    """
    width = 10 / max(len(reports), 1)
    for i, (name, report) in enumerate(reports.items()):
        measured = report["quality"]
        counts = np.asarray(measured["dihedral_histogram"], dtype=float)
        angles = f"{measured['min_dihedral']:.2f}° to {measured['max_dihedral']:.2f}°"
        tets = f"{report['tets']:,} tets, {angles}"
        label = f"{name}: {tets}" if name else tets
        starts = np.linspace(0, 180, len(counts) + 1)[:-1] + width * i
        _bars(axes, starts, counts, width, COLOURS[i % len(COLOURS)], label)
    axes.set(xlim=(0, 180), xlabel="dihedral angle (degrees)", ylabel="share of angles (%)")
    axes.set_xticks(range(0, 181, 20))
    axes.legend(frameon=False, loc="upper right", fontsize=9)


def _radius_ratio_histogram(axes: Axes, spread: Mapping[str, Any]) -> None:
    """Draws radius ratios, in bins of 1/4 from 1 on; the last bin has all beyond, too."""
    counts = np.asarray(spread["histogram"], dtype=float)
    largest = "infinity" if spread["max"] is None else f"{spread['max']:.2f}"
    label = f"{spread['min']:.2f} to {largest}; 1 is a regular tet"
    end = 1 + len(counts) / 4
    _bars(axes, np.arange(1, end, 0.25), counts, 0.25, COLOURS[2], label)
    axes.set(
        xlim=(1, end),
        xlabel="radius ratio of tets; the last bar has all beyond",
        ylabel="share of tets (%)",
    )
    axes.legend(frameon=False, loc="upper right", fontsize=9)


def _bars(
    axes: Axes,
    starts: npt.NDArray[Any],
    counts: npt.NDArray[Any],
    width: float,
    colour: str,
    label: str,
) -> None:
    share = 100 * counts / max(counts.sum(), 1)
    axes.bar(
        starts,
        share,
        width,
        align="edge",
        color=colour,
        edgecolor="white",
        linewidth=0.6,
        label=label,
    )
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#e4e4e8", linewidth=0.8)
    axes.set_axisbelow(True)


def draw_tet(axes: Any, corners: npt.NDArray[Any], title: str) -> None:
    """Draws a tet, its longest edge of length 1, along the direction in which it is thinnest,
    turned a little.

    axes: with the projection 3d.
    corners: (4, 3).
    """
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    centered = corners - corners.mean(axis=0)
    longest = max(float(np.linalg.norm(a - b)) for a in centered for b in centered)
    centered = centered / (longest or 1)
    # The thinnest direction is the last axis of the points' spread: it is to point up.
    turned = centered @ np.linalg.svd(centered)[2].T
    faces: Sequence[Any] = [turned[facet] for facet in _FACETS]
    axes.add_collection3d(
        Poly3DCollection(faces, facecolor="#8db4dd", edgecolor="#1f3f66", alpha=0.55, linewidth=0.8)
    )
    axes.set(xlim=(-0.5, 0.5), ylim=(-0.5, 0.5), zlim=(-0.5, 0.5))
    axes.set_box_aspect((1, 1, 1), zoom=1.3)
    axes.view_init(elev=18, azim=-60)
    axes.set_axis_off()
    axes.set_title(title, fontsize=8, y=0.92)
