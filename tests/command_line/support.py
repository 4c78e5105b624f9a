# SPDX-License-Identifier: Apache-2.0
"""What the tests of the command line share. Each is called with the folders of the sources, the build and the installation."""

import os
import random
import re
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

SOURCE, BUILD, PREFIX = (Path(sys.argv.pop(1)).resolve() for _ in range(3))
sys.path.append(str(SOURCE / "tests/support"))
from domain import own_domain
from pages import commands as commands

PATIENCE = 200  # seconds


class CommandLine(unittest.TestCase):
    """A test in an empty folder of its own, with a DDS domain of its own and the installed programs on the PATH."""

    domain = None

    @classmethod
    def setUpClass(cls):
        cls.domain = own_domain()

    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        ours = {"PATH": f"{PREFIX}/bin:{os.environ['PATH']}", "CITYLEARN_DOMAIN": str(self.domain), "HOME": str(self.folder)}
        self.environment = {name: value for name, value in os.environ.items() if not name.startswith("CITYLEARN_")} | ours

    def run_command(self, *words, status=0):
        """Runs a command to its end and returns its outputs as one text. Its status must be `status`."""
        log = self.folder.parent / (self.folder.name + ".log")  # not a pipe, which a service that is left over would hold open
        self.addCleanup(log.unlink, missing_ok=True)
        with open(log, "wb") as output, subprocess.Popen([str(word) for word in words], cwd=self.folder, env=self.environment,
                                                         stdin=subprocess.DEVNULL, stdout=output, stderr=output,
                                                         start_new_session=True) as process:
            ended = None
            try:
                ended = process.wait(PATIENCE)
            except subprocess.TimeoutExpired:
                pass
            finally:
                left = self.kill_session(process.pid, None if ended is None else time.monotonic() + 5)
        said = f"{' '.join(map(str, words))}\n{log.read_text()}"
        self.assertEqual(ended, status, said)
        self.assertFalse(left, f"left {left} behind: {said}")
        return log.read_text()

    def words(self, command, names=None):
        """Returns the words of a command of the page, with other names for some."""
        names = {"./run": "citylearn"} | (names or {})
        return [str(names.get(word, word)) for word in command if word != "&"]

    def start(self, *words, environment=None):
        """Starts a command that goes on. Returns its process and the file of what it says."""
        log = self.folder / f"{len(list(self.folder.iterdir()))}.log"
        with open(log, "wb") as output:
            process = subprocess.Popen(words, cwd=self.folder, env=environment or self.environment,
                                       stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True)
        self.addCleanup(self.end, process)
        return process, log

    def end(self, process):
        """Ends a command. Returns its status."""
        if process.poll() is None:
            process.send_signal(signal.SIGINT)
        try:
            return process.wait(30)
        finally:
            self.kill_session(process.pid, time.monotonic() + 5)

    def wait_for(self, text, log):
        deadline = time.monotonic() + PATIENCE
        while not re.search(text, log.read_text()):
            self.assertLess(time.monotonic(), deadline, log.read_text())
            time.sleep(0.05)

    @staticmethod
    def kill_session(session, deadline):
        """Kills the processes of a session that have not ended by then, at once without a deadline. Returns their names."""
        while left := living(session):
            if deadline is None or time.monotonic() > deadline:
                os.killpg(session, signal.SIGKILL)
                return left
            time.sleep(0.02)
        return []


class Scenery:
    """A street that is seen from a train: rows of pixels, of which each frame shows the next part."""

    WIDTH, HEIGHT, STEP = 64, 48, 12

    def __init__(self, frames):
        drawn = random.Random(1)
        length = self.STEP * frames + self.WIDTH
        heights = [drawn.choices(range(256), k=length // 6 + 1) for _ in range(self.HEIGHT // 6)]
        self.rows = [bytes(heights[y // 6][x // 6] for x in range(length)) for y in range(self.HEIGHT)]
        self.frames = frames

    def grey(self, frame, light):
        """Returns the pixels of a frame, row by row, each times `light`."""
        begin = self.STEP * frame
        table = bytes(min(255, int(light * value)) for value in range(256))
        return [row[begin:begin + self.WIDTH].translate(table) for row in self.rows]

    def write_pictures(self, folder, light):
        folder.mkdir(parents=True)
        for frame in range(self.frames):
            pixels = b"".join(bytes((value, value, value)) for row in self.grey(frame, light) for value in row)
            (folder / f"{frame:04}.ppm").write_bytes(b"P6 %d %d 255\n" % (self.WIDTH, self.HEIGHT) + pixels)

    def write_video(self, file):
        """Writes it as YUV4MPEG2, which readers of videos recognise by its first bytes."""
        neutral = bytes([128]) * (self.WIDTH * self.HEIGHT // 2)
        with open(file, "wb") as out:
            out.write(b"YUV4MPEG2 W%d H%d F25:1 Ip A1:1 C420jpeg\n" % (self.WIDTH, self.HEIGHT))
            for frame in range(self.frames):
                out.write(b"FRAME\n" + b"".join(self.grey(frame, 1)) + neutral)


def free_ports(count):
    sockets = [socket.create_server(("127.0.0.1", 0)) for _ in range(count)]
    ports = [each.getsockname()[1] for each in sockets]
    for each in sockets:
        each.close()
    return ports


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
