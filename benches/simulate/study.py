"""Simulated scaling: runs the example `simulate`, fits what is fitted, writes
docs/notes/scaling.md's tables and plots. run.sh says how.

Efficiency, after equation 1 of D. Feng, A. Chernikov, N. Chrisochoides, Two-level locality-aware
parallel Delaunay image-to-mesh conversion, 2016: tets per second of p workers over p times those of
one worker. One worker's rate is that for the same mesh: it changes by up to a tenth with the size
of a mesh, up or down, which is no matter of scaling. Tets and seconds are those of the whole run,
or of its steady state, the middle of it (src/simulation/course.rs).
"""

import argparse
import hashlib
import json
import math
import os
import pathlib
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from statistics import mean

ROOT = pathlib.Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT / "benches"))
from harness import find_images, markdown, say  # noqa: E402

BINARY = ROOT / "target/release/examples/simulate"
KEPT = ROOT / "build/simulate"
PAGE = ROOT / "docs/notes/scaling.md"
PICTURES = ROOT / "docs/pictures"

# ---- The paper: Tables 1 (abdomen) and 2 (brain) ----

THREADS = [32, 64, 128, 144, 160, 176, 192]
# Millions of elements, of both algorithms, and seconds.
ELEMENTS = {
    "abdomen": [96.96, 186.80, 374.09, 419.65, 467.01, 513.81, 559.20],
    "brain": [64.32, 128.61, 257.30, 289.46, 321.72, 353.78, 385.94],
}
SECONDS = {
    "PODM": {
        "abdomen": [26.07, 27.02, 35.97, 47.24, 57.24, 74.20, 92.77],
        "brain": [17.73, 18.72, 22.88, 29.91, 39.73, 49.69, 57.78],
    },
    "LAPD": {
        "abdomen": [26.18, 26.90, 31.26, 34.04, 36.27, 37.82, 39.63],
        "brain": [18.48, 18.83, 21.66, 24.01, 25.18, 27.08, 28.48],
    },
}
# Of single-threaded PODM.
RATE_ALONE = {"abdomen": 3.09e6 / 27.78, "brain": 2.01e6 / 18.29}
# The efficiencies as printed; of Table 1b the rows of 160 to 192 threads are illegible in part. The
# abdomen's are a hundredth higher than equation 1 gives: they were divided by a rate that is
# rounded to two digits, 0.11 M elements per second.
PRINTED = {
    "PODM": {
        "abdomen": [1.06, 0.98, 0.74, 0.56, 0.46, 0.36, 0.29],
        "brain": [1.03, 0.98, 0.80, 0.61, 0.46, 0.37, 0.32],
    },
    "LAPD": {
        "abdomen": [1.06, 0.99, 0.85, 0.78, 0.72, 0.70, 0.67],
        "brain": [0.99, 0.97, 0.84, 0.76, 0.73, 0.68, 0.65],
    },
}


def published(name, image):
    """Efficiencies by equation 1, of an algorithm's rows."""
    return [
        elements * 1e6 / seconds / p / RATE_ALONE[image]
        for p, elements, seconds in zip(THREADS, ELEMENTS[image], SECONDS[name][image])
    ]


# Blades of a router, and of a rack unit.
ROUTER, UNIT = 8, 16

# Rows by which the network's constants are fitted: with fewer threads routers are hardly in use.
FITTED = [128, 144, 160, 176, 192]
# Constants to begin with: nanoseconds of a hop, and of a record in a router and between the routers
# of a unit. The hop is the least that counts as one: the rows of 32 and 64 threads, published as
# 0.97 to 1.05, are met the better the shorter it is, and the time in a router, beside it, is long
# enough to be all of a record's way.
START = (1.0, 42.8, 362.0)
# What another fit must be predicted to take off the largest error, to be tried.
WORTH = 0.01
# Deltas of the meshes that a row is the mean of, in parts of the first one's. One run's efficiency
# changes by 0.03 when a few conflicts fall out in another order, as another delta makes them do.
NUDGE = 1.002


# ---- Runs ----


class Runs:
    """Simulated runs, kept by what they were asked for. Those that time real threads beside are
    made anew: machines differ, and so does what else they do."""

    def __init__(self, images, jobs):
        self.images, self.pool = images, ThreadPoolExecutor(jobs)
        self.version = hashlib.sha256(BINARY.read_bytes()).hexdigest()[:16]
        KEPT.mkdir(parents=True, exist_ok=True)

    def one(self, image, workers, *options):
        """One run."""
        words = [str(self.images[image]), "--workers", str(workers), *map(str, options)]
        name = hashlib.sha256(json.dumps([self.version, *words]).encode()).hexdigest()[:24]
        path = KEPT / f"{image}-{workers}-{name}.json"
        if "--real" in options or not path.exists():
            say(f"    {image}, {workers} workers: {' '.join(words[3:])}")
            done = subprocess.run([BINARY, *words], capture_output=True, text=True)
            if done.returncode:
                sys.exit(f"study.py: {' '.join(words)}: {done.stderr.strip()}")
            # Whole, or not at all: an interrupted study goes on with what is there.
            unfinished = path.with_suffix(".tmp")
            unfinished.write_text(done.stdout)
            unfinished.rename(path)
        return json.loads(path.read_text())

    def alone(self, image, tets):
        """One worker on a mesh of about so many tets; its delta is that of the others on the
        same mesh."""
        return self.one(image, 1, "--tets", tets)

    def alones(self, image, tets, meshes):
        """One worker on each of some meshes that hardly differ, of about so many tets."""
        first = self.alone(image, tets)
        return [
            first,
            *self.many(
                [
                    (image, 1, "--delta", f"{first['delta'] * NUDGE**mesh:.6g}")
                    for mesh in range(1, meshes)
                ]
            ),
        ]

    def many(self, asked):
        """As `one`, for each of a list, the longest first."""
        order = sorted(asked, key=lambda words: -words[1])
        results = dict(zip(order, self.pool.map(lambda words: self.one(*words), order)))
        return [results[words] for words in asked]


def rate(run):
    """Tets per second of the whole run."""
    return run["tets"] / run["seconds"]


def whole_efficiency(run, alone, slowdown=1.0):
    """Of the whole run; `alone` is one worker's run for the same mesh, on a core that is not
    slowed down."""
    return rate(run) / run["workers"] / (rate(alone) / slowdown)


def steady_rate(run):
    """Tets made per second in the steady state."""
    return run["steady"]["made"] / run["steady"]["seconds"]


def steady_efficiency(run, alone, slowdown=1.0):
    """Of the steady state, all losses."""
    return steady_rate(run) / run["workers"] / (steady_rate(alone) / slowdown)


def waited(run):
    """Seconds of all workers in the steady state that they waited for data of other nodes."""
    return run["steady"]["travel_s"] + run["steady"]["queue_s"]


def shares(run):
    """Parts of all workers' time in the steady state: rolled back, contention, idle,
    communication. Who waits for data does so within an operation, which may be rolled back: the
    last and the first overlap."""
    whole = run["workers"] * run["steady"]["seconds"]
    return [seconds / whole for seconds in (*run["steady"]["doing_s"][2:], waited(run))]


def percent(parts):
    return [f"{100 * part:.1f}" for part in parts]


def remote(run):
    """Percent of visits whose record is at home on another node."""
    visits = run["visits_by_hops"]
    return 100 * sum(visits[1:]) / sum(visits)


# ---- Blacklight ----


def waits_for_data(run, between, constants):
    """Seconds that a worker waits for a record, by mean value analysis (P. Schweitzer's
    approximation, 1979) of a closed network: p workers, each of which asks for a record, is
    served by the routers in the parts that the run's records took, and asks again after
    `between` seconds."""
    hop, *services = constants
    fetched, workers = sum(run["fetched_by_hops"]), run["workers"]
    way = (
        hop
        * 1e-9
        * sum(hops * count for hops, count in enumerate(run["fetched_by_hops"]))
        / fetched
    )
    centers = [
        (count / fetched, service * 1e-9)
        for level, service in zip(run["served"], services)
        for count in level
        if count
    ]
    queues = [0.0] * len(centers)
    waits = 0.0
    for _ in range(500):
        stays = [
            service * (1 + (workers - 1) / workers * queue)
            for (_, service), queue in zip(centers, queues)
        ]
        waits = sum(visits * stay for (visits, _), stay in zip(centers, stays))
        throughput = workers / (between + way + waits)
        queues = [
            0.5 * (queue + throughput * visits * stay)
            for queue, (visits, _), stay in zip(queues, centers, stays)
        ]
    return way + waits


def time_between(run, constants):
    """Seconds between two records of a worker such that the analysis gives what the run,
    simulated with these constants, waited. Records come in bursts: it is less than the mean."""
    mean = waited(run) / run["steady"]["fetched"]
    low, high = 1e-9, 1.0
    for _ in range(50):
        middle = math.sqrt(low * high)
        low, high = (
            (middle, high) if waits_for_data(run, middle, constants) > mean else (low, middle)
        )
    return low


def predicted(run, work, others, between, constants):
    """The efficiency under other constants than those of the run: one worker's seconds over
    these, what is waited for data, and the other losses, which are as long as operations are."""
    waits = run["steady"]["fetched"] * waits_for_data(run, between, constants)
    return work / ((work + waits) * others)


def fit(rows, simulated):
    """Constants that bring the predicted efficiencies nearest to the published ones of PODM, by
    steps along each axis that halve; and the largest error by which these are predicted to differ,
    before and after. `rows`: lists of runs, on one mesh each, simulated with the constants
    `simulated`; their efficiencies; and that published, of which theirs are to be the mean.
    """
    known = []
    for of_row, found, published in rows:
        cases = []
        for run, efficiency in zip(of_row, found):
            total = run["workers"] * run["steady"]["seconds"]
            work = efficiency * total
            cases.append((run, work, total / (work + waited(run)), time_between(run, simulated)))
        known.append((cases, published))

    def errors(constants):
        return [
            abs(mean(predicted(*case, constants) for case in cases) - published)
            for cases, published in known
        ]

    def error(constants):
        # Such powers have the largest count, and are smooth.
        return sum(one**8 for one in errors(constants))

    best, step = list(simulated), 1.0
    least = error(best)
    while step > 0.01:
        better = False
        # The hop stays as it is (`START`).
        for axis in (1, 2):
            for factor in (1 + step, 1 / (1 + step)):
                tried = list(best)
                tried[axis] = max(1.0, tried[axis] * factor)
                found = error(tried)
                if found < least:
                    best, least, better = tried, found, True
        if not better:
            step /= 2
    return tuple(float(f"{value:.3g}") for value in best), max(errors(simulated)), max(errors(best))


def blacklight(runs, options):
    """The paper's tables."""
    images = [image for image in ELEMENTS if image in runs.images]
    # All rows refine the same meshes.
    alone = {
        image: runs.alones(image, options.tets * THREADS[-1], options.meshes) for image in images
    }
    slow = {image: mean(map(rate, alone[image])) / RATE_ALONE[image] for image in images}

    def sweep(algorithm, constants, threads):
        """For each image and number of threads one run for each mesh."""
        hop, router, unit = constants
        asked = [
            (
                image,
                p,
                "--delta",
                mesh["delta"],
                "--machine",
                "blacklight",
                "--algorithm",
                algorithm,
                "--begging",
                "flat" if algorithm == "podm" else "levels",
                "--set",
                f"slowdown={slow[image]:.4g},hop={hop:g}",
                "--level",
                f"{ROUTER}:{router:g},{UNIT}:{unit:g}",
            )
            for image in images
            for p in threads
            for mesh in alone[image]
        ]
        found = iter(runs.many(asked))
        return {image: [[next(found) for _ in alone[image]] for _ in threads] for image in images}

    def efficiencies(of, image, row):
        return [of(run, one, slow[image]) for run, one in zip(row, alone[image])]

    constants, best = START, (math.inf, START)
    for _ in range(options.rounds):
        podm, rows = sweep("podm", constants, FITTED), []
        for image in images:
            wanted = dict(zip(THREADS, published("PODM", image)))
            rows += [
                (row, efficiencies(steady_efficiency, image, row), wanted[row[0]["workers"]])
                for row in podm[image]
            ]
        fitted, before, after = fit(rows, constants)
        say(
            f"    router {constants[1]} ns, unit {constants[2]} ns: largest error {before:.3f}; "
            f"{after:.3f} is predicted for {fitted[1]} and {fitted[2]} ns"
        )
        best = min(best, (before, constants))
        if before - after < WORTH:
            break
        constants = fitted
    constants = best[1]
    simulated = {
        "PODM": sweep("podm", constants, THREADS),
        "LAPD": sweep("lapd", constants, THREADS),
    }
    used = [
        [
            image,
            ", ".join(str(one["tets"]) for one in alone[image]),
            f"{slow[image]:.2f}",
            *(f"{value:g}" for value in constants),
        ]
        for image in images
    ]
    text = [
        markdown(
            ["image", "tets", "slowdown", "hop, ns", "router, ns a record", "unit, ns a record"],
            used,
        )
    ]
    head = [
        "image",
        "threads",
        "algorithm",
        "printed",
        "published",
        "simulated",
        "error",
        "against printed",
        "least, largest",
        "whole run",
        "rolled back, %",
        "contention, %",
        "idle, %",
        "communication, %",
        "remote visits, %",
        "fetched per tet",
    ]
    table = []
    for image in images:
        for name in simulated:
            for p, row, paper, printed in zip(
                THREADS, simulated[name][image], published(name, image), PRINTED[name][image]
            ):
                found = efficiencies(steady_efficiency, image, row)
                whole = mean(efficiencies(whole_efficiency, image, row))
                lost = [mean(parts) for parts in zip(*map(shares, row))]
                fetched = mean(sum(run["fetched_by_hops"]) / run["tets"] for run in row)
                table.append(
                    [
                        image,
                        str(p),
                        name,
                        f"{printed:.2f}",
                        f"{paper:.3f}",
                        f"{mean(found):.3f}",
                        f"{mean(found) - paper:+.3f}",
                        f"{mean(found) - printed:+.3f}",
                        f"{min(found):.2f}, {max(found):.2f}",
                        f"{whole:.2f}",
                        *percent(lost),
                        f"{mean(map(remote, row)):.1f}",
                        f"{fetched:.2f}",
                    ]
                )
    text.append(markdown(head, table))
    if not options.print_only:
        plot_blacklight(images, simulated, efficiencies)
    return text


def plot_blacklight(images, simulated, efficiencies):
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(images), figsize=(5 * len(images), 8), squeeze=False)
    for column, image in enumerate(images):
        above, below = axes[0][column], axes[1][column]
        above.plot([0, 192], [0, 192], color="grey", lw=0.8, label="ideal")
        for name, color in (("PODM", "tab:blue"), ("LAPD", "tab:red")):
            above.plot(
                THREADS,
                [p * e for p, e in zip(THREADS, published(name, image))],
                "o--",
                color=color,
                mfc="none",
                label=f"{name}, published",
            )
            for style, what, of in (
                ("s-", "steady state", steady_efficiency),
                (":", "whole run", whole_efficiency),
            ):
                speedups = [
                    p * mean(efficiencies(of, image, row))
                    for p, row in zip(THREADS, simulated[name][image])
                ]
                above.plot(
                    THREADS, speedups, style, color=color, label=f"{name}, simulated, {what}"
                )
        above.set(title=image, xlabel="threads", ylabel="speedup")
        above.legend(fontsize=7)
        for offset, name, alpha in ((-3, "PODM", 1.0), (3, "LAPD", 0.6)):
            bottom = [0.0] * len(THREADS)
            for index, (what, color) in enumerate(
                (
                    ("rolled back", "tab:orange"),
                    ("contention", "tab:purple"),
                    ("idle", "tab:green"),
                    ("communication", "tab:blue"),
                )
            ):
                heights = [
                    100 * mean(shares(run)[index] for run in row) for row in simulated[name][image]
                ]
                below.bar(
                    [p + offset for p in THREADS],
                    heights,
                    5,
                    bottom=bottom,
                    color=color,
                    alpha=alpha,
                    label=what if offset < 0 else None,
                )
                bottom = [a + b for a, b in zip(bottom, heights)]
        below.set(
            xlabel="threads; left PODM, right LAPD",
            ylabel="% of the time of all threads, steady state",
        )
        below.legend(fontsize=7)
    figure.tight_layout()
    figure.savefig(PICTURES / "scaling-blacklight.png", dpi=110)


# ---- Other parts ----


def check(runs, options):
    """Simulated beside real, as far as there are cores."""
    text = (
        "Real seconds are those of refinement, with as many threads in the sampling of the image, "
        "which takes no virtual time; one run each."
    )
    rows = []
    for image in runs.images:
        for tets in (250_000, 1_000_000):
            alone, pair = [
                runs.one(image, p, "--tets", tets // p, "--machine", f"1x{p}", "--real")
                for p in (1, 2)
            ]
            cells = [f"{run['real']['seconds']:.3f}, {run['seconds']:.3f}" for run in (alone, pair)]
            real = [run["real"]["tets"] / run["real"]["seconds"] for run in (alone, pair)]
            rows.append(
                [
                    image,
                    str(alone["tets"]),
                    *cells,
                    f"{real[1] / real[0]:.2f}",
                    f"{rate(pair) / rate(alone):.2f}",
                ]
            )
    return [
        text,
        markdown(
            [
                "image",
                "tets",
                "one: real, simulated, s",
                "two: real, simulated, s",
                "real speedup",
                "simulated speedup",
            ],
            rows,
        ),
    ]


def losses(runs, name, machine_words, algorithms, meshes, workers, constants):
    """A table of runs that refine meshes of so many tets."""
    asked, alones = [], []
    for image, tets in ((image, tets) for image in runs.images for tets in meshes):
        alone = runs.alone(image, tets)
        for algorithm, p in ((algorithm, p) for algorithm in algorithms for p in workers):
            asked.append(
                (
                    image,
                    p,
                    "--delta",
                    alone["delta"],
                    "--algorithm",
                    algorithm,
                    *machine_words,
                    *constants,
                )
            )
            alones.append(alone)
    rows = []
    for words, run, alone in zip(asked, runs.many(asked), alones):
        steady, whole = steady_efficiency(run, alone), whole_efficiency(run, alone)
        rows.append(
            [
                words[0],
                words[5].upper(),
                str(run["workers"]),
                str(run["tets"] // run["workers"]),
                f"{run['workers'] * steady:.1f}",
                f"{steady:.2f}",
                f"{whole:.2f}",
                *percent(shares(run)),
                f"{remote(run):.1f}",
            ]
        )
    head = [
        "image",
        "algorithm",
        "workers",
        "tets per worker",
        "speedup",
        "efficiency",
        "whole run",
        "rolled back, %",
        "contention, %",
        "idle, %",
        "communication, %",
        "remote visits, %",
    ]
    return [name, markdown(head, rows)]


# A memory node as near as in one socket of a machine of today, and twice as far in another one;
# caches pass a line in some 100 ns. Assumed, not measured.
TODAY = ("--set", "hop=110", "--level", "8:0.4,64:1")


def size(runs, options):
    return losses(
        runs,
        "One memory node of 16 cores, PODM:",
        ("--machine", "1x16"),
        ["podm"],
        [16 * tets for tets in (2500, 10_000, 40_000, 160_000)],
        [16],
        (),
    )


def today(runs, options):
    both, meshes = ["podm", "lapd"], [256 * options.tets]
    text = losses(
        runs,
        "Two sockets of 8 memory nodes, 256 cores:",
        ("--machine", "2x8x16"),
        both,
        meshes,
        [64, 256],
        TODAY,
    )
    return text + losses(
        runs,
        "Eight such sockets, 1024 cores:",
        ("--machine", "8x8x16"),
        both,
        meshes,
        [1024],
        TODAY,
    )


PARTS = {"check": check, "blacklight": blacklight, "size": size, "today": today}


def write(part, text):
    """Into the page, between the part's two lines."""
    begin, end = f"<!-- {part}: written by run.sh -->", f"<!-- end of {part} -->"
    page = PAGE.read_text()
    before, _, rest = page.partition(begin)
    _, _, after = rest.partition(end)
    if not after:
        sys.exit(f"study.py: {PAGE} has no place for {part}")
    PAGE.write_text(before + begin + "\n" + text + "\n" + end + after)


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("parts", nargs="*", help=", ".join(PARTS))
    parser.add_argument("--images", default="abdomen,brain")
    parser.add_argument(
        "--tets",
        type=int,
        default=32_000,
        help="for each of the 192 or 256 workers of the largest row; all rows refine the same mesh",
    )
    parser.add_argument(
        "--meshes",
        type=int,
        default=3,
        help="that hardly differ, of each image; a row of blacklight is the mean of their runs",
    )
    parser.add_argument(
        "--rounds",
        type=int,
        default=3,
        help=(
            "most fits of Blacklight's constants, one after the other; fewer where another would "
            "gain nothing"
        ),
    )
    parser.add_argument("--jobs", type=int, default=max(1, len(os.sched_getaffinity(0))))
    parser.add_argument("--print-only", action="store_true")
    options = parser.parse_args()
    unknown = set(options.parts) - set(PARTS)
    if unknown:
        sys.exit(f"study.py: no part {', '.join(unknown)}; there are {', '.join(PARTS)}")
    runs = Runs(find_images(options.images), options.jobs)
    for part in options.parts or PARTS:
        say(f"== {part}")
        text = "\n\n".join(PARTS[part](runs, options))
        print(text)
        if not options.print_only:
            write(part, text)


if __name__ == "__main__":
    main()
