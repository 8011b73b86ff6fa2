"""The certificate: what the report says, and None for what was not measured."""

import dataclasses
import unittest

import numpy as np
from phantoms import ball

import lapd


class Certificates(unittest.TestCase):
    def test_full(self):
        mesh = lapd.mesh(ball(), delta=1.5, certificate="full", names={1: "liver"})
        found, report = mesh.certificate(), mesh.report()
        self.assertEqual(found.level, "full")
        self.assertTrue(found.is_delaunay and found.is_closed)
        self.assertEqual(found.tets, len(mesh.tets))
        self.assertEqual(found.unmet, report["certificate"]["unmet"])
        self.assertEqual([row.name for row in found.labels], ["liver", None])
        self.assertEqual(found.labels[0].tets, int((mesh.labels == 1).sum()))
        self.assertEqual([row.fate for row in found.components], ["kept", "kept"])
        self.assertEqual(found.min_dihedral, report["quality"]["min_dihedral"])
        for part in (found, *found.labels, *found.components):
            for field in dataclasses.fields(part.distances):
                self.assertGreater(getattr(part.distances, field.name), 0)
        text = repr(found)
        for words in ("Delaunay        yes", "closed          yes", "1 liver", "mesh to image"):
            self.assertIn(words, text)
        self.assertEqual(str(found), text)
        self.assertTrue(all(len(line) <= 100 for line in text.splitlines()), text)
        with self.assertRaises(dataclasses.FrozenInstanceError):
            found.level = "none"

    def test_every_member_of_the_report(self):
        report = lapd.mesh(ball(), delta=1.5, certificate="full").report()
        kinds = [
            (lapd.Certificate, report["certificate"]),
            (lapd.LabelRow, report["labels"][0]),
            (lapd.ComponentRow, report["components"][0]),
        ]
        distances = {field.name for field in dataclasses.fields(lapd.Distances)}
        for kind, members in kinds:
            names = {field.name for field in dataclasses.fields(kind)}
            self.assertEqual(set(members) - names - distances, set(), kind)

    def test_what_was_not_measured(self):
        sound = lapd.mesh(ball(), delta=1.5).certificate()
        self.assertEqual((sound.level, sound.open_edges), ("sound", 0))
        self.assertIsNone(sound.distances)
        self.assertIsNone(sound.labels[0].distances.mean_mesh_to_image)
        self.assertIn("distances       not measured", repr(sound))
        none = lapd.mesh(ball(), delta=1.5, certificate="none", improve="none").certificate()
        self.assertEqual(none.level, "none")
        measured = dataclasses.asdict(none)
        for name in ("level", "tets", "vertices", "interface_facets"):
            self.assertTrue(measured.pop(name))
        self.assertEqual(set(measured.values()), {None})
        self.assertIsNone(none.is_delaunay)
        self.assertIsNone(none.is_closed)
        self.assertIn("nothing was measured", repr(none))

    def test_defects(self):
        """A ball, and a cube of eight voxels that is lost at a coarse delta."""
        labels = np.zeros((44, 20, 20), dtype=np.uint8)
        x, y, z = np.mgrid[:44, :20, :20]
        labels[(x - 10) ** 2 + (y - 10) ** 2 + (z - 10) ** 2 < 64] = 1
        labels[36:38, 4:6, 4:6] = 1
        with self.assertWarns(lapd.LapdWarning):
            mesh = lapd.mesh(labels, delta=6, adaptive="off", certificate="full")
        found = mesh.certificate()
        (lost,) = [defect for defect in found.defects if defect.kind == "lost"]
        self.assertEqual((lost.label, lost.position, lost.size), (1, (36.0, 4.0, 4.0), 8))
        self.assertEqual(found.labels[0].components_lost, 1)
        self.assertIn("lost: label 1 at (36, 4, 4)", repr(found))


if __name__ == "__main__":
    unittest.main()
