# SPDX-License-Identifier: Apache-2.0
"""Makes the report of one folder."""

import importlib
import sys
from pathlib import Path
from types import ModuleType

from inputs import InputError, Inputs
from page import Page

def module_of(section: str) -> ModuleType:
    try:
        return importlib.import_module(f"sections.{section.replace('-', '_')}")
    except ModuleNotFoundError as error:
        raise InputError(f"report.json: field 'name': unknown section '{section}' (run citylearn paper again)") from error


def make_report(folder: Path) -> None:
    inputs = Inputs(folder)
    page = Page(folder, inputs.command)
    given = ["results.json", "report.json"]
    for section in inputs.sections:
        name, data = section["name"], section["data"]
        page.section(name, section["title"])
        if "error" in section:
            page.remark(f"This part could not be made: {section['error']}")
            continue
        module_of(name).render(inputs, data, page)
        given += [strip["file"] for strip in data.get("strips", [])]
    kind = "drawn" if inputs.recordings.drawn else "real"
    page.write("CityLearn's experiments, again",
               f"Made by: {inputs.command}, version {inputs.version}, on {kind} recordings.", given)


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
