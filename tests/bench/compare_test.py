# SPDX-License-Identifier: Apache-2.0
"""Compares results of programs that record figures of the test's choice: compare_test.py SOURCE"""

import json
import os
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SOURCE = Path(sys.argv.pop(1)).resolve()

# Records figures: at each call the next line of the file beside it, and after the last one the first again.
PROGRAM = """#!/bin/sh
here=$(dirname "$0")
calls=$(cat "$here/calls" 2>/dev/null || echo 0)
echo $((calls + 1)) >"$here/calls"
lines=$(wc -l <"$here/figures")
line=$(sed -n "$((calls % lines + 1))p" "$here/figures")
[ "$line" != fail ] || { echo no luck; exit 1; }
[ "$line" != skip ] || { echo "skipped: no model"; exit 0; }
printf '%s' "$line" | tr ';' '\\n' >>"$CITYLEARN_BENCH_FIGURES"
echo >>"$CITYLEARN_BENCH_FIGURES"
"""


def line(rate, time=20.0):
    """Returns what a program records at one call: a rate and a time."""
    return (json.dumps({"name": "rate", "value": rate, "unit": "steps/s", "better": "higher"}) + ";"
            + json.dumps({"name": "time", "value": time, "unit": "us", "better": "lower"}))


class Compare(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        self.build = self.made("build", [line(1000)])

    def made(self, name, lines):
        """Returns a build folder whose program for loop records these lines."""
        program = self.folder / name / "bench/cases/bench_cases"
        folder = program.parent
        folder.mkdir(parents=True, exist_ok=True)
        program.write_text(PROGRAM)
        program.chmod(0o755)
        (folder / "figures").write_text("\n".join(lines) + "\n")
        (folder / "calls").unlink(missing_ok=True)
        return self.folder / name

    def bench(self, *words, status):
        """Runs ./run bench loop without building. Returns what it says; its status must be this."""
        done = subprocess.run([SOURCE / "run", "bench", "loop", *map(str, words)], capture_output=True, text=True,
                              check=False, env={**os.environ, "CITYLEARN_BUILD": str(self.build)})
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done.stdout if status < 2 else done.stderr

    def before(self, *lines):
        self.made("before", lines)

    def compared(self, *lines, status):
        """Returns the rows of the comparison of such a program with the one before, by the figure's name."""
        self.made("build", lines)
        said = self.bench("--against", self.folder / "before", status=status)
        return {words[1]: words for words in map(str.split, said.splitlines()) if words[:1] == ["loop"]}

    def test_what_is_slower_beyond_the_noise_is_said(self):
        self.before(*[line(rate) for rate in (1000, 1010, 990, 1005, 995)])
        rows = self.compared(*[line(rate) for rate in (900, 910, 890, 905, 895)], status=1)
        self.assertEqual(rows["rate"][2:], ["1,000", "900", "steps/s", "-10.0%", "5.1%", "slower"])
        self.assertNotIn("slower", rows["time"])

    def test_a_longer_time_is_slower_too(self):
        self.before(line(1000, 20))
        rows = self.compared(line(1000, 22), status=1)
        self.assertEqual(rows["time"][-3:], ["+10.0%", "3.0%", "slower"])
        self.assertEqual(self.compared(line(1000, 18), status=0)["time"][-1], "faster")

    def test_the_same_change_within_the_noise_is_not(self):
        self.before(*[line(rate) for rate in (1000, 1100, 900, 1050, 950)])
        rows = self.compared(*[line(rate) for rate in (900, 1000, 810, 950, 850)], status=0)
        self.assertEqual(rows["rate"][5], "-10.0%")
        self.assertNotIn("slower", rows["rate"])

    def test_one_outlier_is_neither_slow_nor_noise(self):
        self.before(*[line(rate) for rate in (1000, 1000, 1000, 1000, 100)])
        self.compared(line(1000), *[line(1000)] * 3, line(100), status=0)
        self.assertIn("slower", self.compared(line(900), status=1)["rate"])

    def test_both_builds_take_turns(self):
        self.before(line(1000))
        self.compared(line(900), status=1)
        for build in ("build", "before"):
            self.assertEqual((self.folder / build / "bench/cases/calls").read_text(), "5\n")

    def test_a_figure_that_is_missing_or_new_is_said(self):
        self.before(line(1000))
        rows = self.compared(line(1000).replace('"rate"', '"speed"'), status=0)
        self.assertEqual(rows["speed"][-2:], ["not", "before"])
        self.assertEqual(rows["rate"][-2:], ["not", "now"])

    def test_a_skipped_benchmark_is_said(self):
        self.before("skip")
        self.made("build", ["skip"])
        self.assertIn("loop       was skipped", self.bench("--against", self.folder / "before", status=0))

    def test_a_benchmark_that_fails_names_its_log(self):
        self.before(line(1000))
        self.made("build", [line(1000), "fail"])
        said = self.bench("--against", self.folder / "before", status=2)
        self.assertRegex(said, r"bench: loop failed with status 1; what it printed is in .*/bench/run.log\n")
        self.assertEqual((self.build / "bench/run.log").read_text(), "no luck\n")

    def test_wrong_arguments_are_one_clear_line(self):
        for words, pattern in ((["nothing"], "'nothing' is not a benchmark; known: .*loop"),
                               (["security", "--against", self.build], "not a benchmark that records figures"),
                               (["--against", self.build, "--repeat", "2"], "at least 3 repetitions")):
            self.assertRegex(self.bench(*words, status=2), pattern)
        self.assertRegex(self.bench("--against", self.folder / "no", status=2), "bench_cases is missing; build it")


if __name__ == "__main__":
    unittest.main()
