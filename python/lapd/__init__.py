"""lapd: quality tetrahedral meshes of segmented 3D images, all tissues at once.

>>> import numpy as np, lapd
>>> x, y, z = np.mgrid[-12:13, -12:13, -12:13]
>>> ball = (x**2 + y**2 + z**2 < 100).astype(np.uint8)
>>> mesh = lapd.mesh(ball, delta=2.0)
>>> mesh.points.shape[1], mesh.tets.shape[1]
(3, 4)
>>> sorted(set(mesh.labels.tolist()))
[1]
>>> certificate = mesh.certificate()
>>> certificate.is_delaunay, certificate.is_closed, len(certificate.defects)
(True, True, 0)

An image is a NumPy array of integer labels, indexed [x, y, z], or an image of nibabel, SimpleITK,
ITK or PyVista, which bring their place in the world along, or the path of a file. Label 0 is the
background. Lengths are in the image's units of length, mostly millimetres.
"""

from __future__ import annotations

from ._certificate import Certificate, ComponentRow, Defect, Distances, LabelRow, LeftTet
from ._library import (
    Cancelled,
    EmptyImage,
    FileError,
    FormatError,
    InvalidArgument,
    LapdError,
    LapdWarning,
    LimitReached,
    MemoryLimit,
    NotMeasured,
    OutOfMemory,
    TimeLimit,
    Unsupported,
    library,
)
from ._mesh import Mesh, WorstTet
from ._run import Estimate, estimate, mesh

__version__: str = library.lapd_version().decode()
__all__ = [
    "Cancelled",
    "Certificate",
    "ComponentRow",
    "Defect",
    "Distances",
    "EmptyImage",
    "Estimate",
    "FileError",
    "FormatError",
    "InvalidArgument",
    "LabelRow",
    "LapdError",
    "LapdWarning",
    "LeftTet",
    "LimitReached",
    "MemoryLimit",
    "Mesh",
    "NotMeasured",
    "OutOfMemory",
    "TimeLimit",
    "Unsupported",
    "WorstTet",
    "estimate",
    "mesh",
]
