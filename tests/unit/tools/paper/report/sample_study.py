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

    def policy(self, label: str, units: list[int], **data) -> dict:
        """An entry of report.json about an agent, or about a control when it is named like one."""
        return {"policy": label.split()[0], "label": label, "variant": "", "learner": "ppo",
                "learns": label.split(",")[0] not in ("blind", "shortest_path", "sequence_filter"),
                "representation": "hog-64", "features": 64, "frames": 128, "steps": 5, "seeds": [1], "experiences": [],
                "imperfections": {"slip": 0, "dropped_frames": 0, "kidnappings": 0},
                "units": units, **data}

    def agents(self) -> list[dict]:
        return [self.policy(f"{agent} <ours>", self.trainings())
                for agent in ("baseline", "features", "raw_images", "place_filter")]

    def controls(self, *names: str, **data) -> list[dict]:
        rows = [trial(traversal, spl=0.95) for traversal in [*TRAVERSALS, "0 m", "1 m"]]
        return [self.policy(name, [self.unit(rows)], **data) for name in names]

    def cases(self, queries: list[str]) -> list[dict]:
        outcome = {"queries": 50, "auc": 0.6, "auc_low": 0.5, "auc_high": 0.7, "recall": 0.8}
        return [{"representation": representation, "method": method, "query": query, "unit": self.unit(outcome)}
                for representation in ("hog-64", "hog-512") for method in ("mlp", "nearest") for query in queries]

    def section(self, name: str, *points: list[dict], **data) -> None:
        common = {"recordings": recordings(TRAVERSALS), "substitute": False, "points": points}
        self.sections.append({"name": name, "title": f"The part {name}", "data": {**common, **data}})

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
    study.section("figure-2", study.agents())
    study.section("figure-6", tolerance=2, representations=["hog-64", "hog-512"], methods=["mlp", "nearest"],
                  queries=["night"], cases=study.cases(["night"]))
    study.section("figure-7", study.agents())
    study.section("figure-8-9", study.agents() + study.controls("blind", "shortest_path", "sequence_filter"))
    walkers = ("features", "raw_images")
    study.section("figure-10", [study.policy(agent, [study.unit(training(1))]) for agent in walkers], pictures=True,
                  traversals=TRAVERSALS,
                  strips=[{"traversal": traversal, "agent": agent, "file": f"walk-{traversal}-{agent}.png",
                           "frames": [2, 3, 4, 5], "steps": [0, 1, 2, None]}
                          for traversal in TRAVERSALS for agent in walkers])
    study.section("tables", encoders=["hog", "vlad"],
                  memory=study.unit({"environments": 512, "agents": 16, "bytes": {"environment": 7e3, "process": 8e7}}),
                  traversals=[{"name": name, "condition": name, "frames": 160, "metres": 1590.0, "step": 10.0,
                               "smallest_step": None, "sensors": "pictures"} for name in TRAVERSALS])
    study.section("longer-routes",
                  *([study.policy("place_filter", study.trainings(), frames=frames),
                     *study.controls("blind", "shortest_path", "sequence_filter", frames=frames)]
                    for frames in (128, 160)), most_for_features=128)
    study.section("transfer",
                  [study.policy("features", [study.unit([trial("summer", spl=0.3)])], variant="unchanged, no training"),
                   study.policy("features", study.trainings(), variant="all"),
                   study.policy("features", study.trainings(), variant="trained from scratch"),
                   *study.controls("blind", "sequence_filter")])
    study.section("viewpoint",
                  [study.policy("features", [study.unit([trial("0 m"), trial("1 m")]), study.unit(None)]),
                   *study.controls("blind", "sequence_filter")],
                  recordings=recordings(["summer", "0 m", "1 m"]), tolerance=2,
                  shifts=[{"at": 0, "name": "0 m"}, {"at": 1, "name": "1 m"}], methods=["mlp", "nearest"],
                  cases=study.cases(["0 m", "1 m"]))

    def tried_on(names: list[str], spl: float) -> int:
        return study.unit({**training(1), "trials": [trial(name, spl=spl) for name in names]})

    study.section("experiences",
                  *([study.policy("place_filter", [tried_on(["mixed"], spl)], experiences=more),
                     *study.controls("sequence_filter", experiences=more)]
                    for more, spl in (([], 0.9), (["night"], 0.8))),
                  recordings=recordings([*TRAVERSALS, "mixed"]), simulated=True, second="night")

    def in_world(slip: float, dropped_frames: float, kidnappings: int, spl: float) -> list[dict]:
        world = {"slip": slip, "dropped_frames": dropped_frames, "kidnappings": kidnappings}
        told = ["sequence_filter, told"] if slip else []
        return [study.policy("place_filter", [tried_on(TRAVERSALS, spl), study.unit(None)], imperfections=world),
                *study.controls("sequence_filter", "blind", "shortest_path", *told, imperfections=world)]

    study.section("imperfect-world", in_world(0, 0, 0, 0.99), in_world(0.1, 0, 0, 0.9), in_world(0, 0.1, 0, 0.99),
                  in_world(0.1, 0.1, 1, 0.99), traversals=TRAVERSALS)
    study.section("dimensions",
                  *([study.policy("features", [tried_on(["night"], spl)], features=features),
                     *study.controls("sequence_filter", "blind", features=features)]
                    for features, spl in ((64, 0.9), (511, 0.8))),
                  substitute=True, encoder="hog", encoder_dimension=600, learned_from=512, missing=[2048])

    return study
