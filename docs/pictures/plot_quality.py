#!/usr/bin/env python3
"""Draws the dihedral angles of one or several meshes from their JSON reports.

usage: plot_quality.py REPORT.json [NAME=REPORT.json ...] [-o quality.png]

Reads `quality.dihedral_histogram` (18 bins of 10 degrees, all six angles of every tet) of
`mesh_image --report` and `cgal_mesh_3 --report`, and draws each as its share of all angles. NAME
labels the bars; without it, the file's name does. Needs `pip install matplotlib ./python`.
"""

import argparse
import json
import pathlib

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt

from lapd._plots import dihedral_histogram


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("reports", nargs="+", metavar="[NAME=]REPORT.json")
    parser.add_argument("-o", default="quality.png", metavar="OUT.png")
    args = parser.parse_args()

    reports = {}
    for argument in args.reports:
        name, _, path = argument.rpartition("=")
        reports[name or pathlib.Path(path).stem] = json.loads(pathlib.Path(path).read_text())
    figure, axes = plt.subplots(figsize=(8, 4.2), dpi=150)
    dihedral_histogram(axes, reports)
    figure.tight_layout()
    figure.savefig(args.o)


if __name__ == "__main__":
    main()
