"""python -m lapd IMAGE -o OUT: meshes a file, as lapd.mesh does."""

from __future__ import annotations

import argparse
import sys
import warnings

from . import LapdError, LapdWarning, __version__, mesh
from ._params import PARAMETERS


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m lapd", description="Meshes a label image.")
    parser.add_argument("image", help="the path of an image")
    parser.add_argument("-o", "--output", action="append", required=True, help="may be given again")
    parser.add_argument("--names", help="a table of names of labels")
    parser.add_argument("--frame", choices=["lps", "ras"])
    parser.add_argument("--boundary-parts", action="store_true")
    parser.add_argument("--version", action="version", version=f"lapd {__version__}")
    for parameter in PARAMETERS:
        option = "--" + parameter.name.replace("_", "-")
        text = parameter.text.replace("%", "%%")
        if isinstance(parameter.kind, list):
            parser.add_argument(option, choices=parameter.kind, help=text)
        elif parameter.kind is bool:
            parser.add_argument(option, action="store_true", default=None, help=text)
        elif not isinstance(parameter.kind, str):
            parser.add_argument(option, type=float, help=text)
    given = vars(parser.parse_args())
    image, outputs = given.pop("image"), given.pop("output")
    parts = given.pop("boundary_parts")
    given = {name: value for name, value in given.items() if value is not None}
    warnings.showwarning = lambda message, category, *_: print(
        f"lapd: {'warning: ' if category is LapdWarning else ''}{message}", file=sys.stderr
    )
    try:
        made = mesh(image, progress=sys.stderr.isatty(), **given)
        for path in outputs:
            made.write(path, boundary_parts=parts)
    except LapdError as error:
        print(f"lapd: {error}", file=sys.stderr)
        return 1
    print(made)
    return 0


if __name__ == "__main__":
    sys.exit(main())
