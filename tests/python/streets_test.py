# SPDX-License-Identifier: Apache-2.0
"""Environments on a map of streets, in process and over DDS."""

import contextlib
import os
import pty
import re
import signal
import sys
import tempfile
import unittest
from pathlib import Path

import actors
from support import BUILD, SOURCE, ClearErrors, walk
from actors import DOMAIN, running

import numpy as np

import citylearn

# A street from a to the east, a corner at b, and a street to the north, to c. States by place and heading:
# a-b, b-c, b-a, c-b. One who goes round the corner faces the link ahead of it.
HEADING = np.array([90, 0, 270, 180])
FEWEST = [[0, 1, 2], [2, 0, 1], [1, 0, 2], [2, 1, 0]]  # steps by state and place
ROWS = np.array([[1, 0.5], [0, 7], [2, 3], [3, 5]])  # as links.txt has them: b-c, a-b, b-a, c-b


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

    def test_controls_are_evaluated_as_by_policy_service(self):
        scores = citylearn.evaluate("shortest_path", controls=["all"], tasks=50, data=self.data, traversal="day", train="day")
        self.assertEqual(scores["shortest_path", "day"].spl, 1)
        self.assertLess(scores["blind", "day"].spl, 1)
        self.assertNotIn(("shuffled", "day"), scores)

    def test_a_walk_is_the_same_over_dds(self):
        expected = walk(self.envs(agents=4, max_steps=20), 7, 100)
        with running(*actors.env_services(1, 4, "day", {"data": self.data}, middleware="cyclonedds"), end=signal.SIGTERM):
            env = citylearn.VectorEnv(middleware="cyclonedds", domain=DOMAIN, interface="lo", traversal="day", max_steps=20)
            self.assertEqual(walk(env, 7, 100), expected)
            self.assertEqual(env.reset(seed=2)[1]["heading"].shape, (4,))
            env.close()

    def test_a_person_walks_by_the_arrow_keys(self):
        with running(*actors.env_services(1, 1, "day", {"data": self.data}), end=signal.SIGTERM):
            pid, terminal = pty.fork()
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
