"""The Python environment that tests need, made when it is missing: requirements.txt, from PyPI."""

import os
import subprocess
import sys
import venv
from pathlib import Path


def skip(what):
    print("SKIPPED: " + " ".join(what.split()))


def make_environment(folder, what):
    """The environment's python, after making it if need be; without network `what` is skipped."""
    wanted = Path(__file__).with_name("requirements.txt")
    stamp = folder / "installed.txt"
    python = folder / "bin/python"
    if stamp.exists() and stamp.read_text() == wanted.read_text():
        return python
    try:
        venv.create(folder, clear=True, with_pip=True)
    except (OSError, subprocess.CalledProcessError) as error:
        skip(f"{what}, no virtual environment can be made: {error}")
        sys.exit(0)
    pip = [python, "-m", "pip", "--disable-pip-version-check", "install", "--quiet"]
    run = subprocess.run(
        [*pip, "--no-deps", "--retries", "1", "-r", wanted],
        check=False,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    if run.returncode != 0:
        print(run.stdout)
        why = run.stdout.strip().splitlines()[-1]
        skip(f"{what}, pip could not install {wanted.name}: {why}")
        sys.exit(0)
    stamp.write_text(wanted.read_text())
    return python


def enter_environment(folder, what):
    """Goes on in the environment, after making it if need be; without network `what` is skipped."""
    if folder.exists() and os.path.samefile(sys.prefix, folder):
        return
    python = make_environment(folder, what)
    os.execv(python, [python, *sys.argv])


if __name__ == "__main__":
    make_environment(Path(sys.argv[1]).absolute(), "all that needs Python's packages")
