# SPDX-License-Identifier: Apache-2.0
"""What the package uses of Gymnasium, or as much of it as it needs itself where Gymnasium is missing."""

from __future__ import annotations

from enum import Enum
from typing import Any

import numpy as np

try:
    import gymnasium
    from gymnasium.spaces import Box, Dict, Discrete
    from gymnasium.vector import AutoresetMode, VectorEnv as VectorEnvBase
    from gymnasium.vector.utils import batch_space

    EnvBase: type = gymnasium.Env
    if "CityLearn-v0" not in gymnasium.registry:
        gymnasium.register("CityLearn-v0", entry_point="citylearn:Env", vector_entry_point="citylearn:VectorEnv")
except ImportError:

    class AutoresetMode(Enum):  # type: ignore[no-redef]
        NEXT_STEP = "NextStep"
        SAME_STEP = "SameStep"
        DISABLED = "Disabled"

    class Box:  # type: ignore[no-redef]
        """An array of one shape and type between two bounds, both included."""

        def __init__(self, low: Any, high: Any, shape: tuple[int, ...], dtype: Any):
            self.low, self.high, self.shape, self.dtype = low, high, shape, np.dtype(dtype)
            self._random = np.random.default_rng()

        def seed(self, seed: int | None = None) -> None:
            self._random = np.random.default_rng(seed)

        def sample(self) -> Any:
            if self.dtype.kind == "f":
                return self._random.normal(size=self.shape).astype(self.dtype)
            return self._random.integers(self.low, self.high, self.shape, self.dtype, endpoint=True)

        def contains(self, x: Any) -> bool:
            x = np.asarray(x)
            return x.shape == self.shape and x.dtype.kind == self.dtype.kind and bool(
                np.all((x >= self.low) & (x <= self.high)))

        def __contains__(self, x: Any) -> bool:
            return self.contains(x)

    def Discrete(n: int) -> Box:  # type: ignore[no-redef]
        return Box(0, n - 1, (), np.int64)

    class Dict(dict):  # type: ignore[no-redef]
        """Named spaces."""

        def seed(self, seed: int | None = None) -> None:
            for space in self.values():
                space.seed(seed)

        def sample(self) -> dict[str, Any]:
            return {name: space.sample() for name, space in self.items()}

        def contains(self, x: Any) -> bool:
            return isinstance(x, dict) and x.keys() == self.keys() and all(
                space.contains(x[name]) for name, space in self.items())

    def batch_space(space: Any, n: int) -> Any:  # type: ignore[no-redef]
        if isinstance(space, Dict):
            return Dict({name: batch_space(one, n) for name, one in space.items()})
        return Box(space.low, space.high, (n, *space.shape), space.dtype)

    class _Seeded:
        metadata: dict[str, Any] = {}
        render_mode = None
        spec = None
        _np_random: np.random.Generator | None = None

        def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> Any:
            if seed is not None:
                self._np_random = np.random.default_rng(seed)

        @property
        def np_random(self) -> np.random.Generator:
            if self._np_random is None:
                self._np_random = np.random.default_rng()
            return self._np_random

        @property
        def unwrapped(self) -> Any:
            return self

    EnvBase = _Seeded

    class VectorEnvBase(_Seeded):  # type: ignore[no-redef]
        closed = False

        def close(self, **kwargs: Any) -> None:
            if not self.closed:
                self.close_extras(**kwargs)
                self.closed = True


def observation_space(features: int, places: int) -> Any:
    """The space of what one agent observes, described at VectorEnv."""
    return Dict({
        "features": Box(-np.inf, np.inf, (features,), np.float32),
        "goal": Discrete(places),
        "previous_action": Discrete(4),
        "action_mask": Box(0, 1, (3,), np.int8),
    })
