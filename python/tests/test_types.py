"""The types that checkers and editors see."""

import importlib.util
import inspect
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from phantoms import has

import lapd
from lapd._params import PARAMETERS

SCRIPT = """
import numpy as np
import numpy.typing as npt

import lapd

voxels = np.zeros((9, 9, 9), dtype=np.uint8)
mesh = lapd.mesh(voxels, spacing=(1.0, 1.0, 2.0), delta=1.5, names={1: "liver"}, threads=2,
                 merge={3: 1}, keep=[1], label_size={1: 2.0}, certificate="full", progress=True)
points: npt.NDArray[np.float64] = mesh.points
labels: npt.NDArray[np.int32] = mesh.labels
certificate: lapd.Certificate = mesh.certificate()
if certificate.distances is not None and certificate.distances.mean_mesh_to_image is not None:
    print(1 + certificate.distances.mean_mesh_to_image)
if certificate.labels is not None:
    print(certificate.labels[0].mesh_volume + 1.0)
print(mesh.worst_tets(3)[0].position[2] + 1.0, mesh.measure("radius_ratio").max())
mesh.write("a.vtu", measures=True)
try:
    lapd.mesh("a.nrrd", frame="ras", split_interfaces="all")
except lapd.FormatError as error:
    print(error)
"""

WRONG = [
    ("lapd.mesh(0, detla=1.0)", 'Unexpected keyword argument "detla"'),
    ('lapd.mesh(0, delta="1")', '"delta"'),
    ('lapd.mesh(0, improve="all")', '"improve"'),
    ("lapd.mesh(0).certificate().tets = 1", "read-only"),
    ('lapd.mesh(0).measure("min_dihedral").lower()', "lower"),
]


class Types(unittest.TestCase):
    def test_stub_is_that_of_the_table(self):
        folder = Path(__file__).resolve().parents[1]
        if not (folder / "make_stubs.py").exists():
            self.skipTest("the tests stand alone, without the sources of the package")
        spec = importlib.util.spec_from_file_location("make_stubs", folder / "make_stubs.py")
        make_stubs = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(make_stubs)
        found = make_stubs.PATH.read_text(encoding="utf-8")
        self.assertEqual(found, make_stubs.stub(), "run python/make_stubs.py")

    def test_installed(self):
        folder = Path(lapd.__file__).parent
        for name in ("py.typed", "_run.pyi"):
            self.assertTrue((folder / name).exists(), name)

    def test_keywords(self):
        signature = inspect.signature(lapd.mesh)
        for parameter in PARAMETERS:
            self.assertIsNone(signature.parameters[parameter.name].default)
            self.assertIn(f"    {parameter.name}: ", lapd.mesh.__doc__)
        self.assertNotIn("parameters", signature.parameters)

    @unittest.skipUnless(has("mypy"), "mypy is not installed")
    def test_mypy(self):
        def checked(text):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "script.py"
                path.write_text(text)
                options = ["--strict", "--follow-imports=silent", "--cache-dir", cache]
                return subprocess.run(
                    [sys.executable, "-m", "mypy", *options, path],
                    capture_output=True,
                    check=False,
                    text=True,
                    cwd=folder,
                    env={**os.environ, "MYPYPATH": str(Path(lapd.__file__).parents[1])},
                ).stdout

        with tempfile.TemporaryDirectory() as cache:
            self.assertIn("Success", checked(SCRIPT))
            text = "import lapd\n" + "\n".join(line for line, _ in WRONG) + "\n"
            found = checked(text).splitlines()
            for number, (line, words) in enumerate(WRONG, 2):
                told = [text for text in found if text.startswith(f"script.py:{number}:")]
                self.assertTrue(any(words in text for text in told), (line, found))


if __name__ == "__main__":
    unittest.main()
