# SPDX-License-Identifier: Apache-2.0
"""Runs forwarded to experiment trackers: to clients that note their calls here, and to the real ones where they are installed."""

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import textwrap
import unittest
from pathlib import Path

PROGRAM = Path(sys.argv[1]).resolve() / "python/citylearn/forward.py"
MANIFEST = {"run": "demo", "id": "policy", "seed": 3, "job": 1_700_000_000_000_000, "agent": "place_filter",
            "parameters": {"ppo": {"clip": 0.2}}, "command": {"words": ["secret"]}}
SUMMARY = {"agent": "place_filter", "evaluate": {"fall": {"spl": 0.5, "completed": 0.75}}}
METRICS = "update,steps,wall,spl,policy_loss\n1,512,1.5,0.25,nan\n2,1024,3.0,0.5,-0.125\n"
NOTES = """
    import json
    def note(*call): print(json.dumps(call))
    def init(**options): note("init", options)
    def log(figures, step): note("log", figures, step)
    def finish(): note("finish")
"""


def installed(name):
    return unittest.skipUnless(importlib.util.find_spec(name), f"{name} is missing (pip install {name})")


class Forward(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory()))
        self.run_folder = self.folder / "runs/20260101/seed-3"
        self.run_folder.mkdir(parents=True)
        for name, text in (("manifest.json", json.dumps(MANIFEST)), ("summary.json", json.dumps(SUMMARY)), ("metrics.csv", METRICS)):
            (self.run_folder / name).write_text(text)

    def forward(self, *words, status=0, **environment):
        done = subprocess.run([sys.executable, str(PROGRAM), *words], cwd=self.folder, capture_output=True, text=True, check=False,
                              env=os.environ | environment)
        self.assertEqual(done.returncode, status, done.stdout + done.stderr)
        return done.stdout if status == 0 else done.stderr

    def noted(self, client):
        """What a client that has wandb's calls is told."""
        (self.folder / f"{client}.py").write_text(textwrap.dedent(NOTES))
        said = self.forward("runs", "--to", client, "--project", "walks", PYTHONPATH=str(self.folder)).splitlines()
        self.assertEqual(said.pop(), "demo-policy-3-1700000000000000: sent")
        return [json.loads(line) for line in said]

    def test_clients_are_told_options_curves_and_results(self):
        begin, *logged, end = self.noted("trackio")
        self.assertEqual(begin, ["init", {"project": "walks", "name": "demo-policy-3-1700000000000000", "resume": "never", "config": {
            "run": "demo", "id": "policy", "seed": 3, "job": 1_700_000_000_000_000, "agent": "place_filter", "parameters.ppo.clip": 0.2}}])
        self.assertEqual(logged, [["log", {"update": 1, "wall": 1.5, "spl": 0.25}, 512],  # NaN is left out
                                  ["log", {"update": 2, "wall": 3, "spl": 0.5, "policy_loss": -0.125}, 1024],
                                  ["log", {"evaluate.fall.spl": 0.5, "evaluate.fall.completed": 0.75}, 1025]])
        self.assertEqual(end, ["finish"])
        self.assertEqual(self.noted("wandb")[0][1]["id"], "demo-policy-3-1700000000000000")

    def test_what_is_wrong_is_told_in_a_line(self):
        self.assertEqual(self.forward("nowhere", "--to", "wandb", status=1),
                         "forward: nowhere: no run is in this folder (manifest.json and metrics.csv)\n")
        (self.folder / "trackio.py").write_text("import no_such_module\n")
        missing = self.forward("runs", "--to", "trackio", status=1, PYTHONPATH=str(self.folder))
        self.assertIn("install it: pip install trackio", missing)
        (self.folder / "trackio.py").write_text(textwrap.dedent(NOTES))
        (self.run_folder / "metrics.csv").write_text(METRICS + "3,15")
        self.assertIn("metrics.csv: row 3 is cut short", self.forward("runs", "--to", "trackio", status=1, PYTHONPATH=str(self.folder)))
        (self.run_folder / "manifest.json").write_text("{")
        self.assertIn("manifest.json: is not JSON", self.forward("runs", "--to", "trackio", status=1, PYTHONPATH=str(self.folder)))

    @installed("mlflow")
    def test_mlflow_has_the_run_once(self):
        store = {"MLFLOW_TRACKING_URI": f"sqlite:///{self.folder}/mlflow.db"}
        self.assertIn("sent", self.forward("runs", "--to", "mlflow", **store))
        self.assertIn("is there already", self.forward("runs", "--to", "mlflow", **store))
        import mlflow
        mlflow.set_tracking_uri(store["MLFLOW_TRACKING_URI"])
        run, = mlflow.search_runs(experiment_names=["citylearn"], output_format="list")
        self.assertEqual(run.data.params["parameters.ppo.clip"], "0.2")
        self.assertEqual(run.data.metrics["evaluate.fall.spl"], 0.5)
        curve = mlflow.MlflowClient().get_metric_history(run.info.run_id, "spl")
        self.assertEqual([(point.step, point.value, point.timestamp) for point in curve],
                         [(512, 0.25, 1_700_000_001_500), (1024, 0.5, 1_700_000_003_000)])

    @installed("wandb")
    def test_wandb_takes_a_run_offline(self):
        self.assertIn("sent", self.forward("runs", "--to", "wandb", WANDB_MODE="offline"))
        self.assertEqual(len(list(self.folder.glob("wandb/offline-run-*/*.wandb"))), 1)

    @installed("trackio")
    def test_trackio_takes_a_run(self):
        self.assertIn("sent", self.forward("runs", "--to", "trackio", TRACKIO_DIR=str(self.folder / "trackio")))
        self.assertEqual(len(list(self.folder.glob("trackio/citylearn*.db"))), 1)


if __name__ == "__main__":
    unittest.main(argv=sys.argv[:1], verbosity=2)
