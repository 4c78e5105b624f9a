# SPDX-License-Identifier: Apache-2.0
"""The page report.html, and the figures and tables beside it."""

import base64
import csv
import hashlib
import io
import json
import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import charts
import jinja2
from inputs import read_json
from matplotlib.figure import Figure


@dataclass
class Section:
    name: str
    title: str
    blocks: list[dict[str, Any]] = field(default_factory=list)  # as templates/report.html.j2 shows them


def csv_text(rows: list[list[Any]]) -> str:
    """Returns CSV; numbers are exact to nine digits, those that are not finite are empty."""
    def cell(value: Any) -> str:
        if not isinstance(value, float):
            return str(value)
        return f"{value:.9g}" if math.isfinite(value) else ""
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows([cell(value) for value in row] for row in rows)
    return text.getvalue()


class Page:
    """Collects the sections and writes the page, which needs no other file. Beside it: tables as NAME.csv, charts as
    NAME.svg, NAME.png and NAME-lines.csv or NAME-bars.csv."""

    def __init__(self, folder: Path, command: str):
        self._folder = folder
        self._command = command
        self._sections: list[Section] = []
        self._files: dict[str, str] = {}  # SHA-256 by name

    def section(self, name: str, title: str) -> None:
        self._sections.append(Section(name, title))

    def text(self, paragraph: str) -> None:
        self._add("text", text=paragraph)

    def remark(self, paragraph: str) -> None:
        """Adds a paragraph that readers must not miss: where we are worse, or what a figure does not tell."""
        self._add("remark", text=paragraph)

    def table(self, name: str, caption: str, columns: list[str], rows: list[list[str]]) -> None:
        self._add("table", caption=caption, columns=columns, rows=rows)
        self._write(f"{name}.csv", csv_text([columns, *rows]).encode())

    def chart(self, name: str, chart: charts.Chart, caption: str) -> None:
        rows: list[list[Any]] = [["line", chart.x_label, chart.y_label, "low", "high"]]
        for line in chart.lines:
            bands = zip(line.low, line.high) if line.low else [(math.nan, math.nan)] * len(line.y)
            rows += [[line.label, float(x), float(y), low, high] for x, y, (low, high) in zip(line.x, line.y, bands)]
        self._write(f"{name}-lines.csv", csv_text(rows).encode())
        self._figure(name, charts.draw_chart(chart), caption)

    def bars(self, name: str, chart: charts.BarChart, caption: str) -> None:
        rows: list[list[Any]] = [["group", "bar", chart.unit, "low", "high"]]
        for group, bars in chart.groups.items():
            rows += [[group, label, bar.value, bar.low, bar.high] for label, bar in zip(chart.names, bars)]
        self._write(f"{name}-bars.csv", csv_text(rows).encode())
        self._figure(name, charts.draw_bars(chart), caption)

    def write(self, title: str, about: str) -> None:
        """Writes report.html, and into manifest.json the hashes of all files."""
        templates = jinja2.FileSystemLoader(Path(__file__).parent / "templates")
        environment = jinja2.Environment(loader=templates, autoescape=True, trim_blocks=True, lstrip_blocks=True,
                                         keep_trailing_newline=True, undefined=jinja2.StrictUndefined)
        html = environment.get_template("report.html.j2").render(title=title, about=about, sections=self._sections)
        self._write("report.html", html.encode())
        for name in ("results.json", "report.json"):
            self._note(name)
        manifest = read_json(self._folder / "manifest.json")
        manifest["files"] = self._files
        text = json.dumps(manifest, indent=2, sort_keys=True, ensure_ascii=False) + "\n"
        self._replace("manifest.json", text.encode())

    def _add(self, kind: str, **content: Any) -> None:
        self._sections[-1].blocks.append({"kind": kind, **content})

    def _figure(self, name: str, figure: Figure, caption: str) -> None:
        self._save(figure, f"{name}.png")
        image = self._save(figure, f"{name}.svg")
        command = f"{self._command} --only {self._sections[-1].name}"
        self._add("figure", source=f"data:image/svg+xml;base64,{base64.b64encode(image).decode()}",
                  caption=f"{caption} Command: {command}")

    def _save(self, figure: Figure, name: str) -> bytes:
        charts.save(figure, self._folder / name)
        return self._note(name)

    def _write(self, name: str, contents: bytes) -> None:
        self._replace(name, contents)
        self._note(name)

    def _note(self, name: str) -> bytes:
        if name in self._files:
            raise ValueError(f"'{name}' is in the report already: name each figure and table differently")
        contents = (self._folder / name).read_bytes()
        self._files[name] = hashlib.sha256(contents).hexdigest()
        return contents

    def _replace(self, name: str, contents: bytes) -> None:
        """Writes a whole file: a crash leaves the old one or the new one."""
        temporary = self._folder / f"{name}.new"
        temporary.write_bytes(contents)
        os.replace(temporary, self._folder / name)
