"""What CalculiX, a solver of its own that takes Abaqus files, makes of our element sets and
surfaces: it solves a small problem on the mesh and prints the volume of each set, and the area and
mean normal of each surface. Its numbers have 7 digits.
"""

import re
import subprocess

import numpy as np
from readback_readers import name_of, region_name


def solve(folder, lines, expected="none"):
    """What CalculiX prints of a job, of which it must have nothing to complain but what is
    expected."""
    (folder / "job.inp").write_text("\n".join([*lines, "*END STEP", ""]))
    run = subprocess.run(["ccx", "job"], check=False, cwd=folder, stdout=subprocess.PIPE, text=True)
    complaints = re.findall(r".*(?:ERROR|WARNING|nonpositive).*", run.stdout)
    complaints = [line for line in complaints if expected not in line]
    assert run.returncode == 0 and not complaints, complaints or run.stdout
    return (folder / "job.dat").read_text()


def check(path, reference):
    """Compares with the reference; the labels of its facets name the surfaces."""
    labels = sorted(set(reference.labels.tolist()))
    pairs = np.unique(reference.pairs, axis=0).tolist()
    lines = [f"*INCLUDE, INPUT={path.name}", "*MATERIAL, NAME=ELASTIC", "*ELASTIC", "1000., 0.3"]
    lines += [f"*SOLID SECTION, ELSET={region_name(label)}, MATERIAL=ELASTIC" for label in labels]
    lines += ["*BOUNDARY", *(f"{v + 1}, 1, 3" for v in reference.tets[0]), "*STEP", "*STATIC"]
    lines += ["*DSLOAD", *(f"{name_of(pair)}, P, 1." for pair in pairs)]
    for label in labels:
        lines += [f"*EL PRINT, ELSET={region_name(label)}, TOTALS=ONLY", "EVOL"]
    for number, pair in enumerate(pairs):
        lines += [f"*SECTION PRINT, SURFACE={name_of(pair)}, NAME=S{number}", "SOF"]
    printed = solve(path.parent, lines)
    number = r"(-?\d\.\d+E[+-]\d+)"
    volumes = dict(re.findall(rf"total volume for set (\S+) and time.*\s+{number}", printed))
    assert set(volumes) == {region_name(label).upper() for label in labels}, volumes
    for label in labels:
        wanted = reference.volumes[reference.labels == label].sum()
        printed_volume = float(volumes[region_name(label).upper()])
        assert abs(printed_volume / wanted - 1) < 1e-6, (label, volumes, wanted)

    sections = re.split(r"statistics for surface set ", printed)[1:]
    assert len(sections) == len(pairs)
    a, b, c = (reference.points[reference.facets[:, i]] for i in range(3))
    vectors = np.cross(b - a, c - a) / 2
    for section, pair in zip(sections, pairs):
        assert section.startswith(f"{name_of(pair).upper()} "), section.splitlines()[0]
        normal = np.array(
            re.search(rf"mean normal\s+{number}" + rf"\s+{number}" * 5, section).groups()[3:],
            dtype=float,
        )
        area = float(re.search(rf"area, normal force.*\s+{number}", section)[1])
        of_pair = vectors[(reference.pairs == pair).all(axis=1)]
        areas = np.linalg.norm(of_pair, axis=1)
        assert abs(area / areas.sum() - 1) < 1e-6, (pair, area, areas.sum())
        assert np.allclose(normal, of_pair.sum(axis=0) / areas.sum(), atol=1e-6), (
            pair,
            normal,
        )
