# SPDX-License-Identifier: Apache-2.0
"""Policies that learn beside policies that learn nothing."""

from typing import Any

from charts import Chart, Line
from inputs import Inputs
from page import Page
from trials import Rows, remark_failed, rows_of, short_rows, trials_on

Policies = dict[str, list[Rows | None]]  # outcomes by label

UNADAPTED, TOLD, BLIND = "sequence_filter", "sequence_filter, told", "blind"
TRIALS = ["traversal", "seeds x tasks", "completed", "SPL", "excess"]  # columns of short_rows()


def learns_nothing(label: str) -> bool:
    return label in (UNADAPTED, TOLD, BLIND, "shortest_path")


def policies_of(inputs: Inputs, part: Any) -> Policies:
    """Returns the outcomes of the part's agents and controls."""
    agents = {agent["label"]: list(rows_of(inputs.outcomes(agent["units"]))) for agent in part["agents"]}
    return {**agents, **inputs.controls(part)}


def remark_failed_agents(inputs: Inputs, part: Any, name: str, page: Page) -> None:
    for agent in part["agents"]:
        remark_failed(page, agent["label"] + name, len(inputs.outcomes(agent["units"])), len(agent["units"]))


def draw_spl(key: str, title: str, x_label: str, points: list[tuple[float, Policies]], traversal: str, page: Page,
             **limits: Any) -> None:
    """Draws SPL on a traversal: a line for each policy, with intervals where it learns."""
    lines: dict[str, Line] = {}
    for x, policies in points:
        for label, outcomes in policies.items():
            learned = not learns_nothing(label)
            line = lines.setdefault(label, Line(label, dashed=not learned))
            spl = trials_on(outcomes, traversal).spl
            line.add(x, spl.mean, *((spl.low, spl.high) if learned else ()))
    chart = Chart(title, x_label, "SPL", list(lines.values()), y_limits=(0, 1), height=260, **limits)
    page.chart(f"{key}-{traversal}", chart,
               f"{title}, mean of the seeds with its 95 % interval; dashed: policies that learn nothing.")


def table_rows(points: list[tuple[str, Policies]], traversals: list[str]) -> list[list[str]]:
    """Returns short_rows() of all policies, after their name for each point and their label."""
    return [row for name, policies in points for label, outcomes in policies.items()
            for row in short_rows(outcomes, traversals, name, label)]
