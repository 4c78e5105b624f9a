# SPDX-License-Identifier: Apache-2.0
"""CityLearn's navigation task for Python: vector environments in process or over DDS, trained policies, evaluation."""

import os
import sys

from .encoder import serve_encoder
from .evaluation import ActingPolicy, Scores, evaluate, load_policy
from .vector_env import AutoresetMode, Env, VectorEnv

__all__ = ["ActingPolicy", "AutoresetMode", "Env", "Scores", "VectorEnv", "evaluate", "load_policy", "serve_encoder"]

os.environ.setdefault("CITYLEARN_PYTHON", sys.executable or "python3")  # encoders that are Python files run in this one
