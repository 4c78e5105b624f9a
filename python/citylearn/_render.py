# SPDX-License-Identifier: Apache-2.0
"""Pictures of agents for people."""

from __future__ import annotations

import math

import numpy as np

from ._options import _native

WIDTH, GAP, BAR, MARK = 240, 4, 12, 8  # pixels
PLACE, GOAL = (220, 60, 40), (40, 180, 60)


class Painter:
    """Draws what agents on a route of a recording see and where they are. `places`: of each state of streets."""

    def __init__(self, recording: _native.Recording, route: _native.Route, places: np.ndarray):
        self._recording, self._route, self._places = recording, route, places
        rows, columns = self._frame(0).shape[:2]
        self._height = max(WIDTH * rows // columns, 1)  # of all: a video has pictures of one size

    def draw(self, seen: int, place: int, goal: int) -> np.ndarray:
        """Returns uint8 (H, W, 3): the frame seen and, beside it, the goal's; below them the route with both places."""
        if len(self._places):  # a goal is a place, of which the first view is shown
            goal = int(np.searchsorted(self._places, goal))
        bar = np.full((BAR, 2 * WIDTH + GAP, 3), 90, np.uint8)
        for where, colour in (goal, GOAL), (place, PLACE):
            at = int(where) * (bar.shape[1] - MARK) // (self._route.frames - 1)
            bar[:, at:at + MARK] = colour
        gap = np.full((self._height, GAP, 3), 255, np.uint8)
        return np.vstack([np.hstack([self._scaled(seen), gap, self._scaled(goal)]), bar])

    def _scaled(self, place: int) -> np.ndarray:
        frame = self._frame(int(place))
        rows, columns = (np.arange(wanted) * given // wanted for wanted, given in
                         zip((self._height, WIDTH), frame.shape))
        return frame[rows][:, columns]

    def _frame(self, place: int) -> np.ndarray:
        """Returns the picture of a place, or its features as a square of grey tiles."""
        frame = self._route.first_frame + place
        picture = self._recording.picture(frame)
        if picture is not None:
            return picture[..., ::-1]
        features = self._recording.feature(frame)
        side = math.isqrt(len(features) - 1) + 1
        tiles = np.zeros(side * side)
        tiles[:len(features)] = features / (np.abs(features).max() or 1)
        return np.repeat((127.5 * (1 + tiles)).astype(np.uint8).reshape(side, side, 1), 3, axis=2)
