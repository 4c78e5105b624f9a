# SPDX-License-Identifier: Apache-2.0
"""A small study as citylearn_paper writes it: every section, with made-up outcomes."""

import json
from pathlib import Path

import matplotlib.image

TRAVERSALS = ["summer", "night"]


def trial(traversal: str, shuffled: bool = False, spl: float = 0.9) -> dict:
    return {"traversal": traversal, "shuffled": shuffled, "tasks": 100, "completed": 0.95, "spl": spl, "excess": 1.2,
            "steps": 40.0, "reward": 0.8,
            "walk": {"goal": 5, "completed": traversal == "summer", "frames": [2, 3, 4, 5]}}


def training(seed: int) -> dict:
    return {"curve": {"episodes": [100, 600, 1000 * seed], "steps": [10, 20, 30], "seconds": [1, 2, 3],
                      "reward": [-0.5, None, 0.7 + 0.1 * seed], "spl": [0.2, 0.6, 0.9], "length": [90, 60, 45]},
            "deployments": [{**trial(name), "episodes": episodes} for episodes in (103, 207) for name in TRAVERSALS],
            "trials": [trial(name, shuffled) for name in TRAVERSALS for shuffled in (False, True)],
            "episodes": 1000 * seed, "steps": 30, "seconds": 3.5,
            "spl95": {"episodes": 700, "steps": 25, "seconds": 2.5} if seed == 1 else None}


class Study:
    """Collects units and sections, then writes the files."""

    def __init__(self) -> None:
        self.outcomes: list = []
        self.sections: list[dict] = []

    def unit(self, outcome) -> int:
        self.outcomes.append(outcome)
        return len(self.outcomes) - 1

    def trainings(self) -> list[int]:
        return [self.unit(training(1)), self.unit(training(2)), self.unit(None)]

    def agents(self) -> list[dict]:
        return [{"agent": agent, "label": f"{agent} <ours>", "representation": "hog-64", "features": 64,
                 "units": self.trainings()} for agent in ("baseline", "features", "raw_images", "place_filter")]

    def controls(self, *names: str) -> list[dict]:
        rows = [trial(traversal, spl=0.95) for traversal in [*TRAVERSALS, "0 m", "1 m"]]
        return [{"label": name, "unit": self.unit(rows)} for name in names]

    def cases(self, queries: list[str]) -> list[dict]:
        outcome = {"queries": 50, "auc": 0.6, "auc_low": 0.5, "auc_high": 0.7, "recall": 0.8}
        return [{"representation": representation, "method": method, "query": query, "unit": self.unit(outcome)}
                for representation in ("hog-64", "hog-512") for method in ("mlp", "nearest") for query in queries]

    def section(self, name: str, **data) -> None:
        self.sections.append({"name": name, "title": f"The part {name}", "data": data})

    def write(self, folder: Path) -> None:
        report = {"command": "./run paper --quick", "version": "1.2.3", "quick": True, "tasks": 100,
                  "recordings": recordings(TRAVERSALS), "sections": self.sections,
                  "measurements": [None] * len(self.outcomes)}
        results = [{"name": "a unit", "spec": {}, "outcome": outcome} for outcome in self.outcomes]
        for name, content in (("report", report), ("results", results), ("manifest", {"seeds": [1, 2]})):
            (folder / f"{name}.json").write_text(json.dumps(content))
        for agent in ("features", "raw_images"):
            for traversal in TRAVERSALS:
                matplotlib.image.imsave(folder / f"walk-{traversal}-{agent}.png", [[0.0] * 40] * 10, cmap="gray")


def recordings(names: list[str]) -> dict:
    return {"drawn": True, "train": "summer", "frames": 160,
            "traversals": [{"name": name, "condition": name} for name in names]}


def sample() -> Study:
    study = Study()
    study.section("figure-2", agents=study.agents())
    study.section("figure-6", tolerance=2, representations=["hog-64", "hog-512"], methods=["mlp", "nearest"],
                  queries=["night"], cases=study.cases(["night"]))
    study.section("figure-7", agents=study.agents())
    study.section("figure-8-9", agents=study.agents(),
                  controls=study.controls("blind", "shortest_path", "sequence_filter"))
    walkers = ("features", "raw_images")
    study.section("figure-10", recordings=recordings(TRAVERSALS), substitute=False, pictures=True,
                  traversals=TRAVERSALS,
                  trainings=[{"agent": agent, "representation": "hog-64", "seed": 1, "frames": 128,
                              "unit": study.unit(training(1))} for agent in walkers],
                  strips=[{"traversal": traversal, "agent": agent, "file": f"walk-{traversal}-{agent}.png",
                           "frames": [2, 3, 4, 5], "steps": [0, 1, 2, None]}
                          for traversal in TRAVERSALS for agent in walkers])
    study.section("tables", encoders=["hog", "vlad"],
                  memory=study.unit({"environments": 512, "agents": 16, "bytes": {"environment": 7e3, "process": 8e7}}),
                  traversals=[{"name": name, "condition": name, "frames": 160, "metres": 1590.0, "step": 10.0,
                               "smallest_step": None, "sensors": "pictures"} for name in TRAVERSALS])
    study.section("longer-routes", most_for_features=128,
                  routes=[{"frames": frames, "controls": study.controls("blind", "shortest_path", "sequence_filter"),
                           "agents": [{"label": "place_filter", "learner": "relabel", "units": study.trainings()}]}
                          for frames in (128, 160)])
    study.section("transfer", frames=80, controls=study.controls("blind", "sequence_filter"),
                  agents=[{"agent": "features", "label": "features",
                           "unchanged": [study.unit([trial("summer", spl=0.3)])],
                           "variants": [{"label": "all", "pretrained": True, "units": study.trainings()},
                                        {"label": "anew", "pretrained": False, "units": study.trainings()}]}])
    study.section("viewpoint", recordings=recordings(["summer", "0 m", "1 m"]), substitute=False,
                  representation="hog-64", frames=128, tolerance=2,
                  shifts=[{"at": 0, "name": "0 m"}, {"at": 1, "name": "1 m"}],
                  methods=["mlp", "nearest"], cases=study.cases(["0 m", "1 m"]),
                  agents=[{"label": "features", "units": [study.unit([trial("0 m"), trial("1 m")]), study.unit(None)]}],
                  controls=study.controls("blind", "sequence_filter"))

    study.section("experiences", recordings=recordings([*TRAVERSALS, "mixed"]), substitute=False, simulated=True,
                  second="night", frames=128, representation="hog-64",
                  variants=[{"more": more, "controls": study.controls("sequence_filter"),
                             "agents": [{"label": "place_filter",
                                         "units": [study.unit({**training(1), "trials": [trial("mixed", spl=spl)]})]}]}
                            for more, spl in (([], 0.9), (["night"], 0.8))])

    def in_world(slip: float, dropped_frames: float, kidnappings: int, spl: float) -> dict:
        told = {"slip": slip} if slip else {}
        return {"slip": slip, "dropped_frames": dropped_frames, "kidnappings": kidnappings, "told": told,
                "controls": study.controls("sequence_filter", "blind", "shortest_path",
                                           *(["sequence_filter, told"] if told else [])),
                "agents": [{"label": "place_filter", "units": [
                    study.unit({**training(1), "trials": [trial(name, spl=spl) for name in TRAVERSALS]}),
                    study.unit(None)]}]}

    study.section("imperfect-world", traversals=TRAVERSALS, frames=128, representation="hog-64",
                  worlds=[in_world(0, 0, 0, 0.99), in_world(0.1, 0, 0, 0.9), in_world(0, 0.1, 0, 0.99),
                          in_world(0.1, 0.1, 1, 0.99)])
    study.section("dimensions", recordings=recordings(TRAVERSALS), substitute=True, encoder="hog",
                  encoder_dimension=600, learned_from=512, missing=[2048], frames=128,
                  sizes=[{"features": features, "controls": study.controls("sequence_filter", "blind"),
                          "agents": [{"label": "features",
                                      "units": [study.unit({**training(1), "trials": [trial("night", spl=spl)]})]}]}
                         for features, spl in ((64, 0.9), (511, 0.8))])

    def on_map(policy: str) -> dict:
        estimate = {"mean": 0.4 if policy == "place_filter" else 0.5, "low": 0.3, "high": 0.6, "n": 100}
        rows = [{"traversal": name, **dict.fromkeys(("completed", "spl", "steps", "shortest"), estimate)}
                for name in TRAVERSALS]
        return {**training(1), "trials": rows, "walk": {"start": 0, "goal": 3, "places": [0, 1, 2, 3]}}

    study.section("map", recordings=recordings(TRAVERSALS), drawn=True, traversals=TRAVERSALS,
                  layout={"first": 0, "frames": 4, "east": [0, 10, 10, None], "north": [0, 0, 10, None],
                          "junctions": [[0, 2]]},
                  policies=[{"policy": policy, "label": policy, "learns": policy == "place_filter",
                             "junctions": junctions, "steps": 5, "units": [study.unit(on_map(policy))]}
                            for policy in ("place_filter", "sequence_filter", "blind") for junctions in (True, False)])
    return study
