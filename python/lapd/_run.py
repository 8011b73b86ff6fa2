"""Meshes an image: hands it to the library, and its progress and warnings to Python.

Type checkers read _run.pyi in this file's place.
"""

from __future__ import annotations

import ctypes
import inspect
import os
import signal
import sys
import textwrap
import threading
import warnings
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, Callable, Iterable, Literal, Mapping

import numpy.typing as npt

from ._images import described
from ._library import (
    Context,
    InvalidArgument,
    LOG_FN,
    LapdError,
    LapdWarning,
    LimitReached,
    MemoryLimit,
    PROGRESS_FN,
    TimeLimit,
    create,
    library,
    number,
    text_of,
)
from ._mesh import Mesh
from ._params import PARAMETERS, set_parameters

_WARNING = 0
_PHASES = ["preparing", "refinement", "extraction", "improvement", "certificate", "reading"]


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
    image: Any,
    *,
    spacing: Iterable[float] | None = None,
    origin: Iterable[float] | None = None,
    direction: npt.ArrayLike | None = None,
    names: Mapping[int, str] | str | os.PathLike[str] | None = None,
    frame: Literal["lps", "ras"] | None = None,
    volume: int | None = None,
    split_interfaces: Iterable[tuple[int, int]] | Literal["all"] | None = None,
    progress: bool | Callable[[float, str, int], Any] = False,
    **parameters: Any,
) -> Mesh:
    """Meshes a segmented image.

    image: a NumPy array of integers, indexed [x, y, z], of any strides; a nibabel, SimpleITK, ITK
        or PyVista image; or the path of a NRRD, NIfTI, MetaImage, INRIMAGE, NumPy or TIFF file.
        Label 0 is the background.
    spacing: the distance between voxel centres along x, y, z. Of an array, 1 by default; of a file
        in place of its own, which .npy and .tif files do not have.
    origin: where the centre of voxel (0, 0, 0) is. Of an array; 0 by default.
    direction: 3 x 3, column k is the direction of image axis k, orthonormal. Of an array; the
        identity by default.
    names: names of labels, which files use: a mapping, or the path of a table (3D Slicer,
        FreeSurfer, ITK-SNAP, or a list).
    frame: "lps" or "ras", the world of a file; as stored by default.
    volume: which volume of a file that has several, from 0 on.
    split_interfaces: "all", or pairs of labels: regions get nodes of their own there.
    progress: True for a bar, or a function of fraction, phase and tets. Ctrl-C ends a run, as does
        any exception in the function.

    Raises InvalidArgument or TypeError for bad arguments; FileError and FormatError for files;
    EmptyImage; LimitReached, TimeLimit and MemoryLimit; OutOfMemory. All but TypeError are
    LapdError.
    """
    with _prepared(
        image, spacing, origin, direction, frame, volume, names, progress, parameters
    ) as run:
        made = ctypes.c_void_p()
        try:
            run.call("mesh_image", ctypes.byref(made))
        except (LimitReached, TimeLimit, MemoryLimit) as error:
            # A partial mesh that was asked for.
            if made.value is None:
                raise
            warnings.warn(f"the mesh is partial: {error}", LapdWarning, stacklevel=2)
        finally:
            result = Mesh(made.value) if made.value else None
        if split_interfaces is not None:
            _split(run.context, result, split_interfaces)
        return result


@dataclass(frozen=True)
class Estimate:
    """What a mesh is to be expected to need, mostly within a fifth."""

    tets: int
    """Tets of labels."""
    peak_bytes: int
    """Memory at the peak, in bytes, the image among them."""
    seconds: float
    """On this machine, with the threads that are asked for."""


def estimate(
    image: Any,
    *,
    spacing: Iterable[float] | None = None,
    origin: Iterable[float] | None = None,
    direction: npt.ArrayLike | None = None,
    frame: Literal["lps", "ras"] | None = None,
    volume: int | None = None,
    **parameters: Any,
) -> Estimate:
    """Tells what `lapd.mesh` with the same arguments is to be expected to need, without making a
    mesh.

    Raises what `lapd.mesh` raises for the same image and parameters.
    """
    with _prepared(
        image, spacing, origin, direction, frame, volume, None, False, parameters
    ) as run:
        tets, peak_bytes, seconds = ctypes.c_uint64(), ctypes.c_uint64(), ctypes.c_double()
        run.call(
            "image_estimate", ctypes.byref(tets), ctypes.byref(peak_bytes), ctypes.byref(seconds)
        )
        return Estimate(tets.value, peak_bytes.value, seconds.value)


class _Prepared:
    """A context with an image and parameters."""

    def __init__(self, context: Context, progress: Any):
        self.context = context
        self.callbacks = _Callbacks(context, progress)
        self.image = ctypes.c_void_p()
        self.params = create("params")

    def call(self, name: str, *arguments: Any) -> None:
        """Calls a function of context, image, parameters and more."""
        self.callbacks.run(lambda: self.context.call(name, self.image, self.params, *arguments))


@contextmanager
def _prepared(image, spacing, origin, direction, frame, volume, names, progress, parameters):
    with Context() as context:
        run = _Prepared(context, progress)
        try:
            source = described(image, spacing, origin, direction, frame, volume)
            source.make(context, run.callbacks, run.image)
            _set_names(context, run.image, names)
            set_parameters(context, run.params, run.image, parameters)
            yield run
        finally:
            library.lapd_params_free(run.params)
            library.lapd_image_free(run.image)


def _show_parameters(function: Callable[..., Any]) -> None:
    """Has `help` and editors show the parameters of the table among the keywords."""
    texts = [
        textwrap.fill(f"{p.name}: {p.text}", 98, initial_indent=" " * 4, subsequent_indent=" " * 8)
        for p in PARAMETERS
    ]
    head = "    Other keywords are parameters of the run:\n"
    text = (function.__doc__ or "").rstrip() + "\n"
    function.__doc__ = "\n".join([text, head, *texts]) + "\n"
    signature = inspect.signature(function)
    keywords = list(signature.parameters.values())[:-1]
    keywords += [
        inspect.Parameter(
            p.name, inspect.Parameter.KEYWORD_ONLY, default=None, annotation=p.annotation
        )
        for p in PARAMETERS
    ]
    function.__signature__ = signature.replace(parameters=keywords)


_show_parameters(mesh)
_show_parameters(estimate)


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
