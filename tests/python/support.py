# SPDX-License-Identifier: Apache-2.0
"""What the tests of the package share. Each is called with the folders of the sources and the build."""

import ctypes
import hashlib
import json
import os
import signal
import struct
import sys
import threading
import unittest
from pathlib import Path

import numpy as np

SOURCE, BUILD = (Path(sys.argv.pop(1)).resolve() for _ in range(2))
sys.path[:0] = [str(BUILD / "python"), str(SOURCE / "tests/support")]

# A route with features that is made at once.
DRAWN = {"synthetic_images": 0, "synthetic_frames": 40, "synthetic_dimension": 16, "frames": 32}


class ClearErrors(unittest.TestCase):
    """A test of what the package says of wrong use."""

    def expect(self, kind, pattern, call, *arguments, **options):
        """The call must raise this kind of exception, with one line that has the pattern."""
        with self.assertRaisesRegex(kind, pattern) as caught:
            call(*arguments, **options)
        self.assertNotIn("\n", str(caught.exception))

    def in_fork(self, call):
        """Calls it in a forked process, which must end well and soon."""
        child = os.fork()
        if child == 0:
            signal.alarm(30)
            try:
                call()
                ctypes.CDLL(None).exit(0)  # with what libraries do then
            finally:
                os._exit(1)
        self.assertEqual(os.waitpid(child, 0)[1], 0)

    def expect_timeout_beside_threads(self, pattern, call):
        """The call must raise TimeoutError with this pattern, and other threads must run meanwhile."""
        caught, turns = [], 0

        def run():
            try:
                call()
            except TimeoutError as error:
                caught.append(str(error))

        thread = threading.Thread(target=run)
        thread.start()
        while thread.is_alive():
            thread.join(0.01)
            turns += 1
        self.assertRegex(caught[0], pattern)
        self.assertGreater(turns, 20)


def with_header(checkpoint, change, name):
    """Writes a checkpoint beside another one, with the header changed. Returns its path."""
    file = checkpoint.read_bytes()
    length, = struct.unpack("<Q", file[12:20])
    header = json.loads(file[20:20 + length])
    change(header)
    text = json.dumps(header).encode()
    body = file[:12] + struct.pack("<Q", len(text)) + text + file[20 + length:-32]
    path = checkpoint.with_name(name)
    path.write_bytes(body + hashlib.sha256(body).digest())
    return path


def towards_goal(observation, position):
    """Returns actions that lead to the goal, but at some places and goals stay, so that some episodes are truncated."""
    goal = observation["goal"]
    lazy = (position * 5 + goal * 3) % 11 == 0
    return np.where(lazy, 0, np.where(goal > position, 1, 2))


def walk(env, seed, steps):
    """Returns all that an environment gives in a walk, as bytes."""
    observation, infos = env.reset(seed=seed)
    seen = [observation[name].tobytes() for name in sorted(observation)] + [infos["position"].tobytes()]
    for _ in range(steps):
        observation, rewards, terminated, truncated, infos = env.step(towards_goal(observation, infos["position"]))
        seen += [observation[name].tobytes() for name in sorted(observation)]
        seen += [infos["position"].tobytes(), rewards.tobytes(), terminated.tobytes(), truncated.tobytes()]
    return b"".join(seen)
