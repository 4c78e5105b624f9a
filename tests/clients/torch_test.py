# SPDX-License-Identifier: Apache-2.0
"""The example that learns with PyTorch."""

import os
import re
import subprocess
import sys
import unittest

from support import SOURCE

EXAMPLES = SOURCE / "python/examples"


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


if __name__ == "__main__":
    unittest.main()
