# SPDX-License-Identifier: Apache-2.0
"""A learner in Python with actors in C++: trajectories arrive, actors do what it publishes, and agents get better."""

import contextlib
import os
import signal
import subprocess
import tempfile
import threading
import time
import unittest
from pathlib import Path

from support import BUILD, DRAWN, ClearErrors
from actors import WHERE, actor, as_options, env_services, running

import numpy as np

import citylearn

SMALL = {"agent": "baseline", "baseline_hidden": 24, "baseline_cells": 16, "trainer_agents": 16, "trainer_segment": 32,
         "trainer_sequence": 32, "frames": 16}
LSTM = ("sensors.weight", "sensors.bias", "lstm.input", "lstm.recurrent", "lstm.bias")


def learner(**options):
    return citylearn.Trajectories(**{**SMALL, **WHERE, "wait": 60, **options})


def until_there_are(actors, source, meanwhile):
    """Returns what meanwhile() returned last."""
    deadline = time.monotonic() + 60
    while True:
        result = meanwhile()
        if source.actors == actors:
            return result
        assert time.monotonic() < deadline, f"{source.actors} actors, not {actors}"


def sigmoid(x):
    return 1 / (1 + np.exp(-x))


def forward(source, parameters, batch):
    """Returns the LSTM's outputs h (L, B, cells) and the masked logits (L, B, 3), as policy_service/network/lstm.h."""
    weight, bias, enter, recurrent, gate_bias = (parameters[name] for name in LSTM)
    sensed = source.values["scale"] * (np.stack([batch.position, batch.goal], -1) / source.frames - 0.5)
    embedded = np.maximum(sensed @ weight.T + bias.T, 0)
    previous = np.eye(4)[batch.previous_action][..., :3]
    entering = np.concatenate([embedded, previous, 1 - batch.action_mask], -1) @ enter.T + gate_bias.T
    h, c = np.split(batch.state, 2, axis=1)
    outputs = []
    for step, first in zip(entering, batch.first):
        h, c = (part * (first == 0)[:, None] for part in (h, c))
        gates = np.split(step + h @ recurrent.T, 4, axis=1)
        c = sigmoid(gates[1]) * c + sigmoid(gates[0]) * np.tanh(gates[3])
        h = sigmoid(gates[2]) * np.tanh(c)
        outputs.append(h)
    heads = np.stack(outputs) @ parameters["heads.weight"].T + parameters["heads.bias"].T
    return np.stack(outputs), np.where(batch.action_mask, heads[..., :3], -1e9)


class Slice(unittest.TestCase):
    def test_two_actors_send_what_they_did_with_the_parameters_they_were_sent(self):
        for middleware in ("cyclonedds", "fastdds"):
            where = {"middleware": middleware}
            with self.subTest(middleware=middleware), running(
                    *env_services(**where), actor(1, **where), actor(2, **where)), learner(**where) as source:
                self.check(source)

    def check(self, source):
        self.assertEqual((source.agent, source.frames, source.features, source.state_size), ("baseline", 16, 16, 32))
        batch = until_there_are(2, source, lambda: next(source))
        self.assertEqual(batch.features.shape, (32, 16, 16))
        self.assertEqual(batch.state.shape, (16, 32))
        for name in ("goal", "position", "action", "reward", "ended", "log_probability"):
            self.assertEqual(getattr(batch, name).shape, (32, 16), name)
        self.assertTrue((batch.action_mask.sum(-1) > 0).all())
        parameters = source.parameters
        _, logits = forward(source, parameters, batch)
        logs = logits - np.log(np.exp(logits).sum(-1, keepdims=True))
        taken = np.take_along_axis(logs, batch.action[..., None].astype(int), -1)[..., 0]
        np.testing.assert_allclose(taken, batch.log_probability, atol=1e-4)
        self.assertLess(self.share_that_goes_on(batch), 0.9)
        parameters["heads.bias"][:, 0] = [0, 20, 0, 0]
        deadline = time.monotonic() + 60
        while self.share_that_goes_on(batch) < 0.99:  # once what was under way has come
            self.assertLess(time.monotonic(), deadline)
            source.publish(parameters)
            batch = next(source)

    @staticmethod
    def share_that_goes_on(batch):
        return (batch.action[batch.action_mask[..., 1] == 1] == 1).mean()


class Learning(unittest.TestCase):
    def test_a_learner_in_numpy_trains_two_actors(self):
        """Policy gradient of the heads alone: what the LSTM, as it was drawn, makes of position and goal is enough."""
        with running(*env_services(), actor(1), actor(2)), learner(baseline_cells=64, baseline_hidden=64,
                                                                   baseline_scale=8) as source:
            parameters = source.parameters
            moments, first = [0.0, 0.0], None
            for update, batch in enumerate(source, 1):
                h, logits = forward(source, parameters, batch)
                chances = np.exp(logits - logits.max(-1, keepdims=True))
                chances /= chances.sum(-1, keepdims=True)
                advantage, target = batch.advantages(0.9, 0.9)
                logs = np.log(np.maximum(chances, 1e-30))
                entropy = -(chances * logs).sum(-1, keepdims=True)
                slope = (chances - np.eye(3)[batch.action]) * advantage[..., None] + 0.01 * chances * (logs + entropy)
                slope = np.concatenate([slope, (batch.value - target)[..., None]], -1)
                inputs = np.concatenate([h, np.ones((*h.shape[:2], 1))], -1)
                gradient = np.einsum("lbi,lbj->ij", slope, inputs) / slope[..., 0].size
                for moment, (decay, power) in enumerate([(0.9, 1), (0.999, 2)]):  # Adam's
                    moments[moment] = decay * moments[moment] + (1 - decay) * gradient**power
                change = 0.03 * moments[0] / (1 - 0.9**update) / (np.sqrt(moments[1] / (1 - 0.999**update)) + 1e-8)
                parameters["heads.weight"] -= change[:, :-1]
                parameters["heads.bias"] -= change[:, -1:]
                source.publish(parameters, entropy=entropy.mean())
                progress = source.progress
                first = progress["spl"] if first is None and progress["episodes"] >= 50 else first
                if progress["spl"] >= 0.9 or update == 600:
                    break
            self.assertLess(first, 0.6)
            self.assertGreaterEqual(progress["spl"], 0.9)


class Endings(unittest.TestCase):
    def setUp(self):
        self.output = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")), "run")

    def test_a_checkpoint_is_left_that_others_read_and_actors_are_dismissed(self):
        with running(*env_services(), actor(1), actor(2)) as (_, _, *actors):
            with learner(output=self.output, checkpoint_every=2) as source:
                for update, _ in zip(range(3), source):
                    until_there_are(2, source, lambda: time.sleep(0.01))
                    parameters = source.parameters
                    parameters["heads.bias"][:, 0] = [0, 20, 0, update]
                    source.publish(parameters, entropy=update, learning_rate=0.5)
            for process in actors:
                self.assertEqual(process.wait(timeout=30), 0, "it was dismissed")
            checkpoint = self.output / "checkpoints/checkpoint-3.clk"
            policy = citylearn.load_policy(checkpoint)
            self.assertEqual((policy.name, policy.frames, policy.update), ("baseline", 16, 3))
            data = {name: value for name, value in DRAWN.items() if name != "frames"}
            score = citylearn.evaluate(policy, tasks=200, **data)["baseline", "summer"]
            self.assertAlmostEqual(score.completed, 0.5, delta=0.15, msg="it goes on, and so reaches goals ahead")
            rows = np.genfromtxt(self.output / "metrics.csv", delimiter=",", names=True)
            np.testing.assert_array_equal(rows["update"], [1, 2, 3])
            np.testing.assert_array_equal(rows["entropy"], [0, 1, 2])
            np.testing.assert_array_equal(rows["learning_rate"], [0.5] * 3)
            done = subprocess.run(
                [BUILD / "policy_service/policy_service", "--mode=evaluate", f"--checkpoint={checkpoint}",
                 "--tasks=200", "--wait=60", *as_options(WHERE)],
                capture_output=True, text=True, check=False, timeout=100)
            self.assertIn("baseline  summer", done.stdout, done.stderr)

    def test_after_an_exception_actors_wait_for_a_learner_that_resumes(self):
        with running(*env_services(), actor(1), actor(2)) as (_, _, *actors):
            with self.assertRaisesRegex(RuntimeError, "mine"):
                with learner(output=self.output) as source:
                    for batch in source:
                        parameters = source.parameters
                        parameters["heads.bias"][:] += 1
                        source.publish(parameters)
                        if source.progress["updates"] == 3:
                            raise RuntimeError("mine")
            with learner(output=self.output, resume=True) as source:
                self.assertEqual(source.progress["updates"], 4)
                np.testing.assert_array_equal(source.parameters["heads.bias"], np.full((4, 1), 4, np.float32))
                next(source)
                self.assertEqual([process.poll() for process in actors], [None, None])

    def test_it_ends_by_itself_after_its_steps(self):
        with running(*env_services(1), actor(1)), learner(steps=3 * 512) as source:
            self.assertEqual(sum(1 for _ in source), 3, "batches; none was answered")
            self.assertEqual(source.progress["updates"], 3)
            self.assertRaises(StopIteration, next, source)

    def test_actors_die_and_come_late_also_while_python_computes(self):
        with running(*env_services(), actor(1), actor(2)) as (_, _, first, second), learner() as source:
            until_there_are(2, source, lambda: next(source))
            first.kill()
            until_there_are(1, source, lambda: next(source))
            with running(actor(3)):
                until_there_are(2, source, lambda: next(source))
                next(source)
                second.kill()
                until_there_are(1, source, lambda: time.sleep(0.01))  # and computes all the time
                self.assertGreater(source.progress["updates"], 0)
                for _ in range(3):
                    next(source)


class Errors(ClearErrors):
    def test_options(self):
        self.expect(TypeError, "unexpected keyword argument 'cells' .known: .*baseline_cells.*trainer_agents", learner, cells=3)
        self.expect(ValueError, "unknown agent 'none' .known: baseline", learner, agent="none")
        self.expect(ValueError, "^baseline_cells: Value 0 not in range", learner, baseline_cells=0)
        self.expect(ValueError, "^frames: '5:6' must be two frames or more", learner, frames="5:6")
        self.expect(ValueError, "wait must be more than 0 seconds, is nan", learner, wait=float("nan"))
        self.expect(TypeError, "wait must be a number of seconds, is '1'", learner, wait="1")
        self.expect(ValueError, "^steps: -1 is less than 0", learner, steps=-1)
        self.expect(FileNotFoundError, "nowhere.clk", learner, initial="nowhere.clk", wait=1)

    def test_what_is_missing_is_a_timeout_that_leaves_other_threads_running(self):
        self.expect_timeout_beside_threads(
            r"no env_service on summer within 1 s \(none was found\) \(same session 'nobody'",
            lambda: learner(session="nobody", wait=1))
        with running(*env_services(1)), learner(wait=5) as source:
            self.expect(TimeoutError, r"no actor has come within 5 s \(start policy_service with role actor in "
                        "the same session 'default', domain", next, source)
            with running(actor(1)):
                while True:  # the wait may go on
                    with contextlib.suppress(TimeoutError):
                        next(source)
                        break

    def test_actors_without_env_services_are_a_timeout(self):
        with running(actor(1)), learner_with_an_env_service_that_goes() as source:
            self.expect(TimeoutError, "1 actor has not sent a whole batch within 5 s .are there env_services on '",
                        lambda: [None for _ in source])

    def test_an_interrupt_ends_the_wait(self):
        signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell's background job ignores it
        with running(*env_services(1)), learner() as source:
            threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
            self.assertRaises(KeyboardInterrupt, next, source)

    def test_parameters(self):
        with running(*env_services(1), actor(1)), learner() as source:
            right = source.parameters
            self.expect(RuntimeError, r"publish\(\) answers a batch; take the next one first", source.publish, right)
            batch = next(source)
            self.expect(ValueError, "discount must be 0..1, is nan", batch.advantages, float("nan"), 0.9)
            self.expect(ValueError, "decay must be 0..1, is 2", batch.advantages, 0.9, 2)
            self.expect(TypeError, "discount must be a number, is 'a'", batch.advantages, "a", 0.9)
            bias = right["heads.bias"]
            for kind, pattern, name, values in [
                    (ValueError, r"'heads.bias' has shape \(3, 1\), must have \(4, 1\)", "heads.bias", bias[:3]),
                    (ValueError, r"'lstm.input' has shape \(30, 64\), must have \(64, 30\)", "lstm.input",
                     right["lstm.input"].T),
                    (ValueError, "'heads.bias' has numbers that are not finite", "heads.bias", bias * np.nan),
                    (ValueError, "'heads.bias' has numbers that are not finite", "heads.bias",
                     bias.astype(np.float64) + 1e300),
                    (TypeError, "'heads.bias' is complex64, must be float32", "heads.bias", bias * 1j),
                    (ValueError, "'baseline' has no parameter 'more'; it has sensors.weight", "more", bias)]:
                self.expect(kind, pattern, source.publish, {**right, name: values})
            self.expect(ValueError, "parameter 'lstm.input' of network 'baseline' is missing", source.publish,
                        {name: values for name, values in right.items() if name != "lstm.input"})
            self.expect(TypeError, "parameters must be a dictionary of arrays by name, is list", source.publish, [bias])
            self.expect(TypeError, "figure 'entropy' must be a number, is 'x'", source.publish, right, entropy="x")
            self.expect(TypeError, "unknown figure 'loss' .known: approx_kl", source.publish, right, loss=1)
            source.publish({**right, "heads.bias": [1, 2, 3, 4]})  # a list, and a bias without its second dimension
            self.expect(RuntimeError, "take the next one first", source.publish, right)
            next(source)
            np.testing.assert_array_equal(source.parameters["heads.bias"][:, 0], [1, 2, 3, 4])

    def test_a_forked_process_leaves_the_learner_to_its_parent(self):
        with running(*env_services(1), actor(1)), learner() as source:
            next(source)
            self.in_fork(lambda: self.expect(RuntimeError, "the learner belongs to process", next, source))
            self.in_fork(source.close)
            next(source)

    def test_closed(self):
        with running(*env_services(1)):
            source = learner()
            source.close()
            source.close()
            for call in (lambda: next(source), lambda: source.publish({}), lambda: source.parameters,
                         lambda: source.progress, lambda: source.actors):
                self.expect(RuntimeError, "the learner is closed; make a new one", call)


@contextlib.contextmanager
def learner_with_an_env_service_that_goes():
    """Yields a learner whose only env_service was killed after it had told what it is about."""
    with running(*env_services(1)) as (process,), learner(wait=5) as source:
        process.kill()
        process.wait()
        yield source


if __name__ == "__main__":
    unittest.main()
