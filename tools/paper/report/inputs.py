# SPDX-License-Identifier: Apache-2.0
"""What citylearn_paper wrote: results.json (outcomes that the same seeds reproduce) and report.json (the rest)."""

import json
import math
from pathlib import Path
from typing import Any


class InputError(Exception):
    """One line for a person: which file, which field, what to do."""


class Fields(dict):
    """A JSON object that names its file when a field is missing."""

    def __init__(self, file: Path, pairs: list[tuple[str, Any]]):
        super().__init__(pairs)
        self.file = file

    def __missing__(self, key: str) -> None:
        raise InputError(f"{self.file}: field '{key}' is missing (run citylearn paper again)")


def read_json(path: Path) -> Any:
    try:
        return json.loads(path.read_text(encoding="utf-8"), object_pairs_hook=lambda pairs: Fields(path, pairs))
    except OSError as error:
        raise InputError(f"{path}: {error.strerror} (name the folder that citylearn paper wrote)") from error
    except ValueError as error:
        raise InputError(f"{path}: not JSON: {error} (run citylearn paper again)") from error


def number(value: Any) -> float:
    """Returns a number of an outcome, NaN for null."""
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise InputError(f"results.json: {value!r} is not a number (run citylearn paper again)")
    return float(value)


def numbers(values: list[Any]) -> list[float]:
    return [number(value) for value in values]


def merged(outcome: Any, measured: Any) -> Any:
    """Returns the outcome with the members that depend on the machine put back."""
    if not isinstance(outcome, Fields) or not isinstance(measured, Fields):
        return outcome if measured is None else measured
    together = Fields(outcome.file, list(outcome.items()))
    for key, value in measured.items():
        together[key] = merged(outcome.get(key), value)
    return together


class Recordings:
    """The traversals of one route."""

    def __init__(self, data: Fields):
        self.drawn: bool = data["drawn"]  # else they are real recordings
        self.train: str = data["train"]  # the traversal learned from
        self.conditions: dict[str, str] = {row["name"]: row["condition"] for row in data["traversals"]}
        self.names: list[str] = list(self.conditions)  # the one learned from first

    def role(self, traversal: str) -> str:
        return " (learned from)" if traversal == self.train else " (never seen)"


class Inputs:
    """Both files together. A unit of work is referred to by its number, its place in results.json."""

    def __init__(self, folder: Path):
        results = read_json(folder / "results.json")
        report = read_json(folder / "report.json")
        self.command: str = report["command"]
        self.version: str = report["version"]
        self.quick: bool = report["quick"]
        self.tasks: int = report["tasks"]
        self.recordings = Recordings(report["recordings"])
        self.sections: list[Fields] = report["sections"]
        measurements = report["measurements"]
        if len(measurements) != len(results):
            raise InputError(f"{folder}/report.json: field 'measurements' has {len(measurements)} entries, but "
                             f"results.json has {len(results)} (both must come from the same run of citylearn paper)")
        self._outcomes = [merged(result["outcome"], measured) for result, measured in zip(results, measurements)]

    def outcome(self, unit: int) -> Any:
        """Returns None for a unit that failed."""
        return self._outcomes[unit]
