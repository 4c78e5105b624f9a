# SPDX-License-Identifier: Apache-2.0
"""The example that trains with Stable-Baselines3 runs as it is."""

import os
import subprocess
import sys
import unittest

from support import SOURCE, need_modules, need_peers

need_modules("torch", "pandas", "matplotlib", "cloudpickle", "typing_extensions")
need_peers("gymnasium", "farama-notifications", "stable-baselines3", "sb3-contrib")


class Example(unittest.TestCase):
    def test_it_trains_and_evaluates(self):
        program = SOURCE / "python/examples/sb3.py"
        self.assertLessEqual(len(program.read_text().splitlines()), 20)
        done = subprocess.run([sys.executable, program, "512"], capture_output=True, text=True, check=False,
                              env={**os.environ, "PYTHONPATH": ":".join(sys.path)})
        self.assertEqual(done.returncode, 0, done.stderr)
        for row in ("RecurrentPPO  summer", "RecurrentPPO  winter", "blind         winter"):
            self.assertIn(row, done.stdout)


if __name__ == "__main__":
    unittest.main()
