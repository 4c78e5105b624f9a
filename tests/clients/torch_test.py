# SPDX-License-Identifier: Apache-2.0
"""The example that learns with PyTorch."""

import os
import re
import subprocess
import sys
import unittest

from support import SOURCE

EXAMPLE = SOURCE / "python/examples/torch_ppo.py"


class InProcess(unittest.TestCase):
    def test_ppo_learns_a_short_route(self):
        self.assertLessEqual(len(EXAMPLE.read_text().splitlines()), 250)
        done = subprocess.run([sys.executable, "-B", EXAMPLE, "--frames=16", "--steps=60000", "--tasks=300",
                               "--evaluate=summer"], capture_output=True, text=True, check=False, timeout=250,
                              env={**os.environ, "PYTHONPATH": ":".join(sys.path)})
        self.assertEqual(done.returncode, 0, done.stderr)
        spl = {name: float(value) for name, value in re.findall(r"(\S+) +summer +\S+ % +(\S+)", done.stdout)}
        self.assertGreaterEqual(spl["torch_ppo"], 0.95, done.stdout)
        self.assertGreater(spl["torch_ppo"], spl["blind"])


if __name__ == "__main__":
    unittest.main()
