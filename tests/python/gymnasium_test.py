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


class Makers(unittest.TestCase):
    def test_make_vec_makes_what_sync_makes(self):
        gymnasium.register("City-v0", entry_point="citylearn:Env", vector_entry_point="citylearn:VectorEnv",
                           kwargs=OPTIONS)
        ours, theirs = (gymnasium.make_vec("City-v0", num_envs=4, vectorization_mode=mode)
                        for mode in ("vector_entry_point", "sync"))
        self.assertIsInstance(ours, citylearn.VectorEnv)
        self.assertEqual(ours.observation_space, theirs.observation_space)
        self.assertTrue(data_equivalence(ours.reset(seed=2), theirs.reset(seed=2)))


class Resets(unittest.TestCase):
    """reset() takes what SyncVectorEnv takes, and answers the same."""

    def test_lists_of_seeds_and_masks(self):
        ours = citylearn.VectorEnv(agents=1, services=4, autoreset_mode="Disabled", **OPTIONS)
        theirs = gymnasium.vector.SyncVectorEnv([lambda: citylearn.Env(**OPTIONS)] * 4, autoreset_mode="Disabled")
        both, one = (ours, theirs), np.array([False, True, False, False])

        def same(call):
            own, other = (call(env) for env in both)
            self.assertTrue(data_equivalence(own, other), f"{own}\n{other}")
            return own

        same(lambda env: env.reset(seed=5, options={"reset_mask": np.ones(4, bool)}))
        same(lambda env: env.reset(seed=[4, 3, 2, 1]))
        observation, infos = same(lambda env: env.reset(seed=6))
        position, ended = infos["position"], np.zeros(4, bool)
        while not ended.any():
            actions = towards_goal(observation, position)
            observation, _, terminated, truncated, infos = same(lambda env: env.step(actions))
            position, ended = infos["position"], terminated | truncated
        self.assertGreater(ended.sum(), 1)
        for agent in np.flatnonzero(ended):  # the others that have ended still show their last observation
            same(lambda env: env.reset(options={"reset_mask": np.arange(4) == agent}))
        same(lambda env: env.reset(seed=9, options={"reset_mask": one.copy()}))
        same(lambda env: env.step(env.action_space.sample() * 0))
        for env in both:  # an episode that goes on; there is no seed
            env.step(np.zeros(4, np.int64))
            observation, infos = env.reset(options={"reset_mask": one.copy()})
            self.assertEqual(infos["_position"].tolist(), one.tolist())
            self.assertEqual((observation["previous_action"] == 3).tolist(), one.tolist())


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
