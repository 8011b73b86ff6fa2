"""The parameters of a run: their names, units, and what sets them."""

from __future__ import annotations

import ctypes
from ctypes import c_double, c_int32, c_size_t, c_uint64, c_void_p
from dataclasses import dataclass
from typing import Any

import numpy as np

from ._library import Context, InvalidArgument, check, library, number

# What is given for parameters that are no single number.
LABEL_SIZES, LABEL_MAP, LABELS = "Mapping[int, float]", "Mapping[int, int]", "Iterable[int]"

_ANNOTATIONS = {
    c_double: "float",
    c_int32: "int",
    c_size_t: "int",
    c_uint64: "int",
    bool: "bool",
    LABEL_SIZES: LABEL_SIZES,
    LABEL_MAP: LABEL_MAP,
    LABELS: LABELS,
}


@dataclass(frozen=True)
class Parameter:
    """A parameter: its name, the C type of its value, or the names of its values, and what it
    is."""

    name: str
    kind: Any
    text: str

    @property
    def annotation(self) -> str:
        """The type of its value, as Python writes it. None stands for the default."""
        if isinstance(self.kind, list):
            values = ", ".join(f'"{value}"' for value in self.kind)
            return f"Literal[{values}] | None"
        return f"{_ANNOTATIONS[self.kind]} | None"


PARAMETERS = [
    Parameter(
        "delta",
        c_double,
        "distance between samples on the interfaces, in units of length; 1.5 times the geometric "
        "mean of the spacing by default",
    ),
    Parameter(
        "size",
        c_double,
        "largest circumradius of tets, in units of length; 2 times delta by default",
    ),
    Parameter(
        "target_tets",
        c_uint64,
        "the tets that the mesh is to have, within a tenth: delta and size are multiplied by one "
        "factor, which is searched; 0 for no such search",
    ),
    Parameter(
        "coarsen",
        c_double,
        "contract edges where that changes nothing in what is connected: the smallest angle in "
        "degrees that interface facets keep then; 15 is a good choice, 0 for no coarsening",
    ),
    Parameter(
        "across",
        c_double,
        "so many elements across each layer of a label, at least 1; 0, the default, for none",
    ),
    Parameter("least_size", c_double, "the least size that elements across layers lead to; 0"),
    Parameter("gradation", c_double, "by how much such sizes grow per distance from a layer; 0.4"),
    Parameter("label_size", LABEL_SIZES, "size for single labels: a mapping"),
    Parameter("radius_edge", c_double, "largest circumradius over shortest edge; at least 2"),
    Parameter("facet_angle", c_double, "smallest angle of interface facets in degrees; at most 30"),
    Parameter("target_dihedral", c_double, "smallest dihedral angle in degrees; 15 by default"),
    Parameter("improve", ["none", "interior", "full"], "what may change to remove slivers; full"),
    Parameter("adaptive", ["off", "thickness", "topology"], "where samples come closer; topology"),
    Parameter("spacing_floor", c_double, "samples come no closer than this many voxels; 0.5"),
    Parameter("sigma", c_double, "smoothing of a coarse segmentation, in voxels; 0"),
    Parameter("surface", ["smooth", "voxel"], "what interfaces are; smooth"),
    Parameter("border", ["flat", "smooth"], "how the object is closed at the image's end; flat"),
    Parameter("order", c_int32, "1, or 2 for a node in the middle of each edge"),
    Parameter("curved", bool, "of order 2: nodes on interfaces go where the image has them"),
    Parameter("background", bool, "keep the tets outside of the object, with label 0"),
    Parameter("background_label", c_int32, "the label that counts as background; 0"),
    Parameter("merge", LABEL_MAP, "labels that become others: a mapping of old to new ones"),
    Parameter("keep", LABELS, "the labels to mesh; all by default"),
    Parameter("min_voxels", c_size_t, "components of fewer voxels are left out; 0"),
    Parameter("threads", c_size_t, "threads of the run; 1, which makes the same mesh each time"),
    Parameter("certificate", ["none", "sound", "full"], "what is measured on the mesh; sound"),
    Parameter("max_vertices", c_size_t, "the run ends when the mesh needs more; 0 for no limit"),
    Parameter("time_limit", c_double, "the run ends after so many seconds; 0 for no limit"),
    Parameter("max_memory", c_uint64, "the run ends when it needs more bytes; 0 for no limit"),
    Parameter("partial", bool, "a mesh of what there is, when a limit ends the run"),
]

_BY_NAME = {parameter.name: parameter for parameter in PARAMETERS}


def set_parameters(context: Context, params: int, image: c_void_p, given: dict) -> None:
    """Sets what was given, and what depends on the image where it was not."""
    given = {name: value for name, value in given.items() if value is not None}
    if "delta" not in given:
        spacing = (c_double * 3)()
        check(library.lapd_image_get_spacing(image, spacing))
        given = {**given, "delta": 1.5 * float(np.cbrt(np.prod(spacing)))}
    if "size" not in given:
        given = {**given, "size": 2 * given["delta"]}
    for name, value in given.items():
        parameter = _BY_NAME.get(name)
        if parameter is None:
            raise TypeError(f"{name!r} is no parameter; there are {', '.join(_BY_NAME)}")
        _set(context, params, parameter, value)


def _set(context: Context, params: int, parameter: Parameter, value) -> None:
    name, kind = parameter.name, parameter.kind
    if name == "label_size":
        for label, size in value.items():
            context.call("params_set_label_size", params, number("label", c_int32, label), size)
    elif name == "merge":
        for label, target in value.items():
            old = (c_int32 * 1)(number("label", c_int32, label))
            context.call("params_set_merge", params, old, 1, number("label", c_int32, target))
    elif name == "keep":
        labels = [number("label", c_int32, label) for label in value]
        context.call("params_set_keep", params, (c_int32 * len(labels))(*labels), len(labels))
    elif isinstance(kind, list):
        if value not in kind:
            raise InvalidArgument(f"{name} is one of {', '.join(kind)}, not {value!r}")
        context.call(f"params_set_{name}", c_void_p(params), c_int32(kind.index(value)))
    else:
        value = bool(value) if kind is bool else number(name, kind, value)
        kind = c_int32 if kind is bool else kind
        context.call(f"params_set_{name}", c_void_p(params), kind(value))
