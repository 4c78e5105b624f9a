# SPDX-License-Identifier: Apache-2.0
"""The examples that learn with PyTorch: in process, and from actors in C++."""

import os
import re
import subprocess
import sys
import unittest

from support import DRAWN, SOURCE

from actors import WHERE, actor, env_services, running

import numpy as np
import torch

import citylearn

EXAMPLES = SOURCE / "python/examples"
sys.path.append(str(EXAMPLES))
import torch_actors


def run(program, *arguments):
    """Returns what an example prints."""
    done = subprocess.run([sys.executable, "-B", EXAMPLES / program, *arguments], capture_output=True, text=True,
                          check=False, timeout=250, env={**os.environ, "PYTHONPATH": ":".join(sys.path)})
    assert done.returncode == 0, done.stderr
    return done.stdout


class InProcess(unittest.TestCase):
    def test_ppo_learns_a_short_route(self):
        self.assertLessEqual(len((EXAMPLES / "torch_ppo.py").read_text().splitlines()), 250)
        printed = run("torch_ppo.py", "--frames=16", "--steps=60000", "--tasks=300", "--evaluate=summer")
        spl = {name: float(value) for name, value in re.findall(r"(\S+) +summer +\S+ % +(\S+)", printed)}
        self.assertGreaterEqual(spl["torch_ppo"], 0.95, printed)
        self.assertGreater(spl["torch_ppo"], spl["blind"])


class WithActors(unittest.TestCase):
    def test_the_networks_are_those_of_the_actors(self):
        for agent in ("baseline", "features"):
            with self.subTest(agent=agent), running(*env_services(), actor(1), actor(2)), citylearn.Trajectories(
                    agent=agent, frames=DRAWN["frames"], wait=60, **WHERE) as source:
                batch = next(source)
                parameters = {name: torch.from_numpy(values) for name, values in source.parameters.items()}
                arrays = {name: value for name, value in vars(batch).items() if isinstance(value, np.ndarray)}
                logits, values, _ = torch_actors.forward(
                    source, parameters, {name: torch.from_numpy(array) for name, array in arrays.items()})
                chosen = torch.distributions.Categorical(logits=logits).log_prob(torch.from_numpy(batch.action).long())
                np.testing.assert_allclose(chosen, batch.log_probability, atol=1e-4)
                np.testing.assert_allclose(values, batch.value, atol=1e-4)

    def test_ppo_trains_two_actors(self):
        with running(*env_services(), actor(1), actor(2)):
            printed = run("torch_actors.py", "agent=baseline", "baseline_hidden=64", "baseline_cells=32", "frames=16",
                          "steps=120000", "stop_when=0.95", "wait=60",
                          *(f"{name}={value}" for name, value in WHERE.items()))
            spl = [float(value) for value in re.findall(r"SPL (\S+)  2 actors", printed)]
            self.assertLess(spl[1], 0.7, printed)  # the first is that of no episode
            self.assertGreaterEqual(spl[-1], 0.95, printed)


if __name__ == "__main__":
    unittest.main()
