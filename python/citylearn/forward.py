# SPDX-License-Identifier: Apache-2.0
"""Copies recorded runs to MLflow, Weights & Biases or Trackio, by their own clients. Needs Python and that client alone."""

import argparse
import csv
import importlib
import json
import math
import sys
from pathlib import Path


class Run:
    """What a policy_service wrote into a folder: manifest.json, metrics.csv and, once it has ended, summary.json."""

    def __init__(self, folder):
        self.folder = folder
        manifest = self._json("manifest.json")
        self.id = f"{manifest.get('run')}-{manifest.get('id')}-{manifest.get('seed')}-{manifest.get('job')}"
        self.started = manifest.get("job", 0) / 1e6  # seconds since 1970
        self.options = leaves({name: value for name, value in manifest.items() if name not in ("command", "options", "origins", "artefacts")})
        self.results = {name: value for name, value in leaves(self._json("summary.json")).items() if is_number(value)}

    def _json(self, name):
        path = self.folder / name
        if name != "manifest.json" and not path.exists():
            return {}
        try:
            found = json.loads(path.read_text())
        except ValueError as error:
            raise SystemExit(f"forward: {path}: is not JSON ({error}); run it again, or restore the file") from None
        if not isinstance(found, dict):
            raise SystemExit(f"forward: {path}: is not a JSON object")
        return found

    def updates(self):
        """Yields (step, seconds since 1970, figures) of each update. Leaves out figures that are not finite."""
        path = self.folder / "metrics.csv"
        with open(path, newline="") as file:
            for row in csv.DictReader(file):
                try:
                    figures = {name: float(text) for name, text in row.items()}
                    step, wall = int(figures.pop("steps")), figures["wall"]
                except (KeyError, TypeError, ValueError):
                    raise SystemExit(f"forward: {path}: row {row.get('update')} is cut short or not of this version") from None
                yield step, self.started + wall, {name: value for name, value in figures.items() if math.isfinite(value)}


def is_number(value):
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def leaves(value, prefix=""):
    """Returns the leaves of nested objects by names that '.' joins."""
    if not isinstance(value, dict):
        return {prefix: value}
    return {key: leaf for name, part in value.items() for key, leaf in leaves(part, f"{prefix}.{name}" if prefix else name).items()}


def to_mlflow(mlflow, run, project):
    """Returns False when MLflow has the run already."""
    mlflow.set_experiment(project)
    if len(mlflow.search_runs(filter_string=f"tags.`citylearn.run` = '{run.id}'", output_format="list")):
        return False
    with mlflow.start_run(run_name=run.id, tags={"citylearn.run": run.id}) as started:
        client = mlflow.MlflowClient()
        mlflow.log_params({name: str(value)[:500] for name, value in run.options.items()})
        points = [mlflow.entities.Metric(name, value, int(time * 1000), step)
                  for step, time, figures in run.updates() for name, value in figures.items()]
        for begin in range(0, len(points), 1000):  # the most that MLflow takes at once
            client.log_batch(started.info.run_id, metrics=points[begin:begin + 1000])
        mlflow.log_metrics(run.results)
    return True


def to_wandb(client, run, project):
    """Sends to a client that has wandb's calls, as Trackio has. Its own error says when it has the run already."""
    client.init(project=project, name=run.id, config=run.options, resume="never", **({"id": run.id} if client.__name__ == "wandb" else {}))
    last = 0
    for last, _, figures in run.updates():
        client.log(figures, step=last)
    if run.results:
        client.log(run.results, step=last + 1)
    client.finish()
    return True


CLIENTS = {"mlflow": to_mlflow, "wandb": to_wandb, "trackio": to_wandb}


def main():
    parser = argparse.ArgumentParser(prog="forward", description=__doc__)
    parser.add_argument("run", type=Path, help="folder of a run, or a folder above several")
    parser.add_argument("--to", required=True, choices=CLIENTS, help="where to; the client's own settings say where that is")
    parser.add_argument("--project", default="citylearn", help="project or experiment there (default: %(default)s)")
    given = parser.parse_args()
    folders = sorted(file.parent for file in given.run.rglob("metrics.csv") if (file.parent / "manifest.json").exists())
    if not folders:
        raise SystemExit(f"forward: {given.run}: no run is in this folder (manifest.json and metrics.csv)")
    try:
        client = importlib.import_module(given.to)
    except ImportError as error:
        raise SystemExit(f"forward: {error}; install it: pip install {given.to}") from None
    for run in map(Run, folders):
        print(f"{run.id}: {'sent' if CLIENTS[given.to](client, run, given.project) else 'is there already'}")


if __name__ == "__main__":
    sys.exit(main())
