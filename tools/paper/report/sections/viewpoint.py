# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: a camera to the side."""

from typing import Any

from charts import Chart, Line, limits_around
from estimates import Estimate, share_of, text_of
from inputs import Inputs, Recordings, number
from page import Page
from trials import MEANS, Rows, remark_failed, remark_worse_than_controls, short_rows, trials_on


def render(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = Recordings(data["recordings"])
    shifts = {shift["name"]: float(shift["at"]) for shift in data["shifts"]}
    page.text(
        "How far the camera may be to the side of where it was when the route was learned. "
        f"{description(recordings, data['substitute'])} Agents learn by relabelling on '{recordings.train}' alone, "
        "with the camera where it was, and are tried on the other recordings without more training.")
    axis = ("camera to the left, m" if recordings.drawn else "window to the right, share of the width",
            limits_around(list(shifts.values()), from_zero=True))
    recognition(inputs, data, recordings, shifts, axis, page)
    agents = {agent["label"]: [inputs.outcome(unit) for unit in agent["units"]] for agent in data["agents"]}
    controls = inputs.controls(data)
    navigation(data, recordings, shifts, axis, agents, controls, page)
    for label, outcomes in agents.items():
        remark_failed(page, label, len([rows for rows in outcomes if rows is not None]), len(outcomes))
        remark_worse_than_controls(page, label, list(shifts), outcomes, controls["blind"],
                                   controls["sequence_filter"], "at")


def description(recordings: Recordings, substitute: bool) -> str:
    if recordings.drawn:
        data = ("The given data have no pictures, so these are drawn recordings" if substitute else
                "These recordings are drawn")
        return (f"{data}: the drive 'shifted', under another sun and with its camera turned a little, with the camera "
                f"so many metres further left than that of '{recordings.train}'.")
    return (f"These pictures are real, the shift is simulated: a window of 4/5 of the width of each picture of "
            f"'{recordings.train}', moved to the right by a share of the width. That is what a turned camera would "
            "see, or one to the side of things far away; nothing near hides anything else. At 0 % the pictures are the "
            "same ones: frames that are not recognised there look like frames elsewhere.")


def recognition(inputs: Inputs, data: Any, recordings: Recordings, shifts: dict[str, float], axis: tuple,
                page: Page) -> None:
    lines: dict[str, Line] = {f"{method}, {name}": Line(f"{method}, {name}") for method in data["methods"]
                              for name in ("AUC", "recall@1")}
    rows = []
    for case in data["cases"]:
        method, query, outcome = case["method"], case["query"], inputs.outcome(case["unit"])
        if outcome is None:
            page.remark(f"Recognition of {query} by {method} failed.")
            continue
        auc = Estimate.of(outcome, "auc", "auc_low", "auc_high", "queries")
        recall = share_of(number(outcome["recall"]) * auc.n, auc.n)
        for name, estimate in (("AUC", auc), ("recall@1", recall)):
            lines[f"{method}, {name}"].add(shifts[query], estimate.mean, estimate.low, estimate.high)
        rows.append([case["representation"], method, query, str(auc.n), text_of(auc, 3), text_of(recall, 3)])
    chart = Chart("Place recognition by shift of the camera", axis[0], "AUC, recall@1", list(lines.values()), axis[1],
                  (0, 1), width=560, height=260)
    page.chart("viewpoint-recognition", chart, f"{chart.title}, with 95 % intervals.")
    page.table("viewpoint-recognition",
               f"Frames of '{recordings.train}' recognised from the side, right within {data['tolerance']} frames. 95 "
               "% intervals: AUC by resampling blocks of neighbouring frames, recall@1 by Wilson.",
               ["representation", "method", "shift", "queries", "AUC", "recall@1"], rows)


def navigation(data: Any, recordings: Recordings, shifts: dict[str, float], axis: tuple,
               agents: dict[str, list[Rows | None]], controls: dict[str, list[Rows | None]], page: Page) -> None:
    lines, rows = [], []
    for label, outcomes in {**agents, **controls}.items():
        rows += short_rows(outcomes, recordings.names, label)
        line = Line(label, dashed=label in controls)
        for name, shift in shifts.items():
            spl = trials_on(outcomes, name).spl
            line.add(shift, spl.mean, *(() if line.dashed else (spl.low, spl.high)))
        lines.append(line)
    chart = Chart("Navigation by shift of the camera", axis[0], "SPL", lines, axis[1], (0, 1), width=560, height=260)
    page.chart("viewpoint", chart,
               f"{chart.title}, mean of the seeds with its 95 % interval; dashed: policies that learn nothing.")
    page.table("viewpoint",
               f"Places 0 to {data['frames'] - 1}, as {data['representation']}: {MEANS}. '{recordings.train}' is what "
               "they learned from.",
               ["policy", "recording", "seeds x tasks", "completed", "SPL", "excess"], rows)
