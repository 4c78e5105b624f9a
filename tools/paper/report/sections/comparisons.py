# SPDX-License-Identifier: Apache-2.0
"""The parts that compare policies while one thing varies: the features, the route, what they know, the world."""

import math
from typing import Any

from charts import Bar, BarChart
from estimates import Estimate, fixed, mean_of, percent, text_of
from policies import Policy, Trials, is_worse
from study import BLIND, MEANS, MISHAPS, TOLD, TRIALS, UNADAPTED, Policies, Study, name_of

ALIKE = 0.01  # SPL; less than this is no difference


def first_of(point: Policies) -> Any:
    return next(iter(point.values())).data


def dimensions(study: Study) -> None:
    data, recordings, page = study.data, study.recordings, study.page
    drawn = "The given data have no pictures, so these are drawn recordings. " if data["substitute"] else ""
    page.text(
        f"{drawn}The paper's main finding is that smaller features generalise better. Here agents learn from "
        f"'{recordings.train}' alone, on more or fewer features of the same encoder, {data['encoder']}: the first "
        f"principal components of its {data['encoder_dimension']} numbers, learned from the {data['learned_from']} "
        f"frames of '{recordings.train}'. Then they are tried on every traversal. features learns by PPO, place_filter "
        "by relabelling; 'sequence_filter' and 'blind' learn nothing."
        + (" The quick report trains features on the fewest and the most alone." if study.inputs.quick else ""))
    if data["missing"]:
        missing = ", ".join(map(str, data["missing"]))
        page.remark(f"Not tried: {missing} features. {data['encoder']} has {data['encoder_dimension']}, and "
                    f"{data['learned_from']} frames have at most {data['learned_from'] - 1} principal components.")
    sizes = [first_of(point)["features"] for point in study.points]
    study.remark_failed(", {features} features")
    study.draw_sizes("dimensions", "features", "features a frame", sizes)
    study.tried("dimensions", f"{study.places}, by number of features: {MEANS}.", ["features", "policy", *TRIALS],
                recordings.names)
    for label in study.points[0]:
        if label != BLIND:
            conclude(study, label)


def unseen(study: Study, policy: Policy) -> Estimate:
    """Returns the mean SPL on traversals never seen, over seeds of the means over traversals."""
    others = [name for name in study.recordings.names if name != study.recordings.train]
    return mean_of([mean_of([Trials([row for row in rows if row["traversal"] == name and not row.get("shuffled")])
                             .spl.mean for name in others]).mean for rows in policy.trials_of_seeds()], (0, 1))


def conclude(study: Study, label: str) -> None:
    """Says how the fewest and the most features compare on traversals never seen, whichever way it comes out."""
    tried = [(point[label].data["features"], unseen(study, point[label])) for point in study.points if label in point]
    tried = [(features, spl) for features, spl in tried if math.isfinite(spl.mean)]
    if len(tried) < 2:
        return
    (fewest, small), (most, large) = tried[0], tried[-1]
    best = max(tried, key=lambda one: one[1].mean)
    gain = small.mean - large.mean
    verdict = "about as well as" if abs(gain) < ALIKE else "better than" if gain > 0 else "worse than"
    study.page.text(f"{label}: on traversals never seen, {fewest} features do {verdict} {most}: SPL "
                    f"{text_of(small, 3)} and {text_of(large, 3)}. Best: {best[0]} with {fixed(best[1].mean, 3)}.")


def longer_routes(study: Study) -> None:
    recordings, lengths = study.recordings, [first_of(point)["frames"] for point in study.points]
    limit = "places (the whole report: 512)" if study.inputs.quick else "places, beyond which it would take hours"
    study.page.text(
        f"The paper's routes have 128 places; here they have {', '.join(map(str, lengths))} of the {study.kind} "
        "recordings, with as many steps as places for each task. place_filter learns by relabelling (the learner "
        "'relabel'); features learns by PPO, as recommended for 128 places, on at most "
        f"{study.data['most_for_features']} {limit}. Beside them are policies that need no learning: "
        "'blind' sweeps without looking, 'shortest_path' knows its place, 'sequence_filter' is Bayes' rule written by "
        "hand.")
    study.draw_sizes("longer-routes", "length of the route", "places on the route", lengths)
    study.tried("longer-routes",
                f"After training: {MEANS}. Shuffled: completed when the frames are shown in a random order.",
                ["places", "policy", *TRIALS, "shuffled"], recordings.names)
    study.trained("longer-routes-training",
                  f"Training on '{recordings.train}' (95 % interval over seeds): episodes until the last 100 of "
                  "them have SPL 0.95, and how much was learned from in total.",
                  ["places", "agent", "learner", "seeds", "episodes to SPL 0.95", "seeds that reached it", "episodes",
                   "steps", "seconds"])
    study.remark_failed(", {places} places")
    for point in study.points:
        for policy in [policy for policy in point.values() if policy.learns]:
            remark_worse_than_controls(study, policy, point)


def remark_worse_than_controls(study: Study, policy: Policy, point: Policies) -> None:
    """Remarks where an agent is worse than policies that learn nothing."""
    lost, behind = [], []
    for name in study.recordings.names:
        own = policy.trials(name)
        figures = f"{name} (SPL {fixed(own.spl.mean, 3)}, completed {percent(own.completed)})"
        if own.spl.mean <= point[BLIND].trials(name).spl.mean:
            lost.append(figures)
        elif is_worse(own.spl, point[UNADAPTED].trials(name).spl):
            behind.append(figures)
    for found, text in ((lost, "no better than a policy that never looks"),
                        (behind, "worse than the sequence filter by more than 0.01 SPL")):
        if found:
            study.page.remark(f"{policy.label}, {policy.cells['places']} places: {text} on {', '.join(found)}.")


def imperfect_world(study: Study) -> None:
    train, traversals = study.recordings.train, study.data["traversals"]
    study.page.text(
        "The world of this part is imperfect. An action slips: half of the slips do nothing, half are done twice. "
        "After a step the frame before is seen again. Once an episode the agent is carried to another place and not "
        f"told. place_filter learns in such a world, from '{train}' alone, and is told how likely slips and "
        f"kidnappings are, as '{TOLD}' is; the plain sequence_filter takes the world for perfect. 'blind' never looks. "
        "'shortest_path' knows its place: what "
        "it lacks to 1 is what no policy can make good. All policies meet the same mishaps at the same steps.")
    worlds = [first_of(point)["imperfections"] for point in study.points]
    names = list(map(name_of, worlds))
    study.remark_failed(", {world}")
    for traversal in traversals:
        for kind in ("slip", "dropped_frames"):
            # A world with one kind of mishap, by its percentage, from the perfect one on.
            along = {100 * world[kind]: point for world, point in zip(worlds, study.points)
                     if all(world[other] == 0 for other in MISHAPS if other != kind)}
            study.draw_spl(f"imperfect-world-{kind.replace('_', '-')}-{traversal}",
                           study.title(traversal, f"SPL by {MISHAPS[kind]}"), f"{MISHAPS[kind]}, %",
                           [(amount, traversal, point) for amount, point in zip(along, alike(list(along.values())))])
        draw_kidnappings(study, {name: point for name, world, point in zip(names, worlds, study.points)
                                 if world["kidnappings"] or name == "perfect"}, traversal)
    study.tried("imperfect-world", f"{study.places_and_eye}: {MEANS}.", ["world", "policy", *TRIALS], traversals)
    for name, point in zip(names, study.points):
        remark_behind(study, name, point)


def alike(points: list[Policies]) -> list[Policies]:
    """Returns the points with the same policies each. Where nothing can be told the told filter is the plain one."""
    labels = dict.fromkeys(label for point in points for label in point)
    return [{label: point.get(label, point[UNADAPTED]) for label in labels} for point in points]


def draw_kidnappings(study: Study, worlds: dict[str, Policies], traversal: str) -> None:
    """Draws the worlds with kidnappings beside the perfect one."""
    points = alike(list(worlds.values()))
    chart = BarChart(study.title(traversal, "SPL with kidnappings"), "SPL", list(points[0]))
    for name, point in zip(worlds, points):
        estimates = [policy.trials(traversal).spl for policy in point.values()]
        chart.groups[name] = [Bar(spl.mean, spl.low, spl.high) for spl in estimates]
    study.page.bars(f"imperfect-world-kidnappings-{traversal}", chart,
                    f"{chart.title}, mean of the seeds with its 95 % interval.")


def remark_behind(study: Study, world: str, point: Policies) -> None:
    """Remarks where what is learned is behind what learns nothing, shortest_path apart, which knows its place."""
    for label, policy in point.items():
        for traversal in study.data["traversals"] if policy.learns else ():
            own = policy.trials(traversal).spl
            ahead = [f"{other} {fixed(spl.mean, 3)}" for other in (UNADAPTED, TOLD, BLIND) if other in point
                     if is_worse(own, spl := point[other].trials(traversal).spl, margin=0)]
            if ahead:
                study.page.remark(f"{label}, {world}, {traversal}: SPL {fixed(own.mean, 3)}, less than "
                                  f"{', '.join(ahead)}.")
