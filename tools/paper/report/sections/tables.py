# SPDX-License-Identifier: Apache-2.0
"""Tables I and II: the data and the environments."""

import math
from typing import Any

from estimates import fixed
from inputs import number
from published import GIGABYTES, STREETLEARN_GIGABYTES
from study import Study


def render(study: Study) -> None:
    data, recordings, page = study.data, study.recordings, study.page
    page.text("The recordings of this report are drawn by the program: a street with buildings, trees and traffic, "
              "driven again under other light, weather and seasons. None of it is a real recording."
              if recordings.drawn else
              "The recordings of this report are those given by --data; this is what the reader found in them:")
    page.table("table-1", f"Table I: traversals as they are used here, aligned to '{recordings.train}'.",
               ["traversal", "condition", "frames", "length, m", "mean step, m", "smallest step, m", "sensors"],
               [[row["name"], row["condition"], str(row["frames"]), fixed(number(row["metres"]), 0),
                 fixed(number(row["step"]), 1), fixed(number(row["smallest_step"]), 2), row["sensors"]]
                for row in data["traversals"]])
    memory = study.inputs.outcome(data["memory"])
    memory_rows = describe_memory(study, memory) if memory else []
    page.table("table-2",
               "Table II: this environment beside CityLearn (Chancan & Milford 2020) and StreetLearn (Mirowski et al. "
               "2018). Their memory as the CityLearn paper gives it; ours measured on these recordings. Empty: not "
               "known to us.",
               ["", "CityLearn-DDS", "CityLearn", "StreetLearn"], feature_rows(study) + memory_rows)


def feature_rows(study: Study) -> list[list[str]]:
    data = study.data
    first = data["traversals"][0]
    smallest = number(first["smallest_step"])
    step = (f"{fixed(smallest, 2)} ({fixed(number(first['step']), 1)})" if math.isfinite(smallest)
            else "no positions in the recording")
    return [
        ["real recordings", "yes (here: drawn ones)" if study.recordings.drawn else "yes", "yes",
         "yes (street panoramas)"],
        ["several conditions of one route", f"yes (here {len(data['traversals'])})", "yes", "no"],
        ["place recognition as the agent's eye", f"yes ({', '.join(data['encoders'])})", "yes (NetVLAD, ResNet)", "no"],
        ["actions", "stay, next, previous", "stay, next, previous", "forward, turn left or right"],
        ["junctions", "no", "no (its future work)", "yes (street graph)"],
        ["environments and learner on many machines", "yes (DDS)", "", "yes (actors of IMPALA)"],
        ["controls that never look, or never learn", "yes", "", ""],
        ["smallest step, m (mean)", step, "", "(about 10)"]]


def describe_memory(study: Study, memory: Any) -> list[list[str]]:
    process = number(memory["bytes"]["process"])  # NaN: env_service is not built
    measured = ("env_service, one measured, with its libraries and the recording, before a policy drives it"
                if math.isfinite(process) else "not measured, because env_service is not built beside this program")
    study.page.text(
        f"Memory: resident, of {memory['agents']} agents on '{study.recordings.train}' "
        f"({study.data['traversals'][0]['frames']} frames). One more environment in a process that already has the "
        f"recording: mean of {memory['environments']}, each with its observation. A process of its own: {measured}. "
        f"Command: {study.inputs.command} --only tables")
    if process > GIGABYTES * 1e9:
        study.page.remark("An env_service takes more memory than the paper's environment.")
    return [["memory of an environment, a process of its own", size_text(process), size_text(GIGABYTES * 1e9),
             size_text(STREETLEARN_GIGABYTES * 1e9)],
            ["memory of one more in the same process", size_text(number(memory["bytes"]["environment"])), "", ""]]


def size_text(size: float) -> str:
    """Returns "34.1 MB" or "12 kB"; empty for NaN."""
    for unit, digits, scale in (("GB", 1, 1e9), ("MB", 1, 1e6), ("kB", 0, 1e3)):
        if size >= scale or unit == "kB":
            return f"{fixed(size / scale, digits)} {unit}" if math.isfinite(size) else ""
    return ""
