# SPDX-License-Identifier: Apache-2.0
"""Policies and their figures: those of policy_service's own evaluation."""

import json
import re
import subprocess
import tempfile
import unittest
from pathlib import Path

from support import BUILD, DRAWN, with_header
from domain import own_domain

import numpy as np

import citylearn

DATA = {name: value for name, value in DRAWN.items() if name != "frames"}
TASKS = 60
WHERE = [f"--domain={own_domain()}", "--interface=lo", "--middleware=cyclonedds", "--log-level=warn"]


class Evaluation(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        """A policy_service trains a little and evaluates the agent and every control on two recordings."""
        folder = Path(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        options = [f"--{name.replace('_', '-')}={value}" for name, value in DATA.items()]
        services = [subprocess.Popen([BUILD / "env_service/env_service", *WHERE, *options, f"--traversal={name}",
                                      "--agents=8", "--linger=0"]) for name in ("summer", "winter")]
        try:
            command = [BUILD / "policy_service/policy_service", *WHERE, "--agent=place_filter", "--steps=4000",
                       "--frames=0:32", f"--tasks={TASKS}", "--controls=all", "--seed=3", "--wait=60",
                       "--evaluate=summer,winter", f"--output={folder}/run",
                       *(f"--source={option[2:]}" for option in options)]
            subprocess.run(command, check=True, stdout=subprocess.DEVNULL, timeout=200)
        finally:
            for service in services:
                service.terminate()
                service.wait()
        cls.summary = json.loads((folder / "run/summary.json").read_text())
        cls.checkpoint = next((folder / "run/checkpoints").glob("checkpoint-*.clk"))
        cls.policy = citylearn.load_policy(cls.checkpoint)
        cls.model = f"{folder}/agent.onnx"
        subprocess.run([BUILD / "tools/export/citylearn_export", f"--checkpoint={cls.checkpoint}", f"--output={cls.model}"],
                       check=True, stderr=subprocess.DEVNULL, timeout=100)

    def same(self, score, expected):
        for name in ("tasks", "completed", "spl", "excess", "mean_steps", "shortest_mean", "reward"):
            self.assertAlmostEqual(getattr(score, name), expected[name], 12, name)

    def test_figures_are_those_of_policy_service(self):
        scores = citylearn.evaluate(self.policy, traversals=["summer", "winter"], controls=["all"], tasks=TASKS, seed=3,
                                    **DATA)
        policies = {"place_filter": self.summary["evaluate"], **self.summary["controls"]}
        self.assertEqual(set(scores), {(policy, name) for policy in policies for name in ("summer", "winter")})
        self.assertGreater(len(policies), 5)
        for (policy, traversal), score in scores.items():
            with self.subTest(policy=policy, traversal=traversal):
                self.same(score, policies[policy][traversal])
        self.assertIn("shortest_path", str(scores))

    def test_an_exported_model_acts_as_the_checkpoint(self):
        exported = citylearn.load_policy(self.model)
        self.assertEqual((exported.name, exported.frames, exported.features), ("place_filter", 32, 16))
        own, other = (citylearn.evaluate(policy, traversal="winter", tasks=TASKS, seed=3, **DATA)["place_filter", "winter"]
                      for policy in (self.policy, exported))
        # OpenCV rounds differently, which hardly ever changes a drawn action.
        self.assertAlmostEqual(own.spl, other.spl, 2)
        self.assertAlmostEqual(own.mean_steps, other.mean_steps, 0)

    def test_a_policy_brings_the_data_of_its_training(self):
        policy = self.policy
        self.assertEqual((policy.data.traversals, policy.data.source["synthetic-frames"]), (["summer"], "40"))
        scores = citylearn.evaluate(policy, traversals=["summer", "winter"], tasks=TASKS, seed=3)
        for (_, traversal), score in scores.items():
            self.same(score, self.summary["evaluate"][traversal])
        for own in (policy, citylearn.load_policy(self.model)):
            self.assertEqual(set(citylearn.evaluate(own, tasks=TASKS)), {("place_filter", "summer")})
            for more, wrong in (({"synthetic_seed": 2}, r"traversal 'summer': has other contents \(40 frames, hash "),
                                ({"synthetic_dimension": 8, "traversal": "winter"},
                                 "traversal 'winter': has 8 features a frame, the training has 16 .take the data")):
                with self.assertRaisesRegex(ValueError, wrong):
                    citylearn.evaluate(own, tasks=TASKS, **more)

    def test_a_checkpoint_of_an_earlier_version_says_nothing_of_its_data(self):
        policy = citylearn.load_policy(with_header(self.checkpoint, lambda header: header.pop("data"), "old.clk"))
        with self.assertRaisesRegex(ValueError, "does not say what it learned from; give data="):
            citylearn.evaluate(policy, tasks=TASKS)
        with self.assertWarnsRegex(UserWarning, "does not say what it learned from"):
            scores = citylearn.evaluate(policy, tasks=TASKS, seed=3, **DATA)
        self.same(scores["place_filter", "summer"], self.summary["evaluate"]["summer"])

    def test_a_control_and_a_function_are_policies_too(self):
        scores = citylearn.evaluate("sequence_filter", tasks=TASKS, seed=3, frames=32, **DATA)
        self.same(scores["sequence_filter", "summer"], self.summary["controls"]["sequence_filter"]["summer"])
        begun = []

        def on(observation, starts):
            begun.append(int(starts.sum()))
            return np.full(len(starts), 1)

        score = citylearn.evaluate(on, tasks=TASKS, seed=3, frames=32, name="on", **DATA)["on", "summer"]
        self.assertEqual((score.tasks, sum(begun)), (TASKS, TASKS))
        self.assertTrue(0.2 < score.completed < 0.8, "goals ahead are reached, those behind are not")
        self.assertAlmostEqual(score.spl, score.completed, 12)

    def test_an_acting_policy_says_what_it_believes(self):
        acting = citylearn.ActingPolicy(self.policy, seed=3)
        self.assertIsNone(acting.belief())
        env = citylearn.VectorEnv(num_envs=8, autoreset_mode=citylearn.AutoresetMode.SAME_STEP, **DRAWN)
        observations, infos = env.reset(seed=1)
        near, starts = [], np.ones(8, bool)
        for _ in range(100):
            actions = acting(observations, starts)
            belief = acting.belief()
            near.append(np.abs(belief["places"][:, 0] - infos["position"]) <= 1)
            observations, _, terminations, truncations, infos = env.step(actions)
            starts = terminations | truncations
        self.assertEqual(belief["places"].shape, (8, 8))
        self.assertTrue((np.diff(belief["probabilities"]) <= 0).all())
        self.assertTrue(((belief["entropy"] >= 0) & (belief["entropy"] <= 5)).all(), "of 32 places: at most 5 bits")
        self.assertGreater(np.mean(near), 0.9)
        with self.assertRaisesRegex(ValueError, "differ in their numbers of agents"):
            acting(observations, starts[:3])
        for name, wrong, words in (("features", observations["features"] * np.nan, "features are not finite"),
                                   ("goal", observations["goal"] + 2**40, "a goal is not a place"),
                                   ("previous_action", observations["previous_action"] - 9, "is not 0 to 3")):
            with self.assertRaisesRegex(ValueError, words):
                acting({**observations, name: wrong}, starts)
        with self.assertRaisesRegex(TypeError, "must be what load_policy.. returns, is str"):
            citylearn.ActingPolicy("best.clk")

    def test_a_filter_is_as_sure_as_it_may_be_and_says_when_it_is_lost(self):
        """Learned slips and kidnappings in the drawn city's summer, acts in fall and winter: the expected calibration error
        over 15 bins; 'lost' within 10 steps of a kidnapping, and where none was near and it is right."""
        world = {"synthetic_images": 0, "slip": 0.1, "kidnappings": 1}
        with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
            summer = subprocess.Popen([BUILD / "env_service/env_service", *WHERE, "--synthetic-images=0", "--slip=0.1",
                                       "--kidnappings=1", "--traversal=summer", "--linger=0"])
            try:
                subprocess.run([BUILD / "policy_service/policy_service", *WHERE, "--agent=place_filter",
                                "--train=summer-slip0.1-kidnap1", "--steps=80000", "--frames=0:128", "--tasks=50",
                                "--wait=60", f"--output={folder}"],
                               check=True, stdout=subprocess.DEVNULL, timeout=200)
            finally:
                summer.terminate()
                summer.wait()
            policy = citylearn.load_policy(next(Path(folder, "checkpoints").glob("checkpoint-*.clk")))
        for traversal in ("fall", "winter"):
            with self.subTest(traversal=traversal):
                self.expect_true_beliefs(policy, traversal, world)

    def expect_true_beliefs(self, policy, traversal, world):
        acting = citylearn.ActingPolicy(policy)
        env = citylearn.VectorEnv(num_envs=64, traversal=traversal, autoreset_mode=citylearn.AutoresetMode.SAME_STEP,
                                  **world)
        observations, infos = env.reset(seed=1001)
        beliefs, positions, first, starts = [], [], [], np.ones(64, bool)
        for _ in range(400):
            actions = acting(observations, starts)
            beliefs.append(acting.belief())
            positions.append(infos["position"])
            first.append(starts)
            observations, _, terminations, truncations, infos = env.step(actions)
            starts = terminations | truncations
        stated, said, positions, first = map(np.array, ([1 - one["lost"] for one in beliefs],
                                                        [one["says_lost"] for one in beliefs], positions, first))
        right = np.abs([one["places"][:, 0] for one in beliefs] - positions) <= 1
        self.assertGreater(right.mean(), 0.9)
        self.expect_said(said, right, first, np.diff(positions, axis=0, prepend=positions[:1]))
        stated, right = stated.ravel(), right.ravel()
        bins = np.minimum((15 * stated).astype(int), 14)
        error = sum(abs((stated - right)[bins == each].sum()) for each in range(15)) / len(stated)
        self.assertLess(error, 0.03)
        surer = np.argsort(-stated, kind="stable")[:len(stated) // 2]
        self.assertLessEqual(1 - right[surer].mean(), 0.001)

    def expect_said(self, said, right, first, moved):
        """All (steps, agents). Kidnappings count where ten steps of the episode follow without another."""
        kidnapped = (np.abs(moved) > 2) & ~first
        noticed, near = [], np.zeros_like(first)
        for step, agent in np.argwhere(kidnapped):
            after = slice(step, step + 10)
            near[after, agent] = True
            if step + 10 <= len(said) and not (first | kidnapped)[step + 1:step + 10, agent].any():
                noticed.append(said[after, agent].any())
        self.assertGreater(len(noticed), 200)
        self.assertGreaterEqual(np.mean(noticed), 0.95)
        self.assertLess((said & right & ~near).mean(), 0.005)

    def test_the_documentation_names_what_there_is(self):
        controls = {"shuffled", "all", *citylearn._options._native.controls()}
        self.assertLessEqual(set(re.findall(r'"(\w+)"', citylearn.evaluate.__doc__)), controls)

    def test_a_function_sees_the_goal_of_each_agent_and_may_return_any_whole_numbers(self):
        goals = []

        def act(observation, _):
            goals.append(len(set(observation["goal"].tolist())))
            return np.where(observation["action_mask"][:, 1], 1, 2)

        def score(kind):
            scores = citylearn.evaluate(lambda *seen: kind(act(*seen)), tasks=TASKS, frames=32, **DATA)
            return scores["policy", "summer"]

        expected = score(np.asarray)
        self.assertGreater(np.mean(goals), 4)
        for kind in (list, np.asfortranarray, np.int8, np.uint64, lambda a: np.repeat(a, 2)[::2],
                     lambda a: np.frombuffer(a.tobytes(), a.dtype)):
            self.assertEqual(score(kind).spl, expected.spl)
        for kind in (np.float64, np.bool_, str, lambda a: a[:0], lambda a: a[:, None], lambda a: a - 3):
            with self.assertRaisesRegex(ValueError, "must return .* whole numbers"):
                score(kind)

    def test_errors(self):
        for error, pattern, call in (
            (FileNotFoundError, "missing.clk", lambda: citylearn.load_policy("missing.clk")),
            (ValueError, "support.py", lambda: citylearn.load_policy(Path(__file__).with_name("support.py"))),
            (ValueError, "unknown control 'nobody'.*known: ", lambda: citylearn.evaluate("nobody", **DATA)),
            (ValueError, "has other contents", lambda: citylearn.evaluate(
                self.policy, **{**DATA, "synthetic_dimension": 8})),
            (ZeroDivisionError, "", lambda: citylearn.evaluate(lambda *_: 1 // 0, **DATA)),
            (TypeError, "policy must be of load_policy.*, is None", lambda: citylearn.evaluate(None, **DATA)),
            (TypeError, "traversals must be a list of names, is 'fall'",
             lambda: citylearn.evaluate("blind", traversals="fall", **DATA)),
            (TypeError, "controls must be a list of names, is 'all'",
             lambda: citylearn.evaluate("blind", controls="all", **DATA)),
            (TypeError, "control_parameters: slip of sequence_filter must be a number, is 'x'",
             lambda: citylearn.evaluate("sequence_filter", control_parameters={"sequence_filter": {"slip": "x"}},
                                        **DATA)),
            (ValueError, "slip.*nan", lambda: citylearn.evaluate(
                "sequence_filter", control_parameters={"sequence_filter": {"slip": float("nan")}}, **DATA)),
            (ValueError, "control_parameters: 'other' is not one of what is evaluated, blind",
             lambda: citylearn.evaluate("blind", control_parameters={"other": {}}, **DATA)),
            (TypeError, "unexpected keyword argument 'colour'", lambda: citylearn.evaluate("blind", colour=1, **DATA)),
        ):
            with self.subTest(pattern=pattern), self.assertRaisesRegex(error, pattern):
                call()


if __name__ == "__main__":
    unittest.main()
