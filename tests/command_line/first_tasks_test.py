# SPDX-License-Identifier: Apache-2.0
"""The ten first tasks of docs/tutorials/README.md, with the commands that the page has. What differs: `./run` is the installed
`citylearn`, whose code is the same; names of hosts and folders are those of this test. Tasks 6 and 7 point to pages with tests of
their own: tests/tutorial, and tests/system/network/security_test.cc."""

import json
import random
import re
import signal
import subprocess
import sys
import time
import unittest

from support import SOURCE, CommandLine

sys.path.append(str(SOURCE / "tests/support"))
from pages import commands

PATIENCE = 200  # seconds


def tasks():
    """Returns the commands of each task by its number, each as its words."""
    page = SOURCE / "docs/tutorials/README.md"
    titles = {line: int(title[1]) for line, text in enumerate(page.read_text().splitlines(), 1)
              if (title := re.match(r"## (\d+)\.", text))}
    found = {number: [] for number in titles.values()}
    for line, words in commands(page):
        found[titles[max(title for title in titles if title < line)]].append(words)
    return found


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


class FirstTasks(CommandLine):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.tasks = tasks()

    def words(self, command, names=None):
        """Returns the words of a command of the page, with other names for some."""
        names = {"./run": "citylearn"} | (names or {})
        return [str(names.get(word, word)) for word in command if word != "&"]

    def run_task(self, number, names=None):
        """Runs the commands of a task, one after the other. Returns what they say."""
        return [self.run_command(*self.words(command, names), seconds=PATIENCE) for command in self.tasks[number]]

    def start(self, *words, environment=None):
        """Starts a command that goes on. Returns its process and the file of what it says."""
        log = self.folder / f"{len(list(self.folder.iterdir()))}.log"
        with open(log, "wb") as output:
            process = subprocess.Popen(words, cwd=self.folder, env=environment or self.environment,
                                       stdin=subprocess.DEVNULL, stdout=output, stderr=output, start_new_session=True)
        self.addCleanup(self.end, process)
        return process, log

    def end(self, process, sent=signal.SIGINT):
        """Ends a command. Returns its status."""
        if process.poll() is None:
            process.send_signal(sent)
        try:
            return process.wait(30)
        finally:
            self.kill_session(process.pid, time.monotonic() + 5)

    def wait_for(self, text, log):
        deadline = time.monotonic() + PATIENCE
        while not re.search(text, log.read_text()):
            self.assertLess(time.monotonic(), deadline, log.read_text())
            time.sleep(0.05)

    def spl(self, output, traversal):
        return json.loads((output / "summary.json").read_text())["evaluate"][traversal]["spl"]

    def newest_run(self):
        return max((self.folder / "runs").glob("*/summary.json"), key=lambda file: file.stat().st_mtime).parent

    def test_the_page_has_ten_tasks_of_at_most_three_commands(self):
        self.assertEqual(sorted(self.tasks), list(range(1, 11)))
        for number, commands in self.tasks.items():
            self.assertLessEqual(len(commands), 3, number)
            self.assertEqual(not commands, number in (6, 7), number)

    def test_pictures_a_video_and_why_an_agent_fails(self):
        data, scenery = self.folder / "DATA", Scenery(140)
        scenery.write_pictures(data / "summer", 1)
        scenery.write_pictures(data / "winter", 0.6)
        check, demo = self.run_task(2, {"DIR": data})
        self.assertIn("280 frames, 0 bad", check)
        self.assertIn("place_filter finds its way in summer, winter", demo)
        self.assertGreater(self.spl(self.newest_run(), "winter"), 0.9)
        why, places, config = self.run_task(10, {"DIR": data})
        self.assertIn("place_filter finds its way in winter", why)
        self.assertRegex(places, r"hog_vlad.*winter|winter.*hog_vlad")
        self.assertRegex(config, r"learning-rate\b.*place_filter")
        videos = self.folder / "VIDEOS"
        videos.mkdir()
        Scenery(210).write_video(self.folder / "drive.mp4")
        self.run_task(3, {"DIR": videos, "DIR/summer.mp4": videos / "summer.mp4"})
        self.assertGreater(self.spl(self.newest_run(), "summer"), 0.9)

    def test_a_demo_another_learner_and_export(self):
        self.assertIn("place_filter finds its way in", self.run_task(1)[0])
        first = self.newest_run()
        listed, demo = (self.run_command(*self.words(command), seconds=PATIENCE) for command in self.tasks[5][:2])
        self.assertRegex(listed, r"vtrace")
        self.assertIn("place_filter", demo)
        second = self.newest_run()
        self.assertNotEqual(first, second)
        names = {"runs/FIRST": first, "runs/SECOND": second}
        table = self.run_command(*self.words(self.tasks[5][2], names))
        self.assertIn("vtrace", table)
        names = {"runs/TIME/checkpoints/best.clk": first / "checkpoints/best.clk"}
        self.assertIn("agent.onnx", self.run_command(*self.words(self.tasks[9][0], names)))
        self.assertGreater((self.folder / "agent.onnx").stat().st_size, 1000)

    def test_two_hosts(self):
        names = {"eth0": "lo", "hostA": "127.0.0.1", "hostB": "127.0.0.1"}
        env, encoder, policy = (self.words(command, names) for command in self.tasks[4])
        self.start(*env)
        self.start(*encoder)
        self.run_command(*policy, seconds=PATIENCE)
        self.assertGreater(self.spl(self.folder / "out", "summer"), 0.9)

    def test_a_run_is_recorded_and_replayed(self):
        demo, record, replay = (self.words(command) for command in self.tasks[8])
        running, said = self.start(*demo)
        self.wait_for("domain", said)
        # Told a domain, it would not look for the demo.
        elsewhere = {name: value for name, value in self.environment.items() if name != "CITYLEARN_DOMAIN"}
        recording, recorded = self.start(*record, environment=elsewhere)
        self.assertEqual(running.wait(PATIENCE), 0, said.read_text())
        self.assertEqual(self.end(recording), 0, recorded.read_text())
        self.assertGreater((self.folder / "drive.mcap").stat().st_size, 10_000)
        showing, shown = self.start(*replay, "--port", "0")
        self.wait_for("http://", shown)
        self.end(showing)


if __name__ == "__main__":
    unittest.main()
