# SPDX-License-Identifier: Apache-2.0
"""What the tests of the command line share. Each is called with the folders of the sources, the build and the installation."""

import fcntl
import os
import signal
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SOURCE, BUILD, PREFIX = (Path(sys.argv.pop(1)).resolve() for _ in range(3))
DOMAINS = range(110, 200)  # as tests/support/processes/domain.h


def own_domain():
    """Returns a DDS domain that no other test on this machine has, until this process and its children have ended."""
    for tried in range(len(DOMAINS)):
        domain = DOMAINS[(os.getpid() + tried) % len(DOMAINS)]
        file = os.open(f"/tmp/citylearn-test-domain-{domain}", os.O_RDWR | os.O_CREAT, 0o666)
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(file)
            continue
        os.set_inheritable(file, True)
        return domain
    raise AssertionError("no DDS domain is free for a test")


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
            try:
                ended = process.wait(seconds)
            except subprocess.TimeoutExpired:
                ended = None
            finally:
                left = self.kill_group(process.pid)
        said = f"{' '.join(map(str, words))}\n{log.read_text()}"
        self.assertEqual(ended, status, said)
        self.assertFalse(left, f"left processes behind: {said}")
        return log.read_text()

    @staticmethod
    def kill_group(group):
        """Kills the processes of a session. Returns whether there were any."""
        try:
            os.killpg(group, signal.SIGKILL)
        except ProcessLookupError:
            return False
        return True
