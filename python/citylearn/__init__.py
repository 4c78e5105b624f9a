# SPDX-License-Identifier: Apache-2.0
"""CityLearn's navigation task for Python: vector environments in process or over DDS, learners for actors in C++,
trained policies, evaluation."""

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from .evaluation import ActingPolicy, Scores, evaluate, load_policy
    from .trajectories import Batch, Trajectories
    from .vector_env import AutoresetMode, Env, VectorEnv

__all__ = ["ActingPolicy", "AutoresetMode", "Batch", "Env", "Scores", "Trajectories", "VectorEnv", "evaluate",
           "load_policy"]

# Loaded at their first use, as they need numpy and the module in C++, and `citylearn.forward` does not.
_HOMES = {"ActingPolicy": "evaluation", "AutoresetMode": "vector_env", "Batch": "trajectories", "Env": "vector_env",
          "Scores": "evaluation", "Trajectories": "trajectories", "VectorEnv": "vector_env", "evaluate": "evaluation",
          "load_policy": "evaluation"}


def __getattr__(name):
    if name not in _HOMES:
        raise AttributeError(f"module 'citylearn' has no attribute '{name}'")
    from importlib import import_module
    value = globals()[name] = getattr(import_module(f".{_HOMES[name]}", __name__), name)
    return value


def __dir__():
    return sorted({*globals(), *__all__})
