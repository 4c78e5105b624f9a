# SPDX-License-Identifier: Apache-2.0
"""What the tests of the command line share. Each is called with the folders of the sources, the build and the installation."""

import os
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

SOURCE, BUILD, PREFIX = (Path(sys.argv.pop(1)).resolve() for _ in range(3))
sys.path.append(str(SOURCE / "tests/support"))
from domain import own_domain


class CommandLine(unittest.TestCase):
    """A test in an empty folder of its own, with a DDS domain of its own and the installed programs on the PATH."""

    domain = None

    @classmethod
    def setUpClass(cls):
        cls.domain = own_domain()

    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="citylearn-")
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        ours = {"PATH": f"{PREFIX}/bin:{os.environ['PATH']}", "CITYLEARN_DOMAIN": str(self.domain), "HOME": temporary.name}
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("CITYLEARN_")} | ours

    def run_command(self, *words, status=0, seconds=100):
        """Runs a command to its end and returns its outputs as one text. Its status must be `status`."""
        log = self.folder.parent / (self.folder.name + ".log")  # not a pipe, which a service that is left over would hold open
        self.addCleanup(log.unlink, missing_ok=True)
        with open(log, "wb") as output, subprocess.Popen([str(word) for word in words], cwd=self.folder, env=self.environment,
                                                         stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                                                         start_new_session=True) as process:
            ended = None
            try:
                ended = process.wait(seconds)
            except subprocess.TimeoutExpired:
                pass
            finally:
                left = self.kill_session(process.pid, None if ended is None else time.monotonic() + 5)
        said = f"{' '.join(map(str, words))}\n{log.read_text()}"
        self.assertEqual(ended, status, said)
        self.assertFalse(left, f"left {left} behind: {said}")
        return log.read_text()

    @staticmethod
    def kill_session(session, deadline):
        """Kills the processes of a session that have not ended by then, at once without a deadline. Returns their names."""
        while left := living(session):
            if deadline is None or time.monotonic() > deadline:
                os.killpg(session, signal.SIGKILL)
                return left
            time.sleep(0.02)
        return []


def living(session):
    """Returns the names of the processes of a session, without those that have ended and that nobody has waited for."""
    found = []
    for file in Path("/proc").glob("[0-9]*/stat"):
        try:
            name, rest = file.read_text().split("(", 1)[1].rsplit(")", 1)
        except OSError:
            continue  # it has just ended
        state, _, _, of_session = rest.split()[:4]
        if int(of_session) == session and state != "Z":
            found.append(name)
    return found
