"""Writes lapd/_run.pyi, where type checkers and editors read the keywords of `lapd.mesh` and
`lapd.estimate`.

    python make_stubs.py

The parameters of a run come from the table in lapd/_params.py, the rest from the function itself.
A test says when the file is out of date.
"""

from __future__ import annotations

import inspect
from pathlib import Path
from typing import Any, Callable

import lapd

PATH = Path(__file__).parent / "lapd" / "_run.pyi"
HEAD = """# Made by make_stubs.py: change _run.py or _params.py, and run that.
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

"""


def stub_of(function: Callable[..., Any], result: str) -> str:
    lines = [f"def {function.__name__}("]
    keyword_only = False
    for parameter in inspect.signature(function).parameters.values():
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not keyword_only:
            lines.append("    *,")
            keyword_only = True
        given = "" if parameter.default is inspect.Parameter.empty else f" = {parameter.default!r}"
        kind = parameter.annotation.replace("'", '"')
        lines.append(f"    {parameter.name}: {kind}{given},")
    lines.append(f") -> {result}:")
    lines.append(f'    """{function.__doc__}    """')
    return "\n".join(lines) + "\n"


def stub() -> str:
    """The text of the file."""
    return HEAD + stub_of(lapd.mesh, "Mesh") + "\n" + stub_of(lapd.estimate, "Estimate")


if __name__ == "__main__":
    PATH.write_text(stub(), encoding="utf-8")
