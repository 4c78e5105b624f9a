# SPDX-License-Identifier: Apache-2.0
"""Stable-Baselines3 and sb3-contrib: the example as it is, and the environment by name."""

import os
import subprocess
import sys
import unittest

from support import DRAWN, SOURCE

import numpy as np
from sb3_contrib import MaskablePPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.env_util import make_vec_env

import citylearn


class Example(unittest.TestCase):
    def test_it_trains_and_evaluates(self):
        program = SOURCE / "python/examples/sb3.py"
        self.assertLessEqual(len(program.read_text().splitlines()), 20)
        done = subprocess.run([sys.executable, program, "512"], capture_output=True, text=True, check=False,
                              env={**os.environ, "PYTHONPATH": ":".join(sys.path)})
        self.assertEqual(done.returncode, 0, done.stderr)
        for row in ("RecurrentPPO  summer", "RecurrentPPO  winter", "blind         winter"):
            self.assertIn(row, done.stdout)

    def test_masks_are_heeded_by_name(self):
        envs = make_vec_env("CityLearn-v0", n_envs=2, seed=1, env_kwargs=DRAWN)
        model = MaskablePPO("MultiInputPolicy", envs, n_steps=32, batch_size=64, seed=1)
        model.learn(128)
        observations = envs.reset()
        self.assertEqual(envs.render().ndim, 3)
        for _ in range(50):
            masks = np.stack(envs.env_method("action_masks"))
            actions, _ = model.predict(observations, action_masks=masks)
            self.assertTrue(masks[[0, 1], actions].all())
            observations, *_ = envs.step(actions)

    def test_its_checker_finds_nothing(self):
        check_env(citylearn.Env(**DRAWN))


if __name__ == "__main__":
    unittest.main()
