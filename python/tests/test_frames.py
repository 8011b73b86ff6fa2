"""An oblique image, anisotropic and moved, by every way into the library: the mesh lies where the
affine says."""

import tempfile
import unittest
from pathlib import Path

import numpy as np
from phantoms import has, volumes

import lapd

SPACING = np.array([0.8, 1.1, 2.3])
SHIFT = np.array([-31.0, 47.5, 112.25])
DELTA = 1.4


def turned():
    """Rotated by 20 degrees about x, then by -35 degrees about z."""
    a, b = np.deg2rad([20, -35])
    about_x = [[1, 0, 0], [0, np.cos(a), -np.sin(a)], [0, np.sin(a), np.cos(a)]]
    about_z = [[np.cos(b), -np.sin(b), 0], [np.sin(b), np.cos(b), 0], [0, 0, 1]]
    return np.array(about_z) @ np.array(about_x)


def affine(direction):
    """From indices of voxels to the world."""
    matrix = np.eye(4)
    matrix[:3, :3] = direction * SPACING
    matrix[:3, 3] = SHIFT
    return matrix


def blobs():
    """Two ellipsoids of different sizes, and nothing that is symmetric about the image."""
    x, y, z = np.mgrid[:26, :22, :12]
    labels = np.zeros(x.shape, dtype=np.uint8)
    labels[((x - 9) / 6) ** 2 + ((y - 8) / 5) ** 2 + ((z - 5) / 3) ** 2 < 1] = 1
    labels[((x - 18) / 5) ** 2 + ((y - 15) / 4) ** 2 + ((z - 7) / 3) ** 2 < 1] = 2
    return labels


class Oblique(unittest.TestCase):
    def check_place(self, mesh, matrix, tolerance=0.25):
        """The centroid and the ends of each label are those of its voxels, by the affine."""
        labels = blobs()
        size = volumes(mesh)
        centroids = mesh.points[mesh.tets].mean(axis=1)
        for label in (1, 2):
            own = mesh.labels == label
            found = np.average(centroids[own], axis=0, weights=size[own])
            places = np.argwhere(labels == label) @ matrix[:3, :3].T + matrix[:3, 3]
            self.assertTrue(np.allclose(found, places.mean(axis=0), atol=tolerance), (label, found))
            corners = mesh.points[np.unique(mesh.tets[own])]
            for end in (np.min, np.max):
                off = end(corners, axis=0) - end(places, axis=0)
                self.assertLess(np.abs(off).max(), SPACING.max(), (label, off))
            self.assertAlmostEqual(
                size[own].sum() / (len(places) * SPACING.prod()), 1, delta=0.06, msg=label
            )

    def check_same(self, one, other):
        self.assertTrue(np.array_equal(one.points, other.points))
        self.assertTrue(np.array_equal(one.tets, other.tets))

    def test_array(self):
        for direction in (turned(), turned() * [-1, 1, 1]):
            mesh = lapd.mesh(
                blobs(), spacing=SPACING, origin=SHIFT, direction=direction, delta=DELTA
            )
            self.check_place(mesh, affine(direction))

    @unittest.skipUnless(has("nibabel"), "nibabel is not installed")
    def test_nifti(self):
        import nibabel

        for direction in (turned(), turned() * [-1, 1, 1]):
            matrix = affine(direction)
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "oblique.nii.gz"
                nibabel.save(nibabel.Nifti1Image(blobs(), matrix), path)
                by_nibabel = lapd.mesh(nibabel.load(path), delta=DELTA)
                by_file = lapd.mesh(path, delta=DELTA)
                in_ras = lapd.mesh(path, delta=DELTA, frame="ras")
                in_lps = lapd.mesh(path, delta=DELTA, frame="lps")
                self.check_place(by_nibabel, matrix)
                self.check_same(by_file, by_nibabel)
                self.check_same(in_ras, by_nibabel)
                to_lps = np.diag([-1, -1, 1, 1]) @ matrix
                self.check_place(in_lps, to_lps)
                self.check_place(in_ras, matrix)
                if not has("SimpleITK"):
                    continue
                import SimpleITK

                by_itk = lapd.mesh(SimpleITK.ReadImage(str(path)), delta=DELTA)
                self.check_place(by_itk, to_lps)
                self.check_same(by_itk, in_lps)


if __name__ == "__main__":
    unittest.main()
