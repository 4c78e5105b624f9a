# SPDX-License-Identifier: Apache-2.0
"""Tianshou's DQN heeds masks once they have the name that it looks for, as docs/reference/clients.md shows."""

import unittest

from support import DRAWN

import citylearn
import gymnasium
import numpy as np
from tianshou.algorithm.modelfree.dqn import DiscreteQLearningPolicy
from tianshou.data import Collector, VectorReplayBuffer
from tianshou.env import DummyVectorEnv
from tianshou.utils.net.common import Net


def renamed():
    env = gymnasium.make("CityLearn-v0", max_steps=20, **DRAWN)
    spaces = {"obs": env.observation_space["features"], "mask": env.observation_space["action_mask"]}
    return gymnasium.wrappers.TransformObservation(
        env, lambda seen: {"obs": seen["features"], "mask": seen["action_mask"]}, gymnasium.spaces.Dict(spaces))


class Tianshou(unittest.TestCase):
    def test_a_collector_takes_allowed_actions_alone(self):
        envs = DummyVectorEnv([renamed] * 3)
        policy = DiscreteQLearningPolicy(model=Net(state_shape=16, action_shape=3, hidden_sizes=[8]),
                                         action_space=envs.action_space[0], eps_inference=0.5)
        buffer = VectorReplayBuffer(600, 3)
        collector = Collector(policy, envs, buffer)
        collector.reset()
        collected = collector.collect(n_step=300)
        self.assertGreater(collected.n_collected_episodes, 10)
        steps = buffer.sample(0)[0]
        self.assertTrue(steps.obs.mask[np.arange(len(steps)), steps.act].all())
        self.assertFalse(steps.obs.mask.all(), "some actions lead off the route")


if __name__ == "__main__":
    unittest.main()
