# SPDX-License-Identifier: Apache-2.0
"""The tests of the package under NumPy 2, and what it says of arrays that are wrong."""

import os
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

from support import BUILD, SOURCE, need_modules, skip_if

import numpy as np

NUMPY = "2.4.6"
TESTS = ["vector_env", "gymnasium", "evaluation", "trajectories"]
SKIPPED = 77

skip_if(f"NumPy {np.__version__} is 2 already" if np.__version__ >= "2" else None)
need_modules("pip", "ensurepip")


def run(*command, **options):
    return subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False, **options)


def python_with_numpy_2():
    """Returns the Python of a virtual environment in the build folder; skips where PyPI is out of reach."""
    folder = BUILD / "tests/python" / f"numpy-{NUMPY}"
    python = folder / "bin/python"
    if not python.exists() or run(python, "-c", f"import numpy; assert numpy.__version__ == '{NUMPY}'").returncode:
        shutil.rmtree(folder, ignore_errors=True)
        made = run(sys.executable, "-m", "venv", "--system-site-packages", folder)
        if made.returncode == 0:
            made = run(python, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", "--retries=1",
                       "--only-binary=:all:", f"numpy=={NUMPY}", timeout=200)
        if made.returncode:
            shutil.rmtree(folder, ignore_errors=True)
            skip_if(f"NumPy {NUMPY} cannot be installed: {made.stdout.strip().splitlines()[-1]}")
    return python


class NumPy2(unittest.TestCase):
    def test_all_tests_pass(self):
        python = python_with_numpy_2()
        for test in TESTS:
            with self.subTest(test):
                done = run(python, "-B", SOURCE / f"tests/python/{test}_test.py", SOURCE, BUILD)
                self.assertIn(done.returncode, (0, SKIPPED), done.stdout)
                print(f"{test}: {done.stdout.strip().splitlines()[-1]}")


class Import(unittest.TestCase):
    """A copy of the package whose module in C++ is replaced."""

    def told(self, module):
        """Returns the last line of what importing the package says."""
        with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
            shutil.copytree(BUILD / "python/citylearn", f"{folder}/citylearn",
                            ignore=shutil.ignore_patterns("_native*"))
            for name, text in module.items():
                Path(folder, "citylearn", name).write_text(text)
            done = run(sys.executable, "-B", "-c", "from citylearn import VectorEnv",
                       env={**os.environ, "PYTHONPATH": folder})
            self.assertEqual(done.returncode, 1)
            return done.stdout.strip().splitlines()[-1]

    def test_arrays_with_wrong_strides_are_refused(self):
        told = self.told({"_native.py": "import numpy\n"
                          "def sample_arrays(): return [numpy.zeros(3), numpy.broadcast_to(numpy.zeros(()), 3)]\n"})
        self.assertIn(f"ImportError: citylearn's arrays have wrong strides under NumPy {np.__version__}; install", told)

    def test_a_module_of_another_python_is_named(self):
        told = self.told({"_native.cpython-39-x86_64-linux-gnu.so": ""})
        self.assertIn(f"ImportError: citylearn's module does not load in {sys.implementation.cache_tag} "
                      f"({sys.executable}); there is _native.cpython-39-x86_64-linux-gnu.so; build it", told)
        self.assertIn("there is none; build it", self.told({}))


if __name__ == "__main__":
    unittest.main()
