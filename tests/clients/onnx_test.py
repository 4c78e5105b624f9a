# SPDX-License-Identifier: Apache-2.0
"""Exported agents in ONNX Runtime do what the services' agents do with the same features, step by step (onnx_sample.cc)."""

import json
import subprocess
import tempfile
import unittest
from pathlib import Path

from support import BUILD

import numpy as np
import onnx
import onnxruntime


def drawn(logits, random):
    """Draws from softmax(logits) by a number 0 .. 1."""
    weights = np.exp(logits - logits.max())
    sums = np.cumsum(weights)
    return int(np.flatnonzero((weights > 0) & (random * sums[-1] < sums))[0])


class Exports(unittest.TestCase):
    @classmethod
    def setUpClass(cls):
        cls.folder = Path(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        subprocess.run([BUILD / "tests/clients/onnx_sample", cls.folder], check=True)

    def check(self, network):
        folder = self.folder / network
        onnx.checker.check_model(folder / "agent.onnx", full_check=True)
        agent = onnxruntime.InferenceSession(folder / "agent.onnx")
        widths = {each.name: each.shape[1] for each in agent.get_inputs()}
        names = [each.name for each in agent.get_outputs()]
        episodes = json.loads((folder / "episodes.json").read_text())
        features = np.fromfile(folder / "features.bin", np.float32).reshape(episodes["frames"], widths["features"])
        state, condition = np.zeros((1, widths["state"])), np.zeros(widths["features"] + 1)
        actions = np.arange(3)
        longest = length = 0
        for number, step in enumerate(episodes["steps"]):
            condition += [*features[step["frame"]], 1]
            seen = {"features": features[step["frame"]], "condition": condition, "goal": [step["goal"]], "first": [step["first"]],
                    "previous_action": actions == step["previous"], "allowed": step["allowed"] >> actions & 1, "state": state[0]}
            found = dict(zip(names, agent.run(None, {name: np.float32([seen[name]]) for name in widths})))
            self.assertEqual(drawn(found["logits"][0], step["random"]), step["action"], f"step {number}")
            state = found["next_state"]
            length = 1 if step["first"] else length + 1
            longest = max(longest, length)
        self.assertGreaterEqual(longest, 30)

    def test_a_filter(self):
        self.check("place_filter")

    def test_a_recurrent_network(self):
        self.check("features")


if __name__ == "__main__":
    unittest.main()
