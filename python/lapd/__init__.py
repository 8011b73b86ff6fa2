"""lapd: quality tetrahedral meshes of segmented 3D images, all tissues at once.

>>> import numpy as np, lapd
>>> x, y, z = np.mgrid[-12:13, -12:13, -12:13]
>>> ball = (x**2 + y**2 + z**2 < 100).astype(np.uint8)
>>> mesh = lapd.mesh(ball, delta=2.0)
>>> mesh.points.shape[1], mesh.tets.shape[1]
(3, 4)
>>> sorted(set(mesh.labels.tolist()))
[1]

An image is a NumPy array of integer labels, indexed [x, y, z], or an image of nibabel, SimpleITK,
ITK or PyVista, which bring their place in the world along, or the path of a file. Label 0 is the
background. Lengths are in the image's units of length, mostly millimetres.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import sys
import tempfile
import threading
import warnings
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Callable, Iterable, Mapping

import numpy as np

from ._images import described
from ._library import (
    LOG_FN,
    PROGRESS_FN,
    Cancelled,
    Context,
    EmptyImage,
    FileError,
    FormatError,
    InvalidArgument,
    LapdError,
    LimitReached,
    MemoryLimit,
    NotMeasured,
    OutOfMemory,
    TimeLimit,
    Unsupported,
    check,
    create,
    library,
    text_of,
)
from ._params import PARAMETERS, number, set_parameters

__version__ = library.lapd_version().decode()
__all__ = [
    "Cancelled",
    "EmptyImage",
    "FileError",
    "FormatError",
    "InvalidArgument",
    "LapdError",
    "LimitReached",
    "LapdWarning",
    "MemoryLimit",
    "Mesh",
    "NotMeasured",
    "OutOfMemory",
    "TimeLimit",
    "Unsupported",
    "mesh",
]

_WARNING = 0
_PHASES = ["preparing", "refinement", "extraction", "improvement", "certificate", "reading"]


class LapdWarning(UserWarning):
    """What the library warns of: an image that is doubtful, tissue that is lost."""


class Mesh:
    """A finished tetrahedral mesh; `lapd.mesh` makes it.

    Its arrays are read-only views of the library's memory, without copying. They keep it alive.

    | array | shape | |
    |---|---|---|
    | points | (n, 3) float64 | in the world of the image |
    | tets | (m, 4) uint32 | rows of points; (b - a) x (c - a) . (d - a) > 0 |
    | labels | (m,) int32 | the label of each tet |
    | neighbors | (m, 4) uint32 | rows of tets across the facet opposite to vertex i, or NO_TET |
    | facets | (k, 3) uint32 | the interfaces; normals point from the first to the second label |
    | facet_labels | (k, 2) int32 | the smaller label first, the background last |
    | facet_tets | (k, 2) uint32 | rows of tets on both sides, or NO_TET |
    | facet_walls | (k,) uint8 | 1 to 6 where the image cuts the object: x min, x max, y min ... |
    """

    NO_TET = 0xFFFFFFFF

    def __init__(self, handle: int):
        self._handle = handle

    def __del__(self):
        library.lapd_mesh_free(self._handle)

    def _array(self, name: str, kind: Any, width: int) -> np.ndarray:
        first, count = ctypes.c_void_p(), ctypes.c_size_t()
        function = getattr(library, "lapd_mesh_get_" + name)
        check(function(ctypes.c_void_p(self._handle), ctypes.byref(first), ctypes.byref(count)))
        shape = (count.value, width) if width > 1 else (count.value,)
        values = count.value * width
        if values == 0:
            return np.empty(shape, dtype=kind)
        buffer = (ctypes.c_char * (values * np.dtype(kind).itemsize)).from_address(first.value)
        # The array has the buffer, and this the mesh.
        buffer.owner = self
        array = np.frombuffer(buffer, dtype=kind).reshape(shape)
        array.flags.writeable = False
        return array

    points = property(lambda self: self._array("points", np.float64, 3))
    tets = property(lambda self: self._array("tets", np.uint32, 4))
    labels = property(lambda self: self._array("labels", np.int32, 1))
    neighbors = property(lambda self: self._array("neighbors", np.uint32, 4))
    facets = property(lambda self: self._array("facets", np.uint32, 3))
    facet_labels = property(lambda self: self._array("facet_labels", np.int32, 2))
    facet_tets = property(lambda self: self._array("facet_tets", np.uint32, 2))
    facet_walls = property(lambda self: self._array("facet_walls", np.uint8, 1))
    tet_mid_nodes = property(lambda self: self._array("tet_mid_nodes", np.uint32, 6))
    facet_mid_nodes = property(lambda self: self._array("facet_mid_nodes", np.uint32, 3))

    def write(
        self, path: str | os.PathLike, *, measures: bool = False, boundary_parts: bool = False
    ) -> None:
        """Writes the mesh to a file, in the format of its ending.

        measures: a .vtu file gets the measures of the tets as cell arrays.
        boundary_parts: each connected part of a boundary becomes one of its own.
        """
        options = create("write_options")
        try:
            with Context() as context:
                context.call("write_options_set_measures", options, int(measures))
                context.call("write_options_set_boundary_parts", options, int(boundary_parts))
                context.call("mesh_write_with", self._handle, text_of(path), options)
        finally:
            library.lapd_write_options_free(options)

    def report(self) -> dict:
        """All that is known of the run: counts, times, quality, certificate, labels, defects."""
        with tempfile.TemporaryDirectory() as folder, Context() as context:
            path = Path(folder) / "report.json"
            context.call("mesh_write_report", self._handle, text_of(path), None)
            return json.loads(path.read_text(encoding="utf-8"))

    def name(self, label: int) -> str | None:
        """The name of a label, if it has one."""
        text = ctypes.c_char_p()
        check(
            library.lapd_mesh_get_label_name(
                ctypes.c_void_p(self._handle),
                ctypes.c_int32(number("label", ctypes.c_int32, label)),
                ctypes.byref(text),
            )
        )
        return None if text.value is None else text.value.decode()

    def to_meshio(self):
        """A meshio.Mesh of tets and facets, with cell data `label`."""
        import meshio

        cells = [("tetra", self.tets), ("triangle", self.facets)]
        labels = [self.labels, self.facet_labels[:, 0]]
        sides = [np.column_stack([self.labels] * 2), self.facet_labels]
        return meshio.Mesh(self.points, cells, cell_data={"label": labels, "BoundaryLabels": sides})

    def to_pyvista(self):
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


def _show_progress() -> Callable[[float, str, int], None]:
    """A bar of tqdm, if it is there, else a line on stderr."""
    try:
        from tqdm.auto import tqdm
    except ImportError:

        def show(fraction: float, phase: str, tets: int) -> None:
            end = "\n" if fraction >= 1 else ""
            print(f"\r{100 * fraction:3.0f} % {phase:12} {tets} tets ", end=end, file=sys.stderr)

        return show
    bar = tqdm(total=100, unit="%")

    def show_bar(fraction: float, phase: str, tets: int) -> None:
        bar.set_description(f"{phase}, {tets} tets")
        bar.update(int(100 * fraction) - bar.n)
        if fraction >= 1:
            bar.close()

    return show_bar


class _Callbacks:
    """Progress and log of a context. An exception in a callback, that of Ctrl-C among them, ends
    the run, and is raised where that returns."""

    def __init__(self, context: Context, progress):
        self.raised: BaseException | None = None
        show = _show_progress() if progress is True else progress or None

        def on_progress(_, report) -> int:
            try:
                if show is not None:
                    show(
                        report.contents.fraction,
                        _PHASES[report.contents.phase],
                        report.contents.tets,
                    )
            except BaseException as error:  # pylint: disable=broad-except
                self.raised = self.raised or error
            return int(self.raised is not None)

        def on_log(_, level, message) -> None:
            try:
                if level == _WARNING:
                    warnings.warn(message.decode(errors="replace"), LapdWarning, stacklevel=4)
            except BaseException as error:  # pylint: disable=broad-except
                self.raised = self.raised or error

        # They must live as long as the context may call them.
        context.kept += [PROGRESS_FN(on_progress), LOG_FN(on_log)]
        context.call("context_set_progress", context.kept[0], None)
        context.call("context_set_log", context.kept[1], None)

    def run(self, call: Callable[[], None]) -> None:
        try:
            with self._interrupts():
                call()
        except LapdError:
            if self.raised is not None:
                raise self.raised from None
            raise
        if self.raised is not None:
            raise self.raised

    @contextmanager
    def _interrupts(self):
        """Ctrl-C is noted and ends the run at the next report. Raised as usual it could come up
        between C and a callback, where an exception is lost."""
        is_main = threading.current_thread() is threading.main_thread()
        if not is_main or signal.getsignal(signal.SIGINT) is not signal.default_int_handler:
            yield
            return

        def note(*_) -> None:
            self.raised = self.raised or KeyboardInterrupt()

        signal.signal(signal.SIGINT, note)
        try:
            yield
        finally:
            signal.signal(signal.SIGINT, signal.default_int_handler)


def mesh(
    image,
    *,
    spacing: Iterable[float] | None = None,
    origin: Iterable[float] | None = None,
    direction: Any = None,
    names: Mapping[int, str] | str | os.PathLike | None = None,
    frame: str | None = None,
    split_interfaces: Iterable[tuple[int, int]] | str | None = None,
    progress: bool | Callable[[float, str, int], Any] = False,
    **parameters,
) -> Mesh:
    """Meshes a segmented image.

    image: a NumPy array of integers, indexed [x, y, z], of any strides; a nibabel, SimpleITK, ITK
        or PyVista image; or the path of a NRRD, NIfTI, MetaImage or INRIMAGE file. Label 0 is the
        background.
    spacing: the distance between voxel centres along x, y, z. Of an array; 1 by default.
    origin: where the centre of voxel (0, 0, 0) is. Of an array; 0 by default.
    direction: 3 x 3, column k is the direction of image axis k, orthonormal. Of an array; the
        identity by default.
    names: names of labels, which files use: a mapping, or the path of a table (3D Slicer,
        FreeSurfer, ITK-SNAP, or a list).
    frame: "lps" or "ras", the world of a file; as stored by default.
    split_interfaces: "all", or pairs of labels: regions get nodes of their own there.
    progress: True for a bar, or a function of fraction, phase and tets. Ctrl-C ends a run, as does
        any exception in the function.

    Other keywords are parameters of the run:

    """
    with Context() as context:
        callbacks = _Callbacks(context, progress)
        handle = ctypes.c_void_p()
        params = create("params")
        try:
            described(image, spacing, origin, direction, frame).make(context, callbacks, handle)
            _set_names(context, handle, names)
            set_parameters(context, params, handle, parameters)
            made = ctypes.c_void_p()
            try:
                callbacks.run(
                    lambda: context.call("mesh_image", handle, params, ctypes.byref(made))
                )
            except (LimitReached, TimeLimit, MemoryLimit) as error:
                # A partial mesh that was asked for.
                if made.value is None:
                    raise
                warnings.warn(f"the mesh is partial: {error}", LapdWarning, stacklevel=2)
            finally:
                result = Mesh(made.value) if made.value else None
            if split_interfaces is not None:
                _split(context, result, split_interfaces)
            return result
        finally:
            library.lapd_params_free(params)
            library.lapd_image_free(handle)


mesh.__doc__ += "\n".join(f"    {p.name}: {p.text}" for p in PARAMETERS) + "\n"


def _set_names(context: Context, image, names) -> None:
    if names is None:
        return
    if isinstance(names, Mapping):
        for label, name in names.items():
            label = number("label", ctypes.c_int32, label)
            context.call("image_set_label_name", image, label, text_of(str(name)))
    else:
        context.call("image_read_label_names", image, text_of(names))


def _split(context: Context, result: Mesh, which) -> None:
    if isinstance(which, str):
        if which != "all":
            raise InvalidArgument(f'split_interfaces is "all" or pairs of labels, not {which!r}')
        context.call("mesh_split_interfaces", result._handle, None, 0)
        return
    pairs = [tuple(pair) for pair in which]
    if not pairs or any(len(pair) != 2 for pair in pairs):
        raise InvalidArgument("split_interfaces has pairs of two labels, and at least one")
    labels = [number("label", ctypes.c_int32, label) for pair in pairs for label in pair]
    array = (ctypes.c_int32 * len(labels))(*labels)
    context.call("mesh_split_interfaces", result._handle, array, len(pairs))
