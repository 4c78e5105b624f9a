# SPDX-License-Identifier: Apache-2.0
"""VectorEnv in process, with numpy alone."""

import argparse
import tempfile
import unittest
from pathlib import Path

from support import DRAWN, ClearErrors, towards_goal, walk

import numpy as np

import citylearn
from citylearn import Env, VectorEnv

MODES = ["NextStep", "SameStep", "Disabled"]
SPACES = {"features", "goal", "previous_action", "action_mask"}


class Spaces(unittest.TestCase):
    def test_observations_fit_the_spaces(self):
        env = VectorEnv(agents=3, services=2, **DRAWN)
        self.assertEqual(env.num_envs, 6)
        observation, infos = env.reset(seed=1)
        self.assertEqual(set(observation), SPACES)
        self.assertTrue(env.observation_space.contains(observation))
        self.assertEqual(observation["features"].shape, (6, 16))
        self.assertEqual(observation["features"].dtype, np.float32)
        for _ in range(50):
            actions = env.action_space.sample()
            self.assertTrue(env.action_space.contains(actions))
            observation, rewards, terminated, truncated, infos = env.step(actions)
            self.assertTrue(env.observation_space.contains(observation))
            self.assertEqual((rewards.shape, terminated.dtype, truncated.dtype), ((6,), np.bool_, np.bool_))
            self.assertTrue(infos["_position"].all())
            one = {name: values[0] for name, values in observation.items()}
            self.assertTrue(env.single_observation_space.contains(one))
        self.assertEqual(env.metadata["autoreset_mode"], citylearn.AutoresetMode.NEXT_STEP)

    def test_arrays_are_new_and_own_their_memory(self):
        env = VectorEnv(agents=2, **DRAWN)
        first, _ = env.reset(seed=1)
        kept = {name: values.copy() for name, values in first.items()}
        second = env.step(np.ones(2, int))[0]
        for name in SPACES:
            self.assertFalse(np.shares_memory(first[name], second[name]), name)
            np.testing.assert_array_equal(first[name], kept[name])
        self.assertIsNone(second["features"].base)

    def test_features_are_those_of_the_place(self):
        with tempfile.TemporaryDirectory() as folder:
            rows = np.arange(24, dtype=np.float32).reshape(12, 2)
            np.savetxt(Path(folder, "line.csv"), rows, delimiter=",", fmt="%g")
            env = VectorEnv(agents=4, data=folder, traversal="line")
            observation, infos = env.reset(seed=2)
            for _ in range(100):
                np.testing.assert_array_equal(observation["features"], rows[infos["position"]])
                observation, _, _, _, infos = env.step(env.action_space.sample())


class Seeds(unittest.TestCase):
    def walk(self, seed, **options):
        return walk(VectorEnv(agents=4, services=2, **{**DRAWN, **options}), seed, 100)

    def test_the_same_seed_gives_the_same_walk_and_another_seed_another(self):
        self.assertEqual(self.walk(3), self.walk(3))
        self.assertNotEqual(self.walk(3), self.walk(4))
        self.assertNotEqual(self.walk(3), self.walk(3, slip=0.2))

    def test_service_i_draws_from_seed_plus_i(self):
        both = VectorEnv(agents=4, services=2, **DRAWN).reset(seed=3)[0]["goal"]
        np.testing.assert_array_equal(both[4:], VectorEnv(agents=4, **DRAWN).reset(seed=4)[0]["goal"])

    def test_a_list_has_a_seed_for_each_service(self):
        env = VectorEnv(agents=4, services=2, **DRAWN)
        both = env.reset(seed=[8, 3])[0]["goal"]
        for part, seed in ((both[:4], 8), (both[4:], 3)):
            np.testing.assert_array_equal(part, VectorEnv(agents=4, **DRAWN).reset(seed=seed)[0]["goal"])
        np.testing.assert_array_equal(env.reset(seed=[None, 3])[0]["goal"][4:], both[4:])

    def test_without_a_seed_resets_differ_but_repeat_after_one(self):
        env = VectorEnv(agents=16, **DRAWN)
        goals = []
        for seed in (1, None, 1, None):
            goals.append(env.reset(seed=seed)[0]["goal"].tolist())
        self.assertEqual(goals[:2], goals[2:])
        self.assertNotEqual(goals[0], goals[1])


class Steps(unittest.TestCase):
    def test_rewards_and_ends_are_those_of_a_simple_model(self):
        env = VectorEnv(agents=8, max_steps=20, autoreset_mode="SameStep", **DRAWN)
        observation, infos = env.reset(seed=9)
        position, goal = infos["position"].copy(), observation["goal"].copy()
        start, nearest, steps = position.copy(), np.abs(goal - position), np.zeros(8, int)
        ends = {True: 0, False: 0}
        for _ in range(400):
            actions = towards_goal(observation, position)
            observation, rewards, terminated, truncated, infos = env.step(actions)
            position = position + np.array([0, 1, -1])[actions]
            np.testing.assert_array_equal(infos["position"], position)
            distance = np.abs(goal - position)
            steps += 1
            np.testing.assert_array_equal(terminated, distance == 0)
            np.testing.assert_array_equal(truncated, (distance > 0) & (steps == 20))
            np.testing.assert_allclose(rewards, np.where(distance == 0, 1, np.where(distance < nearest, 0, -1 / 20)))
            nearest = np.minimum(nearest, distance)
            for agent in np.flatnonzero(terminated | truncated):
                ends[bool(terminated[agent])] += 1
                shortest = abs(goal[agent] - start[agent])
                self.assertAlmostEqual(infos["final_info"]["spl"][agent],
                                       terminated[agent] * shortest / max(shortest, steps[agent]))
                start[agent], steps[agent] = position[agent], 0
                nearest[agent] = abs(observation["goal"][agent] - position[agent])
            goal = observation["goal"].copy()
        self.assertGreater(min(ends.values()), 10, "both ends occur")

    def test_after_an_end_the_next_step_is_a_reset(self):
        env = VectorEnv(agents=8, max_steps=20, **DRAWN)
        observation, infos = env.reset(seed=5)
        ended, seen = np.zeros(8, bool), 0
        for _ in range(200):
            before = observation
            observation, rewards, terminated, truncated, infos = env.step(towards_goal(before, infos["position"]))
            self.assertTrue((rewards[ended] == 0).all())
            self.assertFalse((terminated | truncated)[ended].any())
            self.assertTrue((observation["previous_action"][ended] == 3).all())
            self.assertTrue((observation["previous_action"][~ended] < 3).all())
            np.testing.assert_array_equal(observation["goal"][~ended], before["goal"][~ended])
            seen += ended.sum()
            ended = terminated | truncated
            np.testing.assert_array_equal(infos.get("_spl", np.zeros(8, bool)), ended)
        self.assertGreater(seen, 20)

    def test_an_action_off_the_route_is_stay(self):
        env = VectorEnv(agents=16, autoreset_mode="SameStep", **DRAWN)
        _, infos = env.reset(seed=1)
        off = 0
        for _ in range(60):
            before = infos["position"]
            observation, _, terminated, truncated, infos = env.step(np.full(16, 2))
            at_end = (before == 0) & ~terminated & ~truncated
            off += at_end.sum()
            self.assertTrue((observation["previous_action"][at_end] == 0).all())
        self.assertGreater(off, 10)

    def test_with_shuffled_frames_an_episode_ends_with_its_own(self):
        """One frame is seen at each place of an episode, from its first observation to its last."""
        for mode in MODES:
            env = VectorEnv(agents=1, shuffle=True, max_steps=60, autoreset_mode=mode, **{**DRAWN, "frames": 8})
            observation, infos = env.reset(seed=3)
            seen, ends, way = {}, 0, 1
            for _ in range(600):
                seen.setdefault(int(infos["position"][0]), observation["features"][0].tobytes())
                mask = env.action_masks()[0]
                way = 2 if not mask[1] else 1 if not mask[2] else way
                observation, _, terminated, truncated, infos = env.step([way])
                ended = bool(terminated[0] | truncated[0])
                final = (infos["final_obs"][0], infos["final_info"]) if "final_obs" in infos else (
                    {"features": observation["features"][0]}, infos)
                features = final[0]["features"].tobytes()
                self.assertEqual(seen.setdefault(int(final[1]["position"][0]), features), features, mode)
                self.assertEqual(len(set(seen.values())), len(seen), "no frame is seen at two places")
                if ended:
                    ends += 1
                    seen = {}
                    if mode == "Disabled":
                        observation, infos = env.reset(options={"reset_mask": np.ones(1, bool)})
            self.assertGreater(ends, 40)

    def test_dropped_frames_are_dropped_at_the_end_too(self):
        env = VectorEnv(agents=32, dropped_frames=0.5, autoreset_mode="SameStep", **DRAWN)
        observation, infos = env.reset(seed=1)
        again = ends = 0
        for _ in range(200):
            before = observation["features"]
            actions = np.where(observation["goal"] > infos["position"], 1, 2)
            observation, _, terminated, _, infos = env.step(actions)
            for agent in np.flatnonzero(terminated):
                again += np.array_equal(infos["final_obs"][agent]["features"], before[agent])
                ends += 1
        self.assertGreater(ends, 400)
        self.assertAlmostEqual(again / ends, 0.5, 1)

    def test_actions_of_any_whole_type_and_layout(self):
        def goals(kind):
            env = VectorEnv(agents=5, **DRAWN)
            _, infos = env.reset(seed=4)
            for _ in range(40):
                actions = np.array([1, 2, 0, 2, 1])
                observation, _, _, _, infos = env.step(kind(actions))
            return observation["goal"].tolist(), infos["position"].tolist()

        def read_only(actions):
            return np.frombuffer(actions.astype(np.uint8).tobytes(), np.uint8)

        expected = goals(np.asarray)
        for kind in (list, tuple, np.int8, np.int32, np.uint8, np.uint64, lambda a: a.astype(">i4"), read_only,
                     lambda a: np.repeat(a, 3)[::3], lambda a: np.asfortranarray(np.stack([a, a]))[0]):
            self.assertEqual(goals(kind), expected)

    def test_send_and_recv_are_step(self):
        one, other = (VectorEnv(agents=4, services=3, **DRAWN) for _ in range(2))
        observation, infos = one.reset(seed=2)
        other.reset(seed=2)
        for _ in range(50):
            actions = towards_goal(observation, infos["position"])
            other.send(actions)
            observation, rewards, _, _, infos = one.step(actions)
            later, rewards_later, _, _, _ = other.recv()
            np.testing.assert_array_equal(observation["features"], later["features"])
            np.testing.assert_array_equal(rewards, rewards_later)
        other.send(actions)
        other.close()  # waits for the step


class Errors(ClearErrors):
    def test_options(self):
        self.expect(TypeError, r"unexpected keyword argument 'colour' \(known: .*traversal", VectorEnv, colour="red", **DRAWN)
        self.expect(ValueError, "known: .*synthetic", VectorEnv, dataset="none")
        self.expect(ValueError, "'spring'.*winter", VectorEnv, **{**DRAWN, "traversal": "spring"})
        self.expect(ValueError, "^slip: Value 2", VectorEnv, slip=2, **DRAWN)
        self.expect(ValueError, "agents must be 1..256, is 0", VectorEnv, agents=0, **DRAWN)
        self.expect(TypeError, "services must be a whole number, is 1.5", VectorEnv, services=1.5, **DRAWN)
        self.expect(ValueError, "frames: 0:99 must be two frames or more of the 40", VectorEnv,
                    **{**DRAWN, "frames": 99})
        self.expect(ValueError, "'a:b' is not FIRST:END", VectorEnv, **{**DRAWN, "frames": "a:b"})
        self.expect(ValueError, "Sometimes", VectorEnv, autoreset_mode="Sometimes", **DRAWN)
        self.expect(ValueError, "^slip: nan is not a number", VectorEnv, slip=float("nan"), **DRAWN)
        self.expect(ValueError, "services must be 1..4096, is 1000000000", VectorEnv, services=10**9, **DRAWN)
        self.expect(TypeError, "shuffle must be True or False, is 'no'", VectorEnv, shuffle="no", **DRAWN)
        self.expect(TypeError, "wait must be a number of seconds, is '3'", VectorEnv, wait="3", **DRAWN)
        self.expect(TypeError, "agents must be a whole number, is True", VectorEnv, agents=True, **DRAWN)
        self.expect(TypeError, r"slip must be a text, a number or a list of them, is \{\}", VectorEnv, slip={},
                    **DRAWN)
        self.expect(ValueError, "^slip is empty; leave it out", VectorEnv, slip="", **DRAWN)
        self.expect(ValueError, "^slip is empty; leave it out", VectorEnv, slip=[], **DRAWN)
        self.expect(ValueError, "^encoder: is for pictures, but traversal 'summer' has features", VectorEnv,
                    encoder="patchnorm", **DRAWN)

    def test_an_encoder_needs_a_reference_and_a_control_what_it_knows(self):
        with tempfile.TemporaryDirectory() as folder:
            for name in ("one", "two"):
                drawn = np.random.default_rng(0).integers(0, 255, (12, 32, 32), np.uint8)
                Path(folder, name).mkdir()
                for frame, picture in enumerate(drawn):
                    Path(folder, name, f"{frame:04d}.pgm").write_bytes(b"P5 32 32 255 " + picture.tobytes())
            data = {"data": folder, "store": "none", "encoder": "patchnorm"}
            there = r"no traversal 'summer' \(there are: one, two\)"
            self.expect(ValueError, there, VectorEnv, **data)
            self.expect(ValueError, "^reference 'summer': .*" + there, VectorEnv, traversal="one", **data)
            data.update(traversal="one", reference="two")
            self.assertEqual(VectorEnv(**data).num_envs, 16)
            self.expect(ValueError, "^train 'summer', whose features sequence_filter knows: .*" + there,
                        citylearn.evaluate, "sequence_filter", tasks=5, **data)
        self.expect(ValueError, "'1:20:2' is not FIRST:END", VectorEnv, **{**DRAWN, "frames": "1:20:2"})
        self.expect(TypeError, "max_episode_steps cuts no episode here; give max_steps", VectorEnv,
                    max_episode_steps=5, **DRAWN)
        self.expect(ValueError, "num_envs is 6, but 2 services have 8 agents", VectorEnv, num_envs=6, agents=4,
                    services=2, **DRAWN)

    def test_none_leaves_an_option_out(self):
        parser = argparse.ArgumentParser()
        for name in ("agents", "services", "frames", "max-steps", "shuffle", "wait", "autoreset-mode", "session",
                     "domain", "slip", "render-mode", "num-envs"):
            parser.add_argument(f"--{name}")
        given = {**vars(parser.parse_args([])), **DRAWN}
        self.assertEqual(walk(VectorEnv(**given), 1, 20), walk(VectorEnv(**DRAWN), 1, 20))
        self.assertEqual(Env(**given).observation_space.keys(), SPACES)

    def test_one_environment(self):
        env = Env(**DRAWN)
        self.expect(RuntimeError, r"call reset\(\) first", env.action_masks)
        env.reset(seed=0)
        self.assertTrue(env.action_masks()[0])
        self.expect(ValueError, r"has shape \(2,\), must be one whole number", env.step, [0, 1])
        self.expect(TypeError, "must be whole numbers", env.step, 1.0)
        env.close()
        env.close()
        self.expect(RuntimeError, "is closed", env.step, 0)

    def test_a_forked_process_does_not_wait_for_a_step_of_its_parent(self):
        env = VectorEnv(agents=2, **DRAWN)
        env.reset(seed=0)
        env.send(np.zeros(2, int))

        def receive_and_close():
            self.expect(RuntimeError, "belongs to process", env.recv)
            env.close()

        self.in_fork(receive_and_close)
        env.recv()

    def test_actions(self):
        env = VectorEnv(agents=2, **DRAWN)
        self.expect(RuntimeError, r"call reset\(\) first", env.step, np.zeros(2, int))
        env.reset(seed=0)
        self.expect(ValueError, r"shape \(3,\), must have \(2,\)", env.step, np.zeros(3, int))
        self.expect(TypeError, "float64, must be whole numbers", env.step, np.zeros(2))
        self.expect(ValueError, "action 3 of agent 1", env.step, np.array([0, 3]))
        self.expect(RuntimeError, r"recv\(\) without send\(\)", env.recv)
        env.send(np.zeros(2, int))
        self.expect(RuntimeError, r"call recv\(\) first", env.step, np.zeros(2, int))
        self.expect(RuntimeError, r"call recv\(\) first", env.reset)
        env.recv()
        env.close()
        env.close()
        self.expect(RuntimeError, "is closed", env.step, np.zeros(2, int))
        self.expect(RuntimeError, "is closed", env.reset)

    def test_resets(self):
        env = VectorEnv(agents=2, autoreset_mode="Disabled", max_steps=2, **DRAWN)
        mask = np.ones(2, bool)
        self.expect(ValueError, "seed must be 0", env.reset, seed=-1)
        self.expect(TypeError, "seed must be a whole number", env.reset, seed=1.5)
        self.expect(RuntimeError, "for all agents first", env.reset, options={"reset_mask": np.array([True, False])})
        self.expect(ValueError, "seed must be one number or a list of 1, one for each service, has 2", env.reset,
                    seed=[1, 2])
        self.expect(TypeError, "seed must be a whole number, is 1.5", env.reset, seed=[1.5])
        env.reset(seed=0)
        self.expect(ValueError, "must name an agent", env.reset, options={"reset_mask": ~mask})
        self.expect(TypeError, "array of bool", env.reset, options={"reset_mask": [True, True]})
        self.expect(ValueError, r"shape \(1,\)", env.reset, options={"reset_mask": mask[:1]})
        self.expect(ValueError, "agent 1 is not in the mask, but in a service that begins anew", env.reset,
                    options={"reset_mask": np.array([True, False])})
        for _ in range(2):
            _, _, terminated, truncated, _ = env.step(np.zeros(2, int))
        self.assertTrue((terminated | truncated).all())
        self.expect(RuntimeError, "episode of agent 0 has ended; call reset", env.step, np.zeros(2, int))
        self.expect(ValueError, "agent 0 is not in the mask", env.reset, seed=1,
                    options={"reset_mask": np.array([False, True])})


if __name__ == "__main__":
    unittest.main()
