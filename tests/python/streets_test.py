# SPDX-License-Identifier: Apache-2.0
"""Environments on a map of streets, in process and over DDS."""

import contextlib
import json
import os
import pty
import re
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

import actors
from support import BUILD, SOURCE, ClearErrors, walk
from actors import DOMAIN, WHERE, as_options, running

import numpy as np

import citylearn

# A street from a to the east, a corner at b, and a street to the north, to c. States by place and heading:
# a-b, b-c, b-a, c-b. One who goes round the corner faces the link ahead of it.
HEADING = np.array([90, 0, 270, 180])
FEWEST = [[0, 1, 2], [2, 0, 1], [1, 0, 2], [2, 1, 0]]  # steps by state and place
ROWS = np.array([[1, 0.5], [0, 7], [2, 3], [3, 5]])  # as links.txt has them: b-c, a-b, b-a, c-b


# As tests/support/streets.h: a dead end, a junction, a one-way link, corridors and corners.
NODES = [(0, 10), (10, 10), (20, 10), (30, 10), (20, 20), (0, 0), (30, 0)]  # metres east and north
LINKS = [(0, 90, 1), (0, 180, 5), (1, 90, 2), (1, 270, 0), (2, 0, 4), (2, 90, 3), (2, 270, 1), (3, 180, 6), (4, 180, 2),
         (5, 0, 0), (5, 90, 6), (6, 0, 3), (6, 270, 5)]
TASKS = 60


class Learned(ClearErrors):
    """What policy_service learns and evaluates on streets, Python evaluates to the same digits."""

    @classmethod
    def setUpClass(cls):
        cls.folder = Path(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        cls.write(cls.folder, LINKS)
        cls.learned = {agent: cls.train(agent) for agent in ("place_filter", "features", "baseline")}

    @staticmethod
    def write(folder, links):
        folder.mkdir(exist_ok=True)
        folder.joinpath("nodes.txt").write_text("".join(
            f"{i},0,{north / 111195:.9f},{east / 111195:.9f}\n" for i, (east, north) in enumerate(NODES)))
        folder.joinpath("links.txt").write_text("".join(f"{a},{heading},{b}\n" for a, heading, b in links))
        day = np.random.default_rng(7).normal(size=(len(links), 16))
        dusk = day + np.random.default_rng(8).normal(size=day.shape) / 2
        for name, rows in (("day", day), ("dusk", dusk)):
            np.savetxt(folder / f"{name}.csv", rows, delimiter=",", fmt="%g")

    @classmethod
    def train(cls, agent):
        output = cls.folder / agent
        data = as_options({"data": cls.folder})
        services = [subprocess.Popen([BUILD / "env_service/env_service", *as_options(WHERE), *data, "--agents=8",
                                      "--linger=0", *of]) for of in (["--traversal=day"], ["--traversal=dusk"],
                                                                     ["--traversal=dusk", "--goal-place=4"],
                                                                     ["--traversal=dusk", "--goals=3"])]
        with running(*services, end=signal.SIGTERM):
            subprocess.run([BUILD / "policy_service/policy_service", *as_options(WHERE), f"--agent={agent}", "--steps=3000",
                            f"--tasks={TASKS}", "--train=day", "--evaluate=day,dusk,dusk-goal4,dusk-goals3", "--seed=3", "--wait=60",
                            f"--output={output}", *(f"--source={one[2:]}" for one in data)],
                           check=True, stdout=subprocess.DEVNULL, timeout=200)
        return json.loads((output / "summary.json").read_text())["evaluate"], next(output.glob("checkpoints/checkpoint-*"))

    def export(self, checkpoint):
        model = checkpoint.with_suffix(".onnx")
        return model, subprocess.run([BUILD / "tools/export/citylearn_export", f"--checkpoint={checkpoint}",
                                      f"--output={model}"], check=False, stderr=subprocess.PIPE, text=True, timeout=100)

    def test_a_checkpoint_has_the_figures_of_policy_service(self):
        for agent, (expected, checkpoint) in self.learned.items():
            scores = citylearn.evaluate(citylearn.load_policy(checkpoint), traversals=["day", "dusk"], tasks=TASKS, seed=3)
            for goal in 4, (20 / 111195, 20 / 111195, 5):
                to_it = citylearn.evaluate(citylearn.load_policy(checkpoint), traversals=["dusk"], tasks=TASKS, seed=3,
                                           goal_place=goal)
                self.assertNotEqual(to_it[agent, "dusk-goal4"].shortest_mean, scores[agent, "dusk"].shortest_mean)
                scores |= to_it
            scores |= citylearn.evaluate(citylearn.load_policy(checkpoint), traversals=["dusk"], tasks=TASKS, seed=3, goals=3)
            for (_, traversal), score in scores.items():
                with self.subTest(agent=agent, traversal=traversal):
                    for name in ("tasks", "completed", "spl", "mean_steps", "reward"):
                        self.assertAlmostEqual(getattr(score, name), expected[traversal][name], 12, name)
        self.assertGreater(expected["day"]["spl"], 0)

    def test_all_episodes_lead_to_one_place(self):
        for goal, place in (3, 3), ((0, 30 / 111195), 6):
            env = citylearn.VectorEnv(data=self.folder, traversal="day", agents=4, goal_place=goal)
            observations, _ = env.reset(seed=1)
            for _ in range(50):
                np.testing.assert_array_equal(observations["goal"], place)
                observations, *_ = env.step(env.action_space.sample())
        self.expect(ValueError, "goal_place 0.01,0: no place is within 50 m: the nearest, place 4 at ",
                    citylearn.VectorEnv, data=self.folder, traversal="day", goal_place=(0.01, 0))

    def test_models_walk_likewise_and_place_filter_has_none(self):
        for agent in ("features", "baseline"):
            expected, checkpoint = self.learned[agent]
            model, done = self.export(checkpoint)
            self.assertEqual(done.returncode, 0, done.stderr)
            score = citylearn.evaluate(citylearn.load_policy(model), tasks=TASKS, seed=3)[agent, "day"]
            self.assertAlmostEqual(score.spl, expected["day"]["spl"], 2)  # OpenCV rounds differently
        _, done = self.export(self.learned["place_filter"][1])
        self.assertNotEqual(done.returncode, 0)
        self.assertIn("walks by the map of its streets", done.stderr)

    def test_it_acts_in_an_environment_and_on_other_streets(self):
        policy = citylearn.load_policy(self.learned["place_filter"][1])
        same_step = citylearn.AutoresetMode.SAME_STEP
        env = citylearn.VectorEnv(data=self.folder, traversal="dusk", agents=8, autoreset_mode=same_step)
        acting = citylearn.ActingPolicy(policy, seed=3, envs=env)
        observations, infos = env.reset(seed=1)
        starts, ended, near = np.ones(8, bool), [], []
        for _ in range(60):
            actions = acting(observations, starts)
            near.append(acting.belief()["places"][:, 0] == infos["position"])
            observations, _, terminated, truncated, infos = env.step(actions)
            starts = terminated | truncated
            ended += list(terminated[starts])
        self.assertGreater(np.mean(ended), 0.9)
        self.assertGreater(np.mean(near), 0.7)
        self.expect(ValueError, "learned on streets, here is a line", citylearn.ActingPolicy, policy)
        other = self.folder / "other"
        self.write(other, LINKS[:6] + LINKS[6:9] + [(3, 270, 2)] + LINKS[9:])
        env = citylearn.VectorEnv(data=other, traversal="day")
        self.expect(ValueError, "learned on other streets", citylearn.ActingPolicy, policy, envs=env)
        scores = citylearn.evaluate(policy, tasks=TASKS, data=other, traversals=["dusk"], train="day")
        self.assertGreater(scores["place_filter", "dusk"].spl, 0.8)
        model, _ = self.export(self.learned["features"][1])
        self.expect(ValueError, "learned on other streets, of 7 places", citylearn.evaluate, citylearn.load_policy(model),
                    tasks=9, data=other, traversals=["dusk"])
        line = {"data": self.folder, "rule": "line", "traversals": ["dusk"]}
        self.expect(ValueError, "learned on streets, here is a line", citylearn.evaluate, policy, tasks=9, **line)


class Streets(ClearErrors):
    @classmethod
    def setUpClass(cls):
        folder = tempfile.TemporaryDirectory()
        cls.addClassCleanup(folder.cleanup)
        cls.data = folder.name
        Path(folder.name, "nodes.txt").write_text("a,0,0,0\nb,0,0,0.001\nc,0,0.001,0.001\n")
        Path(folder.name, "links.txt").write_text("b,0,c\na,90,b\nb,270,a\nc,180,b\n")
        np.savetxt(Path(folder.name, "day.csv"), ROWS, delimiter=",", fmt="%g")

    def envs(self, kind=citylearn.VectorEnv, **options):
        return kind(data=self.data, traversal="day", **options)

    def test_actions_turn_and_go_and_goals_are_places(self):
        env = self.envs(agents=8)
        self.assertTrue(env.single_observation_space["goal"].contains(np.int64(2)))
        self.assertFalse(env.single_observation_space["goal"].contains(np.int64(3)))
        observation, infos = env.reset(seed=1)
        for _ in range(60):
            position = infos["position"]
            np.testing.assert_array_equal(infos["heading"], HEADING[position])
            np.testing.assert_array_equal(observation["features"], ROWS[[1, 0, 2, 3]][position])
            at_b = np.isin(position, (1, 2))
            np.testing.assert_array_equal(observation["action_mask"], np.stack([at_b, at_b | True, at_b], 1))
            observation, _, _, _, infos = env.step(env.action_space.sample())

    def test_spl_is_of_the_fewest_steps_and_a_detour_is_limited(self):
        random = np.random.default_rng(3)
        for limits in ({}, {"max_detour": 0, "max_steps": 50}):
            env, completed, spl = self.envs(citylearn.Env, **limits), set(), set()
            for episode in range(60):
                observation, info = env.reset(seed=episode)
                fewest, steps, terminated, truncated = FEWEST[info["position"]][observation["goal"]], 0, False, False
                while not (terminated or truncated):
                    observation, _, terminated, truncated, info = env.step(random.integers(3))
                    steps += 1
                self.assertLessEqual(steps, 50 if limits else 3 * fewest)
                self.assertAlmostEqual(info["spl"], fewest / steps if terminated else 0)
                completed.add(bool(terminated))
                spl.add(info["spl"])
            self.assertGreater(len(spl), 3)
            self.assertEqual(completed, {True} if limits else {False, True})

    def test_a_courier_goes_from_goal_to_goal(self):
        following = [(None, 1, None), (2, 3, 2), (1, 0, 1), (None, 2, None)]  # states, by left, forward and right
        places = [0, 1, 1, 2]

        def fewest(state, goals):
            ways, steps = {(state, 0)}, 0  # where one may be, and how many goals were reached
            while all(reached < len(goals) for _, reached in ways):
                ways = {(to, reached + (places[to] == goals[reached])) for at, reached in ways for to in following[at]
                        if to is not None}
                steps += 1
            return steps

        random, spl = np.random.default_rng(3), set()
        env = self.envs(citylearn.Env, goals=3)
        for episode in range(60):
            observation, info = env.reset(seed=episode)
            start, goals, steps, ended = info["position"], [observation["goal"]], 0, False
            while not ended:
                self.assertEqual(info["later_goals"], 3 - len(goals))
                observation, reward, terminated, truncated, info = env.step(random.integers(3))
                steps += 1
                ended = terminated or truncated
                self.assertEqual(reward == 1, places[info["position"]] == goals[-1])
                if reward == 1 and not ended:
                    self.assertNotEqual(observation["goal"], goals[-1])
                    goals.append(observation["goal"])
            self.assertLessEqual(fewest(start, goals), steps)
            self.assertAlmostEqual(info["spl"], fewest(start, goals) / steps if terminated else 0)
            spl.add(info["spl"])
        self.assertGreater(len(spl), 5)
        self.assertNotIn("later_goals", self.envs().reset(seed=1)[1])
        self.expect(ValueError, "goals", self.envs, goals=17)

    def test_controls_are_evaluated_as_by_policy_service(self):
        scores = citylearn.evaluate("shortest_path", controls=["all"], tasks=50, data=self.data, traversal="day", train="day")
        self.assertEqual(scores["shortest_path", "day"].spl, 1)
        self.assertLess(scores["blind", "day"].spl, 1)
        self.assertNotIn(("shuffled", "day"), scores)

    def test_a_walk_is_the_same_over_dds(self):
        expected = walk(self.envs(agents=4, max_steps=20, goals=2), 7, 100)
        services = actors.env_services(1, 4, "day", {"data": self.data, "goals": 2}, middleware="cyclonedds")
        with running(*services, end=signal.SIGTERM):
            env = citylearn.VectorEnv(middleware="cyclonedds", domain=DOMAIN, interface="lo", traversal="day-goals2",
                                      max_steps=20)
            self.assertEqual(walk(env, 7, 100), expected)
            self.assertEqual(env.reset(seed=2)[1]["heading"].shape, (4,))
            env.close()

    def test_a_person_walks_by_the_arrow_keys(self):
        with running(*actors.env_services(1, 1, "day", {"data": self.data}), end=signal.SIGTERM):
            try:
                pid, terminal = pty.fork()
            except OSError:
                self.skipTest("there are no terminals here")
            if pid == 0:
                os.environ.update(TERM="xterm", PYTHONPATH=str(BUILD / "python"))
                os.execv(sys.executable, [sys.executable, "-B", str(SOURCE / "python/examples/walk.py"), "traversal=day",
                                          "middleware=cyclonedds", f"domain={DOMAIN}", "interface=lo"])
            os.write(terminal, b"x" + 12 * b"\x1bOA" + b"q")  # no action; forward, which leads round all; the end
            told = b""
            with contextlib.suppress(OSError):  # at its end
                while part := os.read(terminal, 4096):
                    told += part
        self.assertEqual(os.waitpid(pid, 0)[1], 0, told)
        walks, spl = re.search(rb"(\d+) walks, SPL ([.\d]+)", told).groups()
        self.assertTrue(3 <= int(walks) <= 12, told)  # of at most 4 steps
        self.assertGreaterEqual(float(spl), 1 / 3)

    def test_it_draws_and_refuses_parts_and_wrong_actions(self):
        env = self.envs(citylearn.Env, render_mode="rgb_array")
        env.reset(seed=1)
        self.assertEqual(env.render().shape[2], 3)
        self.expect(ValueError, r"0 \(left\), 1 \(forward\) or 2 \(right\)", env.step, 3)
        self.expect(ValueError, "streets of 'day' are one route of all 4 frames", self.envs(citylearn.Env, frames=3).reset)
        self.expect(ValueError, "frames of streets are not shuffled", self.envs(citylearn.Env, shuffle=True).reset)
        self.assertEqual(self.envs(rule="line", agents=2).reset(seed=1)[1].keys(), {"position", "_position"})


if __name__ == "__main__":
    unittest.main()
