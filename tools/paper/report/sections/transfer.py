# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: a policy on a second route."""

from typing import Any

from charts import Chart, Line, limits_around
from curves import MEAN_OF_SEEDS, effort_cells, mean_curve, reached
from estimates import fixed
from inputs import Inputs
from page import Page
from trials import MEANS, Rows, is_worse, remark_failed, rows_of, short_rows, trials_on

SMOOTHING = 0.5  # these trainings have few updates
UNCHANGED = "unchanged, no training"


def render(inputs: Inputs, data: Any, page: Page) -> None:
    frames, recordings = data["frames"], inputs.recordings
    quick = " Quick: half of the recommended steps on the first route, a quarter on the second." if inputs.quick else ""
    page.text(
        f"An agent is trained on places 0 to {frames - 1} of '{recordings.train}' and moved to places {frames} to "
        f"{2 * frames - 1}, another stretch of the {'drawn' if recordings.drawn else 'real'} recordings that it has "
        "never seen: without more training; trained there with all its parameters or with some modules frozen (their "
        "tensors do not change by a bit); and, for comparison, one that begins there with random parameters. All learn "
        "by relabelling, on the second route with at most the same number of steps. place_filter is given the places "
        "of its route, so on the second one only that knowledge is exchanged; features has to learn what each place "
        f"looks like; the rest of it is memory (LSTM) and heads.{quick}")
    controls = inputs.controls(data)
    for agent in data["agents"]:
        draw(inputs, agent, controls, page)
    tables(inputs, data, controls, page)
    for agent in data["agents"]:
        remarks(inputs, agent, controls, page)


def unchanged(inputs: Inputs, agent: Any) -> list[Rows | None]:
    return [inputs.outcome(unit) for unit in agent["unchanged"]]


def draw(inputs: Inputs, agent: Any, controls: dict[str, list[Rows | None]], page: Page) -> None:
    train, lines = inputs.recordings.train, []
    for variant in agent["variants"]:
        trainings = inputs.outcomes(variant["units"])
        lines.append(mean_curve(variant["label"], trainings, "spl", SMOOTHING) if trainings else Line(variant["label"]))
    limits = limits_around([line.x[-1] for line in lines if line.x], from_zero=True)
    for label, outcomes in {UNCHANGED: unchanged(inputs, agent), **controls}.items():
        lines.append(Line(label, [0, limits[1]], [trials_on(outcomes, train).spl.mean] * 2, dashed=True))
    chart = Chart(f"{agent['label']} on the second route", "episodes on the second route", "SPL", lines, limits, (0, 1),
                  width=560, height=300)
    page.chart(f"transfer-{agent['agent']}", chart,
               f"{chart.title} ('{train}'): SPL of the episodes of training there, smoothed by {fixed(SMOOTHING, 1)}, "
               f"{MEAN_OF_SEEDS}; dashed: what does not train there.")


def tables(inputs: Inputs, data: Any, controls: dict[str, list[Rows | None]], page: Page) -> None:
    names, rows, training_rows = inputs.recordings.names, [], []
    for agent in data["agents"]:
        rows += short_rows(unchanged(inputs, agent), names, agent["label"], UNCHANGED)
        for variant in agent["variants"]:
            if trainings := inputs.outcomes(variant["units"]):
                labels = agent["label"], variant["label"]
                rows += short_rows(rows_of(trainings), names, *labels)
                training_rows.append([*labels, *effort_cells(trainings, "episodes", "steps")])
    for name, outcomes in controls.items():
        rows += short_rows(outcomes, names, name, "learns nothing")
    page.table("transfer",
               f"On the second route after training there, on each traversal: {MEANS}.",
               ["agent", "variant", "traversal", "seeds x tasks", "completed", "SPL", "excess"], rows)
    page.table("transfer-training",
               f"Training on the second route, '{inputs.recordings.train}': episodes until the last 100 of them have "
               "SPL 0.95 (95 % interval over the seeds that got there).",
               ["agent", "variant", "seeds", "episodes to SPL 0.95", "seeds that reached it", "episodes in total",
                "steps"], training_rows)


def remarks(inputs: Inputs, agent: Any, controls: dict[str, list[Rows | None]], page: Page) -> None:
    train = inputs.recordings.train
    blind, sequence_filter = (trials_on(controls[name], train).spl for name in ("blind", "sequence_filter"))
    as_is = trials_on(unchanged(inputs, agent), train).spl
    spl = f" (SPL {fixed(as_is.mean, 3)})"
    if as_is.mean <= blind.mean:
        page.remark(f"{agent['label']}: without more training it is lost on the second route{spl}: a policy that never "
                    f"looks has {fixed(blind.mean, 3)}.")
    elif is_worse(as_is, sequence_filter):
        page.remark(f"{agent['label']}: without more training it is worse on the second route{spl} than the sequence "
                    f"filter, {fixed(sequence_filter.mean, 3)}.")
    scratch = next(inputs.outcomes(variant["units"]) for variant in agent["variants"] if not variant["pretrained"])
    scratch_reached, scratch_spl = reached(scratch), trials_on(rows_of(scratch), train).spl
    for variant in agent["variants"]:
        trainings = inputs.outcomes(variant["units"])
        who = f"{agent['label']}, {variant['label']}"
        remark_failed(page, who, len(trainings), len(variant["units"]))
        if not trainings:
            continue
        there, end = reached(trainings), trials_on(rows_of(trainings), train).spl
        if there.n < len(trainings):
            page.remark(f"{who}: {len(trainings) - there.n} of {len(trainings)} seeds did not reach SPL 0.95 on the "
                        "second route within these steps.")
        if not variant["pretrained"] or not scratch_reached.n:
            continue
        if not there.n or there.mean >= scratch_reached.mean:
            episodes = f"{fixed(there.mean, 0)} episodes" if there.n else "not reached"
            page.remark(f"{who}: beginning with what was learned on the first route did not shorten the way to SPL "
                        f"0.95 ({episodes}; trained from scratch: {fixed(scratch_reached.mean, 0)}).")
        if is_worse(end, scratch_spl):
            page.remark(f"{who}: ends worse (SPL {fixed(end.mean, 3)}) than training from scratch "
                        f"({fixed(scratch_spl.mean, 3)}).")
