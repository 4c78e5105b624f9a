# SPDX-License-Identifier: Apache-2.0
"""Tables I and II: the data and the environments."""

import math

from estimates import fixed
from inputs import number
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
    page.table("table-2",
               "Table II: this environment beside CityLearn (Chancan & Milford 2020) and StreetLearn (Mirowski et al. "
               "2018). Empty: not known to us.",
               ["", "CityLearn-DDS", "CityLearn", "StreetLearn"], feature_rows(study))


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
