# SPDX-License-Identifier: Apache-2.0
"""Fig. 7: training curves."""

from typing import Any

from charts import Chart, limits_around
from curves import MEAN_OF_SEEDS, final_values, mean_curve, mean_field, reached
from estimates import fixed, text_of
from inputs import Inputs
from page import Page
from published import BASELINE, FEATURES, WIDE_FEATURES, published

SMOOTHING = 0.9
COLUMNS = ["agent", "representation", "seeds", "episodes", "reward", "paper: reward", "SPL", "steps", "paper: steps",
           "episodes to SPL 0.95"]


def render(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        f"Episodes of training: the mean of those that ended in each update, smoothed by {fixed(SMOOTHING, 1)}, "
        f"{MEAN_OF_SEEDS}. The paper: 16 agents, five seeds; reward {BASELINE.reward} (baseline), {FEATURES.reward} "
        "(NetVLAD-64), 0.80 (ResNet-64); just under and just over 50 steps an episode, "
        f"{WIDE_FEATURES.steps} on 512 features and more.")
    agents = [(agent, inputs.outcomes(agent["units"])) for agent in data["agents"]]
    agents = [(agent, trainings) for agent, trainings in agents if trainings]
    draw(agents, "reward", "reward an episode", page)
    draw(agents, "length", "steps an episode", page)
    page.table("figure-7",
               "At the end of training, mean over the last 500 episodes (95 % interval over seeds). An agent that "
               "never looks has reward 0.92 and SPL 0.85 on this task.", COLUMNS,
               [row_of(agent, trainings, page) for agent, trainings in agents])


def draw(agents: list[Any], figure: str, label: str, page: Page) -> None:
    lines = [mean_curve(agent["label"], trainings, figure, SMOOTHING) for agent, trainings in agents]
    values = [1.0 if figure == "reward" else 0.0] + [y for line in lines for y in line.y]
    chart = Chart(f"Training: {label}", "episodes", label, lines, width=560, y_limits=limits_around(values),
                  x_limits=limits_around([line.x[-1] for line in lines], from_zero=True))
    page.chart(f"figure-7-{figure}", chart, f"{label} during training.".capitalize())


def row_of(agent: Any, trainings: list[Any], page: Page) -> list[str]:
    label, known = agent["label"], published(agent["agent"], agent["features"])
    reward, steps, there = final_values(trainings, "reward"), final_values(trainings, "length"), reached(trainings)
    if reward.mean < known.reward:
        page.remark(f"Worse than the paper: {label} ends with reward {text_of(reward, 3)} (n = {reward.n} seeds), the "
                    f"paper's with {fixed(known.reward, 2)}.")
    if steps.mean > known.most_steps:
        page.remark(f"Worse than the paper: {label} takes {text_of(steps, 1)} steps an episode (n = {steps.n} seeds), "
                    f"the paper's {known.steps}.")
    some = f" in {there.n} of {len(trainings)}" if there.n < len(trainings) else ""
    return [label, agent["representation"], str(len(trainings)), text_of(mean_field(trainings, "episodes"), 0),
            text_of(reward, 3), fixed(known.reward, 2), text_of(final_values(trainings, "spl"), 3),
            text_of(steps, 1), known.steps, text_of(there, 0) + some]
