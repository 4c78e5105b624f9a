# SPDX-License-Identifier: Apache-2.0
"""Training curves: means over seeds."""

import math
from typing import Any

import numpy
from charts import Line
from estimates import BOUNDS, COUNTS, Bounds, Estimate, mean_of, smoothed, text_of
from inputs import number, numbers

LAST_EPISODES = 500  # whose mean is an agent's figure at the end of training
POINTS = 200  # of a drawn curve
MEAN_OF_SEEDS = ("mean of the seeds with its 95 % interval (a seed with fewer episodes than the others counts on with "
                 "its last value)")


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


def final_values(trainings: list[Any], figure: str) -> Estimate:
    return mean_of([final_value(training, figure) for training in trainings], BOUNDS.get(figure, COUNTS))


def mean_field(trainings: list[Any], field: str) -> Estimate:
    """Returns the mean of a field of the outcomes, such as "episodes"."""
    return mean_of([number(training[field]) for training in trainings], COUNTS)


def reached(trainings: list[Any], field: str = "episodes") -> Estimate:
    """Returns the mean effort until the last 100 episodes had SPL 0.95, over the seeds that got there."""
    return mean_of([number(t["spl95"][field]) if t["spl95"] else math.nan for t in trainings], COUNTS)


def effort_cells(trainings: list[Any], *totals: str) -> list[str]:
    """Returns the columns "seeds", "episodes to SPL 0.95", "seeds that reached it" and the totals asked for, of
    "episodes", "steps", "seconds"."""
    there = reached(trainings)
    return [str(len(trainings)), text_of(there, 0), f"{there.n} of {len(trainings)}",
            *(text_of(mean_field(trainings, field), 1 if field == "seconds" else 0) for field in totals)]


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


def mean_curve(label: str, trainings: list[Any], figure: str, smoothing: float) -> Line:
    """Returns a figure of the trainings' curves over episodes, each seed's smoothed first."""
    last = max(number(training["episodes"]) for training in trainings)
    x = [last * i / POINTS for i in range(1, POINTS + 1)]
    curves = [training["curve"] for training in trainings]
    seeds = [list(numpy.interp(x, numbers(curve["episodes"]), smoothed(numbers(curve[figure]), smoothing),
                               left=math.nan, right=math.nan)) for curve in curves]
    return line_of_means(label, x, seeds, BOUNDS.get(figure, COUNTS))
