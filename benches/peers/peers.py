"""Runs our mesher and its peers in turn, and writes the tables of docs/notes/benchmarks.md. run.sh
and growth.sh build what it needs and start it.

compare ours, Mesh_3 with each tag, and the Delaunay triangulation of our vertices; bounds are tuned
until the numbers of tets agree. improved ours with its removal of slivers, Mesh_3 with its
perturbation and exudation, both as they come. growth ours alone, on one image, finer and finer.

Tuning, and the runs whose meshes and memory are measured, come before those that are timed.
harness.py has what all benches share.
"""

import argparse
import dataclasses
import json
import math
import os
import pathlib
import statistics
import sys

sys.path.insert(0, str(pathlib.Path(__file__).resolve().parents[1]))
from harness import (
    BUILD,
    RESULTS,
    START,
    at_least_one,
    check_tets,
    execute,
    fail,
    find_image,
    find_images,
    machine,
    markdown,
    ours,
    publish,
    runs_text,
    say,
    spread,
    threads_text,
    tune,
    tune_ours,
    Bystanders,
)

# Criteria of Mesh_3 as multiples of our delta, which give about as many tets and interface facets
# as we have; a common factor is tuned.
FACET_SIZE, FACET_DISTANCE, CELL_SIZE = 1.16, 0.26, 2.0
# How far the peers' number of tets may be from ours: at the end of tuning, and in every timed run.
THEIRS_WITHIN, IN_THE_END = 0.02, 0.05
TAGS = {"parallel": "Mesh_3, Parallel_tag", "sequential": "Mesh_3, Sequential_tag"}
# So that the finest mesh of the growth study gives up before the machine does.
MOST_MEMORY = 0.85


# ---- Programs ----


def criteria(delta, factor):
    """What Mesh_3 is run with: facet size, facet distance, cell size."""
    return [
        round(factor * multiple * delta, 6) for multiple in (FACET_SIZE, FACET_DISTANCE, CELL_SIZE)
    ]


def mesh_3(tag, image, delta, factor, threads, *more):
    """The report of one run of Mesh_3."""
    report = RESULTS / "mesh_3.json"
    facet_size, facet_distance, cell_size = criteria(delta, factor)
    bounds = [
        "--facet-size",
        facet_size,
        "--facet-distance",
        facet_distance,
        "--cell-size",
        cell_size,
        "--threads",
        threads,
    ]
    execute(
        [BUILD / "peers" / "cgal_mesh_3", image, f"--{tag}", *bounds, "--report", report, *more]
    )
    found = json.loads(report.read_text())
    found["span"] = found["seconds"]["refine"]
    found["rate"] = found["tets"] / found["span"]
    return found


def surface_distances(image, our_mesh, their_mesh):
    """What c-tests/crossval/measure.cpp says of two meshes: a dictionary for each. Its status 1
    says that theirs is better somewhere."""
    table = execute([BUILD / "peers" / "measure", image, our_mesh, their_mesh], statuses=(0, 1))
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in table.splitlines()
        if line.startswith("| ")
    ]
    rows = {row[0]: row[1:] for row in rows if len(row) == 3}
    names = {
        "mean_to_image": "mesh to image, mean distance",
        "max_to_image": "mesh to image, largest",
        "mean_to_mesh": "image to mesh, mean distance",
        "max_to_mesh": "image to mesh, largest",
        "lost": "labels lost",
    }
    if any(row not in rows for row in names.values()):
        fail(
            f"measure said nothing of {', '.join(row for row in names.values() if row not in rows)}"
        )
    return [{name: float(rows[row][side]) for name, row in names.items()} for side in (0, 1)]


# ---- One image, all programs ----


@dataclasses.dataclass
class Case:
    """All about one image: the bounds, what was measured once, and the timed runs in their
    order."""

    name: str
    delta: float
    factors: dict
    measured: dict
    memory: dict
    runs: dict
    labels: int


def compare_image(name, image, options):
    say(f"{name}: tuning")
    meshes = {program: RESULTS / f"{program}.mesh" for program in ("lapd", *TAGS)}

    def run_ours(delta):
        return ours(image, delta, options.threads, "-o", meshes["lapd"], "--memory")

    delta, first = tune_ours(name, options.tets, run_ours)
    # Sequential_tag and the Delaunay triangulation have one thread, whatever the others have: they
    # are peers of one thread only.
    alone = options.threads == 1
    tags = [tag for tag in TAGS if tag == "parallel" or alone]
    factors, measured, factor = {}, {}, 1.0
    for tag in tags:

        def run_theirs(factor, tag=tag):
            return mesh_3(tag, image, delta, factor, options.threads, "-o", meshes[tag])

        factor, _ = tune(f"{TAGS[tag]}, factor", factor, first["tets"], THEIRS_WITHIN, run_theirs)
        factors[tag] = factor
        measured["lapd"], measured[tag] = surface_distances(image, meshes["lapd"], meshes[tag])
    points = RESULTS / "points.bin"
    delaunay = [BUILD / "peers" / "cgal_delaunay_3"]
    if alone:
        execute(
            [*delaunay, "collect", image, repr(delta), repr(2 * delta), options.threads, points]
        )

    turns = {
        "lapd": lambda: ours(image, delta, options.threads),
        "parallel": lambda: mesh_3("parallel", image, delta, factors["parallel"], options.threads),
        "delaunay": lambda: json.loads(execute([*delaunay, "time", points])),
        "sequential": lambda: mesh_3("sequential", image, delta, factors["sequential"], 1),
    }
    runs = {program: [] for program in turns if alone or program in ("lapd", "parallel")}
    for turn in range(options.runs):
        for program, done in runs.items():
            done.append(turns[program]())
        say(
            f"    run {turn + 1}: "
            + ", ".join(f"{program} {seconds(done[-1]):.2f} s" for program, done in runs.items())
        )
    for leftover in (*meshes.values(), points):
        leftover.unlink(missing_ok=True)
    check(name, first, runs)
    return Case(name, delta, factors, measured, first["memory_bytes"], runs, len(first["labels"]))


def seconds(run):
    """What is compared of a run: wall time, without reading and writing."""
    return run["span"] if "span" in run else run["seconds"]


def check(name, first, runs):
    """What must hold for the figures to mean something."""
    check_tets(name, [first, *runs["lapd"]])
    for program in runs:
        for run in runs[program]:
            wanted = first["all_tets"] if program == "delaunay" else first["tets"]
            if abs(run["tets"] / wanted - 1) > IN_THE_END:
                fail(
                    f"{name}: {program} has {run['tets']} tets, we have {wanted}: more than "
                    f"{100 * IN_THE_END:g} % apart"
                )
            # One thread's mesh is always the same, and so is the Delaunay triangulation of its
            # vertices.
            if program == "delaunay" and run["tets"] != wanted:
                fail(
                    f"{name}: Delaunay_triangulation_3 makes {run['tets']} tets of our vertices, "
                    f"we have {wanted}"
                )


# ---- Tables ----


def phases(run_list):
    parts = [
        f"{phase} {spread([run['seconds'][phase] for run in run_list], 3)}"
        for phase in ("prepare", "refine", "extract")
    ]
    return ", ".join(parts)


def main_table(cases):
    head = [
        "image",
        "program",
        "tets",
        "seconds",
        "seconds by phase",
        "M tets/s",
        "rate of lapd / of this",
        "peak bytes per tet",
    ]
    head += ["mesh to image: mean, largest", "image to mesh: mean, largest", "labels lost"]
    rows = []
    for case in cases:
        for program, done in case.runs.items():
            if program == "delaunay":
                continue
            mine, tets = program == "lapd", statistics.median_low(run["tets"] for run in done)
            # Run against run of the same turn: what slows the machine slows both.
            ratios = [a["rate"] / b["rate"] for a, b in zip(case.runs["lapd"], done)]
            peak = (
                case.memory["peak_extract"]
                if mine
                else statistics.median(run["peak_rss_bytes"] for run in done)
            )
            found = case.measured[program]
            rows.append(
                [
                    case.name,
                    "lapd" if mine else TAGS[program],
                    str(tets),
                    spread([seconds(run) for run in done], 2),
                    phases(done) if mine else "make_mesh_3",
                    spread([run["rate"] / 1e6 for run in done], 3),
                    "1" if mine else spread(ratios, 2),
                    f"{peak / tets:.0f}",
                    f"{found['mean_to_image']:.4f}, {found['max_to_image']:.3f}",
                    f"{found['mean_to_mesh']:.4f}, {found['max_to_mesh']:.3f}",
                    f"{found['lost']:.0f} of {case.labels}",
                ]
            )
    return markdown(head, rows)


def kernel_table(cases):
    head = [
        "image",
        "vertices, box included",
        "tets of the whole triangulation",
        "refine, s",
        "Delaunay_triangulation_3, s",
    ]
    head += [
        "refine / Delaunay",
        "preparation, part of the whole",
        "bytes per tet beyond image and oracle",
        "peak after preparation, refine, extract, MB",
    ]
    rows = []
    for case in cases:
        lapd, delaunay = case.runs["lapd"], case.runs["delaunay"]
        refine = [run["seconds"]["refine"] for run in lapd]
        plain = [run["seconds"] for run in delaunay]
        peaks = [case.memory[f"peak_{phase}"] / 1e6 for phase in ("prepare", "refine", "extract")]
        rows.append(
            [
                case.name,
                str(lapd[0]["all_vertices"]),
                str(lapd[0]["all_tets"]),
                spread(refine, 3),
                spread(plain, 3),
                spread([a / b for a, b in zip(refine, plain)], 2),
                spread([100 * run["seconds"]["prepare"] / run["span"] for run in lapd], 1) + " %",
                f"{beyond_volumes(case.memory, lapd[0]):.0f}",
                ", ".join(f"{peak:.0f}" for peak in peaks),
            ]
        )
    return markdown(head, rows)


def beyond_volumes(memory, run):
    """Bytes per tet of the whole triangulation: the peak until the end of extraction, without
    program, image and oracle."""
    return (memory["peak_extract"] - memory["read"] - run["oracle_bytes"]) / run["all_tets"]


def bounds_table(cases):
    head = ["image", "lapd: delta, size"] + [
        f"{TAGS[tag]}: facet size, facet distance, cell size" for tag in cases[0].factors
    ]
    rows = []
    for case in cases:
        theirs = [
            ", ".join(f"{value:.4g}" for value in criteria(case.delta, factor))
            for factor in case.factors.values()
        ]
        rows.append([case.name, f"{case.delta:g}, {2 * case.delta:g}", *theirs])
    return markdown(head, rows)


# ---- Commands ----


def compare(options):
    bystanders = Bystanders()
    threads = threads_text(options.threads)
    cases = []
    for name, image in find_images(options.images).items():
        cases.append(compare_image(name, image, options))
        kept = RESULTS / f"compare with {threads}.json"
        kept.write_text(json.dumps([dataclasses.asdict(case) for case in cases], indent=1))
    version = cases[0].runs["parallel"][0]["version"]
    parts = [
        f"### With {threads}",
        machine(bystanders, [version]),
        f"About {options.tets / 1e6:g} M tets with a label, {threads} each; "
        f"{runs_text(options.runs)}.",
        main_table(cases),
        *([kernel_table(cases)] if options.threads == 1 else []),
        bounds_table(cases),
    ]
    part, *fewer = (f"run with {threads_text(count)}" for count in range(options.threads, 0, -1))
    publish(part, "run.sh", "\n\n".join(parts), options, behind=reversed(fewer))


def improved(options):
    """Both with what removes slivers, once each: CGAL's takes minutes."""
    bystanders = Bystanders()
    rows, versions = [], []
    for name, image in find_images(options.images).items():
        say(f"{name}: tuning")

        def run_ours(delta):
            return ours(image, delta, options.threads, "--improve", "full")

        delta, mine = tune_ours(name, options.tets, run_ours)
        mine["span"] += mine["seconds"]["improve"]

        def run_theirs(factor, *more):
            return mesh_3("parallel", image, delta, factor, options.threads, *more)

        factor, _ = tune("factor", 1.0, mine["tets"], THEIRS_WITHIN, run_theirs)
        theirs = run_theirs(factor, "--optimizers")
        theirs["span"] += theirs["seconds"]["optimize"]
        versions.append(theirs["version"])
        both = [("lapd", mine, "improve"), (TAGS["parallel"], theirs, "optimize")]
        for program, run, last in both:
            quality, rate = run["quality"], run["tets"] / run["span"]
            rows.append(
                [
                    name,
                    program,
                    str(run["tets"]),
                    f"{run['span']:.2f}",
                    f"{run['seconds'][last]:.2f}",
                    f"{rate / 1e6:.4f}",
                    "1" if run is mine else f"{mine['tets'] / mine['span'] / rate:.1f}",
                    f"{quality['min_dihedral']:.2f} to {quality['max_dihedral']:.2f}",
                    f"{quality['min_facet_angle']:.2f}",
                ]
            )
    head = ["image", "program", "tets", "seconds, image to improved mesh", "improvement alone"]
    head += ["M tets/s", "rate of lapd / of this", "dihedral angles", "smallest facet angle"]
    threads = threads_text(options.threads)
    parts = [
        f"### Slivers removed, with {threads}",
        machine(bystanders, versions[:1]),
        f"One run each, {threads}.",
        markdown(head, rows),
    ]
    publish(f"improved, {threads}", "improved.sh", "\n\n".join(parts), options)


def growth(options):
    bystanders = Bystanders()
    image = find_image(options.image) or find_image("balls")
    name = options.image if image.name != "balls.nrrd" else "balls"
    limit = [
        "--max-memory",
        int(MOST_MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")),
    ]

    def measure(delta):
        return ours(image, delta, options.threads, "--memory", *limit)

    # The first round looks for the bounds and measures memory; the later ones are timed. The first
    # bound is tuned; from there on each aims at twice the tets, and what it misses by the next one
    # makes up for.
    say(f"{name}: looking for the bounds")
    exponent = 2.2
    start = START[name] * (1e6 / options.smallest) ** (1 / exponent)
    delta, report = tune("delta", start, options.smallest, 0.05, measure)
    sizes, target = [(delta, report)], 2 * options.smallest
    while target <= options.largest:
        coarser, before = sizes[-1]
        delta = float(f"{coarser * (before['tets'] / target) ** (1 / exponent):.4g}")
        report = measure(delta)
        exponent = math.log(report["tets"] / before["tets"]) / math.log(coarser / delta)
        sizes.append((delta, report))
        target *= 2
        say(
            f"    delta {delta:g}: {report['tets']} tets, refine {report['seconds']['refine']:.2f} "
            "s"
        )
    runs = [[] for _ in sizes]
    for turn in range(options.runs):
        for (delta, _), done in zip(sizes, runs):
            done.append(ours(image, delta, options.threads, *limit))
        say(f"    run {turn + 1}: " + ", ".join(f"{done[-1]['span']:.2f}" for done in runs) + " s")
        (RESULTS / "growth.json").write_text(
            json.dumps(
                [{"memory": first, "runs": done} for (_, first), done in zip(sizes, runs)], indent=1
            )
        )

    head = [
        "delta, size",
        "tets",
        "tets of the whole triangulation",
        "preparation, s",
        "refine, s",
        "extract, s",
        "refine, M tets/s",
        "whole, M tets/s",
    ]
    head += [
        "refine, M tets of the whole triangulation/s",
        "bytes per tet of it beyond image and oracle",
    ]
    rows, refine_rates, whole_rates = [], [], []
    for (delta, first), done in zip(sizes, runs):
        refine = [run["tets"] / run["seconds"]["refine"] / 1e6 for run in done]
        whole = [run["rate"] / 1e6 for run in done]
        refine_rates.append(statistics.median(refine))
        whole_rates.append(statistics.median(whole))
        rows.append([f"{delta:g}, {2 * delta:g}", str(first["tets"]), str(first["all_tets"])])
        rows[-1] += [
            spread([run["seconds"][phase] for run in done], 2)
            for phase in ("prepare", "refine", "extract")
        ]
        rows[-1] += [
            spread(refine, 3),
            spread(whole, 3),
            f"{statistics.median(refine) * first['all_tets'] / first['tets']:.3f}",
        ]
        rows[-1].append(f"{beyond_volumes(first['memory_bytes'], first):.0f}")

    def fall(rates):
        return (
            f"{100 * (rates[-1] / rates[0] - 1):+.1f} % against the coarsest mesh, "
            f"{100 * (rates[-1] / max(rates) - 1):+.1f} % against the fastest"
        )

    parts = [
        machine(bystanders, []),
        f"{name}, {threads_text(options.threads)}; "
        f"{runs_text(options.runs, 'through all sizes in turn')}.",
        markdown(head, rows),
        f"The rate of the finest mesh: refine {fall(refine_rates)}; whole {fall(whole_rates)}.",
    ]
    publish("growth", "growth.sh", "\n\n".join(parts), options)


def main():
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("compare", help="ours and the peers")
    one.add_argument("--runs", type=at_least_one, default=5, help="timed runs of each program (5)")
    one.add_argument(
        "--images",
        default="aal,brain,abdomen",
        help="aal, brain, abdomen, balls, separated by commas",
    )
    one.add_argument(
        "--tets", type=at_least_one, default=1_000_000, help="tets of each mesh (1000000)"
    )
    three = commands.add_parser("improved", help="ours and Mesh_3, slivers removed")
    three.add_argument(
        "--images",
        default="aal,brain,abdomen",
        help="aal, brain, abdomen, balls, separated by commas",
    )
    three.add_argument(
        "--tets", type=at_least_one, default=500_000, help="tets of each mesh (500000)"
    )
    two = commands.add_parser("growth", help="ours, finer and finer")
    two.add_argument(
        "--runs", type=at_least_one, default=3, help="timed rounds through all sizes (3)"
    )
    two.add_argument("--image", default="abdomen", help="aal, brain, abdomen or balls (abdomen)")
    two.add_argument(
        "--from",
        dest="smallest",
        type=at_least_one,
        default=250_000,
        help="tets of the coarsest mesh (250000)",
    )
    two.add_argument(
        "--to",
        dest="largest",
        type=at_least_one,
        default=16_000_000,
        help="tets of the finest one (16000000)",
    )
    for command in (one, two, three):
        command.add_argument(
            "--threads", type=at_least_one, default=1, help="threads of each program (1)"
        )
        command.add_argument(
            "--print-only", action="store_true", help="leave docs/notes/benchmarks.md as it is"
        )
    options = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    {"compare": compare, "growth": growth, "improved": improved}[options.command](options)


if __name__ == "__main__":
    main()
