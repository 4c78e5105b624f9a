# SPDX-License-Identifier: Apache-2.0
"""The page, figures and tables of ./run paper, from a small made-up study."""

import contextlib
import io
import json
import math
import sys
import tempfile
import unittest
from pathlib import Path

ROOT = Path(__file__).resolve().parents[5]
sys.path += [str(ROOT / "tools" / folder) for folder in ("paper/report", "vpr", "lab")]

import charts
import estimates
import policies
import recognition_page
import report
from page import Page


class TemporaryFolder(unittest.TestCase):
    def setUp(self) -> None:
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))

    def run_report(self) -> tuple[int, str]:
        errors = io.StringIO()
        with contextlib.redirect_stderr(errors):
            return report.main([str(self.folder)]), errors.getvalue()


def trial(traversal: str, shuffled: bool = False, spl: float = 0.9) -> dict:
    return {"traversal": traversal, "shuffled": shuffled, "tasks": 100, "completed": 0.95, "spl": spl, "excess": 1.2,
            "steps": 40.0, "reward": 0.8}


class TheReport(TemporaryFolder):
    """A section about one agent, as citylearn_paper writes it. system/paper_report_test.cc has a whole report."""

    def write(self, change=lambda report, results: None, failed: bool = False) -> tuple[int, str]:
        training = {"curve": {"episodes": [100], "steps": [10], "seconds": [1], "reward": [0.5], "spl": [0.6], "length": [60]},
                    "trials": [trial("summer")], "episodes": 100, "steps": 10, "seconds": 3.5, "spl95": None}
        agent = {"policy": "features", "label": "features <ours>", "learner": "ppo", "learns": True,
                 "representation": "hog-64", "features": 64, "frames": 128, "steps": 5, "seeds": [1],
                 "imperfections": {"slip": 0, "dropped_frames": 0, "kidnappings": 0}, "units": [0]}
        recordings = {"drawn": True, "train": "summer", "frames": 160, "traversals": [{"name": "summer", "condition": "sun"}]}
        data = {"recordings": recordings, "substitute": False, "points": [[agent]]}
        report = {"command": "./run paper", "version": "1.2.3", "quick": True, "tasks": 100, "recordings": recordings,
                  "sections": [{"name": "figure-7", "title": "A part", "data": data}], "measurements": [None]}
        results = [{"name": "a unit", "spec": {}, "outcome": None if failed else training}]
        change(report, results)
        for name, content in (("report", report), ("results", results), ("manifest", {})):
            (self.folder / f"{name}.json").write_text(json.dumps(content))
        return self.run_report()

    def test_names_are_escaped_and_what_is_worse_is_remarked(self) -> None:
        self.assertEqual(self.write(), (0, ""))
        html = (self.folder / "report.html").read_text()
        for part in ("features &lt;ours&gt;", "Worse than the paper: features"):
            self.assertIn(part, html)

    def test_is_made_when_all_units_failed(self) -> None:
        self.assertEqual(self.write(failed=True), (0, ""))

    def test_bad_input_is_one_line(self) -> None:
        for told, change in (
                ("report.json: field 'measurements' is missing", lambda report, _: report.pop("measurements")),
                ("same run", lambda _, results: results.pop()),
                ("results.json: field 'curve' is missing", lambda _, results: results[0]["outcome"].pop("curve")),
                ("'much' is not a number", lambda _, results: results[0]["outcome"].update(episodes="much")),
                ("unknown section 'moon'", lambda report, _: report["sections"][0].update(name="moon"))):
            status, errors = self.write(change)
            self.assertEqual((status, errors.count("\n")), (1, 1), errors)
            self.assertIn(told, errors)
        (self.folder / "results.json").write_text("[half")
        self.assertIn("results.json: not JSON", self.run_report()[1])
        (self.folder / "results.json").unlink()
        self.assertIn("results.json: No such file", self.run_report()[1])


class ThePage(TemporaryFolder):
    def test_writes_each_number_of_a_chart(self) -> None:
        page = Page(self.folder, "./run paper")
        page.section("part", "A part")
        line = charts.Line("a, b", [0, 0.5], [1, math.nan], [0.5, math.nan], [2, math.nan])
        page.chart("one", charts.Chart("one", "x", "y, m", [line]), "first")
        self.assertEqual((self.folder / "one-lines.csv").read_text(),
                         'line,x,"y, m",low,high\n"a, b",0,1,0.5,2\n"a, b",0.5,,,\n')
        nothing = charts.Bar(math.nan, math.nan, math.nan)
        bars = charts.BarChart("two", "AUC", ["hog", "vlad"], {"night": [charts.Bar(0.25, 0.125, 0.5), nothing]})
        page.bars("two", bars, "second")
        self.assertEqual((self.folder / "two-bars.csv").read_text(),
                         "group,bar,AUC,low,high\nnight,hog,0.25,0.125,0.5\nnight,vlad,,,\n")
        with self.assertRaises(ValueError):
            page.chart("one", charts.Chart("one", "x", "y"), "the first would be lost")

    def test_axes_hold_all_values(self) -> None:
        low, high = charts.limits_around([-3, 17, math.nan])
        self.assertTrue(low <= -3 and high >= 17)
        self.assertEqual(charts.limits_around([]), (0, 1))
        self.assertEqual(charts.limits_around([5, 9], from_zero=True)[0], 0)

    def test_single_points_and_dots_are_drawn_as_dots(self) -> None:
        def markers(line: charts.Line) -> list:
            axes = charts.draw_chart(charts.Chart("one", "x", "y", [line])).axes[0]
            return [(artist.get_marker(), len(artist.get_xdata())) for artist in axes.lines]

        self.assertEqual(markers(charts.Line("a", [0.5], [0.5])), [("o", 1)])
        self.assertEqual(markers(charts.Line("a", [0, 0.5, 1], [0, math.nan, 1])), [("None", 2)])
        self.assertEqual(markers(charts.Line("a", [0, 0.5, 1], [0, math.nan, 1], dots=True)), [("o", 2)])

    def test_recognition_has_a_page_and_curves_for_each_query_and_method(self) -> None:
        curve = {"encoder": "hog", "dimension": 64, "centring": "own", "method": "csls+sequence", "query": "./night",
                 "file": "pr---night-csls-sequence.svg", "auc": 0.5, "recall": [0.5, 1], "precision": [1, 0.5],
                 "matches": "matches-a.jpg"}
        row = {**dict.fromkeys(recognition_page.COLUMNS, 0.125), "query": "<night>", "recall_5": None}
        results = {"reference": "day", "ground_truth": "frames within 5 m", "command": "vpr", "rows": [row]}
        (self.folder / "results.json").write_text(json.dumps(results))
        empty = {**curve, "recall": [], "precision": []}
        del empty["matches"]
        (self.folder / "curves.json").write_text(json.dumps({"curves": [curve, empty]}))
        recognition_page.main(self.folder)
        svg = (self.folder / "pr---night-csls-sequence.svg").read_text()
        self.assertIn("day as reference, ./night as query, csls+sequence", svg)
        self.assertIn("hog 64, own, AUC 0.500", svg)
        html = (self.folder / "index.html").read_text()
        for part in ("&lt;night&gt;", "frames within 5 m", "<td>-</td>", 'src="pr---night'):
            self.assertIn(part, html)
        self.assertEqual(html.count('src="matches-a.jpg"'), 1)


class Estimates(unittest.TestCase):
    def test_means_have_students_interval(self) -> None:
        estimate = estimates.mean_of([1, 2, 3, 4, 5])
        self.assertEqual((estimate.n, estimate.mean), (5, 3))
        self.assertAlmostEqual(estimate.high - 3, 2.7764451052 * math.sqrt(2.5 / 5), 9)  # t(0.975, 4), s^2 = 2.5
        self.assertAlmostEqual(estimate.low + estimate.high, 6, 12)
        for freedom, quantile in ((1, 12.7062047364), (2, 4.3026527297), (3, 3.1824463053), (29, 2.0452296421)):
            self.assertAlmostEqual(estimates.student_quantile(freedom), quantile, 9)

    def test_one_value_has_no_interval_and_none_no_mean(self) -> None:
        self.assertEqual(estimates.mean_of([7]).mean, 7)
        self.assertTrue(math.isnan(estimates.mean_of([7]).low))
        self.assertTrue(math.isnan(estimates.mean_of([]).mean))
        self.assertEqual(estimates.mean_of([math.nan, 2, math.inf, 4]).n, 2)

    def test_intervals_end_where_no_value_can_lie(self) -> None:
        estimate = estimates.mean_of([0.9, 1], estimates.SHARES)
        self.assertAlmostEqual(estimate.mean, 0.95)
        self.assertEqual(estimate.low, estimates.mean_of([0.9, 1]).low)
        self.assertEqual(estimate.high, 1)
        self.assertEqual(estimates.mean_of([3, 50], estimates.COUNTS).low, 0)

    def test_shares_have_wilsons_interval(self) -> None:
        self.assertEqual(estimates.share_of(100, 100).mean, 1)
        self.assertAlmostEqual(estimates.share_of(100, 100).low, 0.963, 3)  # a hundred successes prove no more

    def test_texts(self) -> None:
        self.assertEqual(estimates.percent(estimates.Estimate(0.941, 0.931, 0.955, 5)), "94.1 (93.1..95.5) %")
        self.assertEqual(estimates.text_of(estimates.Estimate(0.5), 2), "0.50")
        self.assertEqual(estimates.text_of(estimates.Estimate(), 2), "-")

    def test_smoothing_has_no_pull_to_zero(self) -> None:
        for value in estimates.smoothed([5, 5, math.nan, 5], 0.9):
            self.assertAlmostEqual(value, 5, 12)


def curve_of(trainings: list[dict], figure: str, smoothing: float) -> charts.Line:
    return policies.Policy({}, trainings).curve("an agent", figure, smoothing)


class Curves(unittest.TestCase):
    def test_final_values_are_of_the_last_episodes(self) -> None:
        curve = {"episodes": [100, 200, 1000, 1000, 1400], "reward": [0, 0, 0.5, None, 0.8]}
        self.assertAlmostEqual(policies.final_value({"curve": curve}, "reward"), (800 * 0.5 + 400 * 0.8) / 1200, 12)
        self.assertTrue(math.isnan(policies.final_value({"curve": {"episodes": [], "reward": []}}, "reward")))

    def test_mean_does_not_jump_where_a_seed_ends(self) -> None:
        def training(episodes: int, reward: float) -> dict:
            return {"episodes": episodes, "curve": {"episodes": [1, episodes / 2, episodes], "reward": [reward] * 3}}

        line = curve_of([training(400, -1), training(1000, 0.5)], "reward", 0.9)
        self.assertEqual(line.x[-1], 1000)
        for y in line.y:
            self.assertAlmostEqual(y, -0.25, 12)

    def test_curves_go_from_the_first_point_to_the_last(self) -> None:
        training = {"episodes": 200, "curve": {"episodes": [100, 200], "reward": [10, 30]}}
        line = curve_of([training], "reward", 0)
        self.assertTrue(math.isnan(line.y[line.x.index(99)]))
        self.assertEqual([line.y[line.x.index(x)] for x in (100, 150, 200)], [10, 20, 30])


class TrialsOfSeeds(unittest.TestCase):
    def test_are_means_over_seeds_or_the_share_of_one(self) -> None:
        def row(traversal: str, completed: float, spl: float, shuffled: bool = False) -> dict:
            return {**trial(traversal, shuffled, spl), "completed": completed, "excess": None}

        two = [[row("summer", 1, 0.9), row("fall", 0.5, 0.4), row("fall", 0.1, 0.1, True)], [row("fall", 0.7, 0.6)]]
        policy = policies.Policy({}, two)
        both = policy.trials("fall")
        self.assertEqual(both.seeds_by_tasks, "2 x 100")
        self.assertAlmostEqual(both.completed.mean, 0.6, 12)
        self.assertAlmostEqual(both.spl.mean, 0.5, 12)
        self.assertTrue(math.isnan(both.figure("excess").mean))
        self.assertEqual(policy.trials("fall", shuffled=True).completed.mean, 0.1)
        one = policy.trials("summer")
        self.assertEqual(one.completed.n, 100)
        self.assertAlmostEqual(one.completed.low, 0.963, 3)
        self.assertEqual(policies.Policy({}, [None]).trials("summer").seeds_by_tasks, "-")

    def test_are_worse_beyond_the_margin_and_by_more_than_chance(self) -> None:
        yardstick = estimates.Estimate(0.9)
        self.assertTrue(policies.is_worse(estimates.Estimate(0.8, 0.75, 0.85, 5), yardstick))
        self.assertFalse(policies.is_worse(estimates.Estimate(0.8, 0.65, 0.95, 5), yardstick))
        self.assertTrue(policies.is_worse(estimates.Estimate(0.8), yardstick))
        self.assertFalse(policies.is_worse(estimates.Estimate(0.895), yardstick))
        self.assertFalse(policies.is_worse(estimates.Estimate(), yardstick))


if __name__ == "__main__":
    unittest.main()
