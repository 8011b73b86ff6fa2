"""What the benches share: images, runs of our mesher, the search for bounds, tables, and the lines
about the machine.

peers/peers.py and threads.py use it. Everything that was run is kept as JSON in build/benches/.
Needs the standard library only.
"""

import argparse
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

ROOT = pathlib.Path(__file__).resolve().parents[1]
BUILD = ROOT / "build"
RESULTS = BUILD / "benches"
DOCS = ROOT / "docs" / "notes" / "benchmarks.md"

# Where the search for bounds starts, for a million tets: delta in world units. Size is always twice
# delta.
START = {"aal": 1.35, "brain": 1.97, "abdomen": 1.61, "balls": 0.55}
# The exponent of delta in the number of tets, as a first guess: between that of surfaces, 2, and
# that of volumes, 3.
EXPONENT = 2.6
# How far the number of tets may be from what was asked for, and with several threads from that of
# other runs with the same bounds.
OURS_WITHIN, RUNS_WITHIN = 0.03, 0.02
TRIES = 6


def fail(line):
    sys.exit(f"{pathlib.Path(sys.argv[0]).name}: {line}")


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
    header = (
        f"NRRD0004\ntype: uchar\ndimension: 3\nsizes: {n} {n} {n}\nencoding: raw\nspacings: 1 1 1\n"
        "\n"
    )
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


def find_images(names):
    """Paths by name, of the images that there are; a phantom where there are none."""
    found = {name: find_image(name) for name in names.split(",")}
    return {name: path for name, path in found.items() if path} or {"balls": find_image("balls")}


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
    # The same spacing everywhere: meshes of a given number of tets are compared, and thin parts
    # would decide it. Refinement is what is compared: nobody's optimiser runs.
    bounds = [
        "--delta",
        repr(delta),
        "--size",
        repr(2 * delta),
        "--no-adaptive",
        "--improve",
        "none",
        "--threads",
        threads,
    ]
    execute([BUILD / "bin" / "mesh_image", image, *bounds, "--quiet", "--report", report, *more])
    found = json.loads(report.read_text())
    found["span"] = sum(found["seconds"][phase] for phase in ("prepare", "refine", "extract"))
    found["rate"] = found["tets"] / found["span"]
    return found


def tune(what, value, target, within, run):
    """Looks for the bound at which `run` gives `target` tets: (bound, report). By the law of
    powers through the last two tries."""
    exponent, tries = EXPONENT, []
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
    return fail(
        f"{what} gives {tries[-1][1]} tets, not within {100 * within:g} % of {target}, after "
        f"{TRIES} tries"
    )


def tune_ours(name, tets, run):
    """The delta at which our mesh of an image has so many tets: (delta, report)."""
    start = float(f"{START[name] * (1e6 / tets) ** (1 / EXPONENT):.4g}")
    return tune("delta", start, tets, OURS_WITHIN, run)


def check_tets(name, reports):
    """Runs with the same bounds: one thread makes the same mesh each time, several make nearly
    as many tets."""
    wanted = reports[0]
    for report in reports:
        same = all(report[count] == wanted[count] for count in ("tets", "all_tets"))
        if not same and report["threads"] == wanted["threads"] == 1:
            fail(
                f"{name}: our number of tets differs from run to run: {wanted['tets']} and "
                f"{report['tets']}"
            )
        if abs(report["tets"] / wanted["tets"] - 1) > RUNS_WITHIN:
            counts = " and ".join(
                f"{run['tets']} with {threads_text(run['threads'])}" for run in (wanted, report)
            )
            fail(f"{name}: tets are {counts}: more than {100 * RUNS_WITHIN:g} % apart")


# ---- Tables ----


def spread(values, digits):
    """Median, and in brackets the least and the largest."""
    low, middle, high = (
        f"{value:.{digits}f}" for value in (min(values), statistics.median(values), max(values))
    )
    return middle if len(values) == 1 else f"{middle} ({low} to {high})"


def markdown(head, rows):
    align = [
        (
            "---"
            if name in ("image", "program", "algorithm", "manager", "begging", "scaling")
            else "---:"
        )
        for name in head
    ]
    lines = ["| " + " | ".join(row) + " |" for row in [head, *rows]]
    return "\n".join([lines[0], "|" + "|".join(align) + "|", *lines[1:]])


def threads_text(threads):
    return "one thread" if threads == 1 else f"{threads} threads"


def runs_text(runs, turns="in turn"):
    return "one run" if runs == 1 else f"medians of {runs} runs {turns}, with least and largest"


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
    """What the machine does beside our programs, from the making of this on: work of others that
    a bench must tell of."""

    def __init__(self):
        self.start = self.read()

    @staticmethod
    def read():
        """Seconds: those of the clock, busy ones of all cores, stolen ones, those of our own
        programs."""
        words = pathlib.Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:]
        user, nice, system, _, _, irq, soft_irq, stolen = (
            int(word) / os.sysconf("SC_CLK_TCK") for word in words[:8]
        )
        own = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
        return (
            time.monotonic(),
            user + nice + system + irq + soft_irq,
            stolen,
            sum(use.ru_utime + use.ru_stime for use in own),
        )

    def describe(self):
        wall, busy, stolen, own = (now - then for now, then in zip(self.read(), self.start))
        others = max(busy - own, 0) / wall
        return (
            f"other programs kept {others:.2f} cores busy meanwhile; the host withheld "
            f"{stolen / wall:.2f}"
        )


def machine(bystanders, versions):
    """Lines about where and with what the figures were made."""
    memory = field("/proc/meminfo", "MemTotal", ":").split()[0]
    gib = f"{int(memory) / 2**20:.0f} GiB" if memory.isdigit() else memory
    system = (
        f"{field('/etc/os-release', 'PRETTY_NAME', '=')}, {platform.system()} {platform.release()}"
    )
    commit = "unknown"
    if (ROOT / ".git").exists():
        commit = first_line(["git", "-C", ROOT, "rev-parse", "--short=12", "HEAD"])
        # The tables that this program writes are no change of what was measured.
        changes = execute(
            [
                "git",
                "-C",
                ROOT,
                "status",
                "--porcelain",
                "--untracked-files=no",
                "--",
                ".",
                f":!{DOCS.relative_to(ROOT)}",
            ]
        )
        commit += " with changes" if changes else ""
    lapd = field(ROOT / "Cargo.toml", "version", "=")
    return "\n".join(
        [
            f"- {datetime.date.today().isoformat()}, lapd {lapd}, commit "
            f"{commit}{''.join(', ' + version for version in versions)}",
            f"- {field('/proc/cpuinfo', 'model name', ':')}, {os.cpu_count()} cores, {gib} of "
            f"memory; {system}",
            f"- {first_line(['c++', '--version'])}, -O3; {first_line(['rustc', '--version'])}, "
            "profile release",
            f"- {bystanders.describe()}",
        ]
    )


def publish(part, script, text, options, behind=()):
    """Prints the text, and puts it between the marks of that part in docs/notes/benchmarks.md. A
    part that is not there yet comes behind the last of those named."""
    print(text)
    if options.print_only:
        return
    begin, end = f"<!-- {part}: written by {script} -->", f"<!-- end of {part} -->"
    page = DOCS.read_text(encoding="utf-8")
    before = [mark for mark in (f"<!-- end of {other} -->" for other in behind) if mark in page]
    if begin not in page and before:
        page = page.replace(before[-1], f"{before[-1]}\n\n{begin}\n{end}", 1)
    pattern = re.compile(re.escape(begin) + ".*?" + re.escape(end), re.DOTALL)
    if len(pattern.findall(page)) != 1:
        fail(f"{DOCS.relative_to(ROOT)} has no part between {begin} and {end}")
    DOCS.write_text(pattern.sub(lambda _: f"{begin}\n{text}\n{end}", page), encoding="utf-8")
    say(f"written into {DOCS.relative_to(ROOT)}")


# ---- Options ----


def at_least_one(text):
    if not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"must be a whole number of at least 1, got {text}")
    return int(text)
