"""What threads bring, and with what they lose time; writes tables of docs/notes/benchmarks.md.
threads.sh builds what it needs and starts it.

speedup   fixed bounds, one thread against several, for images and numbers of tets.
managers  the four contention managers with both begging schemes.
scaling   strong: fixed bounds, ever more threads; weak: ever more threads, each with as many tets.

Speedup is equation 1 of D. Feng, A. Chernikov, N. Chrisochoides, Two-level locality-aware parallel
Delaunay image-to-mesh conversion, 2016: elements per second of p threads over those of one, S(p) =
elements(p) time(1) / (time(p) elements(1)), elements being tets with a label. Efficiency is S(p) /
p. Both are formed between runs of the same turn, so that what slows the machine slows both. Runs
with several threads differ a little; elements(p) are those of the run itself. harness.py has what
all benches share.
"""

import argparse
import dataclasses
import json
import os
import statistics

from harness import (
    RESULTS,
    Bystanders,
    at_least_one,
    check_tets,
    fail,
    find_images,
    machine,
    markdown,
    ours,
    publish,
    runs_text,
    say,
    spread,
    threads_text,
    tune_ours,
)

PHASES = ("prepare", "refine", "extract", "certify")
MANAGERS = ("local", "global", "random", "aggressive")
BEGGING = ("levels", "flat")
# A manager may livelock: it is given up when it takes so many times as long as the first did, but
# not before so many seconds.
PATIENCE, SHORTEST_LIMIT = 20, 10
HEAD_LOSSES = ["rollbacks, % of operations", "idle, %", "contention, %", "rolled back, %"]


# ---- Runs ----


@dataclasses.dataclass
class Series:
    """One image at one number of threads: the bounds, the timed runs, and those of one thread in
    the same turns."""

    name: str
    threads: int
    delta: float
    runs: list
    alone: list


def measure(name, image, delta, threads, *more):
    """The report of one run, whose mesh is sound."""
    report = ours(image, delta, threads, *more)
    certificate = report["certificate"]
    wrong = (
        certificate["non_delaunay_facets"]
        + certificate["inverted_tets"]
        + sum(certificate["unmet"].values())
    )
    if wrong and report["limit_reached"] is None:
        fail(
            f"{name}, delta {delta:g}, {threads_text(threads)}: the certificate finds {wrong} "
            "faults"
        )
    return report


def refine_time(report):
    return report["seconds"]["refine"]


def whole_time(report):
    """All of the pipeline; reading and writing are outside."""
    return sum(report["seconds"][phase] for phase in PHASES)


def run_in_turn(name, image, deltas, runs):
    """A series for each number of threads, with the delta given for it; each turn has a run of
    each."""
    alone = []
    series = [
        Series(name, threads, delta, alone if threads == 1 else [], alone)
        for threads, delta in deltas.items()
    ]
    for turn in range(runs):
        for one in series:
            one.runs.append(measure(name, image, one.delta, one.threads))
        say(
            f"    run {turn + 1}: refine "
            + ", ".join(f"{refine_time(one.runs[-1]):.2f} s ({one.threads})" for one in series)
        )
    for delta in set(deltas.values()):
        check_tets(
            f"{name}, delta {delta:g}",
            [run for one in series if one.delta == delta for run in one.runs],
        )
    return series


def keep(file, series):
    """Every report, as JSON."""
    (RESULTS / file).write_text(json.dumps([dataclasses.asdict(one) for one in series], indent=1))


# ---- Figures ----


def speedups(series, seconds):
    """Equation 1, turn by turn."""
    return [
        run["tets"] * seconds(one) / (seconds(run) * one["tets"])
        for run, one in zip(series.runs, series.alone)
    ]


def losses(runs):
    """Rollbacks in percent of insertions and removals; time without work, waiting after
    conflicts, and in operations that were given up, in percent of the time of all threads."""

    def percent(run, name):
        return 100 * run["overhead"][name] / (run["threads"] * refine_time(run))

    operations = [run["operations"] for run in runs]
    rollbacks = [
        100 * one["rollbacks"] / (one["insertions"] + one["removals"]) for one in operations
    ]
    return [
        spread(rollbacks, 2),
        *(
            spread([percent(run, name) for run in runs], 2)
            for name in ("idle_s", "contention_s", "rollback_s")
        ),
    ]


def speed(series):
    """Seconds, M tets/s, speedup and efficiency: of refine, then of the pipeline."""
    cells = []
    for seconds in (refine_time, whole_time):
        found = speedups(series, seconds)
        cells.append(spread([seconds(run) for run in series.runs], 3))
        cells.append(spread([run["tets"] / seconds(run) / 1e6 for run in series.runs], 3))
        # Against itself one thread's is 1 by definition.
        cells.append("1" if series.threads == 1 else spread(found, 2))
        cells.append(f"{100 * statistics.median(found) / series.threads:.0f} %")
    return cells


HEAD_SPEED = [
    f"{part}{what}"
    for part in ("refine", "whole")
    for what in (", s", ", M tets/s", ": speedup", ": efficiency")
]


def median_tets(series):
    return statistics.median_low(run["tets"] for run in series.runs)


def speed_table(all_series):
    rows = [
        [
            one.name,
            f"{one.delta:g}, {2 * one.delta:g}",
            str(median_tets(one)),
            str(one.threads),
            *speed(one),
        ]
        for one in all_series
    ]
    return markdown(["image", "delta, size", "tets", "threads", *HEAD_SPEED], rows)


def phase_table(all_series):
    rows = []
    for one in all_series:
        times = [spread([run["seconds"][phase] for run in one.runs], 3) for phase in PHASES]
        rows.append([one.name, str(median_tets(one)), str(one.threads), *times])
    return markdown(["image", "tets", "threads", *(f"{phase}, s" for phase in PHASES)], rows)


def loss_table(all_series):
    rows = [
        [one.name, str(median_tets(one)), str(one.threads), *losses(one.runs)]
        for one in all_series
        if one.threads > 1
    ]
    return markdown(["image", "tets", "threads", *HEAD_LOSSES], rows)


def crowd(threads):
    """What must be said where threads are more than cores."""
    cores = len(os.sched_getaffinity(0))
    return (
        f" Threads share {cores} {'cores' if cores > 1 else 'core'} where they are more."
        if max(threads) > cores
        else ""
    )


# ---- Commands ----


def speedup(options):
    bystanders, all_series = Bystanders(), []
    for name, image in find_images(options.images).items():
        for tets in options.tets:
            say(f"{name}, {tets / 1e6:g} M tets: looking for the bounds")
            delta, _ = tune_ours(
                name, tets, lambda delta: measure(name, image, delta, options.threads[-1])
            )
            all_series += run_in_turn(
                name, image, dict.fromkeys(options.threads, delta), options.runs
            )
            keep("speedup.json", all_series)
    parts = [
        machine(bystanders, []),
        f"{runs_text(options.runs).capitalize()}.{crowd(options.threads)}",
        speed_table(all_series),
        phase_table(all_series),
        *([loss_table(all_series)] if options.threads[-1] > 1 else []),
    ]
    publish("speedup", "threads.sh", "\n\n".join(parts), options)


def managers(options):
    bystanders = Bystanders()
    ((name, image),) = find_images(options.image).items()
    say(f"{name}: looking for the bounds")
    delta, first = tune_ours(
        name, options.tets, lambda delta: measure(name, image, delta, options.threads[0])
    )
    pairs = [
        (threads, manager, begging)
        for threads in options.threads
        for manager in MANAGERS
        for begging in BEGGING
    ]
    runs, gave_up = {pair: [] for pair in pairs}, {}
    for turn in range(options.runs):
        for threads, manager, begging in pairs:
            pair, first_pair = (threads, manager, begging), (threads, MANAGERS[0], BEGGING[0])
            if pair in gave_up:
                continue
            limits = []
            if pair != first_pair:
                limit = max(PATIENCE * refine_time(runs[first_pair][-1]), SHORTEST_LIMIT)
                limits = ["--time-limit", f"{limit:.0f}", "--partial"]
            report = measure(
                name, image, delta, threads, "--contention", manager, "--begging", begging, *limits
            )
            if report["limit_reached"] is None:
                runs[pair].append(report)
                took = f"{refine_time(report):.2f} s"
            else:
                gave_up[pair] = took = f"given up after {refine_time(report):.0f} s"
            say(f"    run {turn + 1}: {threads_text(threads)}, {manager}, {begging}: {took}")
        kept = [
            {"threads": pair[0], "manager": pair[1], "begging": pair[2], "runs": runs[pair]}
            for pair in pairs
        ]
        (RESULTS / "managers.json").write_text(json.dumps(kept, indent=1))
    check_tets(name, [first, *(run for pair in pairs if pair not in gave_up for run in runs[pair])])

    head = [
        "threads",
        "manager",
        "begging",
        "refine, s",
        f"refine / that of {MANAGERS[0]}, {BEGGING[0]}",
        *HEAD_LOSSES,
    ]
    rows = []
    for threads, manager, begging in pairs:
        done, defaults = runs[threads, manager, begging], runs[threads, MANAGERS[0], BEGGING[0]]
        row = [str(threads), manager, begging]
        if (threads, manager, begging) in gave_up:
            row += [gave_up[threads, manager, begging], *["-"] * (len(head) - 4)]
        else:
            ratios = [refine_time(a) / refine_time(b) for a, b in zip(done, defaults)]
            row.append(spread([refine_time(run) for run in done], 3))
            row.append("1" if done is defaults else spread(ratios, 2))
            row += losses(done)
        rows.append(row)
    parts = [
        machine(bystanders, []),
        f"{name}, delta {delta:g}, size {2 * delta:g}, {first['tets']} tets; "
        f"{runs_text(options.runs)}.{crowd(options.threads)}",
        markdown(head, rows),
    ]
    publish("managers", "threads.sh", "\n\n".join(parts), options)


def scaling(options):
    bystanders, strong, weak = Bystanders(), [], []
    for name, image in find_images(options.images).items():
        say(f"{name}, strong scaling, {options.tets / 1e6:g} M tets: looking for the bounds")
        delta, _ = tune_ours(
            name, options.tets, lambda delta: measure(name, image, delta, options.threads[-1])
        )
        strong += run_in_turn(name, image, dict.fromkeys(options.threads, delta), options.runs)
        keep("strong.json", strong)

        say(
            f"{name}, weak scaling, {options.tets_per_thread / 1e6:g} M tets for each thread: "
            "looking for the bounds"
        )
        deltas = {}
        for threads in options.threads:
            tets = threads * options.tets_per_thread
            deltas[threads], _ = tune_ours(
                name, tets, lambda delta: measure(name, image, delta, threads)
            )
        weak += run_in_turn(name, image, deltas, options.runs)
        keep("weak.json", weak)
    parts = [
        machine(bystanders, []),
        f"{runs_text(options.runs).capitalize()}.{crowd(options.threads)}",
    ]
    titles = (
        "Strong scaling: the same bounds for any number of threads.",
        "Weak scaling: as many tets for each thread.",
    )
    for what, series in zip(titles, (strong, weak)):
        parts += [
            what,
            speed_table(series),
            *([loss_table(series)] if options.threads[-1] > 1 else []),
        ]
    publish("scaling", "threads.sh", "\n\n".join(parts), options)


# ---- Options ----


def numbers(text):
    """Whole numbers, separated by commas, in order."""
    return sorted({at_least_one(word) for word in text.split(",")})


def with_one(text):
    """Numbers of threads: one thread is among them, because the others are compared with it."""
    return sorted({1, *numbers(text)})


def to_all_cores():
    """1, 2, 4 and so on, to the number of cores."""
    cores = len(os.sched_getaffinity(0))
    return sorted({1 << power for power in range(cores.bit_length())} | {cores})


def main():
    parser = argparse.ArgumentParser(
        prog="threads.sh", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser(
        "speedup", help="one thread against several; what is run where nothing else is named"
    )
    one.add_argument("--runs", type=at_least_one, default=5, help="timed runs of each (5)")
    one.add_argument(
        "--tets",
        type=numbers,
        default=[1_000_000, 4_000_000],
        help="tets of the meshes (1000000,4000000)",
    )
    one.add_argument("--threads", type=with_one, default=[1, 2], help="numbers of threads (1,2)")
    two = commands.add_parser("managers", help="contention managers and begging schemes")
    two.add_argument("--runs", type=at_least_one, default=3, help="timed runs of each (3)")
    two.add_argument(
        "--image",
        choices=("aal", "brain", "abdomen", "balls"),
        default="abdomen",
        help="the image (abdomen)",
    )
    two.add_argument(
        "--tets", type=at_least_one, default=1_000_000, help="tets of the mesh (1000000)"
    )
    two.add_argument(
        "--threads", type=numbers, default=[2, 4, 8, 16], help="numbers of threads (2,4,8,16)"
    )
    three = commands.add_parser("scaling", help="strong and weak scaling")
    three.add_argument("--runs", type=at_least_one, default=3, help="timed runs of each (3)")
    three.add_argument(
        "--tets",
        type=at_least_one,
        default=4_000_000,
        help="tets of each mesh, strong scaling (4000000)",
    )
    three.add_argument(
        "--tets-per-thread",
        type=at_least_one,
        default=1_000_000,
        help="tets for each thread, weak scaling (1000000)",
    )
    three.add_argument(
        "--threads",
        type=with_one,
        default=to_all_cores(),
        help="numbers of threads (1,2,4, ... to the number of cores)",
    )
    for command in (one, three):
        command.add_argument(
            "--images",
            default="aal,brain,abdomen",
            help="aal, brain, abdomen, balls, separated by commas",
        )
    for command in (one, two, three):
        command.add_argument(
            "--print-only", action="store_true", help="leave docs/notes/benchmarks.md as it is"
        )
    options = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    {"speedup": speedup, "managers": managers, "scaling": scaling}[options.command](options)


if __name__ == "__main__":
    main()
