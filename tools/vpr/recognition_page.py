# SPDX-License-Identifier: Apache-2.0
"""Draws precision over recall and writes index.html, from the results.json and curves.json of citylearn vpr."""

import html
import json
import sys
from pathlib import Path

sys.path.append(str(Path(__file__).resolve().parents[1] / "lab"))

import charts

COLUMNS = {"encoder": "encoder", "dimension": "dimension", "centring": "centring", "method": "method", "query": "query",
           "recall_1": "recall@1", "recall_5": "recall@5", "recall_20": "recall@20", "auc": "AUC"}


def name_of(row: dict) -> str:
    return f"{row['encoder']} {row['dimension']}, {row['centring']}"


def area(value: float | None) -> str:
    return "-" if value is None else f"{value:.3f}"


def precision_recall(curve: dict) -> charts.Line:
    recall, precision = curve["recall"], curve["precision"]
    label = f"{name_of(curve)}, AUC {area(curve['auc'])}"
    return charts.Line(label, [0, *recall], [*precision[:1], *precision]) if recall else charts.Line(label)


def draw(folder: Path, reference: str, curves: list[dict]) -> list[str]:
    """Returns the names of the charts' files."""
    plots: dict[str, charts.Chart] = {}
    for curve in curves:
        title = f"{reference} as reference, {curve['query']} as query, {curve['method']}"
        chart = charts.Chart(title, "recall", "precision", x_limits=(0, 1), y_limits=(0, 1))
        plots.setdefault(curve["file"], chart).lines.append(precision_recall(curve))
    for file, chart in plots.items():
        charts.save(charts.draw_chart(chart), folder / file)
    return list(plots)


def cell(value: object) -> str:
    number = isinstance(value, float) or value is None
    return f"<td>{html.escape(area(value) if number else str(value))}</td>"


def page(results: dict, curves: list[dict], files: list[str], matrices: list[str]) -> str:
    def image(file: str) -> str:
        return f'<img src="{html.escape(file)}" alt="{html.escape(file)}">'

    rows = "\n".join(f"<tr>{''.join(cell(row[column]) for column in COLUMNS)}</tr>" for row in results["rows"])
    matches = "\n".join(f"<h3>{html.escape(name_of(curve))}, {html.escape(curve['method'])}, "
                        f"{html.escape(curve['query'])}</h3>\n{image(curve['matches'])}"
                        for curve in curves if "matches" in curve)
    return f"""<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>Place recognition</title>
<style>body {{ font: 15px sans-serif; margin: 2em }} td, th {{ padding: .2em .8em; text-align: left }}
img {{ max-width: 100% }}</style></head><body>
<h1>Place recognition on {html.escape(results['reference'])}</h1>
<p>Right answers: {html.escape(results['ground_truth'])}. <code>{html.escape(results['command'])}</code></p>
<table><tr>{''.join(f'<th>{title}</th>' for title in COLUMNS.values())}</tr>
{rows}</table>
<h2>Curves</h2>
{''.join(map(image, files))}
{'<h2>Matches</h2><p>Top: the query. Middle: the answer, green when right, red when wrong. Bottom: the true place.</p>'
 if matches else ''}
{matches}
{'<h2>Similarities</h2><p>A column is a query frame, a row a reference frame; bright: similar.</p>' if matrices else ''}
{''.join(map(image, matrices))}
</body></html>
"""


def main(folder: Path) -> None:
    results = json.loads((folder / "results.json").read_text())
    curves = json.loads((folder / "curves.json").read_text())["curves"]
    files = draw(folder, results["reference"], curves)
    matrices = sorted(path.name for path in folder.glob("similarity-*.png"))
    (folder / "index.html").write_text(page(results, curves, files, matrices))


if __name__ == "__main__":
    try:
        main(Path(sys.argv[1]))
    except (OSError, ValueError, KeyError) as error:
        sys.exit(f"{sys.argv[1]}: {error} (expected results.json and curves.json of citylearn vpr)")
