# SPDX-License-Identifier: Apache-2.0
"""Beyond the paper: two experiences of a route."""

from typing import Any

from estimates import fixed
from inputs import Inputs, Recordings
from page import Page
from trials import MEANS, Rows, is_worse, remark_failed, rows_of, short_rows, trials_on


def render(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = Recordings(data["recordings"])
    second, known = data["second"], (recordings.train, data["second"])
    others = [name for name in recordings.names if name not in known]
    drawn = "The given data have one recording alone, so these are drawn recordings. " if data["substitute"] else ""
    origin = (f"The data have no third recording, so '{', '.join(others)}' is simulated: each frame is a mixture of "
              "the two that are learned from, from place to place more of the one or of the other, as if snow had "
              "melted in patches. It lies between them by construction, which favours agents that know both."
              if data["simulated"] else "All of them are recordings of their own.")
    page.text(f"{drawn}Agents that learned from '{recordings.train}' alone beside agents that learned from '{second}' "
              "too, the same number of steps in all (--train A,B). Filters remember each place as both showed it. All "
              f"are tried on recordings that neither knows: {', '.join(others)}. {origin}")
    rows = []
    scores: list[dict[str, list[Rows | None]]] = []
    for variant in data["variants"]:
        learned = ", ".join([recordings.train, *variant["more"]])
        policies: dict[str, list[Rows | None]] = {}
        for agent in variant["agents"]:
            trainings = inputs.outcomes(agent["units"])
            remark_failed(page, f"{agent['label']} on {learned}", len(trainings), len(agent["units"]))
            policies[agent["label"]] = list(rows_of(trainings))
        policies.update(inputs.controls(variant))
        for label, outcomes in policies.items():
            rows += short_rows(outcomes, recordings.names, label, learned)
        scores.append(policies)
    page.table("experiences",
               f"Places 0 to {data['frames'] - 1}, as {data['representation']}: {MEANS}.",
               ["policy", "knows", "recording", "seeds x tasks", "completed", "SPL", "excess"], rows)
    for label, outcomes in scores[1].items():
        for name in others:
            alone, both = trials_on(scores[0][label], name).spl, trials_on(outcomes, name).spl
            if is_worse(both, alone, margin=0):
                page.remark(f"{label}: two experiences are worse than one on {name} (SPL {fixed(both.mean, 3)} against "
                            f"{fixed(alone.mean, 3)}).")
