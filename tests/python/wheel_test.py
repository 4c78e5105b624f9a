# SPDX-License-Identifier: Apache-2.0
"""pip makes and installs the package without a network."""

import os
import subprocess
import sys
import tempfile
import unittest

from support import BUILD, SOURCE, need_modules

need_modules("pip")


class Wheel(unittest.TestCase):
    def test_pip_installs_a_package_that_works(self):
        with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
            environment = {**os.environ, "CITYLEARN_BUILD": str(BUILD), "PIP_NO_INDEX": "1"}
            command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target", folder,
                       str(SOURCE / "python")]
            done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stderr)
            program = ("import citylearn\n"
                       "env = citylearn.VectorEnv(synthetic_images=0, synthetic_frames=40, agents=2)\n"
                       "print(citylearn.__file__, env.reset(seed=1)[0]['features'].shape)")
            done = subprocess.run([sys.executable, "-c", program], env={**environment, "PYTHONPATH": folder},
                                  cwd=folder, capture_output=True, text=True, check=False)
            self.assertEqual(done.stdout, f"{folder}/citylearn/__init__.py (2, 64)\n", done.stderr)


if __name__ == "__main__":
    unittest.main()
