# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: a map with junctions."""

from dataclasses import dataclass
from typing import Any

from charts import Chart, Line, limits_around
from curves import MEAN_OF_SEEDS, mean_curve
from estimates import BOUNDS, COUNTS, Estimate, fixed, mean_of, percent, text_of
from inputs import Inputs, Recordings, number, numbers
from page import Page

SMOOTHING = 0.9
LONGER_SIDE = 420  # of the map, in pixels


@dataclass
class Policy:
    """A policy, with or without the junctions, and what came of its seeds."""
    data: Any
    outcomes: list[Any]

    def figure(self, traversal: str, name: str) -> Estimate:
        """Returns a figure of a trial: over the seeds, or of one seed over its tasks."""
        found = [row[name] for outcome in self.outcomes for row in outcome["trials"] if row["traversal"] == traversal]
        if len(found) > 1:
            return mean_of([number(one["mean"]) for one in found], BOUNDS.get(name, COUNTS))
        return Estimate.of(found[0] if found else None, "mean", "low", "high", "n")


def render(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = Recordings(data["recordings"])
    policies = [Policy(policy, inputs.outcomes(policy["units"])) for policy in data["policies"]]
    introduce(data, recordings, page)
    draw_map(data["layout"], recordings, policies, page)
    draw_training(recordings, policies, page)
    table(inputs, data, recordings, policies, page)
    remarks(data, policies, page)


def junctions_text(layout: Any) -> str:
    count = len(layout["junctions"])
    return "1 junction" if count == 1 else f"{count} junctions"


def introduce(data: Any, recordings: Recordings, page: Page) -> None:
    layout = data["layout"]
    page.text(
        "The paper's future work: a route that crosses itself, as a map on which agents choose among neighbours. Where "
        "two stretches pass the same spot, the nearest two of their places are joined: there the action 'stay' turns "
        "into the other road; everywhere else actions are as they were. The shortest path may then lead over "
        "junctions. The paper has no figures for this. place_filter and the policies that learn nothing know the map; "
        "features has to find out where it can turn, and the auxiliary losses that help it to localise know only the "
        "position along the route.")
    places, junctions = f"{layout['frames']} places", junctions_text(layout)
    if data["drawn"]:
        page.text(
            f"There are no recordings here whose GPS shows that they cross themselves. These are {places} of the drawn "
            "city, whose straight street the program lays on a map by a rule, x = sin 3t, y = sin 2t, with 10 m from "
            f"place to place: {junctions}. What an agent sees does not show the crossing roads: it cannot see that it "
            "stands at a junction, it has to know the place.")
    else:
        page.text(
            f"The map is that of the given recordings, by their latitude and longitude. Of their frames {places} from "
            f"{layout['first']} on, which cross themselves most often: {junctions} of places within 1.5 mean steps of "
            f"each other. The recordings are {'drawn by the program' if recordings.drawn else 'real'}.")


def draw_map(layout: Any, recordings: Recordings, policies: list[Policy], page: Page) -> None:
    east, north = numbers(layout["east"]), numbers(layout["north"])

    def on_map(label: str, places: list[int], **style: bool) -> Line:
        return Line(label, [east[place] for place in places], [north[place] for place in places], **style)

    joined = [place for places in layout["junctions"] for place in places]
    lines = [on_map("the route, place after place", list(range(layout["frames"]))),
             on_map(f"its {junctions_text(layout)}", joined, dots=True)]
    ends: list[Line] = []
    for policy in reversed(policies):  # the shorter way is drawn over the longer one
        if policy.data["policy"] == "place_filter" and policy.outcomes:
            walk, junctions = policy.outcomes[0]["walk"], policy.data["junctions"]
            label = f"{'with junctions' if junctions else 'without'}: {len(walk['places']) - 1} steps"
            lines.append(on_map(label, walk["places"], dashed=not junctions))
            ends = [on_map("start", [walk["start"]], dots=True), on_map("goal", [walk["goal"]], dots=True)]
    x_limits, y_limits = limits_around(east), limits_around(north)
    scale = LONGER_SIDE / max(x_limits[1] - x_limits[0], y_limits[1] - y_limits[0])  # the same for both axes
    chart = Chart("The map and one walk on it", "metres east", "metres north", lines + ends, x_limits, y_limits,
                  width=scale * (x_limits[1] - x_limits[0]), height=scale * (y_limits[1] - y_limits[0]))
    page.chart("map", chart,
               f"The route of '{recordings.train}' on the map. Of all tasks, the one for which junctions save most: "
               "the way of place_filter, first seed, with and without junctions.")


def draw_training(recordings: Recordings, policies: list[Policy], page: Page) -> None:
    lines = [mean_curve(f"{policy.data['label']}, {'junctions' if policy.data['junctions'] else 'without'}",
                        policy.outcomes, "spl", SMOOTHING)
             for policy in policies if policy.data["learns"] and policy.outcomes]
    if lines:
        chart = Chart("Training on the map", "episodes", "SPL", lines, y_limits=(0, 1), width=560,
                      x_limits=limits_around([line.x[-1] for line in lines], from_zero=True))
        page.chart("map-training", chart,
                   f"SPL during training on '{recordings.train}', measured by the shortest path with junctions, "
                   f"smoothed by {fixed(SMOOTHING, 1)}, {MEAN_OF_SEEDS}.")


def table(inputs: Inputs, data: Any, recordings: Recordings, policies: list[Policy], page: Page) -> None:
    rows = []
    for traversal in data["traversals"]:
        for policy in policies:
            if policy.outcomes:
                completed, spl, steps, shortest = (policy.figure(traversal, name)
                                                   for name in ("completed", "spl", "steps", "shortest"))
                rows.append([policy.data["label"], "yes" if policy.data["junctions"] else "no", traversal,
                             str(policy.data["steps"]) if policy.data["learns"] else "-",
                             f"{len(policy.outcomes)} x {inputs.tasks}", percent(completed), text_of(spl, 3),
                             text_of(steps, 1), fixed(shortest.mean, 1)])
    page.table("map",
               f"The same {inputs.tasks} tasks for all policies, at most {data['layout']['frames']} steps each, after "
               f"learning on '{recordings.train}' with ppo. 95 % intervals: over seeds; of one seed and of policies "
               "that learn nothing, over tasks (completed: Wilson). SPL is measured by the shortest path with "
               "junctions for all; 'shortest' is the one that the policy could take; 'trained': environment steps of "
               "each training.",
               ["policy", "junctions", "traversal", "trained", "seeds x tasks", "completed", "SPL", "steps",
                "shortest"], rows)


def remarks(data: Any, policies: list[Policy], page: Page) -> None:
    """Remarks where an agent is no better than without junctions, or than a policy that learned nothing."""
    known = {(policy.data["policy"], policy.data["junctions"]): policy for policy in policies}
    for policy in policies:
        if not policy.data["learns"] or not policy.data["junctions"]:
            continue
        same, filtering, blind = (policy.data["policy"], False), ("sequence_filter", True), ("blind", False)
        for traversal in data["traversals"]:
            for name, what, other, whom in (
                    ("completed", "a share of completed tasks of", same, "the same agent without them"),
                    ("spl", "SPL", same, "the same agent without them"),
                    ("spl", "SPL", filtering, "the sequence filter, which has learned nothing"),
                    ("spl", "SPL", blind, "the sweep that never looks")):
                own, yardstick = policy.figure(traversal, name).mean, known[other].figure(traversal, name).mean
                if own < yardstick and fixed(own, 3) != fixed(yardstick, 3):
                    page.remark(f"On '{traversal}' {policy.data['label']} with junctions has {what} {fixed(own, 3)}, "
                                f"less than {whom}: {fixed(yardstick, 3)}.")
