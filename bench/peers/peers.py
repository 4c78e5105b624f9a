# SPDX-License-Identifier: Apache-2.0
"""Compares citylearn with what Python offers for the same, in one run. README.md states the questions."""

import argparse
import json
import os
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[2] / "tests/support"))

WORLD = {"synthetic_images": 0, "synthetic_frames": 128, "frames": 128}  # 128 places, 64 features each


def arguments():
    parser = argparse.ArgumentParser(prog="peers.py", description=__doc__.splitlines()[0],
                                     formatter_class=argparse.ArgumentDefaultsHelpFormatter)
    parser.add_argument("build", type=Path, help="build folder")
    parser.add_argument("--environments", action="store_true", help="only the first question: stepping environments")
    parser.add_argument("--learning", action="store_true", help="only the second question: PPO")
    parser.add_argument("--rounds", type=int, default=5, help="measurements of each environment, by turns")
    parser.add_argument("--seeds", type=int, nargs="+", default=[1], help="of the trainings")
    parser.add_argument("--steps", type=int, default=360_000, help="environment steps of a training, at most")
    parser.add_argument("--time-limit", type=float, default=300, help="seconds of a training, at most")
    parser.add_argument("--threads", type=int, default=len(os.sched_getaffinity(0)), help="of ppo")
    parser.add_argument("--torch-threads", type=int, default=1, help="of RecurrentPPO")
    args = parser.parse_args()
    args.build = args.build.resolve()
    return args


def record_figure(name, value, unit, better="higher"):
    """Appends a figure as record_figure of bench/figures.h does."""
    if path := os.environ.get("CITYLEARN_BENCH_FIGURES"):
        with open(path, "a", encoding="utf-8") as out:
            print(json.dumps({"name": name, "value": value, "unit": unit, "better": better}), file=out)


def main():
    args = arguments()
    for library in ("OMP", "OPENBLAS"):  # before they are loaded
        os.environ[f"{library}_NUM_THREADS"] = str(args.torch_threads)
    sys.path.insert(0, str(args.build / "python"))
    try:
        import citylearn
        import numpy
    except ImportError as error:
        sys.exit(f"peers.py: {error} (./run bench peers builds and finds what it needs)")
    if args.environments or not args.learning:
        import environments
        environments.compare(args.build, WORLD, args.rounds, record_figure)
    if args.learning or not args.environments:
        import learning
        learning.compare(args, WORLD, record_figure)


if __name__ == "__main__":
    main()
