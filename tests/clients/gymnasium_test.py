# SPDX-License-Identifier: Apache-2.0
"""The package as Gymnasium sees it."""

import unittest
import warnings

from support import DRAWN, towards_goal

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
            warnings.filterwarnings("ignore", ".*infinity.*")  # features have no bounds
            check_env(gymnasium.make("CityLearn-v0", render_mode="rgb_array", **OPTIONS).unwrapped)

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
        ours, theirs = (gymnasium.make_vec("CityLearn-v0", num_envs=4, vectorization_mode=mode, **OPTIONS)
                        for mode in (None, "sync"))
        self.assertIsInstance(ours, citylearn.VectorEnv)
        self.assertEqual(ours.observation_space, theirs.observation_space)
        self.assertTrue(data_equivalence(ours.reset(seed=2), theirs.reset(seed=2)))
        self.assertTrue(data_equivalence(ours.reset(seed=[4, 3, 2, 1]), theirs.reset(seed=[4, 3, 2, 1])))

    def test_services_have_agents(self):
        env = gymnasium.make_vec("CityLearn-v0", num_envs=8, agents=4, services=2, **OPTIONS)
        self.assertEqual(env.reset(seed=1)[0]["action_mask"].shape, (8, 3))
        with self.assertRaisesRegex(ValueError, "num_envs is 8, but 2 services have 6 agents"):
            gymnasium.make_vec("CityLearn-v0", num_envs=8, agents=3, services=2, **OPTIONS)
        with self.assertRaisesRegex(TypeError, "unexpected keyword argument 'colour'"):
            gymnasium.make("CityLearn-v0", colour=1)


class Pictures(unittest.TestCase):
    """Two pictures of 240 columns with 4 between them; below, 12 rows of the route with marks of 8 columns."""

    def marks(self, picture, colour):
        """Returns the columns of the route that have this colour."""
        return np.flatnonzero((picture[-12:] == colour).all(axis=(0, 2))).tolist()

    def test_the_frame_seen_is_shown_and_the_places_are_marked(self):
        env = gymnasium.make_vec("CityLearn-v0", num_envs=4, render_mode="rgb_array", shuffle=True, **OPTIONS)
        observation, infos = env.reset(seed=1)
        for _ in range(30):
            for agent, picture in enumerate(env.render()):
                self.assertEqual((picture.shape, picture.dtype), ((252, 484, 3), np.uint8))
                features = observation["features"][agent]  # 16: tiles of 60 x 60
                tiles = 127.5 * (1 + features / np.abs(features).max())
                np.testing.assert_allclose(picture[30:240:60, 30:240:60, 1].ravel(), tiles, atol=1)
                at = int(infos["position"][agent]) * 476 // 31
                self.assertEqual(self.marks(picture, (220, 60, 40)), list(range(at, at + 8)))
                goal = int(observation["goal"][agent]) * 476 // 31
                self.assertLessEqual(set(self.marks(picture, (40, 180, 60))), set(range(goal, goal + 8)))
            observation, _, _, _, infos = env.step(towards_goal(observation, infos["position"]))

    def test_pictures_at_the_goal_are_the_same(self):
        env = gymnasium.make("CityLearn-v0", render_mode="rgb_array", **{**OPTIONS, "synthetic_images": 1, "max_steps": 64,
                                                                         "store": "none"})
        observation, infos = env.reset(seed=3)
        terminated, different = False, 0
        while not terminated:
            picture = env.render()
            different += (picture[:-12, :240] != picture[:-12, 244:]).any()
            observation, _, terminated, _, infos = env.step(1 if observation["goal"] > infos["position"] else 2)
        picture = env.render()
        np.testing.assert_array_equal(picture[:-12, :240], picture[:-12, 244:])
        self.assertGreater(different, 0)
        self.assertGreater(picture[5, :240, 2].mean(), picture[5, :240, 0].mean(), "the sky is blue")
        self.assertEqual(self.marks(picture, (40, 180, 60)), [])

    def test_windows_are_gymnasiums(self):
        self.assertEqual(gymnasium.spec("CityLearn-v0").make(**OPTIONS).render_mode, None)
        with self.assertRaisesRegex(TypeError, "render_mode must be None or rgb_array, is 'human'"):
            citylearn.Env(render_mode="human", **OPTIONS)
        with self.assertRaisesRegex(TypeError, "render_mode must be None over DDS, is 'rgb_array'"):
            citylearn.VectorEnv(render_mode="rgb_array", session="default")


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
