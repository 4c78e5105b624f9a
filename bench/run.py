# SPDX-License-Identifier: Apache-2.0
"""Runs benchmarks, keeps their figures and compares them with kept ones (README.md). `./run bench` calls it."""

import argparse
import datetime
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

SOURCE = Path(__file__).resolve().parent
FORMAT = "citylearn-bench-1"
SLOWER, FAILED, SKIPPED = 1, 2, 77
TOLERANCE = 0.03  # a change below it is never called slower: code moves in memory, clocks drift

# The benchmarks that record figures, with arguments that let each repetition take seconds.
REPEATED = {
    "roundtrip": ["--rounds", "1", "--trips", "2000"],
    "loop": ["40000"],
    "services": ["--rounds", "1", "--steps", "20000"],
    "roles": ["20000"],
    "images": ["1"],
    "threads": ["--rounds", "3"],
    "store": ["20000"],
    "encoder": ["--rounds", "5"],
    "encoding": ["--rounds", "3"],
    "startup": ["--rounds", "3"],
    "peers": ["--environments"],
}


class Failure(Exception):
    """An error that one line explains."""


def arguments():
    parser = argparse.ArgumentParser(
        prog="./run bench", formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Runs the benchmarks NAME, or all, and prints what they print. With --keep, --compare or\n"
        "--against each is repeated with short arguments, and its figures are kept or compared.",
        epilog=f"repeated by default: {', '.join(REPEATED)}\nstatus: 0, 1 when something is slower, 2 after an error\n"
        "bench/README.md says how to read the result.")
    parser.add_argument("--build", help=argparse.SUPPRESS)
    parser.add_argument("names", nargs="*", metavar="NAME", help="a folder of bench/, or a case of bench/cases")
    parser.add_argument("--keep", type=Path, metavar="FILE", help="keep the figures here, for a later --compare")
    parser.add_argument("--compare", type=Path, metavar="FILE", help="say what is slower than these kept figures")
    parser.add_argument("--against", type=Path, metavar="BUILD",
                        help="say what is slower than another build folder, both measured by turns")
    parser.add_argument("--repeat", type=int, default=5, metavar="N", help="repetitions, at least 3 (default: 5)")
    parser.add_argument("--check", action="store_true", help=argparse.SUPPRESS)  # only looks at the arguments
    args = parser.parse_intermixed_args()
    if args.repeat < 3:
        parser.error("--repeat: a spread needs at least 3 repetitions")
    if args.compare and args.against:
        parser.error("--compare and --against exclude each other")
    args.measures = bool(args.keep or args.compare or args.against)
    known = sorted(REPEATED if args.measures else [path.parent.name for path in SOURCE.glob("*/README.md")] +
                   [path.stem for path in SOURCE.glob("cases/*.md")])
    for name in args.names:
        if name not in known:
            what = "benchmark that records figures" if args.measures else "benchmark"
            parser.error(f"'{name}' is not a {what}; known: {', '.join(known)}")
    args.names = args.names or (list(REPEATED) if args.measures else known)
    return args


def command(build, name):
    """Returns the words that start a benchmark of a build folder. Raises Failure."""
    script = SOURCE / name / f"{name}.py"
    if script.exists():
        return ["/usr/bin/python3", "-B", str(script), str(build)]  # Debian's, which has numpy
    words = [Path(build) / f"bench/{name}/bench_{name}"]
    if (SOURCE / f"cases/{name}.md").exists():
        words = [Path(build) / "bench/cases/bench_cases", name]
    if not words[0].exists():
        raise Failure(f"{words[0]} is missing; build it with ./run build")
    return list(map(str, words))


def machine():
    """Returns what must be equal for results to be comparable: processor and number of processors that may be used."""
    models = [line.split(":", 1)[1].strip() for line in Path("/proc/cpuinfo").read_text().splitlines()
              if line.startswith("model name")]
    return {"processor": models[0] if models else os.uname().machine, "processors": len(os.sched_getaffinity(0))}


def described(one):
    return f"{one['processor']}, {one['processors']} processors"


def revision():
    done = subprocess.run(["git", "describe", "--always", "--dirty"], cwd=SOURCE, capture_output=True, text=True,
                          check=False)
    return done.stdout.strip() or "unknown"


def run_all(build, names):
    """Runs benchmarks with their own defaults and shows what they print. Returns the status of this program."""
    failed = []
    for name in names:
        print(f"== {name}", flush=True)
        if subprocess.run(command(build, name), check=False).returncode not in (0, SKIPPED):
            failed.append(name)
    if failed:
        raise Failure(f"failed: {', '.join(failed)}")
    return 0


# --- Results: {"format", "machine", "revision", "date", "others", "figures": {NAME: {"arguments", "figures": {...}}}}

def load(path):
    """Returns a kept result. Raises Failure unless it is one of this machine."""
    try:
        result = json.loads(path.read_text())
    except FileNotFoundError:
        raise Failure(f"{path} does not exist; keep a result there with ./run bench --keep {path}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise Failure(f"{path} cannot be read: {getattr(error, 'strerror', None) or 'it is not text'}") from None
    except json.JSONDecodeError as error:
        raise Failure(f"{path}:{error.lineno}: is not JSON ({error.msg}); keep a result anew with --keep") from None
    if not isinstance(result, dict) or result.get("format") != FORMAT:
        raise Failure(f"{path} is not a result of ./run bench --keep in format {FORMAT}; keep one anew")
    try:
        check(result)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise Failure(f"{path} is damaged ({type(error).__name__}: {error}); keep a result anew with --keep") from None
    if result["machine"] != machine():
        raise Failure(f"{path} was kept on another machine ({described(result['machine'])}; this one is "
                      f"{described(machine())}); keep a result here with --keep")
    return result


def check(result):
    """Raises an error unless the result has what a comparison reads."""
    described(result["machine"]), result["revision"] + result["date"], float(result["others"])
    for benchmark in result["benchmarks"].values():
        list(benchmark["arguments"])
        for figure in benchmark["figures"].values():
            if figure["better"] not in ("lower", "higher") or not figure["unit"] + "" or not figure["values"]:
                raise ValueError("a figure without 'better', 'unit' or 'values'")
            if min(map(float, figure["values"])) <= 0:
                raise ValueError("a figure that is not positive")


def save(result, path):
    temporary = path.with_name(path.name + ".part")
    try:
        temporary.write_text(json.dumps(result, indent=1) + "\n")
        temporary.replace(path)
    except OSError as error:
        raise Failure(f"{path} cannot be written: {error.strerror}") from None


# --- Measuring

def run_once(build, name, log):
    """Runs a benchmark with its short arguments. Returns its figures, {} if it was skipped. Raises Failure."""
    with tempfile.NamedTemporaryFile("r", prefix="citylearn-bench-") as lines:
        done = subprocess.run(command(build, name) + REPEATED[name], stdin=subprocess.DEVNULL, stdout=log, stderr=log,
                              env={**os.environ, "CITYLEARN_BENCH_FIGURES": lines.name}, check=False)
        if done.returncode not in (0, SKIPPED):
            raise Failure(f"{name} failed with status {done.returncode}; what it printed is in {log.name}")
        figures = {}
        for line in lines:
            figure = json.loads(line)
            figures[figure.pop("name")] = figure
        return figures


def busy_seconds():
    """Returns the time that this machine's processors have worked, and that our programs have taken."""
    ticks = [int(word) for word in Path("/proc/stat").read_text().split("\n", 1)[0].split()[1:9]]
    user, nice, system, _idle, _iowait, interrupt, soft_interrupt, _stolen = ticks
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    busy = user + nice + system + interrupt + soft_interrupt
    return busy / os.sysconf("SC_CLK_TCK"), used.ru_utime + used.ru_stime


def measure(builds, names, repeat):
    """Returns a result of each build. The builds and benchmarks take turns, so that a change of the machine's load
    meets all alike."""
    results = [{"format": FORMAT, "machine": machine(), "revision": revision(),
                "date": datetime.datetime.now().isoformat(" ", "minutes"), "others": 0.0,
                "benchmarks": {name: {"arguments": REPEATED[name], "figures": {}} for name in names}} for _ in builds]
    with open(Path(builds[0]) / "bench/run.log", "w", encoding="utf-8") as log:
        (all_before, ours_before), begin = busy_seconds(), datetime.datetime.now()
        for repetition in range(repeat):
            for name in names:
                print(f"{name}, {repetition + 1} of {repeat}", file=sys.stderr, flush=True)
                for build, result in list(zip(builds, results))[::1 if repetition % 2 else -1]:
                    for figure, values in run_once(build, name, log).items():
                        kept = result["benchmarks"][name]["figures"].setdefault(figure, {**values, "values": []})
                        kept.pop("value", None)
                        kept["values"].append(values["value"])
        all_after, ours_after = busy_seconds()
        seconds = (datetime.datetime.now() - begin).total_seconds() * os.cpu_count()
    for result in results:
        result["others"] = round(max(0.0, all_after - all_before - (ours_after - ours_before)) / seconds, 3)
    return results


# --- Comparing

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


def number(value):
    return f"{value:,.0f}" if value >= 1000 else f"{value:.3g}"


def compare(before, now):
    """Prints a table of all figures. Returns how many are slower."""
    for when, one in (("before", before), ("now", now)):
        print(f"{when + ':':<7} {one['revision']}, {one['date']}; other programs used {one['others']:.0%} "
              "of the processors")
    print(f"\n{'benchmark':<10} {'figure':<44} {'before':>9} {'now':>9} {'unit':<10} {'change':>8} {'noise':>7}")
    counts = {"slower": 0, "faster": 0, "": 0}
    for name, benchmark in now["benchmarks"].items():
        old = before["benchmarks"].get(name)
        if old is None:
            print(f"{name:<10} was not measured before")
        elif old["arguments"] != benchmark["arguments"]:
            print(f"{name:<10} was measured with other arguments before ({' '.join(old['arguments'])})")
            continue
        for figure, values in benchmark["figures"].items():
            median = number(statistics.median(values["values"]))
            kept = old and old["figures"].get(figure)
            if not kept or kept["unit"] != values["unit"]:
                print(f"{name:<10} {figure:<44} {'':>9} {median:>9} {values['unit']:<10}    new")
                continue
            change, noise, what = verdict(kept, values)
            counts[what] += 1
            old_median = number(statistics.median(kept["values"]))
            print(f"{name:<10} {figure:<44} {old_median:>9} {median:>9} {values['unit']:<10} {change:>+8.1%} "
                  f"{noise:>7.1%}  {what}".rstrip())
        for figure in (old or {"figures": {}})["figures"].keys() - benchmark["figures"].keys():
            print(f"{name:<10} {figure:<44} was measured before, but not now")
    print(f"\n{counts['slower']} slower, {counts['faster']} faster, {counts['']} unchanged within the noise: "
          f"{TOLERANCE:.0%} and the distances of both results' quartiles")
    if max(before["others"], now["others"]) > 0.1:
        print("Other programs used the machine: repeat on a quiet one, or use --against, before you believe it.")
    return counts["slower"]


def show(result):
    print(f"{'benchmark':<10} {'figure':<44} {'median':>9} {'unit':<10} {'quartiles':>9}")
    for name, benchmark in result["benchmarks"].items():
        for figure, values in benchmark["figures"].items():
            print(f"{name:<10} {figure:<44} {number(statistics.median(values['values'])):>9} {values['unit']:<10} "
                  f"{spread(values['values']):>9.1%}")
        if not benchmark["figures"]:
            print(f"{name:<10} was skipped")


def main():
    args = arguments()
    try:
        before = load(args.compare) if args.compare else None
        if args.keep and not args.keep.absolute().parent.is_dir():
            raise Failure(f"{args.keep} cannot be written: there is no folder {args.keep.parent}")
        if args.against:
            command(args.against, args.names[0])
        if args.check:
            return 0
        if not args.measures:
            return run_all(args.build, args.names)
        now, *others = measure([args.build] + ([args.against] if args.against else []), args.names, args.repeat)
        before = others[0] if others else before
        if args.against:
            before["revision"], now["revision"] = str(args.against), str(args.build)
        if args.keep:
            save(now, args.keep)
        slower = 0
        if before:
            slower = compare(before, now)
        else:
            show(now)
        if args.keep:
            print(f"kept in {args.keep}; compare later with ./run bench --compare {args.keep}")
        return SLOWER if slower else 0
    except Failure as error:
        print(f"bench: {error}", file=sys.stderr)
        return FAILED


if __name__ == "__main__":
    sys.exit(main())
