"""The measures of tets, the worst of them, and the picture of the quality."""

import gc
import sys
import unittest
from unittest import mock

import numpy as np
from phantoms import ball, has

import lapd


class Measures(unittest.TestCase):
    def test_measures(self):
        mesh = lapd.mesh(ball(), delta=1.5)
        quality = mesh.report()["quality"]
        for name, low, high in [
            ("min_dihedral", quality["min_dihedral"], None),
            ("max_dihedral", None, quality["max_dihedral"]),
            ("radius_edge", None, quality["max_radius_edge"]),
            ("scaled_jacobian", *(quality["scaled_jacobian"][end] for end in ("min", "max"))),
            ("edge_ratio", *(quality["edge_ratio"][end] for end in ("min", "max"))),
            ("radius_ratio", *(quality["radius_ratio"][end] for end in ("min", "max"))),
        ]:
            found = mesh.measure(name)
            self.assertEqual(found.shape, (len(mesh.tets),))
            for value, wanted in ((found.min(), low), (found.max(), high)):
                if wanted is not None:
                    self.assertAlmostEqual(value, wanted, places=9, msg=name)
        with self.assertRaises(lapd.InvalidArgument):
            mesh.measure("beauty")

    def test_worst_tets(self):
        mesh = lapd.mesh(ball(), delta=1.5)
        worst = mesh.worst_tets(5)
        self.assertEqual(len(worst), 5)
        badness = [min(tet.min_dihedral, 180 - tet.max_dihedral) for tet in worst]
        self.assertEqual(badness, sorted(badness))
        first = worst[0]
        centroid = mesh.points[mesh.tets[first.tet]].mean(axis=0)
        self.assertTrue(np.allclose(first.position, centroid))
        self.assertEqual(first.label, mesh.labels[first.tet])
        self.assertEqual(len(mesh.worst_tets(10**6)), len(mesh.tets))
        self.assertEqual(mesh.worst_tets(0), [])
        with self.assertRaises(lapd.InvalidArgument):
            mesh.worst_tets(-1)


class Pictures(unittest.TestCase):
    @unittest.skipUnless(has("matplotlib"), "matplotlib is not installed")
    def test_picture(self):
        import matplotlib

        matplotlib.use("Agg")
        from matplotlib import pyplot

        mesh = lapd.mesh(ball(), delta=1.5, names={1: "liver", 3: "liver"})
        figure = mesh.plot_quality(count=8)
        figure.canvas.draw()
        self.assertEqual(len(figure.axes), 10)
        bars = [sum(bar.get_height() for bar in axes.patches) for axes in figure.axes[:2]]
        self.assertTrue(np.allclose(bars, 100), bars)
        first = mesh.worst_tets(1)[0]
        title = figure.axes[2].get_title()
        self.assertIn(f"{first.min_dihedral:.1f}° to {first.max_dihedral:.1f}°\nliver\n", title)
        pyplot.close(figure)
        own, axes = pyplot.subplots()
        self.assertIs(mesh.plot_quality(axes), own)
        self.assertEqual(len(axes.patches), 18)
        pyplot.close(own)
        gc.collect()
        self.assertEqual(pyplot.get_fignums(), [])
        for count in (0, 13):
            with self.assertRaises(lapd.InvalidArgument):
                mesh.plot_quality(count=count)
        with self.assertRaises(lapd.NotMeasured):
            lapd.mesh(ball(), delta=1.5, certificate="none").plot_quality()

    def test_without_matplotlib(self):
        mesh = lapd.mesh(ball(), delta=1.5)
        with mock.patch.dict(sys.modules, {"matplotlib": None}):
            with self.assertRaises(ImportError) as raised:
                mesh.plot_quality()
        self.assertIn("pip install matplotlib", str(raised.exception))


if __name__ == "__main__":
    unittest.main()
