# SPDX-License-Identifier: Apache-2.0
"""Exported agents in ONNX Runtime do what the services' agents do with the same pictures, step by step (onnx_sample.cc)."""

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

    def check(self, encoder):
        folder = self.folder / encoder
        onnx.checker.check_model(folder / "agent.onnx", full_check=True)
        agent = onnxruntime.InferenceSession(folder / "agent.onnx")
        shapes = {each.name: each.shape for each in agent.get_inputs()}
        names = [each.name for each in agent.get_outputs()]
        episodes = json.loads((folder / "episodes.json").read_text())
        pictures = np.fromfile(folder / "pictures.bin", np.uint8).reshape(episodes["frames"], *shapes["picture"])
        kept = {name: np.zeros(shapes[name], np.float32) for name in ("state", "condition")}

        def run(step, seen):
            actions = np.arange(3)
            return dict(zip(names, agent.run(None, {**kept, "seen": seen, **{name: np.float32([values]) for name, values in (
                ("picture", pictures[step["frame"]][0]), ("goal", [step["goal"]]), ("first", [step["first"]]),
                ("previous_action", actions == step["previous"]), ("allowed", step["allowed"] >> actions & 1))}})))

        # The encoder_service takes the frames in their order, whatever the agent does.
        seen = [np.zeros(shapes["seen"], np.float32)]
        for frame in range(episodes["frames"]):
            seen.append(run({"frame": frame, "goal": 0, "previous": -1, "allowed": 7, "first": True}, seen[frame])["next_seen"])
        longest = length = 0
        for number, step in enumerate(episodes["steps"]):
            found = run(step, seen[step["frame"]])
            logits = found["logits"][0]
            self.assertEqual(drawn(logits, step["random"]), step["action"], f"step {number}")
            self.assertEqual(found["action"].item(), logits.argmax(), f"step {number}")
            kept = {"state": found["next_state"], "condition": found["next_condition"]}
            length = 1 if step["first"] else length + 1
            longest = max(longest, length)
        self.assertGreaterEqual(longest, 30)

    def test_by_patchnorm(self):
        self.check("patchnorm")

    def test_by_a_network(self):
        self.check("onnx")


if __name__ == "__main__":
    unittest.main()
