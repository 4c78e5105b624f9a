# SPDX-License-Identifier: Apache-2.0
"""A section of the report, and the charts, tables and remarks that sections share."""

from typing import Any

from charts import Chart, Line, limits_around
from inputs import Inputs, Recordings
from page import Page
from policies import Policy, training_row, trial_row

# For captions.
MEANS = ("means over the same tasks for all policies (agents: over seeds, with the 95 % interval of the mean; one seed "
         "or a control: of the share, Wilson)")
MEAN_OF_SEEDS = ("mean of the seeds with its 95 % interval (a seed with fewer episodes than the others counts on with "
                 "its last value)")

UNADAPTED, TOLD, BLIND = "sequence_filter", "sequence_filter, told", "blind"
TRIALS = ["traversal", "seeds x tasks", "completed", "SPL", "excess"]  # columns of most tables of trials

MISHAPS = {"slip": "slip", "dropped_frames": "dropped frames", "kidnappings": "kidnappings"}

Policies = dict[str, Policy]  # by label


class Study:
    """What citylearn_paper says about a section, and the page that shows it."""

    def __init__(self, inputs: Inputs, data: Any, page: Page):
        self.inputs, self.data, self.page = inputs, data, page
        self.recordings = Recordings(data["recordings"])
        self.points: list[Policies] = [{entry["label"]: policy_of(inputs, entry) for entry in point}
                                       for point in data["points"]]

    @property
    def policies(self) -> list[Policy]:
        return [policy for point in self.points for policy in point.values()]

    @property
    def kind(self) -> str:
        return "drawn" if self.recordings.drawn else "real"

    @property
    def places(self) -> str:
        first = self.policies[0].data
        return f"Places 0 to {first['frames'] - 1}"

    @property
    def places_and_eye(self) -> str:
        return f"{self.places}, as {self.policies[0].data['representation']}"

    def title(self, traversal: str, text: str = "") -> str:
        return f"{traversal}{self.recordings.role(traversal)}{text and ': '}{text}"

    def trained(self, name: str, caption: str, columns: list[str | tuple[str, str]]) -> None:
        """Adds a table about trainings, a row for each agent of which a seed succeeded."""
        rows = [training_row(policy, columns) for policy in self.policies if policy.learns and policy.trainings]
        self.page.table(name, caption, [column if isinstance(column, str) else column[0] for column in columns], rows)

    def tried(self, name: str, caption: str, columns: list[str], traversals: list[str],
              by_traversal: bool = False) -> None:
        """Adds a table about trials, a row for each policy on each traversal that it was tried on."""
        pairs = ([(policy, traversal) for traversal in traversals for policy in self.policies] if by_traversal else
                 [(policy, traversal) for policy in self.policies for traversal in traversals])
        keys = ["traversal" if column == "recording" else column for column in columns]
        self.page.table(name, caption, columns, [trial_row(policy, traversal, keys) for policy, traversal in pairs
                                                 if policy.trials(traversal).rows])

    def draw_spl(self, name: str, title: str, x_label: str, points: list[tuple[float, str, Policies]],
                 **limits: Any) -> None:
        """Draws SPL over x, on a traversal at each: a line for each policy, with intervals where it learns."""
        lines: dict[str, Line] = {}
        for x, traversal, policies in points:
            for label, policy in policies.items():
                line = lines.setdefault(label, Line(label, dashed=not policy.learns))
                spl = policy.trials(traversal).spl
                line.add(x, spl.mean, *((spl.low, spl.high) if policy.learns else ()))
        chart = Chart(title, x_label, "SPL", list(lines.values()), y_limits=(0, 1), height=260, **limits)
        self.page.chart(name, chart,
                        f"{title}, mean of the seeds with its 95 % interval; dashed: policies that learn nothing.")

    def draw_sizes(self, name: str, what: str, x_label: str, sizes: list[int]) -> None:
        """Draws SPL on each traversal over a size that the points differ in."""
        for traversal in self.recordings.names:
            self.draw_spl(f"{name}-{traversal}", self.title(traversal, f"SPL by {what}"), x_label,
                          [(size, traversal, point) for size, point in zip(sizes, self.points)],
                          x_logarithmic=True, x_limits=(sizes[0] * 0.9, sizes[-1] * 1.1))

    def draw_training(self, name: str, caption: str, chart: Chart, yardsticks: dict[str, float] | None = None) -> None:
        """Draws lines over episodes, and dashed ones at the heights of the yardsticks."""
        chart.x_limits = limits_around([line.x[-1] for line in chart.lines if line.x], from_zero=True)
        chart.width = 560
        for label, height in (yardsticks or {}).items():
            chart.lines.append(Line(label, [0, chart.x_limits[1]], [height] * 2, dashed=True))
        self.page.chart(name, chart, caption)

    def remark_failed(self, where: str) -> None:
        """Remarks which trainings failed; {COLUMN} in `where` becomes that cell of the policy."""
        for policy in self.policies:
            if policy.learns and (failed := policy.outcomes.count(None)):
                self.page.remark(f"{policy.label}{where.format(**policy.cells)}: {failed} of {len(policy.outcomes)} "
                                 "trainings failed.")


def policy_of(inputs: Inputs, entry: Any) -> Policy:
    cells = {"agent": entry["label"], "policy": entry["label"], "learner": entry["learner"], "representation": entry["representation"], "features": str(entry["features"]),
             "places": str(entry["frames"]), "world": name_of(entry["imperfections"]),
             "trained": str(entry["steps"]) if entry["learns"] else "-"}
    return Policy(entry, [inputs.outcome(unit) for unit in entry["units"]], cells)


def name_of(world: Any) -> str:
    """Returns "slip 10 %, kidnappings 1"."""
    parts = [f"{text} {world[kind]}" if kind == "kidnappings" else f"{text} {100 * world[kind]:g} %"
             for kind, text in MISHAPS.items() if world[kind] > 0]
    return ", ".join(parts) or "perfect"
