# SPDX-License-Identifier: Apache-2.0
"""skrl wraps the environment by name, one agent or many."""

import unittest

from support import DRAWN

import citylearn
import gymnasium
import torch
from skrl.envs.wrappers.torch import wrap_env

OPTIONS = {**DRAWN, "max_steps": 20}


class Skrl(unittest.TestCase):
    def check(self, env, agents):
        env = wrap_env(env)
        self.assertEqual(env.num_envs, agents)
        observations, _ = env.reset()
        ends = 0
        for _ in range(50):
            self.assertEqual(observations.shape, (agents, 16 + 1 + 1 + 3))
            masks = observations[:, :3]  # names come in the order of the alphabet
            self.assertTrue(((masks == 0) | (masks == 1)).all() and masks[:, 0].all())
            actions = torch.multinomial(masks, 1)
            observations, rewards, terminated, truncated, _ = env.step(actions)
            self.assertEqual(rewards.shape, (agents, 1))
            ends += int((terminated | truncated).sum())
            if agents == 1 and ends:  # as its trainers do
                observations, _ = env.reset()
        self.assertGreater(ends, 0)

    def test_one_agent(self):
        self.check(gymnasium.make("CityLearn-v0", **OPTIONS), 1)

    def test_many_agents(self):
        self.check(gymnasium.make_vec("CityLearn-v0", num_envs=4, **OPTIONS), 4)


if __name__ == "__main__":
    unittest.main()
