# SPDX-License-Identifier: Apache-2.0
"""Agents and controls, what their seeds say together, and the columns of tables made of it."""

import math
from dataclasses import dataclass, field
from typing import Any, Callable

import numpy
from charts import Line
from estimates import BOUNDS, COUNTS, Bounds, Estimate, fixed, mean_of, percent, share_of, smoothed, text_of
from inputs import number, numbers
from published import Published, published

LAST_EPISODES = 500  # whose mean is an agent's figure at the end of training
POINTS = 200  # of a drawn curve


@dataclass(frozen=True)
class Trials:
    """The trials of several seeds on one traversal."""
    rows: list[Any]  # of a seed each

    @property
    def seeds_by_tasks(self) -> str:
        return f"{len(self.rows)} x {self.rows[-1]['tasks']}" if self.rows else "-"

    def figure(self, name: str) -> Estimate:
        """Returns the mean over the seeds. Of one seed it is, for completed tasks, their share (Wilson)."""
        values = [row[name] for row in self.rows]
        if len(values) == 1 and name == "completed":
            tasks = self.rows[0]["tasks"]
            return share_of(values[0] * tasks, tasks)
        return mean_of([number(value) for value in values], BOUNDS.get(name, COUNTS))

    @property
    def spl(self) -> Estimate:
        return self.figure("spl")

    @property
    def completed(self) -> Estimate:
        return self.figure("completed")


@dataclass
class Policy:
    """An agent that learns or learned, or a control, which learns nothing."""
    data: Any  # its entry in report.json
    outcomes: list[Any]  # of its units; None: failed
    cells: dict[str, str] = field(default_factory=dict)  # columns of tables that tell it from others

    @property
    def label(self) -> str:
        return self.data["label"]

    @property
    def learns(self) -> bool:
        return self.data["learns"]

    @property
    def trainings(self) -> list[Any]:
        """Returns the outcomes that there are."""
        return [outcome for outcome in self.outcomes if outcome is not None]

    @property
    def published(self) -> Published:
        return published(self.data["policy"], self.data["features"])

    def trials(self, traversal: str, shuffled: bool = False) -> Trials:
        return Trials([row for outcome in self.trials_of_seeds() for row in outcome
                       if row["traversal"] == traversal and row.get("shuffled", False) == shuffled])

    def trials_of_seeds(self) -> list[list[Any]]:
        return [outcome if isinstance(outcome, list) else outcome["trials"] for outcome in self.trainings]

    def mean(self, name: str) -> Estimate:
        """Returns the mean of a field of the trainings, such as "episodes"."""
        return mean_of([number(training[name]) for training in self.trainings], COUNTS)

    def threshold(self, name: str) -> list[float]:
        """Returns each seed's effort until its last 100 episodes had SPL 0.95, NaN where it never got there."""
        return [number(t["spl95"][name]) if t["spl95"] else math.nan for t in self.trainings]

    def reached(self, name: str = "episodes") -> Estimate:
        return mean_of(self.threshold(name), COUNTS)

    def final(self, figure: str) -> Estimate:
        """Returns a figure at the end of training."""
        return mean_of([final_value(training, figure) for training in self.trainings], BOUNDS.get(figure, COUNTS))

    def curve(self, label: str, figure: str, smoothing: float) -> Line:
        """Returns a figure of the training over episodes, each seed's smoothed first; empty when all seeds failed."""
        if not self.trainings:
            return Line(label)
        last = max(number(training["episodes"]) for training in self.trainings)
        x = [last * i / POINTS for i in range(1, POINTS + 1)]
        curves = [training["curve"] for training in self.trainings]
        seeds = [list(numpy.interp(x, numbers(curve["episodes"]), smoothed(numbers(curve[figure]), smoothing),
                                   left=math.nan, right=math.nan)) for curve in curves]
        return line_of_means(label, x, seeds, BOUNDS.get(figure, COUNTS))


def final_value(training: Any, figure: str) -> float:
    """Returns the mean of a figure over the last episodes, NaN when there were none."""
    episodes, values = numbers(training["curve"]["episodes"]), numbers(training["curve"][figure])
    total = weight = 0.0
    for i in reversed(range(len(values))):
        if episodes[-1] - episodes[i] >= LAST_EPISODES:
            break
        if math.isfinite(values[i]):
            count = episodes[i] - (episodes[i - 1] if i else 0)
            total += count * values[i]
            weight += count
    return total / weight if weight else math.nan


def held(values: list[float]) -> list[float]:
    """Returns the values with the last finite one repeated to the end. Otherwise the mean would jump where a seed ends
    that has fewer episodes than the others, as those that fail do."""
    last = max((i for i, value in enumerate(values) if math.isfinite(value)), default=None)
    return values if last is None else values[:last + 1] + [values[last]] * (len(values) - last - 1)


def line_of_means(label: str, x: list[float], seeds: list[list[float]], bounds: Bounds) -> Line:
    """Returns the mean of the seeds, held at their ends, and its interval over x."""
    seeds = [held(seed) for seed in seeds]
    estimates = [mean_of([seed[i] for seed in seeds], bounds) for i in range(len(x))]
    return Line(label, x, [e.mean for e in estimates], [e.low for e in estimates], [e.high for e in estimates])


def is_worse(estimate: Estimate, yardstick: Estimate, margin: float = 0.01) -> bool:
    """Whether a figure is worse on the same tasks: by more than the margin, and not by chance alone where there is an
    interval to tell."""
    if not estimate.mean < yardstick.mean - margin:
        return False
    return not math.isfinite(estimate.high) or estimate.high < yardstick.mean


# The columns of tables about trainings, and about trials on a traversal.
TRAINED: dict[str, Callable[[Policy], str]] = {
    "seeds": lambda policy: str(len(policy.trainings)),
    "episodes to SPL 0.95": lambda policy: text_of(policy.reached(), 0),
    "seconds to SPL 0.95": lambda policy: text_of(policy.reached("seconds"), 1),
    "seeds that reached it": lambda policy: f"{policy.reached().n} of {len(policy.trainings)}",
    "episodes": lambda policy: text_of(policy.mean("episodes"), 0),
    "steps": lambda policy: text_of(policy.mean("steps"), 0),
    "seconds": lambda policy: text_of(policy.mean("seconds"), 1),
    "reward": lambda policy: text_of(policy.final("reward"), 3),
    "SPL": lambda policy: text_of(policy.final("spl"), 3),
    "steps an episode": lambda policy: text_of(policy.final("length"), 1),
    "paper: training": lambda policy: policy.published.time,
    "paper: reward": lambda policy: fixed(policy.published.reward, 2),
    "paper: steps": lambda policy: policy.published.steps}
TRIED: dict[str, Callable[[Trials], str]] = {
    "seeds x tasks": lambda trials: trials.seeds_by_tasks,
    "completed": lambda trials: percent(trials.completed),
    "failed": lambda trials: f"{fixed(100 * (1 - trials.completed.mean), 1)} %",
    "SPL": lambda trials: text_of(trials.spl, 3),
    "excess": lambda trials: text_of(trials.figure("excess"), 2),
    "steps": lambda trials: text_of(trials.figure("steps"), 1),
    "reward": lambda trials: text_of(trials.figure("reward"), 3)}


def training_row(policy: Policy, columns: list[str | tuple[str, str]]) -> list[str]:
    """Returns a row of a table about trainings; a column may be (heading, key of TRAINED)."""
    keys = [column if isinstance(column, str) else column[1] for column in columns]
    return [policy.cells[key] if key in policy.cells else TRAINED[key](policy) for key in keys]


def trial_row(policy: Policy, traversal: str, columns: list[str]) -> list[str]:
    trials, shuffled = policy.trials(traversal), policy.trials(traversal, shuffled=True)
    cells = {**policy.cells, "traversal": traversal, "shuffled": percent(shuffled.completed) if shuffled.rows else "-"}
    return [cells[column] if column in cells else TRIED[column](trials) for column in columns]
