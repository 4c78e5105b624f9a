# SPDX-License-Identifier: Apache-2.0
"""The parts that the paper has figures of: trainings, deployments, place recognition, the data and the environments."""

import math
from dataclasses import dataclass
from typing import Any

from charts import Bar, BarChart, Chart, Line, limits_around
from curves import MEAN_OF_SEEDS, final_value, final_values, line_of_means, mean_curve, mean_field, reached
from estimates import COUNTS, REWARDS, SHARES, Estimate, fixed, mean_of, percent, smoothed, text_of
from inputs import Inputs, number, numbers
from page import Page
from published import (BASELINE, FEATURES, GIGABYTES, RAW_IMAGES, RECOGNITION_SHARES, RELEASED, STREETLEARN_GIGABYTES,
                       WIDE_FEATURES, published)
from trials import MEANS, rows_of, shuffled_cell, trials_on

SMOOTHING = 0.9
COST_COLUMNS = ["agent", "representation", "seeds", "seconds to SPL 0.95", "episodes to SPL 0.95",
                "seeds that reached it", "seconds in total", "steps/s", "paper: training", "reward", "paper: reward",
                "steps", "paper: steps"]
CURVE_COLUMNS = ["agent", "representation", "seeds", "episodes", "reward", "paper: reward", "SPL", "steps",
                 "paper: steps", "episodes to SPL 0.95"]
DEPLOYMENT_COLUMNS = ["policy", "traversal", "seeds x tasks", "completed", "failed", "SPL", "excess", "steps",
                      "reward", "shuffled"]


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


def figure_2(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        "How long an agent trains until its last 100 episodes have SPL 0.95, the threshold of this figure, and the "
        "reward that it has at the end. Seconds are wall time on the machine that made this report, with everything in "
        f"one process. The paper trained for {FEATURES.minutes} minutes on 64 features and for {RAW_IMAGES.time} on "
        "raw images, until its curves were flat: that is another threshold and another machine. How agents trained on "
        "more than 64 features do on other traversals, is in the part 'dimensions'.")
    costs = [Cost(agent, inputs.outcomes(agent["units"])) for agent in data["agents"]]
    costs = [cost for cost in costs if cost.trainings]
    rows = [cost_row(cost, page) for cost in costs]
    draw_costs(costs, page)
    page.table("figure-2", "Time to SPL 0.95 and in total (95 % interval over seeds).", COST_COLUMNS, rows)
    features = next((cost for cost in costs if cost.agent["agent"] == "features"), None)
    raw = next((cost for cost in costs if cost.agent["agent"] == "raw_images"), None)
    if features and raw:
        compare_costs(features, raw, page)


def cost_row(cost: Cost, page: Page) -> list[str]:
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


def draw_costs(costs: list[Cost], page: Page) -> None:
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


def compare_costs(features: Cost, raw: Cost, page: Page) -> None:
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


def figure_6(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = inputs.recordings
    found = {(case["representation"], case["method"], case["query"]): inputs.outcome(case["unit"])
             for case in data["cases"]}
    page.text(
        f"Area under precision over recall (AUC) of single frames: which frame of '{recordings.train}' shows the same "
        f"place as a frame of another traversal, right within {data['tolerance']} frames, of {recordings.frames} "
        "frames. 'mlp' is the paper's classifier, one multi-layer perceptron trained on the reference; 'nearest' is "
        "the nearest frame by cosine. In the paper the AUC falls with the dimension, halves from summer to winter and "
        "falls below a quarter from day to night.")
    rows = []
    for method in data["methods"]:
        chart = BarChart(f"Area under the precision-recall curve, {method}", "AUC", data["representations"])
        for query in data["queries"]:
            chart.groups[query] = []
            for representation in data["representations"]:
                outcome = found[representation, method, query]
                auc = auc_of(outcome)
                chart.groups[query].append(Bar(auc.mean, auc.low, auc.high))
                if outcome:
                    rows.append([representation, method, query, recordings.conditions[query], str(auc.n),
                                 text_of(auc, 3), fixed(number(outcome["recall"]), 3)])
        page.bars(f"figure-6-{method}", chart, f"{chart.title}.")
    page.table("figure-6", "95 % intervals by resampling blocks of neighbouring frames.",
               ["representation", "method", "query", "condition", "queries", "AUC", "recall@1"], rows)
    aucs = {representation: {query: auc_of(found[representation, data["methods"][0], query]).mean
                             for query in data["queries"]} for representation in data["representations"]}
    compare_conditions(recordings.conditions, aucs, page)
    compare_dimensions(aucs, page)


def auc_of(outcome: Any) -> Estimate:
    return Estimate.of(outcome, "auc", "auc_low", "auc_high", "queries")


def compare_conditions(conditions: dict[str, str], aucs: dict[str, dict[str, float]], page: Page) -> None:
    """The paper gives no figures that stand alone, but how they fall."""
    rows = []
    for representation, by_query in aucs.items():
        best = max((auc for auc in by_query.values() if math.isfinite(auc)), default=math.nan)
        for query, auc in by_query.items():
            share = auc / best if len(by_query) > 1 and best > 0 else math.nan
            paper, text = RECOGNITION_SHARES.get(conditions[query], (math.nan, "-"))
            rows.append([representation, query, fixed(auc, 3), fixed(share, 2), text])
            if share < paper:
                page.remark(f"Worse than the paper: by {representation}, '{query}' keeps {fixed(share, 2)} of the AUC "
                            f"of the condition that is recognised best, in the paper {text}.")
    page.table("figure-6-falls",
               "How the AUC of the paper's classifier falls: of each condition, as a share of the best other "
               "condition's, for each representation (none if there is one condition only). The paper: half from "
               "summer to winter, below a quarter from day to night.",
               ["representation", "query", "AUC", "share of the best", "paper"], rows)


def compare_dimensions(aucs: dict[str, dict[str, float]], page: Page) -> None:
    names = list(aucs)
    for narrow, wide in zip(names, names[1:]):
        if narrow.rpartition("-")[0] != wide.rpartition("-")[0]:
            continue
        before, after = (sum(aucs[name].values()) / len(aucs[name]) for name in (narrow, wide))
        if after > before:
            page.remark("Unlike in the paper, the AUC does not fall with the dimension: mean over conditions "
                        f"{fixed(before, 3)} by {narrow}, {fixed(after, 3)} by {wide}.")


def figure_7(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        f"Episodes of training: the mean of those that ended in each update, smoothed by {fixed(SMOOTHING, 1)}, "
        f"{MEAN_OF_SEEDS}. The paper: 16 agents, five seeds; reward {BASELINE.reward} (baseline), {FEATURES.reward} "
        "(NetVLAD-64), 0.80 (ResNet-64); just under and just over 50 steps an episode, "
        f"{WIDE_FEATURES.steps} on 512 features and more.")
    agents = [(agent, inputs.outcomes(agent["units"])) for agent in data["agents"]]
    agents = [(agent, trainings) for agent, trainings in agents if trainings]
    draw_curves(agents, "reward", "reward an episode", page)
    draw_curves(agents, "length", "steps an episode", page)
    page.table("figure-7",
               "At the end of training, mean over the last 500 episodes (95 % interval over seeds). An agent that "
               "never looks has reward 0.92 and SPL 0.85 on this task.", CURVE_COLUMNS,
               [curve_row(agent, trainings, page) for agent, trainings in agents])


def draw_curves(agents: list[Any], figure: str, label: str, page: Page) -> None:
    lines = [mean_curve(agent["label"], trainings, figure, SMOOTHING) for agent, trainings in agents]
    values = [1.0 if figure == "reward" else 0.0] + [y for line in lines for y in line.y]
    chart = Chart(f"Training: {label}", "episodes", label, lines, width=560, y_limits=limits_around(values),
                  x_limits=limits_around([line.x[-1] for line in lines], from_zero=True))
    page.chart(f"figure-7-{figure}", chart, f"{label} during training.".capitalize())


def curve_row(agent: Any, trainings: list[Any], page: Page) -> list[str]:
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


def figure_8_9(inputs: Inputs, data: Any, page: Page) -> None:
    page.text(
        "After every 100 episodes of training the agent, as it is then, is tried on tasks on the traversal it learns "
        "from (Fig. 8) and on those it never saw (Fig. 9): a random start, a random goal, at most as many steps as "
        "places. The paper gives the share of completed tasks. Completion alone cannot tell a navigator from an agent "
        "that sweeps the route without looking, so success weighted by path length (SPL) is shown beside it.")
    agents = [(agent, inputs.outcomes(agent["units"])) for agent in data["agents"]]
    controls = inputs.controls(data)
    for traversal in inputs.recordings.names:
        for figure in ("completed", "spl"):
            draw_deployments(inputs, agents, controls, traversal, figure, page)
    rows = []
    for traversal in inputs.recordings.names:
        rows += [deployment_row(agent["label"], rows_of(trainings), traversal) for agent, trainings in agents]
        rows += [deployment_row(label, outcomes, traversal) for label, outcomes in controls.items()]
    page.table("figure-8-9",
               f"After training: {MEANS}. Excess: steps / shortest path of completed tasks. Shuffled: completed when "
               "the frames are shown in a random order; an agent that looks must fail then.",
               DEPLOYMENT_COLUMNS, [row for row in rows if row])
    remark_lower_than_controls(agents, controls, page)
    compare_released(inputs, agents, page)


def deployments(trainings: list[Any], traversal: str, figure: str) -> tuple[list[float], list[list[float]]]:
    """Returns the checkpoints, in episodes, and each seed's values there."""
    # Checkpoints lie a little beyond each hundred.
    seeds = [{100 * math.floor(number(row["episodes"]) / 100): number(row[figure])
              for row in training["deployments"] if row["traversal"] == traversal} for training in trainings]
    checkpoints = sorted({episodes for seed in seeds for episodes in seed})
    return checkpoints, [[seed.get(episodes, math.nan) for episodes in checkpoints] for seed in seeds]


def draw_deployments(inputs: Inputs, agents: list[Any], controls: dict[str, list[Any]], traversal: str, figure: str,
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


def deployment_row(label: str, outcomes: list[Any], traversal: str) -> list[str] | None:
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


def tables(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = inputs.recordings
    page.text("The recordings of this report are drawn by the program: a street with buildings, trees and traffic, "
              "driven again under other light, weather and seasons. None of it is a real recording."
              if recordings.drawn else
              "The recordings of this report are those given by --data; this is what the reader found in them:")
    page.table("table-1", f"Table I: traversals as they are used here, aligned to '{recordings.train}'.",
               ["traversal", "condition", "frames", "length, m", "mean step, m", "smallest step, m", "sensors"],
               [[row["name"], row["condition"], str(row["frames"]), fixed(number(row["metres"]), 0),
                 fixed(number(row["step"]), 1), fixed(number(row["smallest_step"]), 2), row["sensors"]]
                for row in data["traversals"]])
    memory = inputs.outcome(data["memory"])
    memory_rows = describe_memory(inputs, data, memory, page) if memory else []
    page.table("table-2",
               "Table II: this environment beside CityLearn (Chancan & Milford 2020) and StreetLearn (Mirowski et al. "
               "2018). Their memory as the CityLearn paper gives it; ours measured on these recordings. Empty: not "
               "known to us.",
               ["", "CityLearn-DDS", "CityLearn", "StreetLearn"], feature_rows(inputs, data) + memory_rows)


def feature_rows(inputs: Inputs, data: Any) -> list[list[str]]:
    first = data["traversals"][0]
    smallest = number(first["smallest_step"])
    step = (f"{fixed(smallest, 2)} ({fixed(number(first['step']), 1)})" if math.isfinite(smallest)
            else "no positions in the recording")
    return [
        ["real recordings", "yes (here: drawn ones)" if inputs.recordings.drawn else "yes", "yes",
         "yes (street panoramas)"],
        ["several conditions of one route", f"yes (here {len(data['traversals'])})", "yes", "no"],
        ["place recognition as the agent's eye", f"yes ({', '.join(data['encoders'])})", "yes (NetVLAD, ResNet)", "no"],
        ["actions", "stay, next, previous", "stay, next, previous", "forward, turn left or right"],
        ["junctions", "yes, in one process (part 'map' of this report)", "no (its future work)", "yes (street graph)"],
        ["environments and learner on many machines", "yes (DDS)", "", "yes (actors of IMPALA)"],
        ["controls that never look, or never learn", "yes", "", ""],
        ["smallest step, m (mean)", step, "", "(about 10)"]]


def describe_memory(inputs: Inputs, data: Any, memory: Any, page: Page) -> list[list[str]]:
    process = number(memory["bytes"]["process"])  # NaN: env_service is not built
    measured = ("env_service, one measured, with its libraries and the recording, before a policy drives it"
                if math.isfinite(process) else "not measured, because env_service is not built beside this program")
    page.text(
        f"Memory: resident, of {memory['agents']} agents on '{inputs.recordings.train}' "
        f"({data['traversals'][0]['frames']} frames). One more environment in a process that already has the "
        f"recording: mean of {memory['environments']}, each with its observation. A process of its own: {measured}. "
        f"Command: {inputs.command} --only tables")
    if process > GIGABYTES * 1e9:
        page.remark("An env_service takes more memory than the paper's environment.")
    return [["memory of an environment, a process of its own", size_text(process), size_text(GIGABYTES * 1e9),
             size_text(STREETLEARN_GIGABYTES * 1e9)],
            ["memory of one more in the same process", size_text(number(memory["bytes"]["environment"])), "", ""]]


def size_text(size: float) -> str:
    """Returns "34.1 MB" or "12 kB"; empty for NaN."""
    for unit, digits, scale in (("GB", 1, 1e9), ("MB", 1, 1e6), ("kB", 0, 1e3)):
        if size >= scale or unit == "kB":
            return f"{fixed(size / scale, digits)} {unit}" if math.isfinite(size) else ""
    return ""
