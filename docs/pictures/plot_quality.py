#!/usr/bin/env python3
"""Draws the dihedral angles of one or several meshes from their JSON reports.

usage: plot_quality.py REPORT.json [NAME=REPORT.json ...] [-o quality.png]

Reads `quality.dihedral_histogram` (18 bins of 10 degrees, all six angles of every tet) of
`mesh_image --report` and `cgal_mesh_3 --report`, and draws each as its share of all angles. NAME
labels a curve; without it, the file's name does. Needs `pip install matplotlib`.
"""

import argparse
import json
import pathlib

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

COLOURS = ["#2f6db5", "#e0803c", "#3f9b64", "#b24a72", "#7d6bb3", "#8a7a3d"]


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("reports", nargs="+", metavar="[NAME=]REPORT.json")
    parser.add_argument("-o", default="quality.png", metavar="OUT.png")
    args = parser.parse_args()

    figure, axes = plt.subplots(figsize=(8, 4.2), dpi=150)
    width = 10 / len(args.reports)
    for i, argument in enumerate(args.reports):
        name, _, path = argument.rpartition("=")
        report = json.loads(pathlib.Path(path).read_text())
        quality = report["quality"]
        counts = np.asarray(quality["dihedral_histogram"], float)
        edges = np.linspace(0, 180, len(counts) + 1)
        text = (
            f"{name or pathlib.Path(path).stem}: {report['tets']:,} tets, "
            f"{quality['min_dihedral']:.2f}° to {quality['max_dihedral']:.2f}°"
        )
        share = 100 * counts / max(counts.sum(), 1)
        axes.bar(
            edges[:-1] + width * i,
            share,
            width,
            align="edge",
            color=COLOURS[i % len(COLOURS)],
            edgecolor="white",
            linewidth=0.6,
            label=text,
        )
    axes.set(xlim=(0, 180), xlabel="dihedral angle (degrees)", ylabel="share of angles (%)")
    axes.set_xticks(range(0, 181, 20))
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(axis="y", color="#e4e4e8", linewidth=0.8)
    axes.set_axisbelow(True)
    axes.legend(frameon=False, loc="upper right", fontsize=9)
    figure.tight_layout()
    figure.savefig(args.o)


if __name__ == "__main__":
    main()
