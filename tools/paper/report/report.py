# SPDX-License-Identifier: Apache-2.0
"""Makes the report of one folder."""

import sys
from pathlib import Path

from inputs import InputError, Inputs
from page import Page
from sections import comparisons, figures
from study import Study

RENDERERS = {
    "figure-2": figures.figure_2, "figure-7": figures.figure_7, "figure-8-9": figures.figure_8_9,
    "longer-routes": comparisons.longer_routes, "imperfect-world": comparisons.imperfect_world,
    "dimensions": comparisons.dimensions}


def make_report(folder: Path) -> None:
    inputs = Inputs(folder)
    page = Page(folder, inputs.command)
    for section in inputs.sections:
        name, data = section["name"], section["data"]
        page.section(name, section["title"])
        if name not in RENDERERS:
            raise InputError(f"report.json: field 'name': unknown section '{name}' (run citylearn paper again)")
        RENDERERS[name](Study(inputs, data, page))
    kind = "drawn" if inputs.recordings.drawn else "real"
    page.write("CityLearn's experiments, again",
               f"Made by: {inputs.command}, version {inputs.version}, on {kind} recordings.")


def main(arguments: list[str]) -> int:
    if len(arguments) != 1:
        print("usage: python3 tools/paper/report FOLDER, which citylearn paper wrote", file=sys.stderr)
        return 2
    try:
        make_report(Path(arguments[0]))
    except (InputError, OSError) as error:
        print(error, file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    return 0
