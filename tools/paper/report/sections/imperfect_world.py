# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: an imperfect world."""

from typing import Any

from charts import Bar, BarChart
from compared import BLIND, TOLD, UNADAPTED, Policies, draw_spl, learns_nothing, policies_of
from estimates import fixed
from inputs import Inputs
from page import Page
from trials import MEANS, is_worse, short_rows, trials_on

KINDS = {"slip": "slip", "dropped_frames": "dropped frames", "kidnappings": "kidnappings"}


def render(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        "The world of this part is imperfect. An action slips: half of the slips do nothing, half are done twice. "
        "After a step the frame before is seen again. Once an episode the agent is carried to another place and not "
        "told. place_filter learns in such a world, from "
        f"'{inputs.recordings.train}' alone, and is told how likely slips and kidnappings are, as '{TOLD}' is; the "
        "plain sequence_filter takes the world for perfect. 'blind' never looks. 'shortest_path' knows its place: what "
        "it lacks to 1 is what no policy can make good. All policies meet the same mishaps at the same steps.")
    worlds = [(world, policies_of(inputs, world, name_of(world), page)) for world in data["worlds"]]
    for traversal in data["traversals"]:
        for kind in ("slip", "dropped_frames"):
            draw_spl(f"imperfect-world-{kind.replace('_', '-')}",
                     f"{traversal}{inputs.recordings.role(traversal)}: SPL by {KINDS[kind]}", f"{KINDS[kind]}, %",
                     along(worlds, kind), traversal, page)
        draw_others(inputs, worlds, traversal, page)
    rows = [row for world, policies in worlds for label, outcomes in policies.items()
            for row in short_rows(outcomes, data["traversals"], name_of(world), label)]
    page.table("imperfect-world",
               f"Places 0 to {data['frames'] - 1}, as {data['representation']}: {MEANS}.",
               ["world", "policy", "traversal", "seeds x tasks", "completed", "SPL", "excess"], rows)
    for world, policies in worlds:
        remark_behind(world, policies, data["traversals"], page)


def name_of(world: Any) -> str:
    """Returns "slip 10 %, kidnappings 1"."""
    parts = [f"{text} {world[kind]}" if kind == "kidnappings" else f"{text} {100 * world[kind]:g} %"
             for kind, text in KINDS.items() if world[kind] > 0]
    return ", ".join(parts) or "perfect"


def only(world: Any, kind: str) -> bool:
    return all(world[other] == 0 for other in KINDS if other != kind)


def along(worlds: list[tuple[Any, Policies]], kind: str) -> list[tuple[float, Policies]]:
    """Returns the worlds with one kind of mishap, by its percentage, from the perfect world on. In that one nothing can
    be told, so the told filter is the plain one."""
    chosen = [(100 * world[kind], policies) for world, policies in worlds if only(world, kind)]
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
