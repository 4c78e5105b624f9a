# SPDX-License-Identifier: Apache-2.0
"""The parts about trainings and deployments that the paper has figures of."""

import math

from charts import Chart, Line, limits_around
from estimates import COUNTS, SHARES, fixed, mean_of, percent, text_of
from inputs import number
from policies import Policy, final_value, line_of_means
from published import BASELINE, FEATURES, RAW_IMAGES, RELEASED, WIDE_FEATURES
from study import BLIND, MEAN_OF_SEEDS, MEANS, Study

SMOOTHING = 0.9


def figure_2(study: Study) -> None:
    study.page.text(
        "How long an agent trains until its last 100 episodes have SPL 0.95, the threshold of this figure, and the "
        "reward that it has at the end. Seconds are wall time on the machine that made this report, with everything in "
        f"one process. The paper trained for {FEATURES.minutes} minutes on 64 features and for {RAW_IMAGES.time} on "
        "raw images, until its curves were flat: that is another threshold and another machine. How agents trained on "
        "more than 64 features do on other traversals, is in the part 'dimensions'.")
    trained = [policy for policy in study.policies if policy.trainings]
    for policy in trained:
        count, there = len(policy.trainings), policy.reached().n
        policy.cells["steps/s"] = text_of(mean_of([1 / seconds for seconds in seconds_per_step(policy)], COUNTS), 0)
        if there < count:
            study.page.remark(f"{short_label(policy)}: {count - there} of {count} seeds did not reach SPL 0.95.")
    draw_costs(study, trained)
    study.trained("figure-2", "Time to SPL 0.95 and in total (95 % interval over seeds).",
                  ["agent", "representation", "seeds", "seconds to SPL 0.95", "episodes to SPL 0.95",
                   "seeds that reached it", ("seconds in total", "seconds"), "steps/s", "paper: training", "reward",
                   "paper: reward", ("steps", "steps an episode"), "paper: steps"])
    features, raw = (next((policy for policy in trained if policy.data["policy"] == name), None)
                     for name in ("features", "raw_images"))
    if features and raw:
        compare_costs(study, features, raw)


def short_label(policy: Policy) -> str:
    return f"features, {policy.data['features']}" if policy.data["policy"] == "features" else policy.label


def seconds_per_step(policy: Policy) -> list[float]:
    return [number(t["seconds"]) / number(t["steps"]) for t in policy.trainings]


def draw_costs(study: Study, trained: list[Policy]) -> None:
    dots = Chart("Time to SPL 0.95 and final reward", "training time to SPL 0.95, s", "reward an episode, at the end",
                 x_logarithmic=True, width=560)
    for policy in trained:
        rewards = [final_value(training, "reward") for training in policy.trainings]
        dots.lines.append(Line(short_label(policy), policy.threshold("seconds"), rewards, dots=True))
    dots.y_limits = limits_around([y for line in dots.lines for x, y in zip(line.x, line.y) if math.isfinite(x)])
    study.page.chart("figure-2", dots,
                     "Each dot is a seed: time to SPL 0.95, and mean reward of the last 500 episodes. Seeds that never "
                     "got there have no dot.")


def compare_costs(study: Study, features: Policy, raw: Policy) -> None:
    paper = RAW_IMAGES.minutes / FEATURES.minutes
    step = mean_of(seconds_per_step(raw)).mean / mean_of(seconds_per_step(features)).mean
    threshold = raw.reached("seconds").mean / features.reached("seconds").mean
    effort = (f"reaching SPL 0.95 {fixed(threshold, 1)} times" if math.isfinite(threshold)
              else "the time to SPL 0.95 cannot be compared, because one of them never got there")
    study.page.text(f"Raw images compared with features: a training step costs {fixed(step, 1)} times as much, "
                    f"{effort} (seeds: {len(raw.trainings)} and {len(features.trainings)}; the paper, whole training: "
                    f"{fixed(paper, 0)} times).")
    if step > paper or threshold > paper:
        study.page.remark("Raw images cost more here, compared with features, than in the paper.")
    minutes = features.mean("seconds").mean / 60
    if minutes > FEATURES.minutes:
        study.page.remark(f"Training on features took {fixed(minutes, 1)} minutes, longer than the paper's "
                          f"{FEATURES.minutes}.")


def figure_7(study: Study) -> None:
    study.page.text(
        f"Episodes of training: the mean of those that ended in each update, smoothed by {fixed(SMOOTHING, 1)}, "
        f"{MEAN_OF_SEEDS}. The paper: 16 agents, five seeds; reward {BASELINE.reward} (baseline), {FEATURES.reward} "
        "(NetVLAD-64), 0.80 (ResNet-64); just under and just over 50 steps an episode, "
        f"{WIDE_FEATURES.steps} on 512 features and more.")
    trained = [policy for policy in study.policies if policy.trainings]
    for figure, label, floor in (("reward", "reward an episode", 1.0), ("length", "steps an episode", 0.0)):
        lines = [policy.curve(policy.label, figure, SMOOTHING) for policy in trained]
        study.draw_training(f"figure-7-{figure}", f"{label} during training.".capitalize(),
                            Chart(f"Training: {label}", "episodes", label, lines,
                                  y_limits=limits_around([floor, *(y for line in lines for y in line.y)])))
    for policy in trained:
        there, count = policy.reached(), len(policy.trainings)
        policy.cells["reached"] = text_of(there, 0) + (f" in {there.n} of {count}" if there.n < count else "")
        remark_worse_than_paper(study, policy)
    study.trained("figure-7",
                  "At the end of training, mean over the last 500 episodes (95 % interval over seeds). An agent that "
                  "never looks has reward 0.92 and SPL 0.85 on this task.",
                  ["agent", "representation", "seeds", "episodes", "reward", "paper: reward", "SPL",
                   ("steps", "steps an episode"), "paper: steps", ("episodes to SPL 0.95", "reached")])


def remark_worse_than_paper(study: Study, policy: Policy) -> None:
    known, reward, steps = policy.published, policy.final("reward"), policy.final("length")
    if reward.mean < known.reward:
        study.page.remark(f"Worse than the paper: {policy.label} ends with reward {text_of(reward, 3)} (n = {reward.n} "
                          f"seeds), the paper's with {fixed(known.reward, 2)}.")
    if steps.mean > known.most_steps:
        study.page.remark(f"Worse than the paper: {policy.label} takes {text_of(steps, 1)} steps an episode (n = "
                          f"{steps.n} seeds), the paper's {known.steps}.")


def figure_8_9(study: Study) -> None:
    study.page.text(
        "After every 100 episodes of training the agent, as it is then, is tried on tasks on the traversal it learns "
        "from (Fig. 8) and on those it never saw (Fig. 9): a random start, a random goal, at most as many steps as "
        "places. The paper gives the share of completed tasks. Completion alone cannot tell a navigator from an agent "
        "that sweeps the route without looking, so success weighted by path length (SPL) is shown beside it.")
    traversals = study.recordings.names
    for traversal in traversals:
        for figure, label in (("completed", "share of tasks completed"), ("spl", "SPL")):
            draw_deployments(study, traversal, figure, label)
    study.tried("figure-8-9",
                f"After training: {MEANS}. Excess: steps / shortest path of completed tasks. Shuffled: completed when "
                "the frames are shown in a random order; an agent that looks must fail then.",
                ["policy", "traversal", "seeds x tasks", "completed", "failed", "SPL", "excess", "steps", "reward",
                 "shuffled"], traversals, by_traversal=True)
    remark_lower_than_controls(study)
    compare_released(study)


def deployments(policy: Policy, traversal: str, figure: str) -> Line:
    # Checkpoints lie a little beyond each hundred episodes.
    seeds = [{100 * math.floor(number(row["episodes"]) / 100): number(row[figure])
              for row in training["deployments"] if row["traversal"] == traversal} for training in policy.trainings]
    checkpoints = sorted({episodes for seed in seeds for episodes in seed})
    values = [[seed.get(episodes, math.nan) for episodes in checkpoints] for seed in seeds]
    return line_of_means(policy.label, checkpoints, values, SHARES)


def draw_deployments(study: Study, traversal: str, figure: str, label: str) -> None:
    chart = Chart(study.title(traversal, label), "episodes", label, y_limits=(0, 1), height=260,
                  lines=[deployments(policy, traversal, figure) for policy in study.policies if policy.learns])
    tried = {policy.label: policy.trials(traversal) for policy in study.policies if not policy.learns}
    study.draw_training(f"figure-{8 if traversal == study.recordings.train else 9}-{traversal}-{figure}",
                        f"{chart.title}, {MEAN_OF_SEEDS}; dashed: policies that learn nothing.", chart,
                        {name: trials.figure(figure).mean for name, trials in tried.items() if trials.rows})


def remark_lower_than_controls(study: Study) -> None:
    for control in study.policies:
        if control.learns or control.label == "shortest_path":  # no policy can be better
            continue
        lower = []
        for row in control.trainings[0] if control.trainings else []:
            for policy in study.policies:
                if policy.learns and (spl := policy.trials(row["traversal"]).spl).mean < number(row["spl"]):
                    lower.append(f"{policy.label} on {row['traversal']} {text_of(spl, 3)} against "
                                 f"{fixed(number(row['spl']), 3)}")
        if lower:
            reason = "never looks" if control.label == BLIND else "learns nothing"
            study.page.remark(f"Lower SPL than {control.label}, which {reason}: {'; '.join(lower)}.")


def compare_released(study: Study) -> None:
    """The agents that the paper's authors released, beside ours."""
    recordings, rows = study.recordings, []
    for released in RELEASED:
        role = " (learned from)" if released.learned else ""
        rows.append([released.label, f"Nordland {released.condition}{role}", f"{fixed(100 * released.completed, 1)} %",
                     fixed(released.steps, 1), fixed(released.reward, 3)])
        policy = next(policy for policy in study.policies if policy.data["policy"] == released.agent)
        for traversal in recordings.names:
            trials = policy.trials(traversal)
            if (traversal == recordings.train) != released.learned or not trials.rows:
                continue
            rows.append([policy.label, f"{traversal}{role}", percent(trials.completed),
                         text_of(trials.figure("steps"), 1), text_of(trials.figure("reward"), 3)])
            # Of traversals never seen, only the same condition can be worse or better.
            alike = released.learned or recordings.conditions[traversal] == released.condition
            if alike and trials.completed.mean < released.completed - 0.0005:  # more than the rounding of both
                study.page.remark(
                    f"{policy.label} completes {percent(trials.completed)} of the tasks on {traversal} (n = "
                    f"{len(trials.rows)} seeds), fewer than the {released.label} on Nordland {released.condition}, "
                    f"{fixed(100 * released.completed, 1)} %.")
    study.page.table("figure-8-9-released",
                     "The agents that the paper's authors released, measured by us (NetVLAD features of the first 128 "
                     "frames of Nordland, 2,000 to 4,000 tasks), and ours: the same task, on other recordings unless "
                     "this report is on those.",
                     ["policy", "traversal", "completed", "steps", "reward"], rows)
