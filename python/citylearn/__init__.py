# SPDX-License-Identifier: Apache-2.0
"""CityLearn's navigation task for Python: vector environments in process or over DDS, trained policies, evaluation."""

from .evaluation import Scores, evaluate, load_policy
from .vector_env import AutoresetMode, Env, VectorEnv

__all__ = ["AutoresetMode", "Env", "Scores", "VectorEnv", "evaluate", "load_policy"]
