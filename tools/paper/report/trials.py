# SPDX-License-Identifier: Apache-2.0
"""What the trials of several seeds on one traversal say together."""

import math
from dataclasses import dataclass
from typing import Any

from estimates import BOUNDS, COUNTS, Estimate, fixed, mean_of, percent, share_of, text_of
from inputs import number
from page import Page

# For captions of tables.
MEANS = ("means over the same tasks for all policies (agents: over seeds, with the 95 % interval of the mean; one seed "
         "or a control: of the share, Wilson)")

Rows = list[Any]  # of one seed: {"traversal", "shuffled" where it may be so, tasks, completed, spl, ...}


@dataclass(frozen=True)
class Trials:
    seeds: int
    tasks: int  # of each seed
    completed: Estimate  # mean over the seeds; of one seed or a control over its tasks (Wilson)
    spl: Estimate
    excess: Estimate
    steps: Estimate
    reward: Estimate

    @property
    def seeds_by_tasks(self) -> str:
        return f"{self.seeds} x {self.tasks}" if self.seeds else "-"


def rows_of(trainings: list[Any]) -> list[Rows]:
    return [training["trials"] for training in trainings]


def trials_on(outcomes: list[Rows | None], traversal: str, shuffled: bool = False) -> Trials:
    """Returns the trials on a traversal. Failed outcomes (None) and those without such a row are left out."""
    found = [row for rows in outcomes for row in (rows or [])
             if row["traversal"] == traversal and row.get("shuffled", False) == shuffled]
    figures = {name: mean_of([number(row[name]) for row in found], BOUNDS.get(name, COUNTS))
               for name in ("completed", "spl", "excess", "steps", "reward")}
    tasks = found[-1]["tasks"] if found else 0
    if len(found) == 1:
        figures["completed"] = share_of(found[0]["completed"] * tasks, tasks)
    return Trials(len(found), tasks, **figures)


def is_worse(estimate: Estimate, yardstick: Estimate, margin: float = 0.01) -> bool:
    """Whether a figure is worse on the same tasks: by more than the margin, and not by chance alone where there is an
    interval to tell."""
    if not estimate.mean < yardstick.mean - margin:
        return False
    return not math.isfinite(estimate.high) or estimate.high < yardstick.mean


def remark_worse_than_controls(page: Page, who: str, recordings: list[str], agent: list[Rows | None],
                               blind: list[Rows | None], sequence_filter: list[Rows | None], preposition: str) -> None:
    """Remarks on which recordings an agent is worse than policies that learn nothing."""
    lost, behind = [], []
    for name in recordings:
        own = trials_on(agent, name)
        figures = f"{name} (SPL {fixed(own.spl.mean, 3)}, completed {percent(own.completed)})"
        if own.spl.mean <= trials_on(blind, name).spl.mean:
            lost.append(figures)
        elif is_worse(own.spl, trials_on(sequence_filter, name).spl):
            behind.append(figures)
    if lost:
        page.remark(f"{who}: no better than a policy that never looks {preposition} {', '.join(lost)}.")
    if behind:
        page.remark(f"{who}: worse than the sequence filter by more than 0.01 SPL {preposition} {', '.join(behind)}.")


def remark_failed(page: Page, who: str, succeeded: int, seeds: int) -> None:
    if succeeded < seeds:
        page.remark(f"{who}: {seeds - succeeded} of {seeds} trainings failed.")


def short_rows(outcomes: list[Rows | None], traversals: list[str], *labels: str) -> list[list[str]]:
    """Returns the labels and the columns "traversal", "seeds x tasks", "completed", "SPL", "excess", a row for each
    traversal that was tried."""
    found = [(name, trials_on(outcomes, name)) for name in traversals]
    return [[*labels, name, trials.seeds_by_tasks, percent(trials.completed), text_of(trials.spl, 3),
             text_of(trials.excess, 2)] for name, trials in found if trials.seeds]


def shuffled_cell(outcomes: list[Rows | None], traversal: str) -> str:
    """Returns the share of tasks completed when the frames were shown in a random order."""
    trials = trials_on(outcomes, traversal, shuffled=True)
    return percent(trials.completed) if trials.seeds else "-"
