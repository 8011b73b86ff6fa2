"""Images of other packages, as the C library takes them: voxels, strides, and place."""

from __future__ import annotations

import ctypes
import os
from ctypes import c_double, c_int32, c_size_t
from dataclasses import dataclass

import numpy as np

from ._library import Context, InvalidArgument, number, text_of

# lapd_voxel_type
_TYPES = ["u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8"]
# lapd_world_frame
_FRAMES = {None: 0, "lps": 1, "ras": 2}


@dataclass
class Array:
    """Voxels indexed [x, y, z], and where they are."""

    voxels: np.ndarray
    spacing: np.ndarray
    origin: np.ndarray
    direction: np.ndarray

    def make(self, context: Context, callbacks, handle) -> None:
        """Makes the image; the library reads the voxels where they are."""
        voxels = self.voxels
        shapes = [np.shape(a) for a in (self.spacing, self.origin, self.direction)]
        if shapes != [(3,), (3,), (3, 3)]:
            raise InvalidArgument("the image's place in the world has not three dimensions")
        if voxels.ndim != 3:
            raise InvalidArgument(f"the image has {voxels.ndim} dimensions, 3 are needed")
        if voxels.dtype == bool:
            voxels = voxels.view(np.uint8)
        kind = voxels.dtype.newbyteorder("=").str[1:]
        if kind not in _TYPES:
            raise InvalidArgument(f"labels are integers, not {voxels.dtype}")
        size = voxels.dtype.itemsize
        is_native = voxels.dtype.isnative and all(stride % size == 0 for stride in voxels.strides)
        if not is_native or voxels.size == 0:
            voxels = np.asfortranarray(voxels, dtype=voxels.dtype.newbyteorder("="))
        strides = [stride // size for stride in voxels.strides]
        frame = [
            np.ascontiguousarray(values, dtype=np.float64).ctypes.data_as(ctypes.POINTER(c_double))
            for values in (self.origin, self.spacing, self.direction)
        ]
        callbacks.run(
            lambda: context.call(
                "image_create",
                voxels.ctypes.data,
                c_int32(_TYPES.index(kind)),
                (c_size_t * 3)(*voxels.shape),
                (ctypes.c_ssize_t * 3)(*strides),
                *frame,
                ctypes.byref(handle),
            )
        )


@dataclass
class File:
    """A file that the library reads itself."""

    path: bytes
    frame: str | None
    spacing: np.ndarray | None
    volume: int | None

    def make(self, context: Context, callbacks, handle) -> None:
        if self.frame not in _FRAMES:
            raise InvalidArgument(f"frame is lps or ras, not {self.frame!r}")
        if self.volume is not None:
            context.call("context_set_volume", number("volume", ctypes.c_uint32, self.volume))
        arguments = (self.path, _FRAMES[self.frame], 0, None, 0, ctypes.byref(handle))
        callbacks.run(lambda: context.call("image_read_labels", *arguments))
        if self.spacing is not None:
            sides = (c_double * 3)(*self.spacing)
            context.call("image_set_spacing", handle, sides)


def described(image, spacing, origin, direction, frame, volume):
    """What an image of any kind is to the library."""
    if isinstance(image, (str, os.PathLike)):
        if origin is not None or direction is not None:
            raise InvalidArgument("a file has its own origin and direction")
        sides = None if spacing is None else _vector("spacing", spacing, 1.0)
        return File(text_of(image), frame, sides, volume)
    if frame is not None:
        raise InvalidArgument("frame is for files; other images stay in the world they are in")
    if volume is not None:
        raise InvalidArgument("volume is for files; of an array take the part yourself")
    for convert in (_of_nibabel, _of_simple_itk, _of_itk, _of_pyvista):
        found = convert(image)
        if found is not None:
            _refuse("this image", spacing, origin, direction)
            return found
    voxels = np.asarray(image)
    return Array(
        voxels,
        _vector("spacing", spacing, 1.0),
        _vector("origin", origin, 0.0),
        np.eye(3) if direction is None else _matrix(direction),
    )


def _refuse(what: str, *given) -> None:
    if any(value is not None for value in given):
        raise InvalidArgument(f"{what} has its own spacing, origin and direction")


def _vector(name: str, values, default: float) -> np.ndarray:
    if values is None:
        return np.full(3, default)
    vector = np.asarray(values, dtype=np.float64)
    if vector.shape != (3,):
        raise InvalidArgument(f"{name} has 3 values, not a shape of {vector.shape}")
    return vector


def _matrix(values) -> np.ndarray:
    matrix = np.asarray(values, dtype=np.float64)
    if matrix.shape == (9,):
        matrix = matrix.reshape(3, 3)
    if matrix.shape != (3, 3):
        raise InvalidArgument(f"direction is 3 x 3, not a shape of {matrix.shape}")
    return matrix


def _of_nibabel(image):
    """A nibabel image: RAS, by its affine."""
    affine = getattr(image, "affine", None)
    if affine is None or not hasattr(image, "dataobj"):
        return None
    steps = np.asarray(affine, dtype=np.float64)[:3, :3]
    lengths = np.linalg.norm(steps, axis=0)
    if not (lengths > 0).all():
        raise InvalidArgument("the affine of the image is singular")
    # The affine is rounded once more than the spacings, which our reader of NIfTI takes, too.
    zooms = getattr(getattr(image, "header", None), "get_zooms", tuple)()[:3]
    spacing = lengths
    if len(zooms) == 3:
        zooms = np.asarray(zooms, dtype=np.float64)
        spacing = np.where(np.abs(lengths - zooms) <= 1e-6 * lengths, zooms, lengths)
    voxels = np.asanyarray(image.dataobj)
    if voxels.dtype.kind == "f":
        # Whole numbers that a header's slope made floats of.
        rounded = np.rint(voxels)
        if not (np.abs(voxels - rounded) <= 1e-3).all():
            raise InvalidArgument("the voxels are no whole numbers, so they are no labels")
        if not (np.abs(rounded) < 2.0**53).all():
            raise InvalidArgument("the voxels are too large for labels")
        voxels = rounded.astype(np.int64)
    return Array(voxels, spacing, np.asarray(affine)[:3, 3], steps / lengths)


def _of_simple_itk(image):
    """A SimpleITK image: LPS."""
    if not all(hasattr(image, name) for name in ("GetSpacing", "GetPixelIDTypeAsString")):
        return None
    import SimpleITK

    voxels = SimpleITK.GetArrayViewFromImage(image).T
    return Array(
        voxels,
        np.array(image.GetSpacing()),
        np.array(image.GetOrigin()),
        _matrix(image.GetDirection()),
    )


def _of_itk(image):
    """An ITK image: LPS."""
    if not all(hasattr(image, name) for name in ("GetSpacing", "GetLargestPossibleRegion")):
        return None
    import itk

    voxels = np.asarray(itk.array_view_from_image(image)).T
    direction = np.asarray(itk.array_from_matrix(image.GetDirection()))
    spacing, origin = np.array(image.GetSpacing()), np.array(image.GetOrigin())
    # The origin is that of index 0, which the image need not have.
    first = np.array(list(image.GetBufferedRegion().GetIndex()))
    return Array(voxels, spacing, origin + direction @ (first * spacing), direction)


def _of_pyvista(image):
    """A PyVista or VTK image: its active scalars, which lie at its points."""
    if not all(hasattr(image, name) for name in ("GetSpacing", "GetDimensions", "GetPointData")):
        return None
    from vtkmodules.util.numpy_support import vtk_to_numpy

    scalars = image.GetPointData().GetScalars()
    if scalars is None or scalars.GetNumberOfComponents() != 1:
        raise InvalidArgument("the image has no point scalars of one component")
    voxels = vtk_to_numpy(scalars).reshape(image.GetDimensions(), order="F")
    direction = np.eye(3)
    if hasattr(image, "GetDirectionMatrix"):
        matrix = image.GetDirectionMatrix()
        direction = np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
    spacing, origin = np.array(image.GetSpacing()), np.array(image.GetOrigin())
    # The origin is that of index 0, which the image need not have.
    first = np.array(image.GetExtent()[::2])
    return Array(voxels, spacing, origin + direction @ (first * spacing), direction)
