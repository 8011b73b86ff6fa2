# Made by make_stubs.py: change _run.py or _params.py, and run that.
import os
from dataclasses import dataclass
from typing import Any, Callable, Iterable, Literal, Mapping

import numpy.typing as npt

from ._mesh import Mesh

@dataclass(frozen=True)
class Estimate:
    tets: int
    peak_bytes: int
    seconds: float

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
    delta: float | None = None,
    size: float | None = None,
    target_tets: int | None = None,
    coarsen: float | None = None,
    across: float | None = None,
    least_size: float | None = None,
    gradation: float | None = None,
    label_size: Mapping[int, float] | None = None,
    radius_edge: float | None = None,
    facet_angle: float | None = None,
    target_dihedral: float | None = None,
    improve: Literal["none", "interior", "full"] | None = None,
    adaptive: Literal["off", "thickness", "topology"] | None = None,
    spacing_floor: float | None = None,
    sigma: float | None = None,
    surface: Literal["smooth", "voxel"] | None = None,
    border: Literal["flat", "smooth"] | None = None,
    order: int | None = None,
    curved: bool | None = None,
    background: bool | None = None,
    background_label: int | None = None,
    merge: Mapping[int, int] | None = None,
    keep: Iterable[int] | None = None,
    min_voxels: int | None = None,
    threads: int | None = None,
    certificate: Literal["none", "sound", "full"] | None = None,
    max_vertices: int | None = None,
    time_limit: float | None = None,
    max_memory: int | None = None,
    partial: bool | None = None,
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

    Other keywords are parameters of the run:

    delta: distance between samples on the interfaces, in units of length; 1.5 times the geometric
        mean of the spacing by default
    size: largest circumradius of tets, in units of length; 2 times delta by default
    target_tets: the tets that the mesh is to have, within a tenth: delta and size are multiplied
        by one factor, which is searched; 0 for no such search
    coarsen: contract edges where that changes nothing in what is connected: the smallest angle in
        degrees that interface facets keep then; 15 is a good choice, 0 for no coarsening
    across: so many elements across each layer of a label, at least 1; 0, the default, for none
    least_size: the least size that elements across layers lead to; 0
    gradation: by how much such sizes grow per distance from a layer; 0.4
    label_size: size for single labels: a mapping
    radius_edge: largest circumradius over shortest edge; at least 2
    facet_angle: smallest angle of interface facets in degrees; at most 30
    target_dihedral: smallest dihedral angle in degrees; 15 by default
    improve: what may change to remove slivers; full
    adaptive: where samples come closer; topology
    spacing_floor: samples come no closer than this many voxels; 0.5
    sigma: smoothing of a coarse segmentation, in voxels; 0
    surface: what interfaces are; smooth
    border: how the object is closed at the image's end; flat
    order: 1, or 2 for a node in the middle of each edge
    curved: of order 2: nodes on interfaces go where the image has them
    background: keep the tets outside of the object, with label 0
    background_label: the label that counts as background; 0
    merge: labels that become others: a mapping of old to new ones
    keep: the labels to mesh; all by default
    min_voxels: components of fewer voxels are left out; 0
    threads: threads of the run; 1, which makes the same mesh each time
    certificate: what is measured on the mesh; sound
    max_vertices: the run ends when the mesh needs more; 0 for no limit
    time_limit: the run ends after so many seconds; 0 for no limit
    max_memory: the run ends when it needs more bytes; 0 for no limit
    partial: a mesh of what there is, when a limit ends the run
    """

def estimate(
    image: Any,
    *,
    spacing: Iterable[float] | None = None,
    origin: Iterable[float] | None = None,
    direction: npt.ArrayLike | None = None,
    frame: Literal["lps", "ras"] | None = None,
    volume: int | None = None,
    delta: float | None = None,
    size: float | None = None,
    target_tets: int | None = None,
    coarsen: float | None = None,
    across: float | None = None,
    least_size: float | None = None,
    gradation: float | None = None,
    label_size: Mapping[int, float] | None = None,
    radius_edge: float | None = None,
    facet_angle: float | None = None,
    target_dihedral: float | None = None,
    improve: Literal["none", "interior", "full"] | None = None,
    adaptive: Literal["off", "thickness", "topology"] | None = None,
    spacing_floor: float | None = None,
    sigma: float | None = None,
    surface: Literal["smooth", "voxel"] | None = None,
    border: Literal["flat", "smooth"] | None = None,
    order: int | None = None,
    curved: bool | None = None,
    background: bool | None = None,
    background_label: int | None = None,
    merge: Mapping[int, int] | None = None,
    keep: Iterable[int] | None = None,
    min_voxels: int | None = None,
    threads: int | None = None,
    certificate: Literal["none", "sound", "full"] | None = None,
    max_vertices: int | None = None,
    time_limit: float | None = None,
    max_memory: int | None = None,
    partial: bool | None = None,
) -> Estimate:
    """Tells what `lapd.mesh` with the same arguments is to be expected to need, without making a
    mesh.

    Raises what `lapd.mesh` raises for the same image and parameters.

    Other keywords are parameters of the run:

    delta: distance between samples on the interfaces, in units of length; 1.5 times the geometric
        mean of the spacing by default
    size: largest circumradius of tets, in units of length; 2 times delta by default
    target_tets: the tets that the mesh is to have, within a tenth: delta and size are multiplied
        by one factor, which is searched; 0 for no such search
    coarsen: contract edges where that changes nothing in what is connected: the smallest angle in
        degrees that interface facets keep then; 15 is a good choice, 0 for no coarsening
    across: so many elements across each layer of a label, at least 1; 0, the default, for none
    least_size: the least size that elements across layers lead to; 0
    gradation: by how much such sizes grow per distance from a layer; 0.4
    label_size: size for single labels: a mapping
    radius_edge: largest circumradius over shortest edge; at least 2
    facet_angle: smallest angle of interface facets in degrees; at most 30
    target_dihedral: smallest dihedral angle in degrees; 15 by default
    improve: what may change to remove slivers; full
    adaptive: where samples come closer; topology
    spacing_floor: samples come no closer than this many voxels; 0.5
    sigma: smoothing of a coarse segmentation, in voxels; 0
    surface: what interfaces are; smooth
    border: how the object is closed at the image's end; flat
    order: 1, or 2 for a node in the middle of each edge
    curved: of order 2: nodes on interfaces go where the image has them
    background: keep the tets outside of the object, with label 0
    background_label: the label that counts as background; 0
    merge: labels that become others: a mapping of old to new ones
    keep: the labels to mesh; all by default
    min_voxels: components of fewer voxels are left out; 0
    threads: threads of the run; 1, which makes the same mesh each time
    certificate: what is measured on the mesh; sound
    max_vertices: the run ends when the mesh needs more; 0 for no limit
    time_limit: the run ends after so many seconds; 0 for no limit
    max_memory: the run ends when it needs more bytes; 0 for no limit
    partial: a mesh of what there is, when a limit ends the run
    """
