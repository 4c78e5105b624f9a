#!python
# SPDX-License-Identifier: Apache-2.0
"""The command citylearn of a wheel: starts its programs, once the Debian packages are there that they need."""

import importlib.metadata
import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path


def missing(packages):
    """Returns those of the Debian packages that are not installed; none where no dpkg says."""
    if not packages or not shutil.which("dpkg-query"):
        return []
    done = subprocess.run(["dpkg-query", "--show", "--showformat", "${Package} ${db:Status-Status}\\n", *packages],
                          capture_output=True, text=True, check=False)
    there = {line.split()[0] for line in done.stdout.splitlines() if line.endswith(" installed")}
    return [package for package in packages if package not in there]


# The package itself is not imported: its module needs the same libraries.
programs = Path(importlib.util.find_spec("citylearn").origin).parent / "installed/bin"
packages = missing(importlib.metadata.metadata("citylearn-dds").get_all("Requires-External"))
# Another package may have the same library, as those of BLAS do.
binaries = [*programs.iterdir(), *programs.parents[1].glob("_native.*")]
if packages and "not found" in subprocess.run(["ldd", *binaries], capture_output=True, text=True, check=False).stdout:
    sys.exit("citylearn: its programs need packages of the system: "
             f"apt-get install --no-install-recommends {' '.join(packages)}")
os.execv(programs / "citylearn", ["citylearn", *sys.argv[1:]])
