"""Writes lapd/_run.pyi, where type checkers and editors read the keywords of `lapd.mesh`.

    python make_stubs.py

The parameters of a run come from the table in lapd/_params.py, the rest from the function itself.
A test says when the file is out of date.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import lapd

PATH = Path(__file__).parent / "lapd" / "_run.pyi"
HEAD = """# Made by make_stubs.py: change _run.py or _params.py, and run that.
import os
from typing import Any, Callable, Iterable, Literal, Mapping

import numpy.typing as npt

from ._mesh import Mesh

"""


def stub() -> str:
    """The text of the file."""
    lines = ["def mesh("]
    keyword_only = False
    for parameter in inspect.signature(lapd.mesh).parameters.values():
        if parameter.kind is inspect.Parameter.KEYWORD_ONLY and not keyword_only:
            lines.append("    *,")
            keyword_only = True
        given = "" if parameter.default is inspect.Parameter.empty else f" = {parameter.default!r}"
        kind = parameter.annotation.replace("'", '"')
        lines.append(f"    {parameter.name}: {kind}{given},")
    lines.append(") -> Mesh:")
    lines.append(f'    """{lapd.mesh.__doc__}    """')
    return HEAD + "\n".join(lines) + "\n"


if __name__ == "__main__":
    PATH.write_text(stub(), encoding="utf-8")
