# SPDX-License-Identifier: Apache-2.0
"""The parts that compare policies while one thing varies: the features, the route, what they know, the world."""

import math
from typing import Any

from charts import Bar, BarChart
from compared import (BLIND, TOLD, TRIALS, UNADAPTED, Policies, draw_spl, learns_nothing, policies_of,
                      remark_failed_agents, table_rows)
from curves import effort_cells
from estimates import Estimate, fixed, mean_of, text_of
from inputs import Inputs, Recordings
from page import Page
from trials import MEANS, Rows, is_worse, remark_failed, remark_worse_than_controls, shuffled_cell, trials_on

ALIKE = 0.01  # SPL; less than this is no difference
KINDS = {"slip": "slip", "dropped_frames": "dropped frames", "kidnappings": "kidnappings"}


def dimensions(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = Recordings(data["recordings"])
    drawn = "The given data have no pictures, so these are drawn recordings. " if data["substitute"] else ""
    page.text(
        f"{drawn}The paper's main finding is that smaller features generalise better. Here agents learn from "
        f"'{recordings.train}' alone, on more or fewer features of the same encoder, {data['encoder']}: the first "
        f"principal components of its {data['encoder_dimension']} numbers, learned from the {data['learned_from']} "
        f"frames of '{recordings.train}'. Then they are tried on every traversal. features learns by PPO, place_filter "
        "by relabelling; 'sequence_filter' and 'blind' learn nothing."
        + (" The quick report trains features on the fewest and the most alone." if inputs.quick else ""))
    if data["missing"]:
        missing = ", ".join(map(str, data["missing"]))
        page.remark(f"Not tried: {missing} features. {data['encoder']} has {data['encoder_dimension']}, and "
                    f"{data['learned_from']} frames have at most {data['learned_from'] - 1} principal components.")
    for size in data["sizes"]:
        remark_failed_agents(inputs, size, f", {size['features']} features", page)
    sizes = [(size["features"], policies_of(inputs, size)) for size in data["sizes"]]
    for traversal in recordings.names:
        draw_spl("dimensions", f"{traversal}{recordings.role(traversal)}: SPL by features", "features a frame", sizes,
                 traversal, page, x_logarithmic=True, x_limits=(sizes[0][0] * 0.9, sizes[-1][0] * 1.1))
    page.table("dimensions", f"Places 0 to {data['frames'] - 1}, by number of features: {MEANS}.",
               ["features", "policy", *TRIALS],
               table_rows([(str(features), policies) for features, policies in sizes], recordings.names))
    for label in [label for label in sizes[0][1] if label != BLIND]:
        conclude(label, recordings, sizes, page)


def unseen(recordings: Recordings, outcomes: list[Rows | None]) -> Estimate:
    """Returns the mean SPL on traversals never seen, over seeds of the means over traversals."""
    others = [name for name in recordings.names if name != recordings.train]
    return mean_of([mean_of([trials_on([rows], name).spl.mean for name in others]).mean for rows in outcomes], (0, 1))


def conclude(label: str, recordings: Recordings, sizes: list[tuple[int, Policies]], page: Page) -> None:
    """Says how the fewest and the most features compare on traversals never seen, whichever way it comes out."""
    tried = [(features, unseen(recordings, policies[label])) for features, policies in sizes if label in policies]
    tried = [(features, spl) for features, spl in tried if math.isfinite(spl.mean)]
    if len(tried) < 2:
        return
    (fewest, small), (most, large) = tried[0], tried[-1]
    best = max(tried, key=lambda one: one[1].mean)
    gain = small.mean - large.mean
    verdict = "about as well as" if abs(gain) < ALIKE else "better than" if gain > 0 else "worse than"
    page.text(f"{label}: on traversals never seen, {fewest} features do {verdict} {most}: SPL {text_of(small, 3)} and "
              f"{text_of(large, 3)}. Best: {best[0]} with {fixed(best[1].mean, 3)}.")


def longer_routes(inputs: Inputs, data: Any, page: Page) -> None:
    recordings, routes = inputs.recordings, data["routes"]
    lengths = ", ".join(str(route["frames"]) for route in routes)
    limit = "places (the whole report: 512)" if inputs.quick else "places, beyond which it would take hours"
    page.text(
        f"The paper's routes have 128 places; here they have {lengths} of the "
        f"{'drawn' if recordings.drawn else 'real'} recordings, with as many steps as places for each task. "
        "place_filter learns by relabelling (the learner 'relabel'); features learns by PPO, as recommended for 128 "
        f"places, on at most {data['most_for_features']} {limit}. Beside them are policies that need no learning: "
        "'blind' sweeps without looking, 'shortest_path' knows its place, 'sequence_filter' is Bayes' rule written by "
        "hand.")
    points = [(route["frames"], policies_of(inputs, route)) for route in routes]
    for traversal in recordings.names:
        draw_spl("longer-routes", f"{traversal}{recordings.role(traversal)}: SPL by length of the route",
                 "places on the route", points, traversal, page, x_logarithmic=True,
                 x_limits=(points[0][0] * 0.9, points[-1][0] * 1.1))
    page.table("longer-routes",
               f"After training: {MEANS}. Shuffled: completed when the frames are shown in a random order.",
               ["places", "policy", *TRIALS, "shuffled"],
               [[*row, shuffled_cell(policies[row[1]], traversal=row[2])] for places, policies in points
                for row in table_rows([(str(places), policies)], recordings.names)])
    trained = [(str(route["frames"]), agent, inputs.outcomes(agent["units"]))
               for route in routes for agent in route["agents"]]
    page.table("longer-routes-training",
               f"Training on '{recordings.train}' (95 % interval over seeds): episodes until the last 100 of "
               "them have SPL 0.95, and how much was learned from in total.",
               ["places", "agent", "learner", "seeds", "episodes to SPL 0.95", "seeds that reached it", "episodes",
                "steps", "seconds"],
               [[places, agent["label"], agent["learner"],
                 *effort_cells(trainings, "episodes", "steps", "seconds")] for places, agent, trainings in trained
                if trainings])
    for places, policies in points:
        for agent, trainings in [(agent, trainings) for length, agent, trainings in trained if length == str(places)]:
            who = f"{agent['label']}, {places} places"
            remark_failed(page, who, len(trainings), len(agent["units"]))
            remark_worse_than_controls(page, who, recordings.names, policies[agent["label"]], policies[BLIND],
                                       policies[UNADAPTED], "on")


def experiences(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = Recordings(data["recordings"])
    second, known = data["second"], (recordings.train, data["second"])
    others = [name for name in recordings.names if name not in known]
    drawn = "The given data have one recording alone, so these are drawn recordings. " if data["substitute"] else ""
    origin = (f"The data have no third recording, so '{', '.join(others)}' is simulated: each frame is a mixture of "
              "the two that are learned from, from place to place more of the one or of the other, as if snow had "
              "melted in patches. It lies between them by construction, which favours agents that know both."
              if data["simulated"] else "All of them are recordings of their own.")
    page.text(f"{drawn}Agents that learned from '{recordings.train}' alone beside agents that learned from '{second}' "
              "too, the same number of steps in all (--train A,B). Filters remember each place as both showed it. All "
              f"are tried on recordings that neither knows: {', '.join(others)}. {origin}")
    scores = [(", ".join([recordings.train, *variant["more"]]), policies_of(inputs, variant))
              for variant in data["variants"]]
    for (learned, _), variant in zip(scores, data["variants"]):
        remark_failed_agents(inputs, variant, f" on {learned}", page)
    page.table("experiences", f"Places 0 to {data['frames'] - 1}, as {data['representation']}: {MEANS}.",
               ["policy", "knows", "recording", *TRIALS[1:]],
               [[label, learned, *row] for learned, label, *row in table_rows(scores, recordings.names)])
    (_, of_one), (_, of_two) = scores
    for label, outcomes in of_two.items():
        for name in others:
            alone, both = trials_on(of_one[label], name).spl, trials_on(outcomes, name).spl
            if is_worse(both, alone, margin=0):
                page.remark(f"{label}: two experiences are worse than one on {name} (SPL {fixed(both.mean, 3)} against "
                            f"{fixed(alone.mean, 3)}).")


def imperfect_world(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        "The world of this part is imperfect. An action slips: half of the slips do nothing, half are done twice. "
        "After a step the frame before is seen again. Once an episode the agent is carried to another place and not "
        "told. place_filter learns in such a world, from "
        f"'{inputs.recordings.train}' alone, and is told how likely slips and kidnappings are, as '{TOLD}' is; the "
        "plain sequence_filter takes the world for perfect. 'blind' never looks. 'shortest_path' knows its place: what "
        "it lacks to 1 is what no policy can make good. All policies meet the same mishaps at the same steps.")
    for world in data["worlds"]:
        remark_failed_agents(inputs, world, f", {name_of(world)}", page)
    worlds = [(world, policies_of(inputs, world)) for world in data["worlds"]]
    for traversal in data["traversals"]:
        for kind in ("slip", "dropped_frames"):
            draw_spl(f"imperfect-world-{kind.replace('_', '-')}",
                     f"{traversal}{inputs.recordings.role(traversal)}: SPL by {KINDS[kind]}", f"{KINDS[kind]}, %",
                     along(worlds, kind), traversal, page)
        draw_others(inputs, worlds, traversal, page)
    page.table("imperfect-world", f"Places 0 to {data['frames'] - 1}, as {data['representation']}: {MEANS}.",
               ["world", "policy", *TRIALS],
               table_rows([(name_of(world), policies) for world, policies in worlds], data["traversals"]))
    for world, policies in worlds:
        remark_behind(world, policies, data["traversals"], page)


def name_of(world: Any) -> str:
    """Returns "slip 10 %, kidnappings 1"."""
    parts = [f"{text} {world[kind]}" if kind == "kidnappings" else f"{text} {100 * world[kind]:g} %"
             for kind, text in KINDS.items() if world[kind] > 0]
    return ", ".join(parts) or "perfect"


def along(worlds: list[tuple[Any, Policies]], kind: str) -> list[tuple[float, Policies]]:
    """Returns the worlds with one kind of mishap, by its percentage, from the perfect world on. In that one nothing can
    be told, so the told filter is the plain one."""
    chosen = [(100 * world[kind], policies) for world, policies in worlds
              if all(world[other] == 0 for other in KINDS if other != kind)]
    labels = dict.fromkeys(label for _, policies in chosen for label in policies)
    return [(amount, {label: policies.get(label, policies[UNADAPTED]) for label in labels})
            for amount, policies in chosen]


def draw_others(inputs: Inputs, worlds: list[tuple[Any, Policies]], traversal: str, page: Page) -> None:
    """Draws the worlds with kidnappings beside the perfect one."""
    chosen = [(world, policies) for world, policies in worlds if world["kidnappings"] or name_of(world) == "perfect"]
    labels = list(dict.fromkeys(label for _, policies in chosen for label in policies))
    chart = BarChart(f"{traversal}{inputs.recordings.role(traversal)}: SPL with kidnappings", "SPL", labels)
    for world, policies in chosen:
        estimates = [trials_on(policies.get(label, policies[UNADAPTED]), traversal).spl for label in labels]
        chart.groups[name_of(world)] = [Bar(spl.mean, spl.low, spl.high) for spl in estimates]
    page.bars(f"imperfect-world-kidnappings-{traversal}", chart,
              f"{chart.title}, mean of the seeds with its 95 % interval.")


def remark_behind(world: Any, policies: Policies, traversals: list[str], page: Page) -> None:
    """Remarks where what is learned is behind what learns nothing, shortest_path apart, which knows its place."""
    for label, outcomes in policies.items():
        if learns_nothing(label):
            continue
        for traversal in traversals:
            own = trials_on(outcomes, traversal).spl
            ahead = [f"{other} {fixed(spl.mean, 3)}" for other in (UNADAPTED, TOLD, BLIND) if other in policies
                     if is_worse(own, spl := trials_on(policies[other], traversal).spl, margin=0)]
            if ahead:
                page.remark(f"{label}, {name_of(world)}, {traversal}: SPL {fixed(own.mean, 3)}, less than "
                            f"{', '.join(ahead)}.")
