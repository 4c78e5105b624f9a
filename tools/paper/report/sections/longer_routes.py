# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: longer routes."""

from typing import Any

from charts import Chart, Line
from curves import effort_cells
from inputs import Inputs
from page import Page
from trials import (MEANS, Rows, remark_failed, remark_worse_than_controls, rows_of, short_rows, shuffled_cell,
                    trials_on)


def render(inputs: Inputs, data: Any, page: Page) -> None:
    lengths = ", ".join(str(route["frames"]) for route in data["routes"])
    limit = "places (the whole report: 512)" if inputs.quick else "places, beyond which it would take hours"
    page.text(
        f"The paper's routes have 128 places; here they have {lengths} of the "
        f"{'drawn' if inputs.recordings.drawn else 'real'} recordings, with as many steps as places for each task. "
        "place_filter learns by relabelling (the learner 'relabel'); features learns by PPO, as recommended for 128 "
        f"places, on at most {data['most_for_features']} {limit}. Beside them are policies that need no learning: "
        "'blind' sweeps without looking, 'shortest_path' knows its place, 'sequence_filter' is Bayes' rule written by "
        "hand.")
    for traversal in inputs.recordings.names:
        draw(inputs, data, traversal, page)
    tables(inputs, data, page)
    for route in data["routes"]:
        controls = inputs.controls(route)
        for agent in route["agents"]:
            trainings = inputs.outcomes(agent["units"])
            who = f"{agent['label']}, {route['frames']} places"
            remark_failed(page, who, len(trainings), len(agent["units"]))
            remark_worse_than_controls(page, who, inputs.recordings.names, rows_of(trainings), controls["blind"],
                                       controls["sequence_filter"], "on")


def draw(inputs: Inputs, data: Any, traversal: str, page: Page) -> None:
    agents: dict[str, Line] = {}
    controls: dict[str, Line] = {}
    for route in data["routes"]:
        for agent in route["agents"]:
            spl = trials_on(rows_of(inputs.outcomes(agent["units"])), traversal).spl
            line = agents.setdefault(agent["label"], Line(agent["label"]))
            line.add(route["frames"], spl.mean, spl.low, spl.high)
        for label, outcomes in inputs.controls(route).items():
            line = controls.setdefault(label, Line(label, dashed=True))
            line.add(route["frames"], trials_on(outcomes, traversal).spl.mean)
    chart = Chart(f"{traversal}{inputs.recordings.role(traversal)}: SPL by length of the route", "places on the route",
                  "SPL", [*agents.values(), *controls.values()], y_limits=(0, 1), x_logarithmic=True, height=260,
                  x_limits=(data["routes"][0]["frames"] * 0.9, data["routes"][-1]["frames"] * 1.1))
    page.chart(f"longer-routes-{traversal}", chart,
               f"{chart.title}, mean of the seeds with its 95 % interval; dashed: policies that learn nothing.")


def tables(inputs: Inputs, data: Any, page: Page) -> None:
    rows, training_rows = [], []

    def add(places: str, label: str, outcomes: list[Rows | None]) -> None:
        for row in short_rows(outcomes, inputs.recordings.names, places, label):
            rows.append([*row, shuffled_cell(outcomes, traversal=row[2])])

    for route in data["routes"]:
        places = str(route["frames"])
        for agent in route["agents"]:
            if trainings := inputs.outcomes(agent["units"]):
                add(places, agent["label"], rows_of(trainings))
                training_rows.append([places, agent["label"], agent["learner"],
                                      *effort_cells(trainings, "episodes", "steps", "seconds")])
        for label, outcomes in inputs.controls(route).items():
            add(places, label, outcomes)
    page.table("longer-routes",
               f"After training: {MEANS}. Shuffled: completed when the frames are shown in a random order.",
               ["places", "policy", "traversal", "seeds x tasks", "completed", "SPL", "excess", "shuffled"], rows)
    page.table("longer-routes-training",
               f"Training on '{inputs.recordings.train}' (95 % interval over seeds): episodes until the last 100 of "
               "them have SPL 0.95, and how much was learned from in total.",
               ["places", "agent", "learner", "seeds", "episodes to SPL 0.95", "seeds that reached it", "episodes",
                "steps", "seconds"], training_rows)
