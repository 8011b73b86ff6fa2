"""Builds the C library by cargo and puts it into the package.

The wheel runs on any Python 3: the library does not know Python. With LAPD_PREBUILT in the
environment that library is taken, and nothing is built; LAPD_LICENSES then names a folder with the
licences of what is linked into it.
"""

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

from setuptools import Distribution, setup
from setuptools.command.bdist_wheel import bdist_wheel
from setuptools.command.build_py import build_py

ROOT = Path(__file__).resolve().parents[1]
NAME = {"win32": "lapd.dll", "darwin": "liblapd.dylib"}.get(sys.platform, "liblapd.so")


def built_library():
    """Where the library is, built if need be."""
    prebuilt = os.environ.get("LAPD_PREBUILT")
    if prebuilt:
        return Path(prebuilt)
    target = Path(os.environ.get("CARGO_TARGET_DIR", ROOT / "target"))
    cargo = ["cargo", "build", "--release", "--locked", "--lib", "--features", "memory-reserve"]
    subprocess.run(cargo, check=True, cwd=ROOT)
    return target / "release" / NAME


class BuildWithLibrary(build_py):
    def run(self):
        super().run()
        folder = Path(self.build_lib) / "lapd"
        folder.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(built_library(), folder / NAME)
        licenses = folder / "licenses"
        if os.environ.get("LAPD_LICENSES"):
            shutil.copytree(os.environ["LAPD_LICENSES"], licenses, dirs_exist_ok=True)
        elif not os.environ.get("LAPD_PREBUILT"):
            script = ROOT / "packaging" / "licenses.py"
            subprocess.run([sys.executable, str(script), str(licenses)], check=True)


class PlatformWheel(bdist_wheel):
    def finalize_options(self):
        super().finalize_options()
        self.root_is_pure = False

    def get_tag(self):
        return "py3", "none", super().get_tag()[2]


class PlatformDistribution(Distribution):
    def has_ext_modules(self):
        return True


version = re.search(r'^version = "(.*)"', (ROOT / "Cargo.toml").read_text(), re.MULTILINE)[1]
setup(
    version=version,
    distclass=PlatformDistribution,
    cmdclass={"build_py": BuildWithLibrary, "bdist_wheel": PlatformWheel},
)
