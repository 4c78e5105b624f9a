# SPDX-License-Identifier: Apache-2.0
"""Runs benchmarks, and compares two builds by their figures (README.md). `./run bench` calls it."""

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path

SOURCE = Path(__file__).resolve().parent
SLOWER, FAILED, SKIPPED = 1, 2, 77
TOLERANCE = 0.03  # a change below it is never called slower: code moves in memory, clocks drift

# The benchmarks that record figures, with arguments that let each repetition take seconds.
REPEATED = {
    "loop": ["40000"],
    "services": ["--rounds", "1", "--steps", "20000"],
    "roles": ["20000"],
    "beliefs": [],
}


class Failure(Exception):
    """An error that one line explains."""


def arguments():
    parser = argparse.ArgumentParser(
        prog="./run bench", formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Runs the benchmarks NAME, or all, and prints what they print. With --against each is\n"
        "repeated with short arguments, by turns with the other build, and figures are compared.",
        epilog=f"compared by default: {', '.join(REPEATED)}\nstatus: 0, 1 when something is slower, 2 after an error\n"
        "bench/README.md says how to read the result.")
    parser.add_argument("--build", type=Path, help=argparse.SUPPRESS)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a case of bench/cases")
    parser.add_argument("--against", type=Path, metavar="BUILD", help="say what is slower than another build folder")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="repetitions, at least 3 (default: 5)")
    parser.add_argument("--check", action="store_true", help=argparse.SUPPRESS)  # only looks at the arguments
    args = parser.parse_intermixed_args()
    if args.repeat < 3:
        parser.error("--repeat: a spread needs at least 3 repetitions")
    known = sorted(REPEATED if args.against else [path.stem for path in SOURCE.glob("cases/*.md")])
    for name in args.names:
        if name not in known:
            what = "benchmark that records figures" if args.against else "benchmark"
            parser.error(f"'{name}' is not a {what}; known: {', '.join(known)}")
    args.names = args.names or (list(REPEATED) if args.against else known)
    return args


def command(build, name):
    """Returns the words that start a benchmark of a build folder. Raises Failure."""
    program = build / "bench/cases/bench_cases"
    if not program.exists():
        raise Failure(f"{program} is missing; build it with ./run build")
    return [str(program), name]


def run_all(build, names):
    """Runs benchmarks with their own defaults and shows what they print. Raises Failure naming those that failed."""
    failed = []
    for name in names:
        print(f"== {name}", flush=True)
        if subprocess.run(command(build, name), check=False).returncode not in (0, SKIPPED):
            failed.append(name)
    if failed:
        raise Failure(f"failed: {', '.join(failed)}")


def run_once(build, name, log):
    """Runs a benchmark with its short arguments. Returns its figures by name, {} if it was skipped. Raises Failure."""
    with tempfile.NamedTemporaryFile("r", prefix="citylearn-bench-") as lines:
        done = subprocess.run(command(build, name) + REPEATED[name], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                              env={**os.environ, "CITYLEARN_BENCH_FIGURES": lines.name}, check=False)
        if done.returncode not in (0, SKIPPED):
            raise Failure(f"{name} failed with status {done.returncode}; what it printed is in {log.name}")
        return {figure.pop("name"): figure for figure in map(json.loads, lines)}


def busy_seconds():
    """Returns how long this machine's processors have worked for others than our programs."""
    ticks = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
    user, nice, system, _idle, _iowait, interrupt, soft_interrupt, _stolen = ticks
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = user + nice + system + interrupt + soft_interrupt
    return busy / os.sysconf("SC_CLK_TCK") - used.ru_utime - used.ru_stime


def measure(builds, names, repeat):
    """Returns the figures of each build, {(benchmark, figure): {"unit", "better", "values"}}, and the share of the
    processors that other programs used. The builds take turns, so that a change of the load meets all alike."""
    results = [{} for _ in builds]
    before, begin = busy_seconds(), time.monotonic()
    with open(builds[0] / "bench/run.log", "w", encoding="utf-8") as log:
        for repetition in range(repeat):
            for name in names:
                print(f"{name}, {repetition + 1} of {repeat}", file=sys.stderr, flush=True)
                for build, result in list(zip(builds, results))[::1 if repetition % 2 else -1]:
                    for figure, one in run_once(build, name, log).items():
                        result.setdefault((name, figure), {**one, "values": []})["values"].append(one["value"])
    seconds = (time.monotonic() - begin) * os.cpu_count()
    return results, max(0.0, busy_seconds() - before) / seconds


def spread(values):
    """Returns the distance of the quartiles, relative to the median."""
    low, _, high = statistics.quantiles(values, n=4, method="inclusive") if len(values) > 1 else values * 3
    return (high - low) / statistics.median(values)


def verdict(before, now):
    """Returns the relative change of the median, the noise beyond which it counts, and "slower", "faster" or ""."""
    change = statistics.median(now["values"]) / statistics.median(before["values"]) - 1
    noise = TOLERANCE + spread(before["values"]) + spread(now["values"])
    worse = change if now["better"] == "lower" else 1 / (1 + change) - 1  # of the time that it takes
    return change, noise, "slower" if worse > noise else "faster" if 1 / (1 + worse) - 1 > noise else ""


def compare(before, now, names):
    """Prints a table of all figures. Returns how many are slower."""
    def median(figure):
        value = statistics.median(figure["values"]) if figure else None
        return "" if value is None else f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"

    print(f"{'benchmark':<10} {'figure':<44} {'before':>9} {'now':>9} {'unit':<10} {'change':>8} {'noise':>7}")
    counts = {"slower": 0, "faster": 0, "": 0}
    for name, figure in {**now, **before}:
        old, new = before.get((name, figure)), now.get((name, figure))
        row = f"{name:<10} {figure:<44} {median(old):>9} {median(new):>9} {(new or old)['unit']:<10}"
        if not old or not new:
            print(row, "not before" if new else "not now")
            continue
        change, noise, what = verdict(old, new)
        counts[what] += 1
        print(f"{row} {change:>+8.1%} {noise:>7.1%}  {what}".rstrip())
    for name in set(names) - {name for name, _ in {**now, **before}}:
        print(f"{name:<10} was skipped")
    print(f"\n{counts['slower']} slower, {counts['faster']} faster, {counts['']} unchanged within the noise: "
          f"{TOLERANCE:.0%} and the distances of both results' quartiles")
    return counts["slower"]


def main():
    args = arguments()
    try:
        if args.against:
            command(args.against, args.names[0])
        if args.check:
            return 0
        if not args.against:
            run_all(args.build, args.names)
            return 0
        (now, before), others = measure([args.build, args.against], args.names, args.repeat)
        slower = compare(before, now, args.names)
        if others > 0.1:
            print(f"Other programs used {others:.0%} of the processors: repeat it on a quiet machine.")
        return SLOWER if slower else 0
    except Failure as error:
        print(f"bench: {error}", file=sys.stderr)
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
