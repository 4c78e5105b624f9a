# SPDX-License-Identifier: Apache-2.0
"""The paper's main finding, tried: smaller features generalise better."""

import math
from typing import Any

from compared import Policies, draw_spl, policies_of
from estimates import Estimate, fixed, mean_of, text_of
from inputs import Inputs, Recordings
from page import Page
from trials import MEANS, Rows, short_rows, trials_on

ALIKE = 0.01  # SPL; less than this is no difference


def render(inputs: Inputs, data: Any, page: Page) -> None:
    recordings = Recordings(data["recordings"])
    drawn = "The given data have no pictures, so these are drawn recordings. " if data["substitute"] else ""
    page.text(
        f"{drawn}The paper's main finding is that smaller features generalise better. Here agents learn from "
        f"'{recordings.train}' alone, on more or fewer features of the same encoder, {data['encoder']}: the first "
        f"principal components of its {data['encoder_dimension']} numbers, learned from the {data['learned_from']} "
        f"frames of '{recordings.train}'. Then they are tried on every traversal. features learns by PPO, place_filter "
        "by relabelling; 'sequence_filter' and 'blind' learn nothing."
        + (" The quick report trains features on the fewest and the most alone." if inputs.quick else ""))
    if data["missing"]:
        missing = ", ".join(map(str, data["missing"]))
        page.remark(f"Not tried: {missing} features. {data['encoder']} has {data['encoder_dimension']}, and "
                    f"{data['learned_from']} frames have at most {data['learned_from'] - 1} principal components.")
    sizes = [(size["features"], policies_of(inputs, size, f"{size['features']} features", page))
             for size in data["sizes"]]
    for traversal in recordings.names:
        draw_spl("dimensions", f"{traversal}{recordings.role(traversal)}: SPL by features", "features a frame", sizes,
                 traversal, page, x_logarithmic=True, x_limits=(sizes[0][0] * 0.9, sizes[-1][0] * 1.1))
    page.table("dimensions",
               f"Places 0 to {data['frames'] - 1}, by number of features: {MEANS}.",
               ["features", "policy", "traversal", "seeds x tasks", "completed", "SPL", "excess"],
               [row for features, policies in sizes for label, outcomes in policies.items()
                for row in short_rows(outcomes, recordings.names, str(features), label)])
    for label in [label for label in sizes[0][1] if label != "blind"]:
        conclude(label, recordings, sizes, page)


def unseen(recordings: Recordings, outcomes: list[Rows | None]) -> Estimate:
    """Returns the mean SPL on traversals never seen, over seeds of the means over traversals."""
    others = [name for name in recordings.names if name != recordings.train]
    return mean_of([mean_of([trials_on([rows], name).spl.mean for name in others]).mean for rows in outcomes], (0, 1))


def conclude(label: str, recordings: Recordings, sizes: list[tuple[int, Policies]], page: Page) -> None:
    """Says how the fewest and the most features compare on traversals never seen, whichever way it comes out."""
    tried = [(features, unseen(recordings, policies[label])) for features, policies in sizes if label in policies]
    tried = [(features, spl) for features, spl in tried if math.isfinite(spl.mean)]
    if len(tried) < 2:
        return
    (fewest, small), (most, large) = tried[0], tried[-1]
    best = max(tried, key=lambda one: one[1].mean)
    gain = small.mean - large.mean
    verdict = ("about as well" if abs(gain) < ALIKE else "better" if gain > 0 else "worse")
    page.text(f"{label}: on traversals never seen, {fewest} features do {verdict} than {most}".replace(
                  "as well than", "as well as")
              + f": SPL {text_of(small, 3)} and {text_of(large, 3)}. Best: {best[0]} with {fixed(best[1].mean, 3)}.")
