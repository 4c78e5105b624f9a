# SPDX-License-Identifier: Apache-2.0
"""The ten first tasks of docs/tutorials/README.md, with the commands that the page has. What differs: `./run` is the installed
`citylearn`, whose code is the same; names of hosts and folders are those of this test; of the demos, that of task 8
alone is evaluated on as many tasks as a user's. Tasks 6 and 7 point to pages with tests of their own: tests/tutorial,
and tests/system/network/security_test.cc."""

import json
import re
import unittest

from support import PATIENCE, SOURCE, CommandLine, Scenery, commands


FEW = ["--tasks", "200"]  # of 2000: evaluation takes most of a demo's time


def tasks():
    """Returns the commands of each task by its number, each as its words."""
    page = SOURCE / "docs/tutorials/README.md"
    titles = {line: int(title[1]) for line, text in enumerate(page.read_text().splitlines(), 1)
              if (title := re.match(r"## (\d+)\.", text))}
    found = {number: [] for number in titles.values()}
    for line, words in commands(page):
        found[titles[max(title for title in titles if title < line)]].append(words)
    return found


class FirstTasks(CommandLine):
    @classmethod
    def setUpClass(cls):
        super().setUpClass()
        cls.tasks = tasks()

    def run_task(self, number, names=None):
        """Runs the commands of a task, one after the other, demos with FEW. Returns what they say."""
        return [self.run_command(*self.words(command, names), *(FEW if command[:2] == ["./run", "demo"] else []))
                for command in self.tasks[number]]

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
        self.assertIn("place_filter finds its way in winter (", demo)
        self.assertGreater(self.spl(self.newest_run(), "winter-slip0.1"), 0.9)
        why, places, config = self.run_task(10, {"DIR": data, "runs/TIME": self.newest_run()})
        self.assertIn("place_filter finds its way in winter (", why)
        self.assertRegex(places, r"winter by hog_vlad \(\d+ numbers, centring running\), nearest frame: first answer right \d+ %")
        self.assertRegex(config, r"learning-rate\b.*place_filter")
        self.assertRegex(config, r"--frames +0:128 ")
        videos = self.folder / "VIDEOS"
        videos.mkdir()
        Scenery(210).write_video(self.folder / "drive.mp4")
        self.run_task(3, {"DIR": videos, "DIR/summer.mp4": videos / "summer.mp4"})
        self.assertGreater(self.spl(self.newest_run(), "summer-slip0.1"), 0.9)

    def test_a_demo_another_learner_and_export(self):
        self.assertIn("place_filter finds its way in", self.run_task(1)[0])
        first = self.newest_run()
        listed = self.run_command(*self.words(self.tasks[5][0]))
        demo = self.run_command(*self.words(self.tasks[5][1]), *FEW)
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
        self.run_command(*policy, *FEW)
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
