# SPDX-License-Identifier: Apache-2.0
"""Figures of the paper (Chancan & Milford, ICRA 2020) and of the agents that its authors released."""

import math
from dataclasses import dataclass


@dataclass(frozen=True)
class Published:
    """An agent at the end of its training: 128 places, 16 agents, mean of five seeds."""
    reward: float = math.nan  # mean of an episode; NaN: not given
    steps: str = "-"  # an episode, in the paper's words
    most_steps: float = math.inf  # that these words still cover
    minutes: int = 0  # of training; 0: not given

    @property
    def time(self) -> str:
        hours, minutes = divmod(self.minutes, 60)
        return (f"{hours} h " if hours else "") + f"{minutes} min" if self.minutes else "-"


BASELINE = Published(0.99, "just under 50", 50)
FEATURES = Published(0.92, "just over 50", 55, minutes=11)  # 64 of them
WIDE_FEATURES = Published(steps="about 75", most_steps=80)  # 512 and more
RAW_IMAGES = Published(minutes=29 * 60 + 48)


def published(agent: str, features: int) -> Published:
    """Returns the figures of the paper's agent that is like ours; without any where there is none."""
    if agent == "features":
        return FEATURES if features == 64 else WIDE_FEATURES if features >= 512 else Published()
    return {"baseline": BASELINE, "raw_images": RAW_IMAGES}.get(agent, Published())


@dataclass(frozen=True)
class Released:
    """An agent that the paper's authors released, run by this project: NetVLAD features (64) of Nordland's first 128
    frames, at most 128 steps, 2,000 to 4,000 tasks."""
    label: str
    agent: str  # ours that is like it
    condition: str  # of Nordland
    learned: bool  # from this traversal
    completed: float
    steps: float
    reward: float


RELEASED = [
    Released("authors' NetVLAD-64 agent", "features", "summer", True, 0.867, 64.5, 0.68),
    Released("authors' NetVLAD-64 agent", "features", "fall", False, 0.896, 63.1, math.nan),
    Released("authors' baseline agent", "baseline", "summer", True, 1.0, 43.4, 0.998)]
