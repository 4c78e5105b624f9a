# SPDX-License-Identifier: Apache-2.0
"""Fig. 2: what training costs."""

import math
from dataclasses import dataclass
from typing import Any

from charts import Chart, Line, limits_around
from curves import final_value, final_values, mean_field, reached
from estimates import COUNTS, REWARDS, fixed, mean_of, smoothed, text_of
from inputs import Inputs, number, numbers
from page import Page
from published import FEATURES, RAW_IMAGES, published

COLUMNS = ["agent", "representation", "seeds", "seconds to SPL 0.95", "episodes to SPL 0.95", "seeds that reached it",
           "seconds in total", "steps/s", "paper: training", "reward", "paper: reward", "steps", "paper: steps"]


@dataclass
class Cost:
    """What the seeds of one agent took."""
    agent: Any
    trainings: list[Any]

    @property
    def label(self) -> str:
        return f"features, {self.agent['features']}" if self.agent["agent"] == "features" else self.agent["label"]

    def seconds_to_threshold(self) -> list[float]:
        return [number(t["spl95"]["seconds"]) if t["spl95"] else math.nan for t in self.trainings]

    def seconds_per_step(self) -> list[float]:
        return [number(t["seconds"]) / number(t["steps"]) for t in self.trainings]


def render(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        "How long an agent trains until its last 100 episodes have SPL 0.95, the threshold of this figure, and the "
        "reward that it has at the end. Seconds are wall time on the machine that made this report, with everything in "
        f"one process. The paper trained for {FEATURES.minutes} minutes on 64 features and for {RAW_IMAGES.time} on "
        "raw images, until its curves were flat: that is another threshold and another machine. How agents trained on "
        "more than 64 features do on other traversals, is in the part 'dimensions'.")
    costs = [Cost(agent, inputs.outcomes(agent["units"])) for agent in data["agents"]]
    costs = [cost for cost in costs if cost.trainings]
    rows = [row_of(cost, page) for cost in costs]
    draw(costs, page)
    page.table("figure-2", "Time to SPL 0.95 and in total (95 % interval over seeds).", COLUMNS, rows)
    features = next((cost for cost in costs if cost.agent["agent"] == "features"), None)
    raw = next((cost for cost in costs if cost.agent["agent"] == "raw_images"), None)
    if features and raw:
        compare(features, raw, page)


def row_of(cost: Cost, page: Page) -> list[str]:
    agent, trainings = cost.agent, cost.trainings
    there = mean_of(cost.seconds_to_threshold(), COUNTS)
    known = published(agent["agent"], agent["features"])
    if there.n < len(trainings):
        page.remark(f"{cost.label}: {len(trainings) - there.n} of {len(trainings)} seeds did not reach SPL 0.95.")
    rewards = [final_value(training, "reward") for training in trainings]
    rates = [1 / seconds for seconds in cost.seconds_per_step()]
    return [agent["label"], agent["representation"], str(len(trainings)), text_of(there, 1),
            text_of(reached(trainings), 0), f"{there.n} of {len(trainings)}",
            text_of(mean_field(trainings, "seconds"), 1), text_of(mean_of(rates, COUNTS), 0),
            known.time, text_of(mean_of(rewards, REWARDS), 3), fixed(known.reward, 2),
            text_of(final_values(trainings, "length"), 1), known.steps]


def draw(costs: list[Cost], page: Page) -> None:
    dots = Chart("Time to SPL 0.95 and final reward", "training time to SPL 0.95, s", "reward an episode, at the end",
                 x_logarithmic=True, width=560)
    curves = Chart("Training time and reward", "training time, s", "reward an episode", y_limits=(-1, 1),
                   x_logarithmic=True, width=560)
    for cost in costs:
        rewards = [final_value(training, "reward") for training in cost.trainings]
        dots.lines.append(Line(cost.label, cost.seconds_to_threshold(), rewards, dots=True))
        curve = cost.trainings[0]["curve"]
        curves.lines.append(Line(cost.label, numbers(curve["seconds"]), smoothed(numbers(curve["reward"]), 0.9)))
    dots.y_limits = limits_around([y for line in dots.lines for x, y in zip(line.x, line.y) if math.isfinite(x)])
    page.chart("figure-2", dots,
               "Each dot is a seed: time to SPL 0.95, and mean reward of the last 500 episodes. Seeds that never got "
               "there have no dot.")
    page.chart("figure-2-curves", curves,
               "Reward during training, over seconds of training (smoothed, first seed of each agent).")


def compare(features: Cost, raw: Cost, page: Page) -> None:
    paper = RAW_IMAGES.minutes / FEATURES.minutes
    step = mean_of(raw.seconds_per_step()).mean / mean_of(features.seconds_per_step()).mean
    threshold = mean_of(raw.seconds_to_threshold()).mean / mean_of(features.seconds_to_threshold()).mean
    effort = (f"reaching SPL 0.95 {fixed(threshold, 1)} times" if math.isfinite(threshold)
              else "the time to SPL 0.95 cannot be compared, because one of them never got there")
    page.text(f"Raw images compared with features: a training step costs {fixed(step, 1)} times as much, {effort} "
              f"(seeds: {len(raw.trainings)} and {len(features.trainings)}; the paper, whole training: "
              f"{fixed(paper, 0)} times).")
    if step > paper or threshold > paper:
        page.remark("Raw images cost more here, compared with features, than in the paper.")
    minutes = mean_field(features.trainings, "seconds").mean / 60
    if minutes > FEATURES.minutes:
        page.remark(f"Training on features took {fixed(minutes, 1)} minutes, longer than the paper's "
                    f"{FEATURES.minutes}.")
