"""Runs our mesher and its peers in turn, and writes the tables of docs/benchmarks.md. run.sh and growth.sh build what it needs and start it.

compare  ours, Mesh_3 with each tag, and the Delaunay triangulation of our vertices; bounds are tuned until the numbers of tets agree.
growth   ours alone, on one image, finer and finer.

Tuning, and the runs whose meshes and memory are measured, come before those that are timed. Everything that was run is kept as JSON
in build/peers/results/. Needs the standard library only.
"""
import argparse
import dataclasses
import datetime
import json
import math
import os
import pathlib
import platform
import re
import resource
import statistics
import subprocess
import sys
import time

ROOT = pathlib.Path(__file__).resolve().parents[2]
BUILD = ROOT / "build"
RESULTS = BUILD / "peers" / "results"
DOCS = ROOT / "docs" / "benchmarks.md"

# Where tuning starts, for a million tets: delta in world units. Size is always twice delta.
START = {"aal": 1.35, "brain": 1.97, "abdomen": 1.61, "balls": 0.55}
# Criteria of Mesh_3 as multiples of our delta, which give about as many tets and interface facets as we have; a common factor is tuned.
FACET_SIZE, FACET_DISTANCE, CELL_SIZE = 1.16, 0.26, 2.0
# How far the number of tets may be from what was asked for: ours from the target, theirs from ours; and in the end, in every timed run.
OURS_WITHIN, THEIRS_WITHIN, IN_THE_END = 0.03, 0.02, 0.05
TRIES = 6
TAGS = {"parallel": "Mesh_3, Parallel_tag", "sequential": "Mesh_3, Sequential_tag"}
# So that the finest mesh of the growth study gives up before the machine does.
MOST_MEMORY = 0.85


def fail(line):
    sys.exit(f"peers.py: {line}")


def say(line):
    print(line, file=sys.stderr, flush=True)


# ---- Images ----


def phantom():
    """A ball of two halves inside a larger one, 96^3 voxels: for where there are no images."""
    path, n = RESULTS / "balls.nrrd", 96
    middle, inner, outer = (n - 1) / 2, (7 / 32 * n) ** 2, (13 / 32 * n) ** 2
    voxels = bytearray()
    for z in range(n):
        for y in range(n):
            base = (z - middle) ** 2 + (y - middle) ** 2
            for x in range(n):
                r = base + (x - middle) ** 2
                voxels.append((3 if x < middle else 2) if r < inner else 1 if r < outer else 0)
    header = f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\nspacings: 1 1 1\n\n"
    path.write_bytes(header.encode() + bytes(voxels))
    return path


def find_image(name):
    """The path of an image, or None where it is not installed."""
    folder = pathlib.Path(os.environ.get("LAPD_IMAGES") or ROOT.parent / "shared" / "images")
    known = {
        "aal": pathlib.Path("/usr/share/mricron/templates/aal.nii.gz"),
        "brain": folder / "spl" / "brain.nrrd",
        "abdomen": folder / "spl" / "abdomen.nrrd",
    }
    if name == "balls":
        return phantom()
    if name not in known:
        fail(f"unknown image {name}; there are {', '.join(known)} and balls")
    if not known[name].exists():
        say(f"SKIPPED: {name}, no file {known[name]}")
        return None
    return known[name]


# ---- Programs ----


def execute(command, statuses=(0,)):
    """Standard output of a program."""
    command = [str(word) for word in command]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode not in statuses:
        message = "; ".join(done.stderr.strip().splitlines()) or "no message"
        fail(f"{pathlib.Path(command[0]).name} ended with status {done.returncode}: {message}")
    return done.stdout


def ours(image, delta, threads, *more):
    """The report of one run of our mesher."""
    report = RESULTS / "lapd.json"
    bounds = ["--delta", repr(delta), "--size", repr(2 * delta), "--threads", threads]
    execute([BUILD / "bin" / "mesh_image", image, *bounds, "--quiet", "--report", report, *more])
    found = json.loads(report.read_text())
    found["span"] = sum(found["seconds"][phase] for phase in ("distance", "refine", "extract"))
    found["rate"] = found["tets"] / found["span"]
    return found


def criteria(delta, factor):
    """What Mesh_3 is run with: facet size, facet distance, cell size."""
    return [round(factor * multiple * delta, 6) for multiple in (FACET_SIZE, FACET_DISTANCE, CELL_SIZE)]


def mesh_3(tag, image, delta, factor, threads, *more):
    """The report of one run of Mesh_3."""
    report = RESULTS / "mesh_3.json"
    facet_size, facet_distance, cell_size = criteria(delta, factor)
    bounds = ["--facet-size", facet_size, "--facet-distance", facet_distance, "--cell-size", cell_size, "--threads", threads]
    execute([BUILD / "peers" / "cgal_mesh_3", image, f"--{tag}", *bounds, "--report", report, *more])
    found = json.loads(report.read_text())
    found["span"] = found["seconds"]["refine"]
    found["rate"] = found["tets"] / found["span"]
    return found


def surface_distances(image, our_mesh, their_mesh):
    """What c-tests/crossval/measure.cpp says of two meshes: a dictionary for each. Its status 1 says that theirs is better somewhere."""
    table = execute([BUILD / "peers" / "measure", image, our_mesh, their_mesh], statuses=(0, 1))
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in table.splitlines() if line.startswith("| ")]
    rows = {row[0]: row[1:] for row in rows if len(row) == 3}
    names = {
        "mean_to_image": "mesh to image, mean distance",
        "max_to_image": "mesh to image, largest",
        "mean_to_mesh": "image to mesh, mean distance",
        "max_to_mesh": "image to mesh, largest",
        "lost": "labels lost",
    }
    if any(row not in rows for row in names.values()):
        fail(f"measure said nothing of {', '.join(row for row in names.values() if row not in rows)}")
    return [{name: float(rows[row][side]) for name, row in names.items()} for side in (0, 1)]


def tune(what, value, target, within, run):
    """Looks for the bound at which `run` gives `target` tets: (bound, report). By the law of powers through the last two tries; the first guess
    lies between that of surfaces, 2, and that of volumes, 3."""
    exponent, tries = 2.6, []
    for _ in range(TRIES):
        report = run(value)
        tries.append((value, report["tets"]))
        say(f"    {what} {value:.4f}: {report['tets']} tets")
        if abs(report["tets"] / target - 1) <= within:
            return value, report
        if len(tries) > 1:
            (a, m), (b, n) = tries[-2:]
            if a != b and m != n:
                exponent = min(max(-math.log(n / m) / math.log(b / a), 1.5), 3.5)
        value = float(f"{value * (report['tets'] / target) ** (1 / exponent):.4g}")
    return fail(f"{what} gives {tries[-1][1]} tets, not within {100 * within:g} % of {target}, after {TRIES} tries")


# ---- One image, all programs ----


@dataclasses.dataclass
class Case:
    """All about one image: the bounds, what was measured once, and the timed runs in their order."""

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
    start = START[name] * (1e6 / options.tets) ** (1 / 2.6)

    def run_ours(delta):
        return ours(image, delta, options.threads, "-o", meshes["lapd"], "--memory")

    delta, first = tune("delta", start, options.tets, OURS_WITHIN, run_ours)
    # Sequential_tag has one thread, whatever the others have: it is a peer of one thread only.
    tags = [tag for tag in TAGS if tag == "parallel" or options.threads == 1]
    factors, measured, factor = {}, {}, 1.0
    for tag in tags:

        def run_theirs(factor, tag=tag):
            return mesh_3(tag, image, delta, factor, options.threads, "-o", meshes[tag])

        factor, _ = tune(f"{TAGS[tag]}, factor", factor, first["tets"], THEIRS_WITHIN, run_theirs)
        factors[tag] = factor
        measured["lapd"], measured[tag] = surface_distances(image, meshes["lapd"], meshes[tag])
    points = RESULTS / "points.bin"
    delaunay = [BUILD / "peers" / "cgal_delaunay_3"]
    execute([*delaunay, "collect", image, repr(delta), repr(2 * delta), options.threads, points])

    turns = {
        "lapd": lambda: ours(image, delta, options.threads),
        "parallel": lambda: mesh_3("parallel", image, delta, factors["parallel"], options.threads),
        "delaunay": lambda: json.loads(execute([*delaunay, "time", points])),
        "sequential": lambda: mesh_3("sequential", image, delta, factors["sequential"], 1),
    }
    runs = {program: [] for program in turns if program in (*tags, "lapd", "delaunay")}
    for turn in range(options.runs):
        for program, done in runs.items():
            done.append(turns[program]())
        say(f"    run {turn + 1}: " + ", ".join(f"{program} {seconds(done[-1]):.2f} s" for program, done in runs.items()))
    for leftover in (*meshes.values(), points):
        leftover.unlink(missing_ok=True)
    check(name, first, runs, options)
    return Case(name, delta, factors, measured, first["memory_bytes"], runs, len(first["labels"]))


def seconds(run):
    """What is compared of a run: wall time, without reading and writing."""
    return run["span"] if "span" in run else run["seconds"]


def check(name, first, runs, options):
    """What must hold for the figures to mean something."""
    all_runs = [first, *runs["lapd"]]
    if options.threads == 1 and len({(run["tets"], run["all_tets"]) for run in all_runs}) > 1:
        fail(f"{name}: our number of tets differs from run to run: {[run['tets'] for run in all_runs]}")
    for program in runs:
        for run in runs[program]:
            wanted = first["all_tets"] if program == "delaunay" else first["tets"]
            if abs(run["tets"] / wanted - 1) > IN_THE_END:
                fail(f"{name}: {program} has {run['tets']} tets, we have {wanted}: more than {100 * IN_THE_END:g} % apart")
            # One thread's mesh is always the same, and so is the Delaunay triangulation of its vertices.
            if program == "delaunay" and options.threads == 1 and run["tets"] != wanted:
                fail(f"{name}: Delaunay_triangulation_3 makes {run['tets']} tets of our vertices, we have {wanted}")


# ---- Tables ----


def spread(values, digits):
    """Median, and in brackets the least and the largest."""
    low, middle, high = (f"{value:.{digits}f}" for value in (min(values), statistics.median(values), max(values)))
    return middle if len(values) == 1 else f"{middle} ({low} to {high})"


def markdown(head, rows):
    align = ["---" if name in ("image", "program") else "---:" for name in head]
    lines = ["| " + " | ".join(row) + " |" for row in [head, *rows]]
    return "\n".join([lines[0], "|" + "|".join(align) + "|", *lines[1:]])


def phases(run_list):
    parts = [f"{phase} {spread([run['seconds'][phase] for run in run_list], 3)}" for phase in ("distance", "refine", "extract")]
    return ", ".join(parts)


def main_table(cases):
    head = ["image", "program", "tets", "seconds", "seconds by phase", "M tets/s", "rate of lapd / of this", "peak bytes per tet"]
    head += ["mesh to image: mean, largest", "image to mesh: mean, largest", "labels lost"]
    rows = []
    for case in cases:
        for program, done in case.runs.items():
            if program == "delaunay":
                continue
            mine, tets = program == "lapd", statistics.median_low(run["tets"] for run in done)
            # Run against run of the same turn: what slows the machine slows both.
            ratios = [a["rate"] / b["rate"] for a, b in zip(case.runs["lapd"], done)]
            peak = case.memory["peak_extract"] if mine else statistics.median(run["peak_rss_bytes"] for run in done)
            found = case.measured[program]
            rows.append([
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
            ])
    return markdown(head, rows)


def kernel_table(cases):
    head = ["image", "vertices, box included", "tets of the whole triangulation", "refine, s", "Delaunay_triangulation_3, s"]
    head += ["refine / Delaunay", "distance, part of the whole", "bytes per tet beyond image and oracle", "peak after distance, refine, extract, MB"]
    rows = []
    for case in cases:
        lapd, delaunay = case.runs["lapd"], case.runs["delaunay"]
        refine = [run["seconds"]["refine"] for run in lapd]
        plain = [run["seconds"] for run in delaunay]
        peaks = [case.memory[f"peak_{phase}"] / 1e6 for phase in ("distance", "refine", "extract")]
        rows.append([
            case.name,
            str(lapd[0]["all_vertices"]),
            str(lapd[0]["all_tets"]),
            spread(refine, 3),
            spread(plain, 3),
            spread([a / b for a, b in zip(refine, plain)], 2),
            spread([100 * run["seconds"]["distance"] / run["span"] for run in lapd], 1) + " %",
            f"{beyond_volumes(case.memory, lapd[0]):.0f}",
            ", ".join(f"{peak:.0f}" for peak in peaks),
        ])
    return markdown(head, rows)


def beyond_volumes(memory, run):
    """Bytes per tet of the whole triangulation: the peak until the end of extraction, without program, image and oracle."""
    return (memory["peak_extract"] - memory["read"] - run["oracle_bytes"]) / run["all_tets"]


def bounds_table(cases):
    head = ["image", "lapd: delta, size"] + [f"{TAGS[tag]}: facet size, facet distance, cell size" for tag in cases[0].factors]
    rows = []
    for case in cases:
        theirs = [", ".join(f"{value:.4g}" for value in criteria(case.delta, factor)) for factor in case.factors.values()]
        rows.append([case.name, f"{case.delta:g}, {2 * case.delta:g}", *theirs])
    return markdown(head, rows)


# ---- The machine ----


def first_line(command):
    try:
        return execute(command).splitlines()[0].strip()
    except (FileNotFoundError, IndexError):
        return "unknown"


def field(path, name, separator):
    """What stands after `name` in a file of the system."""
    try:
        for line in pathlib.Path(path).read_text(errors="replace").splitlines():
            key, found, value = line.partition(separator)
            if found and key.strip() == name:
                return value.strip().strip('"')
    except OSError:
        pass
    return "unknown"


class Bystanders:
    """What the machine does beside our programs, from the making of this on: work of others that a bench must tell of."""

    def __init__(self):
        self.start = self.read()

    @staticmethod
    def read():
        """Seconds: those of the clock, busy ones of all cores, stolen ones, those of our own programs."""
        words = pathlib.Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]
        user, nice, system, _, _, irq, soft_irq, stolen = (int(word) / os.sysconf("SC_CLK_TCK") for word in words[:8])
        own = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return time.monotonic(), user + nice + system + irq + soft_irq, stolen, sum(use.ru_utime + use.ru_stime for use in own)

    def describe(self):
        wall, busy, stolen, own = (now - then for now, then in zip(self.read(), self.start))
        others = max(busy - own, 0) / wall
        return f"other programs kept {others:.2f} cores busy meanwhile; the host withheld {stolen / wall:.2f}"


def machine(bystanders, versions):
    """Lines about where and with what the figures were made."""
    memory = field("/proc/meminfo", "MemTotal", ":").split()[0]
    gib = f"{int(memory) / 2**20:.0f} GiB" if memory.isdigit() else memory
    system = f"{field('/etc/os-release', 'PRETTY_NAME', '=')}, {platform.system()} {platform.release()}"
    commit = "unknown"
    if (ROOT / ".git").exists():
        commit = first_line(["git", "-C", ROOT, "rev-parse", "--short=12", "HEAD"])
        # The tables that this program writes are no change of what was measured.
        changes = execute(["git", "-C", ROOT, "status", "--porcelain", "--untracked-files=no", "--", ".", f":!{DOCS.relative_to(ROOT)}"])
        commit += " with changes" if changes else ""
    lapd = field(ROOT / "Cargo.toml", "version", "=")
    return "\n".join([
        f"- {datetime.date.today().isoformat()}, lapd {lapd}, commit {commit}{''.join(', ' + version for version in versions)}",
        f"- {field('/proc/cpuinfo', 'model name', ':')}, {os.cpu_count()} cores, {gib} of memory; {system}",
        f"- {first_line(['c++', '--version'])}, -O3; {first_line(['rustc', '--version'])}, profile release",
        f"- {bystanders.describe()}",
    ])


def publish(part, text, options):
    """Prints the text, and puts it between the marks of that part in docs/benchmarks.md."""
    print(text)
    if options.print_only:
        return
    begin, end = f"<!-- {part}: written by {part}.sh -->", f"<!-- end of {part} -->"
    page = DOCS.read_text(encoding="utf-8")
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if len(pattern.findall(page)) != 1:
        fail(f"{DOCS.relative_to(ROOT)} has no part between {begin} and {end}")
    DOCS.write_text(pattern.sub(lambda _: f"{begin}\n{text}\n{end}", page), encoding="utf-8")
    say(f"written into {DOCS.relative_to(ROOT)}")


# ---- Commands ----


def compare(options):
    bystanders = Bystanders()
    images = {name: find_image(name) for name in options.images.split(",")}
    images = {name: path for name, path in images.items() if path} or {"balls": find_image("balls")}
    cases = []
    for name, image in images.items():
        cases.append(compare_image(name, image, options))
        (RESULTS / "compare.json").write_text(json.dumps([dataclasses.asdict(case) for case in cases], indent=1))
    version = cases[0].runs["parallel"][0]["version"]
    threads = "one thread each" if options.threads == 1 else f"{options.threads} threads, but one for the Delaunay triangulation"
    runs = "one run" if options.runs == 1 else f"medians of {options.runs} runs in turn, with least and largest"
    parts = [
        machine(bystanders, [version]),
        f"About {options.tets / 1e6:g} M tets with a label, {threads}; {runs}.",
        main_table(cases),
        kernel_table(cases),
        bounds_table(cases),
    ]
    publish("run", "\n\n".join(parts), options)


def growth(options):
    bystanders = Bystanders()
    image = find_image(options.image) or find_image("balls")
    name = options.image if image.name != "balls.nrrd" else "balls"
    limit = ["--max-memory", int(MOST_MEMORY * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES"))]

    def measure(delta):
        return ours(image, delta, options.threads, "--memory", *limit)

    # The first round looks for the bounds and measures memory; the later ones are timed. The first bound is tuned; from there on each aims at
    # twice the tets, and what it misses by the next one makes up for.
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
        say(f"    delta {delta:g}: {report['tets']} tets, refine {report['seconds']['refine']:.2f} s")
    runs = [[] for _ in sizes]
    for turn in range(options.runs):
        for (delta, _), done in zip(sizes, runs):
            done.append(ours(image, delta, options.threads, *limit))
        say(f"    run {turn + 1}: " + ", ".join(f"{done[-1]['span']:.2f}" for done in runs) + " s")
        (RESULTS / "growth.json").write_text(json.dumps([{"memory": first, "runs": done} for (_, first), done in zip(sizes, runs)], indent=1))

    head = ["delta, size", "tets", "tets of the whole triangulation", "distance, s", "refine, s", "extract, s", "refine, M tets/s", "whole, M tets/s"]
    head += ["refine, M tets of the whole triangulation/s", "bytes per tet of it beyond image and oracle"]
    rows, refine_rates, whole_rates = [], [], []
    for (delta, first), done in zip(sizes, runs):
        refine = [run["tets"] / run["seconds"]["refine"] / 1e6 for run in done]
        whole = [run["rate"] / 1e6 for run in done]
        refine_rates.append(statistics.median(refine))
        whole_rates.append(statistics.median(whole))
        rows.append([f"{delta:g}, {2 * delta:g}", str(first["tets"]), str(first["all_tets"])])
        rows[-1] += [spread([run["seconds"][phase] for run in done], 2) for phase in ("distance", "refine", "extract")]
        rows[-1] += [spread(refine, 3), spread(whole, 3), f"{statistics.median(refine) * first['all_tets'] / first['tets']:.3f}"]
        rows[-1].append(f"{beyond_volumes(first['memory_bytes'], first):.0f}")

    def fall(rates):
        return f"{100 * (rates[-1] / rates[0] - 1):+.1f} % against the coarsest mesh, {100 * (rates[-1] / max(rates) - 1):+.1f} % against the fastest"

    runs_text = "one run" if options.runs == 1 else f"medians of {options.runs} rounds through all sizes, with least and largest"
    threads = "one thread" if options.threads == 1 else f"{options.threads} threads"
    parts = [
        machine(bystanders, []),
        f"{name}, {threads}; {runs_text}.",
        markdown(head, rows),
        f"The rate of the finest mesh: refine {fall(refine_rates)}; whole {fall(whole_rates)}.",
    ]
    publish("growth", "\n\n".join(parts), options)


def at_least_one(text):
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text}")
    return int(text)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    one = commands.add_parser("compare", help="ours and the peers")
    one.add_argument("--runs", type=at_least_one, default=5, help="timed runs of each program (5)")
    one.add_argument("--images", default="aal,brain,abdomen", help="aal, brain, abdomen, balls, separated by commas")
    one.add_argument("--tets", type=at_least_one, default=1_000_000, help="tets of each mesh (1000000)")
    two = commands.add_parser("growth", help="ours, finer and finer")
    two.add_argument("--runs", type=at_least_one, default=3, help="timed rounds through all sizes (3)")
    two.add_argument("--image", default="abdomen", help="aal, brain, abdomen or balls (abdomen)")
    two.add_argument("--from", dest="smallest", type=at_least_one, default=250_000, help="tets of the coarsest mesh (250000)")
    two.add_argument("--to", dest="largest", type=at_least_one, default=16_000_000, help="tets of the finest one (16000000)")
    for command in (one, two):
        command.add_argument("--threads", type=at_least_one, default=1, help="threads of each program (1)")
        command.add_argument("--print-only", action="store_true", help="leave docs/benchmarks.md as it is")
    options = parser.parse_args()
    RESULTS.mkdir(parents=True, exist_ok=True)
    {"compare": compare, "growth": growth}[options.command](options)


if __name__ == "__main__":
    main()
