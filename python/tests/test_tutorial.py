"""The code of the guide's tutorial: that of the page is that of the script, and it runs."""

import os
import re
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from phantoms import has

DOCS = Path(__file__).resolve().parents[2] / "docs"
PAGE, SCRIPT = DOCS / "guide/python-tutorial.md", DOCS / "pictures/python_tutorial.py"
# The parts that PyVista draws, by the headings of the script.
DRAWN = r"# 6\. .*(?=# 8\. )"


def run(text):
    """Runs a script; returns what it left behind, by name and size."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "script.py"
        path.write_text(text, encoding="utf-8")
        done = subprocess.run(
            [sys.executable, path],
            check=False,
            cwd=folder,
            capture_output=True,
            text=True,
            env={**os.environ, "PYVISTA_OFF_SCREEN": "true"},
        )
        return done, {file.name: file.stat().st_size for file in Path(folder).iterdir()}


def draws():
    """Whether PyVista can draw here, which needs more than its package."""
    test = "import pyvista as pv\np = pv.Plotter()\np.add_mesh(pv.Sphere())\np.screenshot('a.png')"
    return has("pyvista") and run(test)[0].returncode == 0


@unittest.skipUnless(PAGE.exists(), "the tests stand alone, without the documentation")
class Tutorial(unittest.TestCase):
    def test_page_is_the_script(self):
        page, script = (path.read_text(encoding="utf-8") for path in (PAGE, SCRIPT))
        blocks = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
        parts = re.split(r"^# \d\. .*\n", script, flags=re.MULTILINE)[1:]
        parts[-1] = parts[-1].split("\n# Few colours")[0]
        self.assertEqual([block.strip() for block in blocks], [part.strip() for part in parts])
        headings = re.findall(r"^# (\d\. .*)$", script, re.MULTILINE)
        self.assertEqual(re.findall(r"^## (.*)$", page, re.MULTILINE), headings)
        for picture in re.findall(r"\((\.\./pictures/.*?\.png)\)", page):
            size = (PAGE.parent / picture).stat().st_size
            self.assertTrue(0 < size < 150_000, (picture, size))

    @unittest.skipUnless(
        all(has(name) for name in ("matplotlib", "PIL", "skfem")),
        "matplotlib, Pillow or scikit-fem is not installed",
    )
    def test_script_runs(self):
        text = SCRIPT.read_text(encoding="utf-8")
        wanted = ["labels", "mesh", "potential", "quality"]
        if not draws():
            text, pictures = re.subn(DRAWN, "", text, flags=re.DOTALL)
            self.assertEqual(pictures, 1)
            wanted = ["labels", "quality"]
            text = text.split("\n# Few colours")[0]
        done, left = run(text)
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertIn("potential 0.000 to 1.000 V", done.stdout)
        self.assertIn("components      0 lost, 0 merged, 0 torn off", done.stdout)
        for name in wanted:
            self.assertIn(f"python-tutorial-{name}.png", left)


if __name__ == "__main__":
    unittest.main()
