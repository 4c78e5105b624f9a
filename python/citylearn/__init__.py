# SPDX-License-Identifier: Apache-2.0
"""CityLearn's navigation task for Python: vector environments in process or over DDS, trained policies, evaluation."""

from .evaluation import Policy, Scores, evaluate, load_policy
from .vector_env import AutoresetMode, Env, VectorEnv

__all__ = ["AutoresetMode", "Env", "Policy", "Scores", "VectorEnv", "evaluate", "load_policy"]
