# SPDX-License-Identifier: Apache-2.0
"""VectorEnv over DDS: the same numbers as in process, and one clear error for each thing that goes wrong."""

import os
import signal
import threading
import unittest

import actors
from support import DRAWN, ClearErrors, towards_goal, walk
from actors import DOMAIN, put_to_sleep, running

import numpy as np

import citylearn

MIDDLEWARES = ["cyclonedds", "fastdds"]
TASK = {"frames": DRAWN["frames"], "max_steps": 20}


def env_services(middleware, count=1, traversal="summer", data=None):
    """Yields running env_services of four agents."""
    return running(*actors.env_services(count, 4, traversal, data, middleware=middleware), end=signal.SIGTERM)


def connect(middleware, **options):
    return citylearn.VectorEnv(**{"middleware": middleware, "domain": DOMAIN, "interface": "lo", **TASK, **options})


class Equality(unittest.TestCase):
    def test_a_walk_is_the_same_in_process_and_over_each_middleware(self):
        for mode in ("NextStep", "SameStep"):
            here = citylearn.VectorEnv(agents=4, services=2, max_steps=20, autoreset_mode=mode, **DRAWN)
            expected = walk(here, 7, 150)
            for middleware in MIDDLEWARES:
                with self.subTest(mode=mode, middleware=middleware), env_services(middleware, 2):
                    env = connect(middleware, services=2, autoreset_mode=mode)
                    self.assertEqual(env.num_envs, 8)
                    self.assertEqual(walk(env, 7, 150), expected)
                    self.assertEqual(walk(env, 7, 150), expected, "the same again")
                    env.close()

    def test_shuffled_frames_lists_of_seeds_and_masks(self):
        task = {"services": 2, "shuffle": True, "autoreset_mode": "Disabled", "max_steps": 20}
        here = citylearn.VectorEnv(agents=4, **task, **DRAWN)
        with env_services("cyclonedds", 2):
            there = connect("cyclonedds", **task)

            def same(call):
                own, other = call(here), call(there)
                for name in own[0]:
                    np.testing.assert_array_equal(own[0][name], other[0][name], name)
                np.testing.assert_array_equal(own[-1]["position"], other[-1]["position"])
                return own

            observation, infos = same(lambda env: env.reset(seed=[7, 3]))
            position, ends = infos["position"], 0
            for step in range(100):
                actions = towards_goal(observation, position)
                observation, _, terminated, truncated, infos = same(lambda env: env.step(actions))
                position, ended = infos["position"], terminated | truncated
                ends += ended.sum()
                second = np.arange(8) >= 4
                if step == 50:  # the second service begins anew
                    observation, infos = same(lambda env: env.reset(seed=[1, 5], options={"reset_mask": second}))
                    position, ended = np.where(second, infos["position"], position), ended & ~second
                if ended.any():
                    observation, _ = same(lambda env: env.reset(options={"reset_mask": ended.copy()}))
            self.assertGreater(ends, 20)
            there.close()

    def test_pictures_are_seen_as_an_encoder_service_encodes_them(self):
        data = {"synthetic_frames": 40, "synthetic_width": 64, "synthetic_height": 48, "frames": 32}
        task = {"autoreset_mode": "SameStep", "max_steps": 20}
        for traversal in ("summer", "winter"):
            here = citylearn.VectorEnv(agents=4, traversal=traversal, store="none", encoder="patchnorm", **task, **data)
            with env_services("cyclonedds", data=data), env_services("cyclonedds", data=data, traversal="winter"), \
                    running(actors.service("encoder_service", "--encoder=patchnorm", "--store=none"),
                            end=signal.SIGTERM):
                env = connect("cyclonedds", traversal=traversal, **task)
                self.assertEqual(walk(env, 7, 60), walk(here, 7, 60), traversal)
                env.close()

    def test_a_closed_environment_frees_its_services(self):
        with env_services("cyclonedds"):
            for seed in range(2):
                env = connect("cyclonedds", wait=10)
                env.reset(seed=seed)
                env.close()


class Errors(ClearErrors):
    def test_a_missing_service_is_a_timeout_that_leaves_other_threads_running(self):
        self.expect_timeout_beside_threads(
            r"0 of 1 env_services on 'summer' within 1 s \(none was found\) \(same session 'nobody'",
            lambda: connect("cyclonedds", session="nobody", wait=1))

    def test_a_silent_service_is_a_timeout_and_reset_goes_on_after_it(self):
        with env_services("cyclonedds") as (service,):
            env = connect("cyclonedds", wait=2)
            env.reset(seed=1)
            put_to_sleep(service)
            with self.assertRaisesRegex(TimeoutError, "env_service 'env-summer-0': has .* for 2 s"):
                env.step(np.zeros(4, int))
            with self.assertRaisesRegex(RuntimeError, r"call reset\(\) first"):
                env.step(np.zeros(4, int))
            service.send_signal(signal.SIGCONT)
            first = env.reset(seed=1)[0]["goal"]
            np.testing.assert_array_equal(first, env.reset(seed=1)[0]["goal"])
            env.close()

    def test_an_interrupt_ends_the_wait(self):
        with env_services("cyclonedds") as (service,):
            env = connect("cyclonedds")
            env.reset(seed=1)
            put_to_sleep(service)
            threading.Timer(0.5, os.kill, (os.getpid(), signal.SIGINT)).start()
            with self.assertRaises(KeyboardInterrupt):
                env.step(np.zeros(4, int))
            service.send_signal(signal.SIGCONT)
            env.close()

    def test_a_restarted_service_is_a_connection_error(self):
        with env_services("cyclonedds") as (first,):
            env = connect("cyclonedds", wait=20)
            env.reset(seed=1)
            first.kill()
            first.wait()
            with env_services("cyclonedds"), self.assertRaisesRegex(ConnectionError, r"was restarted \(call reset"):
                while True:
                    env.step(np.zeros(4, int))

    def test_a_forked_process_leaves_the_environment_to_its_parent(self):
        for middleware in MIDDLEWARES:
            with self.subTest(middleware=middleware), env_services(middleware):
                env = connect(middleware, wait=20)
                env.reset(seed=1)
                self.in_fork(lambda: self.assertRaisesRegex(RuntimeError, "belongs to process .* make a new one here",
                                                            env.step, np.zeros(4, int)))
                self.in_fork(lambda: self.assertRaisesRegex(RuntimeError, "belongs to process", env.reset))
                self.in_fork(env.close)
                self.in_fork(lambda: None)
                for _ in range(20):
                    env.step(np.zeros(4, int))
                env.close()

    def test_options(self):
        with self.assertRaisesRegex(TypeError, "unexpected keyword argument 'slip' .known: .*middleware"):
            connect("cyclonedds", slip=0.1)
        with self.assertRaisesRegex(ValueError, "unknown middleware 'none'"):
            connect("none")
        with env_services("cyclonedds"):
            with self.assertRaisesRegex(ValueError, "frames: 0:64 must be two frames or more of the 40"):
                connect("cyclonedds", frames=64)


if __name__ == "__main__":
    unittest.main()
