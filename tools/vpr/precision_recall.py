# SPDX-License-Identifier: Apache-2.0
"""Draws pr-QUERY-METHOD.svg, precision over recall, from the results.json and curves.json of ./run vpr."""

import json
import sys
from pathlib import Path

import charts


def line_of(curve: dict) -> charts.Line:
    label = f"{curve['encoder']} {curve['dimension']}, {curve['centring']}, AUC {curve['auc']:.3f}"
    recall, precision = curve["recall"], curve["precision"]
    return charts.Line(label, [0, *recall], [*precision[:1], *precision]) if recall else charts.Line(label)


def draw(folder: Path) -> None:
    reference = json.loads((folder / "results.json").read_text())["reference"]
    plots: dict[str, charts.Chart] = {}
    for curve in json.loads((folder / "curves.json").read_text())["curves"]:
        title = f"{reference} as reference, {curve['query']} as query, {curve['method']}"
        chart = charts.Chart(title, "recall", "precision", x_limits=(0, 1), y_limits=(0, 1))
        plots.setdefault(curve["file"], chart).lines.append(line_of(curve))
    for name, chart in plots.items():
        charts.save(charts.draw_chart(chart), folder / name)


if __name__ == "__main__":
    try:
        draw(Path(sys.argv[1]))
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"{sys.argv[1]}: {error} (expected results.json and curves.json of ./run vpr)")
