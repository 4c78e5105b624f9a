# SPDX-License-Identifier: Apache-2.0
"""TorchRL makes the environment by name, one agent or many."""

import unittest

from support import DRAWN

import citylearn
import gymnasium
from torchrl.envs import GymEnv, GymWrapper
from torchrl.envs.utils import check_env_specs

OPTIONS = {**DRAWN, "max_steps": 20}


class TorchRl(unittest.TestCase):
    def check(self, env, shape):
        check_env_specs(env)
        steps = env.rollout(40, break_when_any_done=False)
        self.assertEqual(steps.batch_size, shape)
        self.assertEqual(steps["features"].shape, (*shape, DRAWN["synthetic_dimension"]))
        self.assertTrue(steps["next", "done"].any())
        self.assertTrue((steps["next", "reward"] <= 1).all())

    def test_one_agent(self):
        self.check(GymEnv("CityLearn-v0", **OPTIONS), (40,))

    def test_many_agents_that_it_resets(self):
        self.check(GymWrapper(gymnasium.make_vec("CityLearn-v0", num_envs=4, autoreset_mode="Disabled", **OPTIONS)), (4, 40))


if __name__ == "__main__":
    unittest.main()
