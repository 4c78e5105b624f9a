# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: a camera to the side."""

from charts import Chart, Line, limits_around
from estimates import share_of, text_of
from sections.recognition import recognised
from study import MEANS, TRIALS, Study


def render(study: Study) -> None:
    recordings = study.recordings
    shifts = {shift["name"]: float(shift["at"]) for shift in study.data["shifts"]}
    study.page.text(
        "How far the camera may be to the side of where it was when the route was learned. "
        f"{description(study)} Agents learn by relabelling on '{recordings.train}' alone, "
        "with the camera where it was, and are tried on the other recordings without more training.")
    axis = "camera to the left, m" if recordings.drawn else "window to the right, share of the width"
    limits = limits_around(list(shifts.values()), from_zero=True)
    recognition(study, shifts, axis, limits)
    study.draw_spl("viewpoint", "Navigation by shift of the camera", axis,
                   [(shift, name, study.points[0]) for name, shift in shifts.items()], x_limits=limits, width=560)
    study.tried("viewpoint",
                f"{study.places_and_eye}: {MEANS}. '{recordings.train}' is what they learned from.",
                ["policy", "recording", *TRIALS[1:]], recordings.names)
    study.remark_worse_than_controls(study.points[0], list(shifts), "at")


def description(study: Study) -> str:
    train = study.recordings.train
    if study.recordings.drawn:
        data = ("The given data have no pictures, so these are drawn recordings" if study.data["substitute"] else
                "These recordings are drawn")
        return (f"{data}: the drive 'shifted', under another sun and with its camera turned a little, with the camera "
                f"so many metres further left than that of '{train}'.")
    return (f"These pictures are real, the shift is simulated: a window of 4/5 of the width of each picture of "
            f"'{train}', moved to the right by a share of the width. That is what a turned camera would "
            "see, or one to the side of things far away; nothing near hides anything else. At 0 % the pictures are the "
            "same ones: frames that are not recognised there look like frames elsewhere.")


def recognition(study: Study, shifts: dict[str, float], axis: str, limits: tuple[float, float]) -> None:
    lines: dict[str, Line] = {f"{method}, {name}": Line(f"{method}, {name}") for method in study.data["methods"]
                              for name in ("AUC", "recall@1")}
    rows = []
    for (representation, method, query), (auc, recall_at_1) in recognised(study).items():
        if not auc.n:
            study.page.remark(f"Recognition of {query} by {method} failed.")
            continue
        recall = share_of(recall_at_1 * auc.n, auc.n)
        for name, estimate in (("AUC", auc), ("recall@1", recall)):
            lines[f"{method}, {name}"].add(shifts[query], estimate.mean, estimate.low, estimate.high)
        rows.append([representation, method, query, str(auc.n), text_of(auc, 3), text_of(recall, 3)])
    chart = Chart("Place recognition by shift of the camera", axis, "AUC, recall@1", list(lines.values()), limits,
                  (0, 1), width=560, height=260)
    study.page.chart("viewpoint-recognition", chart, f"{chart.title}, with 95 % intervals.")
    study.page.table("viewpoint-recognition",
                     f"Frames of '{study.recordings.train}' recognised from the side, right within "
                     f"{study.data['tolerance']} frames. 95 % intervals: AUC by resampling blocks of neighbouring "
                     "frames, recall@1 by Wilson.",
                     ["representation", "method", "shift", "queries", "AUC", "recall@1"], rows)
