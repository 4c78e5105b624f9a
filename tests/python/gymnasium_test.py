# SPDX-License-Identifier: Apache-2.0
"""The package as Gymnasium sees it."""

import unittest
import warnings

from support import DRAWN, need_modules, need_peers, towards_goal

need_modules("cloudpickle", "typing_extensions")
need_peers("gymnasium", "farama-notifications")

import gymnasium
import numpy as np
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.wrappers.vector import DictInfoToList, RecordEpisodeStatistics

import citylearn

SERVICES = 6
OPTIONS = {**DRAWN, "max_steps": 20}


class Checks(unittest.TestCase):
    def test_the_checker_finds_nothing(self):
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", ".*(infinity|not within|render).*")  # features have no bounds
            check_env(citylearn.Env(**OPTIONS), skip_render_check=True)

    def test_wrappers_of_vectors_work(self):
        env = RecordEpisodeStatistics(DictInfoToList(citylearn.VectorEnv(agents=4, **OPTIONS)).env)
        self.assertIsInstance(env.unwrapped, gymnasium.vector.VectorEnv)
        observation, infos = env.reset(seed=1)
        lengths = []
        for _ in range(100):
            observation, _, _, _, infos = env.step(towards_goal(observation, infos["position"]))
            if "episode" in infos:
                lengths += infos["episode"]["l"][infos["_episode"]].tolist()
        self.assertGreater(len(lengths), 10)
        self.assertLessEqual(max(lengths), 20)

    def test_a_closed_one_of_many_agents_is_no_env(self):
        with self.assertRaisesRegex(ValueError, "one agent"):
            citylearn.Env(services=2, **OPTIONS)


class AutoresetModes(unittest.TestCase):
    """SyncVectorEnv is Gymnasium's own model of all three modes: service i and environment i draw from seed + i."""

    def check(self, mode):
        ours = citylearn.VectorEnv(agents=1, services=SERVICES, autoreset_mode=mode, **OPTIONS)
        theirs = gymnasium.vector.SyncVectorEnv([lambda: citylearn.Env(**OPTIONS)] * SERVICES, autoreset_mode=mode)
        self.assertEqual(ours.metadata["autoreset_mode"], theirs.metadata["autoreset_mode"])
        self.assertEqual(ours.observation_space, theirs.observation_space)
        self.assertEqual(ours.action_space, theirs.action_space)
        own, other = ours.reset(seed=3), theirs.reset(seed=3)
        position, ends = own[1]["position"], 0
        for _ in range(300):
            self.same(own, other)
            position = np.where(own[-1]["_position"], own[-1]["position"], position)
            actions = towards_goal(own[0], position)
            own, other = ours.step(actions), theirs.step(actions)
            ended = own[2] | own[3]
            ends += ended.sum()
            if mode == gymnasium.vector.AutoresetMode.DISABLED and ended.any():
                self.same(own, other)
                position = own[-1]["position"]
                own, other = (env.reset(options={"reset_mask": ended.copy()}) for env in (ours, theirs))
        self.assertGreater(ends, 20)

    def same(self, own, other):
        for one, two in zip(own[:-1], other[:-1]):
            if isinstance(one, dict):
                self.assertEqual({k: v.dtype for k, v in one.items()}, {k: v.dtype for k, v in two.items()})
                for name in one:
                    np.testing.assert_array_equal(one[name], two[name], name)
            else:
                self.assertEqual(one.dtype, two.dtype)
                np.testing.assert_array_equal(one, two)
        self.assertEqual(own[-1].keys(), other[-1].keys())
        self.assertTrue(data_equivalence(own[-1], other[-1]), f"{own[-1]}\n{other[-1]}")

    def test_next_step(self):
        self.check(gymnasium.vector.AutoresetMode.NEXT_STEP)

    def test_same_step(self):
        self.check(gymnasium.vector.AutoresetMode.SAME_STEP)

    def test_disabled(self):
        self.check(gymnasium.vector.AutoresetMode.DISABLED)


if __name__ == "__main__":
    unittest.main()
