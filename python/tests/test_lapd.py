"""The package against the library: arrays, places, files, errors, threads, Ctrl-C.

    python -m unittest discover python/tests

With LAPD_LIBRARY in the environment the library is that one. Other packages are tested where they
are installed.
"""

import _thread
import doctest
import gc
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import warnings
from pathlib import Path

import numpy as np
from phantoms import ball, has, same, volumes, write_nrrd

import lapd


class Arrays(unittest.TestCase):
    def test_mesh(self):
        mesh = lapd.mesh(ball(), delta=1.5)
        self.assertEqual(set(mesh.labels.tolist()), {1, 3})
        self.assertTrue((volumes(mesh) > 0).all())
        self.assertAlmostEqual(volumes(mesh).sum() / (ball() > 0).sum(), 1, delta=0.02)
        self.assertEqual(mesh.facets.shape[0], mesh.facet_labels.shape[0])
        self.assertEqual(
            {tuple(pair) for pair in mesh.facet_labels.tolist()}, {(1, 0), (3, 0), (1, 3)}
        )
        self.assertFalse(mesh.points.flags.writeable)
        self.assertIn("2 labels", repr(mesh))

    def test_arrays_outlive_the_mesh(self):
        points = lapd.mesh(ball(), delta=1.5).points
        gc.collect()
        copied = points.copy()
        lapd.mesh(ball(), delta=1.2)
        self.assertTrue(np.array_equal(points, copied))

    def test_types_and_strides(self):
        wanted = lapd.mesh(ball(), delta=1.5)
        for kind in ["i1", "u2", "<i4", ">i4", "u8", ">i8"]:
            self.assertTrue(same(lapd.mesh(ball(kind), delta=1.5), wanted), kind)
        self.assertTrue(same(lapd.mesh(np.asfortranarray(ball()), delta=1.5), wanted))
        self.assertTrue(same(lapd.mesh(ball()[::-1][::-1], delta=1.5), wanted))
        wide = np.zeros((21, 19, 34), dtype=np.uint8)
        wide[:, :, ::2] = ball()
        self.assertTrue(same(lapd.mesh(wide[:, :, ::2], delta=1.5), wanted))
        flipped = lapd.mesh(ball()[::-1], delta=1.5)
        self.assertFalse(same(flipped, wanted))
        self.assertEqual(len(lapd.mesh(ball() > 0, delta=1.5).facet_labels[0]), 2)

    def test_place(self):
        turn = np.array([[0, -1, 0], [1, 0, 0], [0, 0, 1.0]])
        moved = lapd.mesh(ball(), spacing=(0.5, 1, 2), origin=(5, 6, 7), direction=turn, delta=1.5)
        self.assertAlmostEqual(volumes(moved).sum() / (ball() > 0).sum(), 1, delta=0.03)
        centre = np.array([5, 6, 7]) + turn @ (np.array([0.5, 1, 2]) * [10, 9, 8])
        middle = (moved.points.max(axis=0) + moved.points.min(axis=0)) / 2
        self.assertTrue(np.allclose(middle, centre, atol=0.5), middle)

    def test_options(self):
        names = {1: "left", 3: "right"}
        mesh = lapd.mesh(ball(), delta=1.5, names=names, split_interfaces="all", merge={3: 2})
        self.assertEqual([mesh.name(label) for label in (1, 2, 9)], ["left", "right", None])
        owners = [set(mesh.tets[mesh.labels == label].ravel().tolist()) for label in (1, 2)]
        self.assertFalse(owners[0] & owners[1])
        mesh = lapd.mesh(ball(), delta=1.5, keep=[3], order=2, improve="none", size=4)
        self.assertEqual(mesh.tet_mid_nodes.shape, (len(mesh.tets), 6))
        report = mesh.report()
        self.assertEqual(report["tets"], len(mesh.tets))
        self.assertTrue(same(lapd.mesh(ball(), delta=None, size=None), lapd.mesh(ball())))

    def test_files_and_bytes(self):
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            write_nrrd(folder / "a.nrrd", ball())
            one = lapd.mesh(ball(), delta=1.5)
            other = lapd.mesh(folder / "a.nrrd", delta=1.5)
            self.assertTrue(same(one, other))
            one.write(folder / "one.mesh")
            text = (folder / "one.mesh").read_text()
            self.assertIn("label_1__label_3", text)
            one.write(folder / "one.vtu", measures=True, boundary_parts=True)
            run = subprocess.run(
                [sys.executable, "-m", "lapd", folder / "a.nrrd", "-o", folder / "b.mesh"]
                + ["--delta", "1.5"],
                check=True,
                capture_output=True,
                text=True,
            )
            self.assertIn("2 labels", run.stdout)
            plain = [line for line in text.splitlines() if "SPACE" not in line]
            lines = (folder / "b.mesh").read_text().splitlines()
            self.assertEqual([line for line in lines if "SPACE" not in line], plain)


class Errors(unittest.TestCase):
    def test_kinds(self):
        for kind, call in [
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), delta=-1)),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball().astype(float))),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball()[0])),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), surface="round")),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), threads=-1)),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), threads=2**70)),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), keep=[7])),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), spacing=(1, 2))),
            (lapd.InvalidArgument, lambda: lapd.mesh("a.nrrd", origin=(1, 1, 1))),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), split_interfaces=[(1, 9)])),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), split_interfaces=[(1, 2, 3)])),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), split_interfaces=[])),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), merge={2**32 + 1: 3})),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), names={2**32 + 1: "x"})),
            (lapd.InvalidArgument, lambda: lapd.mesh(ball(), names={1: "a\0b"})),
            (lapd.InvalidArgument, lambda: lapd.mesh("a\0.nrrd")),
            (lapd.EmptyImage, lambda: lapd.mesh(np.zeros((3, 3, 3), np.uint8))),
            (lapd.FileError, lambda: lapd.mesh("/no/such/file.nrrd")),
            (lapd.LimitReached, lambda: lapd.mesh(ball(), max_vertices=20)),
            (TypeError, lambda: lapd.mesh(ball(), detla=1)),
            (ValueError, lambda: lapd.mesh(ball(), delta=float("nan"))),
        ]:
            with self.assertRaises(kind) as raised:
                call()
            self.assertNotIn("\n", str(raised.exception))

    def test_warnings(self):
        with warnings.catch_warnings(record=True) as told:
            warnings.simplefilter("always")
            lapd.mesh(ball(), delta=1.5)
            self.assertEqual(told, [])
            lapd.mesh(ball(), max_vertices=200, delta=0.5, partial=True)
            self.assertTrue(any(issubclass(w.category, lapd.LapdWarning) for w in told))


class Runs(unittest.TestCase):
    def test_progress(self):
        seen = []
        lapd.mesh(ball(), delta=0.4, progress=lambda *report: seen.append(report))
        self.assertTrue(seen and seen[-1][0] == 1)
        self.assertTrue(all(a[0] <= b[0] for a, b in zip(seen, seen[1:])))

        def fail(*_):
            raise ZeroDivisionError

        with self.assertRaises(ZeroDivisionError):
            lapd.mesh(ball(), delta=0.4, progress=fail)

    def test_interrupt(self):
        times, answers = [], []

        def interrupt():
            times.append(time.perf_counter())
            _thread.interrupt_main()

        # Early and later in the refinement; one of three may come while the machine is busy.
        for after in (0.1, 0.3, 0.5):
            timer = threading.Timer(after, interrupt)
            timer.start()
            with self.assertRaises(KeyboardInterrupt):
                lapd.mesh(ball(), delta=0.08, adaptive="off")
            answers.append(time.perf_counter() - times[-1])
        self.assertLess(sorted(answers)[1], 0.1, answers)

    def test_threads(self):
        wanted, found = lapd.mesh(ball(), delta=1), [None] * 4

        def work(i):
            found[i] = lapd.mesh(ball(), delta=1)

        workers = [threading.Thread(target=work, args=(i,)) for i in range(4)]
        [worker.start() for worker in workers]
        [worker.join() for worker in workers]
        self.assertTrue(all(same(mesh, wanted) for mesh in found))

    @unittest.skipUnless(sys.platform == "linux", "reads /proc")
    def test_no_leaks(self):
        def resident():
            return int(Path("/proc/self/statm").read_text().split()[1])

        for _ in range(20):
            lapd.mesh(ball(), delta=1)
        before = resident()
        for _ in range(100):
            lapd.mesh(ball(), delta=1)
        self.assertLess(resident() - before, 2000, "pages more after 100 calls")


class Packages(unittest.TestCase):
    spacing = (0.5, 1.0, 2.0)

    def file(self, folder):
        path = Path(folder) / "a.nrrd"
        write_nrrd(path, ball(), self.spacing)
        return path

    @unittest.skipUnless(has("nibabel"), "nibabel is not installed")
    def test_nibabel(self):
        import nibabel

        image = nibabel.Nifti1Image(ball(), np.diag([*self.spacing, 1]))
        with tempfile.TemporaryDirectory() as folder:
            wanted = lapd.mesh(self.file(folder), delta=1.5)
            path = Path(folder) / "a.nii.gz"
            nibabel.save(image, path)
            self.assertTrue(same(lapd.mesh(path, delta=1.5), wanted))
            self.assertTrue(same(lapd.mesh(nibabel.load(path), delta=1.5), wanted))
        self.assertTrue(same(lapd.mesh(image, delta=1.5), wanted))

    @unittest.skipUnless(has("SimpleITK"), "SimpleITK is not installed")
    def test_simple_itk(self):
        import SimpleITK

        with tempfile.TemporaryDirectory() as folder:
            path = self.file(folder)
            wanted = lapd.mesh(path, delta=1.5, frame="lps")
            found = lapd.mesh(SimpleITK.ReadImage(str(path)), delta=1.5)
        self.assertTrue(np.allclose(found.points, wanted.points, atol=1e-9))
        self.assertTrue(np.array_equal(found.tets, wanted.tets))

    @unittest.skipUnless(has("itk"), "ITK is not installed")
    def test_itk(self):
        import itk

        image = itk.image_view_from_array(np.ascontiguousarray(ball().T))
        image.SetSpacing(list(self.spacing))
        wanted = lapd.mesh(ball(), spacing=self.spacing, delta=1.5)
        self.assertTrue(same(lapd.mesh(image, delta=1.5), wanted))
        image.SetOrigin([3.0, 4.0, 5.0])
        moved = lapd.mesh(image, delta=1.5)
        for end in (np.min, np.max):
            places = end(moved.points, axis=0), end(wanted.points, axis=0) + [3, 4, 5]
            self.assertTrue(np.allclose(*places, atol=0.3), places)

    @unittest.skipUnless(has("pyvista"), "PyVista is not installed")
    def test_pyvista(self):
        import pyvista

        image = pyvista.ImageData(dimensions=ball().shape, spacing=self.spacing)
        image.point_data["labels"] = ball().ravel(order="F")
        image.set_active_scalars("labels")
        found = lapd.mesh(image, delta=1.5)
        self.assertTrue(same(found, lapd.mesh(ball(), spacing=self.spacing, delta=1.5)))
        # A part of the image stays where it was.
        part = image.extract_subset((2, 20, 0, 18, 0, 16))
        wanted = lapd.mesh(ball()[2:], spacing=self.spacing, origin=(1, 0, 0), delta=1.5)
        self.assertTrue(np.allclose(lapd.mesh(part, delta=1.5).points, wanted.points))
        grid = found.to_pyvista()
        self.assertEqual(grid.n_cells, len(found.tets))
        self.assertAlmostEqual(grid.volume, volumes(found).sum(), places=6)

    @unittest.skipUnless(has("meshio"), "meshio is not installed")
    def test_meshio(self):
        mesh = lapd.mesh(ball(), delta=1.5)
        found = mesh.to_meshio()
        self.assertTrue(np.array_equal(found.cells_dict["tetra"], mesh.tets))
        self.assertTrue(np.array_equal(found.cell_data_dict["label"]["tetra"], mesh.labels))


class Doctests(unittest.TestCase):
    def test_examples(self):
        failed, tried = doctest.testmod(lapd)
        self.assertEqual(failed, 0)
        self.assertGreater(tried, 5)


class FilesOfArrays(unittest.TestCase):
    def test_arrays_of_files_lie_as_in_memory(self):
        voxels = np.zeros((8, 10, 14), np.uint8)
        voxels[1:7, 2:8, 3:13] = 1
        given = {"spacing": (1.0, 2.0, 0.5), "delta": 1.0}
        wanted = lapd.mesh(voxels, **given)
        with tempfile.TemporaryDirectory() as folder:
            for name, array in [("c", voxels), ("fortran", np.asfortranarray(voxels))]:
                path = Path(folder) / f"{name}.npy"
                np.save(path, array)
                with warnings.catch_warnings():
                    warnings.simplefilter("ignore", lapd.LapdWarning)
                    self.assertTrue(same(lapd.mesh(path, **given), wanted), name)
                    self.assertTrue(same(lapd.mesh(path, volume=0, **given), wanted), name)
                    with self.assertRaises(lapd.InvalidArgument):
                        lapd.mesh(path, volume=1)
        with self.assertRaises(lapd.InvalidArgument):
            lapd.mesh(voxels, volume=0)


class Budget(unittest.TestCase):
    def test_number_of_tets_and_estimate(self):
        target = 20_000
        made = lapd.mesh(ball(), target_tets=target)
        self.assertAlmostEqual(len(made.tets) / target, 1, delta=0.1)
        found = made.report()
        expected = lapd.estimate(ball(), delta=found["delta"], size=found["size"])
        self.assertTrue(0.5 < expected.tets / len(made.tets) < 2, expected)
        self.assertGreater(expected.peak_bytes, 0)
        self.assertGreater(expected.seconds, 0)
        with self.assertRaises(lapd.InvalidArgument):
            lapd.estimate(ball(), delta=-1.0)


if __name__ == "__main__":
    unittest.main()
