# SPDX-License-Identifier: Apache-2.0
"""Draws pr-QUERY-METHOD.svg, precision over recall, from the results.json and curves.json of ./run vpr."""

import json
import re
import sys
from pathlib import Path

import charts


def slug(text: str) -> str:
    """Returns `text` as part of a file's name, as slug() in report.cc does."""
    return re.sub(r"[^A-Za-z0-9_.]|^\.", "-", text)


def line_of(curve: dict) -> charts.Line:
    label = f"{curve['encoder']} {curve['dimension']}, {curve['centring']}, AUC {curve['auc']:.3f}"
    recall, precision = curve["recall"], curve["precision"]
    return charts.Line(label, [0, *recall], [*precision[:1], *precision]) if recall else charts.Line(label)


def draw(folder: Path) -> None:
    reference = json.loads((folder / "results.json").read_text())["reference"]
    plots: dict[tuple[str, str], list[charts.Line]] = {}
    for curve in json.loads((folder / "curves.json").read_text())["curves"]:
        plots.setdefault((curve["query"], curve["method"]), []).append(line_of(curve))
    for (query, method), lines in plots.items():
        chart = charts.Chart(f"{reference} as reference, {query} as query, {method}", "recall", "precision", lines,
                             x_limits=(0, 1), y_limits=(0, 1))
        charts.save(charts.draw_chart(chart), folder / f"pr-{slug(query)}-{slug(method)}.svg")


if __name__ == "__main__":
    try:
        draw(Path(sys.argv[1]))
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"{sys.argv[1]}: {error} (expected results.json and curves.json of ./run vpr)")
