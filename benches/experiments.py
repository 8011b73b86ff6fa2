"""The paper's experiments (section 5) with threads: PODM and LAPD beside each other; writes tables
of docs/notes/benchmarks.md. experiments.sh builds what it needs and starts it.

weak   weak scaling, as many tets for each thread: Tables 1 and 2, and the overheads of Fig. 7b.
nodes  accesses to the memory of other nodes on synthetic machines: fixed bounds, ever more nodes.

D. Feng, A. Chernikov, N. Chrisochoides, Two-level locality-aware parallel Delaunay image-to-mesh
conversion, 2016. Speedup is its equation 1; as there, one thread of PODM is what all are compared
with, run in the same turn. Time is that of refinement. Overheads are in percent of the time of all
threads. Accesses are visits of tets and vertices by operations; they are counted in a run of their
own, for counting takes time.
"""

import argparse
import dataclasses

from harness import (
    RESULTS,
    Bystanders,
    at_least_one,
    check_tets,
    find_images,
    machine,
    markdown,
    publish,
    runs_text,
    say,
    spread,
    threads_text,
    tune_ours,
)
from threads import (
    crowd,
    keep,
    losses,
    measure,
    median_tets,
    numbers,
    refine_time,
    speedups,
    to_all_cores,
    with_one,
)

ALGORITHMS = ("podm", "lapd")


@dataclasses.dataclass
class Series:
    """An algorithm on an image at one number of threads: the timed runs, those of one thread in
    the same turns, and the run that counted."""

    name: str
    algorithm: str
    threads: int
    delta: float
    runs: list
    alone: list
    counted: dict


def accesses(report):
    """Accesses to other nodes' memory in percent of all, and their hops in the mean."""
    local, remote, hops = (
        sum(one[what] for one in report["thread_reports"])
        for what in ("local_accesses", "remote_accesses", "access_hops")
    )
    return 100 * remote / max(local + remote, 1), hops / max(remote, 1)


def run_in_turn(name, image, deltas, runs, more=()):
    """Series for both algorithms at each number of threads, with the delta and the options given
    for it; each turn has a run of each."""
    alone = []
    series = []
    for threads, delta in deltas.items():
        for algorithm in ALGORITHMS:
            own = alone if (threads, algorithm) == (1, ALGORITHMS[0]) else []
            counted = measure(
                name, image, delta, threads, "--algorithm", algorithm, "--count-accesses", *more
            )
            series.append(Series(name, algorithm, threads, delta, own, alone, counted))
    for turn in range(runs):
        for one in series:
            one.runs.append(
                measure(name, image, one.delta, one.threads, "--algorithm", one.algorithm, *more)
            )
        say(
            f"    run {turn + 1}: refine "
            + ", ".join(
                f"{refine_time(one.runs[-1]):.2f} s ({one.algorithm}, {one.threads})"
                for one in series
            )
        )
    for delta in set(deltas.values()):
        check_tets(
            f"{name}, delta {delta:g}",
            [run for one in series if one.delta == delta for run in one.runs],
        )
    return series


# ---- Commands ----


def weak(options):
    bystanders, all_series = Bystanders(), []
    for name, image in find_images(options.images).items():
        say(
            f"{name}, {options.tets_per_thread / 1e6:g} M tets for each thread: looking for the "
            "bounds"
        )
        deltas = {}
        for threads in options.threads:
            deltas[threads], _ = tune_ours(
                name,
                threads * options.tets_per_thread,
                lambda delta: measure(name, image, delta, threads),
            )
        all_series += run_in_turn(name, image, deltas, options.runs)
        keep("weak-both.json", all_series)
    rows = []
    for one in all_series:
        found = speedups(one, refine_time)
        share, hops = accesses(one.counted)
        rows.append(
            [
                one.name,
                one.algorithm,
                str(one.threads),
                f"{median_tets(one) / 1e6:.2f}",
                spread([refine_time(run) for run in one.runs], 2),
                spread([run["tets"] / refine_time(run) / 1e6 for run in one.runs], 2),
                spread(found, 2),
                spread([speedup / one.threads for speedup in found], 2),
                *losses(one.runs),
                f"{share:.1f}, {hops:.1f}",
            ]
        )
    head = [
        "image",
        "algorithm",
        "threads",
        "elements, M",
        "time, s",
        "elements per second, M",
        "speedup",
        "efficiency",
        "rollbacks, % of operations",
        "idle, %",
        "contention, %",
        "rolled back, %",
        "remote accesses: %, hops",
    ]
    parts = [
        machine(bystanders, []),
        f"{runs_text(options.runs).capitalize()}.{crowd(options.threads)}",
        markdown(head, rows),
    ]
    publish("weak-both", "experiments.sh", "\n\n".join(parts), options)


def nodes(options):
    bystanders, all_series, rows = Bystanders(), [], []
    for name, image in find_images(options.images).items():
        say(f"{name}, {options.tets / 1e6:g} M tets: looking for the bounds")
        delta, _ = tune_ours(name, options.tets, lambda delta: measure(name, image, delta, 1))
        for count in options.nodes:
            threads = count * options.threads_per_node
            topology = f"numa:{count} core:{options.threads_per_node} pu:1"
            say(f"  {topology}")
            podm, lapd = run_in_turn(
                name, image, {threads: delta}, options.runs, ("--topology", topology)
            )
            all_series += [podm, lapd]
            (podm_share, _), (lapd_share, _) = accesses(podm.counted), accesses(lapd.counted)
            ratios = [refine_time(a) / refine_time(b) for a, b in zip(lapd.runs, podm.runs)]
            rows.append(
                [
                    name,
                    str(count),
                    str(threads),
                    f"{podm_share:.2f}",
                    f"{lapd_share:.2f}",
                    # On one node nothing is remote.
                    f"{lapd_share / podm_share:.2f}" if podm_share else "-",
                    spread([refine_time(run) for run in podm.runs], 2),
                    spread(ratios, 2),
                ]
            )
        keep("nodes.json", all_series)
    head = [
        "image",
        "nodes",
        "threads",
        "PODM: remote accesses, %",
        "LAPD: remote accesses, %",
        "LAPD / PODM",
        "PODM: refine, s",
        "refine, LAPD / PODM",
    ]
    parts = [
        machine(bystanders, []),
        f"About {options.tets / 1e6:g} M tets, {threads_text(options.threads_per_node)} for each "
        "node; "
        f"{runs_text(options.runs)}."
                + crowd([count * options.threads_per_node for count in options.nodes]),
        markdown(head, rows),
    ]
    publish("nodes", "experiments.sh", "\n\n".join(parts), options)


def main():
    parser = argparse.ArgumentParser(
        prog="experiments.sh",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("weak", help="weak scaling of both algorithms")
    one.add_argument(
        "--tets-per-thread",
        type=at_least_one,
        default=1_000_000,
        help="tets for each thread (1000000)",
    )
    one.add_argument(
        "--threads",
        type=with_one,
        default=to_all_cores(),
        help="numbers of threads (1,2,4, ... to the number of cores)",
    )
    two = commands.add_parser("nodes", help="accesses to other nodes' memory on synthetic machines")
    two.add_argument(
        "--tets", type=at_least_one, default=1_000_000, help="tets of each mesh (1000000)"
    )
    two.add_argument(
        "--nodes", type=numbers, default=[2, 4, 8, 12], help="numbers of memory nodes (2,4,8,12)"
    )
    two.add_argument(
        "--threads-per-node", type=at_least_one, default=1, help="threads of each node (1)"
    )
    for command in (one, two):
        command.add_argument("--runs", type=at_least_one, default=3, help="timed runs of each (3)")
        command.add_argument(
            "--images",
            default="abdomen,brain",
            help="aal, brain, abdomen, balls, separated by commas (abdomen,brain)",
        )
        command.add_argument(
            "--print-only", action="store_true", help="leave docs/notes/benchmarks.md as it is"
        )
    options = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    {"weak": weak, "nodes": nodes}[options.command](options)


if __name__ == "__main__":
    main()
