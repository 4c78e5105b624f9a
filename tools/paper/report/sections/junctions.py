# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: a map with junctions."""

from charts import Chart, Line, limits_around
from estimates import fixed
from inputs import numbers
from study import BLIND, MEAN_OF_SEEDS, UNADAPTED, Study

SMOOTHING = 0.9
LONGER_SIDE = 420  # of the map, in pixels


def render(study: Study) -> None:
    train = study.recordings.train
    introduce(study)
    draw_map(study)
    lines = [policy.curve(f"{policy.label}, {'junctions' if policy.data['junctions'] else 'without'}", "spl", SMOOTHING)
             for policy in study.policies if policy.learns and policy.trainings]
    if lines:
        study.draw_training("map-training",
                            f"SPL during training on '{train}', measured by the shortest path with junctions, "
                            f"smoothed by {fixed(SMOOTHING, 1)}, {MEAN_OF_SEEDS}.",
                            Chart("Training on the map", "episodes", "SPL", lines, y_limits=(0, 1)))
    study.tried("map",
                f"The same {study.inputs.tasks} tasks for all policies, at most {study.data['layout']['frames']} steps "
                f"each, after learning on '{train}' with ppo. 95 % intervals: over seeds; of one seed and of policies "
                "that learn nothing, over tasks (completed: Wilson). SPL is measured by the shortest path with "
                "junctions for all; 'shortest' is the one that the policy could take; 'trained': environment steps of "
                "each training.",
                ["policy", "junctions", "traversal", "trained", "seeds x tasks", "completed", "SPL", "steps",
                 "shortest"], study.data["traversals"], by_traversal=True)
    remarks(study)


def junctions_text(study: Study) -> str:
    count = len(study.data["layout"]["junctions"])
    return "1 junction" if count == 1 else f"{count} junctions"


def introduce(study: Study) -> None:
    layout = study.data["layout"]
    study.page.text(
        "The paper's future work: a route that crosses itself, as a map on which agents choose among neighbours. Where "
        "two stretches pass the same spot, the nearest two of their places are joined: there the action 'stay' turns "
        "into the other road; everywhere else actions are as they were. The shortest path may then lead over "
        "junctions. The paper has no figures for this. place_filter and the policies that learn nothing know the map; "
        "features has to find out where it can turn, and the auxiliary losses that help it to localise know only the "
        "position along the route.")
    places, junctions = f"{layout['frames']} places", junctions_text(study)
    if study.data["drawn"]:
        study.page.text(
            f"There are no recordings here whose GPS shows that they cross themselves. These are {places} of the drawn "
            "city, whose straight street the program lays on a map by a rule, x = sin 3t, y = sin 2t, with 10 m from "
            f"place to place: {junctions}. What an agent sees does not show the crossing roads: it cannot see that it "
            "stands at a junction, it has to know the place.")
    else:
        origin = "drawn by the program" if study.recordings.drawn else "real"
        study.page.text(
            f"The map is that of the given recordings, by their latitude and longitude. Of their frames {places} from "
            f"{layout['first']} on, which cross themselves most often: {junctions} of places within 1.5 mean steps of "
            f"each other. The recordings are {origin}.")


def draw_map(study: Study) -> None:
    layout = study.data["layout"]
    east, north = numbers(layout["east"]), numbers(layout["north"])

    def on_map(label: str, places: list[int], **style: bool) -> Line:
        return Line(label, [east[place] for place in places], [north[place] for place in places], **style)

    joined = [place for places in layout["junctions"] for place in places]
    lines = [on_map("the route, place after place", list(range(layout["frames"]))),
             on_map(f"its {junctions_text(study)}", joined, dots=True)]
    ends: list[Line] = []
    for policy in reversed(study.policies):  # the shorter way is drawn over the longer one
        if policy.data["policy"] == "place_filter" and policy.trainings:
            walk, junctions = policy.trainings[0]["walk"], policy.data["junctions"]
            label = f"{'with junctions' if junctions else 'without'}: {len(walk['places']) - 1} steps"
            lines.append(on_map(label, walk["places"], dashed=not junctions))
            ends = [on_map("start", [walk["start"]], dots=True), on_map("goal", [walk["goal"]], dots=True)]
    x_limits, y_limits = limits_around(east), limits_around(north)
    scale = LONGER_SIDE / max(x_limits[1] - x_limits[0], y_limits[1] - y_limits[0])  # the same for both axes
    chart = Chart("The map and one walk on it", "metres east", "metres north", lines + ends, x_limits, y_limits,
                  width=scale * (x_limits[1] - x_limits[0]), height=scale * (y_limits[1] - y_limits[0]))
    study.page.chart("map", chart,
                     f"The route of '{study.recordings.train}' on the map. Of all tasks, the one for which junctions "
                     "save most: the way of place_filter, first seed, with and without junctions.")


def remarks(study: Study) -> None:
    """Remarks where an agent is no better than without junctions, or than a policy that learned nothing."""
    with_junctions, without = study.points
    for label, policy in with_junctions.items():
        for traversal in study.data["traversals"] if policy.learns else ():
            for figure, what, other, whom in (
                    ("completed", "a share of completed tasks of", without[label], "the same agent without them"),
                    ("spl", "SPL", without[label], "the same agent without them"),
                    ("spl", "SPL", with_junctions[UNADAPTED], "the sequence filter, which has learned nothing"),
                    ("spl", "SPL", without[BLIND], "the sweep that never looks")):
                own, yardstick = (one.trials(traversal).figure(figure).mean for one in (policy, other))
                if own < yardstick and fixed(own, 3) != fixed(yardstick, 3):
                    study.page.remark(f"On '{traversal}' {label} with junctions has {what} {fixed(own, 3)}, "
                                      f"less than {whom}: {fixed(yardstick, 3)}.")
