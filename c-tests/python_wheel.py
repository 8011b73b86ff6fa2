"""The Python package: a wheel of the installed library, and its tests with nothing but that wheel.

    python3 python_wheel.py SOURCE LIBRARY WORK ENVIRONMENT

The wheel is one for any Python 3, has the library and its types in it, and is unpacked rather than
installed. Its tests use what ENVIRONMENT has of other packages. Without network a line says what
was SKIPPED. Exit status 1 if anything fails.
"""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

# Nothing is to be written beside the sources.
sys.dont_write_bytecode = True

from environment import enter_environment, skip

if len(sys.argv) != 5:
    sys.exit(__doc__)
source, library, work = (Path(argument).absolute() for argument in sys.argv[1:4])
enter_environment(Path(sys.argv[4]).absolute(), "the Python package")

shutil.rmtree(work, ignore_errors=True)
work.mkdir(parents=True)
# setup.py reads the version beside the package; building leaves things behind in a copy alone.
shutil.copytree(source / "python", work / "source/python")
shutil.copy(source / "Cargo.toml", work / "source")
pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet", "--no-deps"]
made = subprocess.run(
    [*pip, "--retries", "1", "-w", work / "wheels", work / "source/python"],
    check=False,
    env={**os.environ, "LAPD_PREBUILT": str(library)},
    stdout=subprocess.PIPE,
    stderr=subprocess.STDOUT,
    text=True,
)
if made.returncode != 0:
    print(made.stdout)
    if "No matching distribution" in made.stdout or "Temporary failure" in made.stdout:
        skip("the Python package, pip has no setuptools for it")
        sys.exit(0)
    sys.exit(1)
(wheel,) = (work / "wheels").glob("*.whl")
assert "-py3-none-" in wheel.name, wheel.name
with zipfile.ZipFile(wheel) as archive:
    names = archive.namelist()
    archive.extractall(work / "installed")
needed = ["liblapd.so", "__init__.py", "__main__.py", "_certificate.py", "py.typed", "_run.pyi"]
for name in needed:
    assert f"lapd/{name}" in names, (name, names)
print(f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB")

clean = {name: value for name, value in os.environ.items() if not name.startswith("LAPD_")}
tests = subprocess.run(
    [sys.executable, "-m", "unittest", "discover", "-v", source / "python/tests"],
    check=False,
    cwd=work,
    env={**clean, "PYTHONPATH": str(work / "installed"), "PYTHONDONTWRITEBYTECODE": "1"},
)
sys.exit(tests.returncode)
