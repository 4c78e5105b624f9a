# SPDX-License-Identifier: Apache-2.0
"""Fig. 8 and 9: deployment and generalisation."""

import math
from typing import Any

from charts import Chart, Line, limits_around
from curves import MEAN_OF_SEEDS, line_of_means
from estimates import SHARES, fixed, percent, text_of
from inputs import Inputs, number
from page import Page
from published import RELEASED
from trials import MEANS, rows_of, shuffled_cell, trials_on

COLUMNS = ["policy", "traversal", "seeds x tasks", "completed", "failed", "SPL", "excess", "steps", "reward",
           "shuffled"]


def render(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        "After every 100 episodes of training the agent, as it is then, is tried on tasks on the traversal it learns "
        "from (Fig. 8) and on those it never saw (Fig. 9): a random start, a random goal, at most as many steps as "
        "places. The paper gives the share of completed tasks. Completion alone cannot tell a navigator from an agent "
        "that sweeps the route without looking, so success weighted by path length (SPL) is shown beside it.")
    agents = [(agent, inputs.outcomes(agent["units"])) for agent in data["agents"]]
    controls = inputs.controls(data)
    for traversal in inputs.recordings.names:
        for figure in ("completed", "spl"):
            draw(inputs, agents, controls, traversal, figure, page)
    rows = []
    for traversal in inputs.recordings.names:
        rows += [row_of(agent["label"], rows_of(trainings), traversal) for agent, trainings in agents]
        rows += [row_of(label, outcomes, traversal) for label, outcomes in controls.items()]
    page.table("figure-8-9",
               f"After training: {MEANS}. Excess: steps / shortest path of completed tasks. Shuffled: completed when "
               "the frames are shown in a random order; an agent that looks must fail then.",
               COLUMNS, [row for row in rows if row])
    remark_lower_than_controls(agents, controls, page)
    compare_released(inputs, agents, page)


def deployments(trainings: list[Any], traversal: str, figure: str) -> tuple[list[float], list[list[float]]]:
    """Returns the checkpoints, in episodes, and each seed's values there."""
    # Checkpoints lie a little beyond each hundred.
    seeds = [{100 * math.floor(number(row["episodes"]) / 100): number(row[figure])
              for row in training["deployments"] if row["traversal"] == traversal} for training in trainings]
    checkpoints = sorted({episodes for seed in seeds for episodes in seed})
    return checkpoints, [[seed.get(episodes, math.nan) for episodes in checkpoints] for seed in seeds]


def draw(inputs: Inputs, agents: list[Any], controls: dict[str, list[Any]], traversal: str, figure: str,
         page: Page) -> None:
    label = "SPL" if figure == "spl" else "share of tasks completed"
    lines = [line_of_means(agent["label"], *deployments(trainings, traversal, figure), SHARES)
             for agent, trainings in agents]
    limits = limits_around([line.x[-1] for line in lines if line.x], from_zero=True)
    for name, outcomes in controls.items():
        if (trials := trials_on(outcomes, traversal)).seeds:
            lines.append(Line(name, [0, limits[1]], [getattr(trials, figure).mean] * 2, dashed=True))
    chart = Chart(f"{traversal}{inputs.recordings.role(traversal)}: {label}", "episodes", label, lines, limits, (0, 1),
                  width=560, height=260)
    number_of_figure = 8 if traversal == inputs.recordings.train else 9
    page.chart(f"figure-{number_of_figure}-{traversal}-{figure}", chart,
               f"{chart.title}, {MEAN_OF_SEEDS}; dashed: policies that learn nothing.")


def row_of(label: str, outcomes: list[Any], traversal: str) -> list[str] | None:
    trials = trials_on(outcomes, traversal)
    if not trials.seeds:
        return None
    return [label, traversal, trials.seeds_by_tasks, percent(trials.completed),
            f"{fixed(100 * (1 - trials.completed.mean), 1)} %", text_of(trials.spl, 3), text_of(trials.excess, 2),
            text_of(trials.steps, 1), text_of(trials.reward, 3),
            shuffled_cell(outcomes, traversal)]


def remark_lower_than_controls(agents: list[Any], controls: dict[str, list[Any]], page: Page) -> None:
    for name, (outcome,) in controls.items():
        if name == "shortest_path":  # no policy can be better
            continue
        lower = []
        for row in outcome or []:
            for agent, trainings in agents:
                spl = trials_on(rows_of(trainings), row["traversal"]).spl
                if spl.mean < number(row["spl"]):
                    lower.append(f"{agent['label']} on {row['traversal']} {text_of(spl, 3)} against "
                                 f"{fixed(number(row['spl']), 3)}")
        if lower:
            reason = "never looks" if name == "blind" else "learns nothing"
            page.remark(f"Lower SPL than {name}, which {reason}: {'; '.join(lower)}.")


def compare_released(inputs: Inputs, agents: list[Any], page: Page) -> None:
    """The agents that the paper's authors released, beside ours."""
    recordings, rows = inputs.recordings, []
    for released in RELEASED:
        role = " (learned from)" if released.learned else ""
        rows.append([released.label, f"Nordland {released.condition}{role}", f"{fixed(100 * released.completed, 1)} %",
                     fixed(released.steps, 1), fixed(released.reward, 3)])
        label, trainings = next((agent["label"], trainings) for agent, trainings in agents
                                if agent["agent"] == released.agent)
        for traversal in recordings.names:
            trials = trials_on(rows_of(trainings), traversal)
            if (traversal == recordings.train) != released.learned or not trials.seeds:
                continue
            rows.append([label, f"{traversal}{role}", percent(trials.completed), text_of(trials.steps, 1),
                         text_of(trials.reward, 3)])
            # Of traversals never seen, only the same condition can be worse or better.
            alike = released.learned or recordings.conditions[traversal] == released.condition
            if alike and trials.completed.mean < released.completed - 0.0005:  # more than the rounding of both
                page.remark(f"{label} completes {percent(trials.completed)} of the tasks on {traversal} (n = "
                            f"{trials.seeds} seeds), fewer than the {released.label} on Nordland {released.condition}, "
                            f"{fixed(100 * released.completed, 1)} %.")
    page.table("figure-8-9-released",
               "The agents that the paper's authors released, measured by us (NetVLAD features of the first 128 frames "
               "of Nordland, 2,000 to 4,000 tasks), and ours: the same task, on other recordings unless this report is "
               "on those.",
               ["policy", "traversal", "completed", "steps", "reward"], rows)
