"""The C library: where it is, its functions, its errors. Nothing is computed here."""

from __future__ import annotations

import ctypes
import os
import sys
from ctypes import POINTER, c_char_p, c_double, c_int32, c_int64, c_size_t, c_uint64, c_void_p
from pathlib import Path


class LapdError(Exception):
    """A call failed; the text says what and what to do. `status` is its lapd_status."""

    status = 9


class InvalidArgument(LapdError, ValueError):
    """A bad argument, or two that do not go together."""

    status = 1


class Unsupported(LapdError):
    """This build or this machine cannot do it."""

    status = 2


class FileError(LapdError, OSError):
    """A file could not be read or written."""

    status = 3


class FormatError(LapdError, ValueError):
    """A file is no valid image, or uses what is not read."""

    status = 4


class EmptyImage(LapdError, ValueError):
    """There is no label to mesh."""

    status = 5


class LimitReached(LapdError):
    """The mesh needs more vertices than it may have."""

    status = 6


class Cancelled(LapdError):
    """The progress callback asked for it."""

    status = 7


class OutOfMemory(LapdError, MemoryError):
    """The system refused memory."""

    status = 8


class TimeLimit(LapdError, TimeoutError):
    """The refinement did not end in time."""

    status = 12


class MemoryLimit(LapdError, MemoryError):
    """The run, or the image, needs more memory than it may have."""

    status = 13


class NotMeasured(LapdError):
    """The certificate was not asked for."""

    status = 14


class LapdWarning(UserWarning):
    """What the library warns of: an image that is doubtful, tissue that is lost."""


ERRORS = {kind.status: kind for kind in LapdError.__subclasses__()}


class Progress(ctypes.Structure):
    _fields_ = [("phase", c_int32), ("fraction", c_double), ("tets", c_uint64)]


PROGRESS_FN = ctypes.CFUNCTYPE(c_int32, c_void_p, POINTER(Progress))
LOG_FN = ctypes.CFUNCTYPE(None, c_void_p, c_int32, c_char_p)
DOUBLES, INTS, SIZES = POINTER(c_double), POINTER(c_int32), POINTER(c_size_t)
HANDLE = POINTER(c_void_p)

# What the functions take, behind the context that all of these have first.
FUNCTIONS = {
    "context_set_progress": [PROGRESS_FN, c_void_p],
    "context_set_log": [LOG_FN, c_void_p],
    "context_set_max_read_bytes": [c_uint64],
    "context_set_allow_outside": [c_int32],
    "context_set_volume": [c_int64],
    "image_set_spacing": [c_void_p, c_void_p],
    "image_create": [
        c_void_p,
        c_int32,
        SIZES,
        POINTER(ctypes.c_ssize_t),
        DOUBLES,
        DOUBLES,
        DOUBLES,
        HANDLE,
    ],
    "image_read_labels": [c_char_p, c_int32, c_int32, SIZES, c_size_t, HANDLE],
    "image_set_label_name": [c_void_p, c_int32, c_char_p],
    "image_read_label_names": [c_void_p, c_char_p],
    "mesh_image": [c_void_p, c_void_p, HANDLE],
    "mesh_write_with": [c_void_p, c_char_p, c_void_p],
    "mesh_write_report": [c_void_p, c_char_p, c_char_p],
    "image_estimate": [c_void_p, c_void_p, c_void_p, c_void_p, c_void_p],
    "mesh_split_interfaces": [c_void_p, INTS, c_size_t],
    "write_options_set_measures": [c_void_p, c_int32],
    "write_options_set_boundary_parts": [c_void_p, c_int32],
    "params_set_label_size": [c_void_p, c_int32, c_double],
    "params_set_merge": [c_void_p, INTS, c_size_t, c_int32],
    "params_set_keep": [c_void_p, INTS, c_size_t],
}


def find_library() -> Path:
    """The library of the package, or the one that LAPD_LIBRARY names."""
    named = os.environ.get("LAPD_LIBRARY")
    if named:
        return Path(named)
    name = {"win32": "lapd.dll", "darwin": "liblapd.dylib"}.get(sys.platform, "liblapd.so")
    return Path(__file__).with_name(name)


def load():
    path = find_library()
    try:
        return ctypes.CDLL(str(path))
    except OSError as error:
        raise ImportError(
            f"the library of lapd cannot be loaded from {path}: {error}; build the package with "
            "pip, or name the library in the environment variable LAPD_LIBRARY"
        ) from None


library = load()
library.lapd_version.restype = c_char_p
library.lapd_status_message.restype = c_char_p
library.lapd_context_last_error.restype = c_char_p
library.lapd_context_last_error.argtypes = [c_void_p]
for name, arguments in FUNCTIONS.items():
    getattr(library, "lapd_" + name).argtypes = [c_void_p, *arguments]
for name in ("context", "image", "params", "mesh", "write_options"):
    getattr(library, f"lapd_{name}_free").argtypes = [c_void_p]
    getattr(library, f"lapd_{name}_free").restype = None


def check(status: int) -> None:
    """Raises what a status of a call without a context means."""
    if status != 0:
        message = library.lapd_status_message(c_int32(status)).decode()
        raise ERRORS.get(status, LapdError)(message)


def text_of(text) -> bytes:
    """A text or path as C has strings, which end at a zero byte."""
    encoded = os.fsencode(text) if isinstance(text, os.PathLike) else str(text).encode()
    if b"\0" in encoded:
        raise InvalidArgument(f"{text!r} has a zero byte in it")
    return encoded


def create(kind: str) -> int:
    """A new handle of a kind that needs nothing else."""
    handle = c_void_p()
    check(getattr(library, f"lapd_{kind}_create")(ctypes.byref(handle)))
    return handle.value


class Context:
    """A context for one call and those that belong to it."""

    def __init__(self):
        self.handle = create("context")
        self.kept = []

    def __enter__(self):
        return self

    def __exit__(self, *_):
        library.lapd_context_free(self.handle)

    def call(self, name: str, *arguments) -> None:
        """Calls a function; another thread may run Python meanwhile."""
        status = getattr(library, "lapd_" + name)(c_void_p(self.handle), *arguments)
        if status != 0:
            message = library.lapd_context_last_error(self.handle).decode(errors="replace")
            raise ERRORS.get(status, LapdError)(message)


def number(name: str, kind, value):
    """A number as the C library takes it; ctypes would cut it off without a word."""
    if kind is not c_double:
        bits = 8 * ctypes.sizeof(kind)
        low, high = (-(2 ** (bits - 1)), 2 ** (bits - 1)) if kind is c_int32 else (0, 2**bits)
        if value != int(value) or not low <= int(value) < high:
            raise InvalidArgument(f"{name} is a whole number from {low} on, not {value!r}")
        return int(value)
    return float(value)
