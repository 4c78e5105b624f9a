# SPDX-License-Identifier: Apache-2.0
"""The commands of docs/how-to, as the pages have them. What differs: `./run` is the installed `citylearn`, hosts and folders are
those of this test, and trainings are short."""

import ast
import json
import random
import re
import time
import unittest
from pathlib import Path

from support import PATIENCE, SOURCE, CommandLine, Scenery, commands, own_domain

PAGES = SOURCE / "docs/how-to"
OURS = {"./run", "python3 -m citylearn.lerobot", "env_service", "encoder_service", "policy_service", "dashboard", "compose/keystore"}
SHORT = ["--frames", "0:64", "--steps", "8000", "--tasks", "50"]
SHORT_CITY = ["--synthetic-frames", "128"]  # of 1000, all of which an encoder_service encodes

# Commands that this test does not run, by their beginnings, and what runs them or why nothing does.
ELSEWHERE = {
    "env_service --middleware fastdds --interface eth0 --discovery-server": "tests/system/network",
    "policy_service --plugin build/release/plugins/mine.so": "tests/tutorial",
    "./run build": "every test",
    "./run ros2": "tests/ros2",
    "./run teach": "tests/ros2",
    "./run simulated-robot": "tests/ros2",
    "./run demo --data route": "tests/ros2",
    "./run env": "tests/ros2",
    "./run encoder --reference": "tests/ros2",
    "./run policy --mode evaluate --checkpoint runs/taught": "tests/ros2",
    "./run setup": "every test",
    "./run vpr $D": "takes recordings that not everybody has",
    "./run paper": "tests/system/paper_report_test.cc",
    "./run data info DIR --kitti-camera": "tests/unit/env_service",
    "./run data info BAGS": "tests/unit/env_service",
    "./run demo --data BAGS": "takes recordings that not everybody has",
    "./run data info DIR --plain-clock-offset": "tests/unit/env_service",
    "./run demo --dataset": "takes recordings that not everybody has",
    "encoder_service --id encoder-a --encoder onnx": "tests/system/encoder_test.cc",
    "encoder_service --id encoder-b --encoder onnx": "tests/system/encoder_test.cc",
    "compose/keystore ": "tests/system/network/security_test.cc, with the services that follow",
    "env_service --id env-summer": "tests/system/network/security_test.cc",
    "encoder_service --id encoder --interface eth0 --peers hostB --security": "tests/system/network/security_test.cc",
    "policy_service --id policy --train summer --interface eth0": "tests/system/network/security_test.cc",
    "policy_service --mode evaluate --checkpoint runs/TIME": "tests/python/same_figures_test.py",
    "policy_service --initial": "tests/unit/policy_service/run/policy_test.cc",
    "policy_service --train summer --frames 0:128 --output out/rank": "tests/slurm",
    "policy_service --train summer,fall --evaluate winter ...": "the demo before it",
    "env_service --dataset synthetic --metrics": "prometheus_test.py",
    "env_service --data DIR --traversal": "tests/python/streets_test.py",
    "env_service --data CITY --rule street": "tests/unit/env_service/datasets",
    "env_service --data DIR --rule street": "tests/unit/env_service/streets",
    "policy_service --train summer --evaluate summer,fall --controls all": "tests/simulation/services/streets_test.cc",
    "python3 -m citylearn.lerobot DATASET": "tests/clients/lerobot_test.py",
    "./run data info FOLDER": "tests/clients/lerobot_test.py",
    "./run replay drive --agent": "tests/unit/tools/record",
}


def ours(page):
    """Returns the commands of a page that start a program of ours, each as its words."""
    return [words for _, words in commands(PAGES / f"{page}.md") if words[:1] and {words[0], " ".join(words[:3])} & OURS]


class Recipes(CommandLine):
    def setUp(self):
        super().setUp()
        self.hosts = {"eth0": "lo", "hostA,hostB": "127.0.0.1"}

    def take(self, page, *beginnings):
        """Returns those commands of a page that begin so, in its order, with the names of this test."""
        found = []
        for command in ours(page):
            text = " ".join(command)
            if any(text.startswith(beginning) for beginning in beginnings):
                found.append(self.words(command, self.hosts))
        self.assertEqual(len(found), len(beginnings), f"{page}.md has other commands: {found}")
        return found

    def learn(self, command, *more):
        """Runs a policy_service or a demo, shortened. Returns what it says."""
        return self.run_command(*command, *SHORT, *more)

    def results(self, output):
        return json.loads((self.folder / output / "summary.json").read_text())["evaluate"]

    def write_recordings(self):
        data = self.folder / "DATA"
        Scenery(80).write_pictures(data / "summer", 1)
        Scenery(80).write_pictures(data / "winter", 0.6)
        self.hosts["DIR"] = data

    def test_a_robot_repeats_what_it_was_taught(self):
        [robot] = self.take("drive-a-robot", "./run robot")
        self.environment["ROS_DOMAIN_ID"] = str(own_domain())
        self.run_command(*robot, "--places", "16", "--tasks", "3", "--slip", "0", "--output", "robots", "--no-wait")
        results = self.results("robots/repeat")
        self.assertEqual(set(results), {"robot-fall", "robot-rain"})
        for look, result in results.items():
            self.assertGreaterEqual(result["completed"], 0.66, look)
        for option, wrong in ("--places", "08"), ("--places", "9" * 20), ("--tasks", "0"), ("--middleware", "ros"):
            said = self.run_command(*robot, option, wrong, "--no-wait", status=1)
            self.assertRegex(said, rf"\A\w+: {option}: '{wrong}' is \w.*\n\Z")

    def test_each_command_is_run_or_named(self):
        read = ast.walk(ast.parse(Path(__file__).read_text()))
        written = {each.value for each in read if isinstance(each, ast.Constant) and isinstance(each.value, str) and each.value}
        for page in sorted(PAGES.glob("*.md")):
            for text in (" ".join(words) for words in ours(page.stem)):
                with self.subTest(page=page.name, command=text):
                    self.assertTrue(text in written or any(text.startswith(known) for known in written - OURS))

    def test_hosts_are_connected(self):
        env, encoder, policy, doctor = self.take(
            "connect-hosts", "env_service --interface eth0 --peers", "encoder_service --interface eth0 --peers hostA,hostB",
            "policy_service --interface eth0", "./run doctor --interface")
        self.write_recordings()
        self.start(*[str(self.hosts["DIR"]) if word == "/recordings" else word for word in env])
        self.start(*encoder)
        self.learn(policy)
        self.assertGreater(self.results("out")["summer"]["spl"], 0.5)
        self.assertIn("127.0.0.1", self.run_command(*doctor))

    def test_two_machines_by_hand_and_more_env_services(self):
        self.environment |= {"CITYLEARN_INTERFACE": "lo", "CITYLEARN_PEERS": "127.0.0.1"}
        train, evaluate, encoder, dashboard, policy = self.take(
            "run-on-a-cluster", "env_service --traversal summer --frames 0:128 --agents 8 --recorders", "env_service --traversal fall",
            "encoder_service --reference", "dashboard", "policy_service --train summer --evaluate summer,fall --output out --resume")
        services = [self.start(*words) for words in (train, evaluate, encoder)]
        services.append(self.start(*dashboard, "--port", "0"))
        self.run_command(*policy, "--steps", "8000", "--tasks", "50")
        self.assertEqual(sorted(self.results("out")), ["fall", "summer"])
        # The same training once more: it is over, and only evaluated again.
        self.assertIn("resum", self.run_command(*policy, "--steps", "8000", "--tasks", "50"))
        for process, _ in services:
            self.assertEqual(self.end(process), 0)

    def test_a_learner_has_actors_and_evaluation_is_divided(self):
        learner, *actors = self.take("run-on-a-cluster", "policy_service --role learner", "policy_service --role actor",
                                     "policy_service --role actor")
        for words in self.take("run-on-a-cluster", "env_service --traversal winter --id winter-a",
                               "env_service --traversal winter --id winter-b"):
            self.start(*words, *SHORT_CITY)
        for traversal in ("summer", "fall"):
            self.start("env_service", "--traversal", traversal, *SHORT_CITY)
        self.start("encoder_service")
        started = [self.start(*words, "--id", f"actor-{number}") for number, words in enumerate(actors)]
        self.learn(learner, "--evaluate", "summer,fall,winter")
        self.assertEqual(sorted(self.results("out")), ["fall", "summer", "winter"])
        for process, log in started:
            self.assertEqual(process.wait(PATIENCE), 0, log.read_text())

    def test_ranks_learn_one_agent(self):
        domains = {name: str(own_domain()) for name in "123"}
        first, second = self.take("run-on-a-cluster", "policy_service --domain 1", "policy_service --domain 2")
        for number, words in enumerate((first, second)):
            for option in "--ranks-domain", "--domain":
                where = words.index(option) + 1
                words[where] = domains[words[where]]
            words[words.index("--output") + 1] = f"out-{number}"
            self.start("env_service", "--domain", words[where], "--synthetic-images", "0")
        other, log = self.start(*second, *SHORT)
        self.learn(first)
        self.assertEqual(other.wait(PATIENCE), 0, log.read_text())
        self.assertIn("rank", log.read_text())

    def test_an_imperfect_world(self):
        encoder, *envs, policy, demo = self.take("try-an-imperfect-world", "encoder_service &", "env_service --traversal summer",
                                                 "env_service --traversal winter &", "env_service --traversal winter --slip",
                                                 "policy_service --train summer --evaluate winter,winter-slip", "./run demo --seeds")
        self.start(*encoder)
        for words in envs:
            self.start(*words, *SHORT_CITY)
        self.learn(policy, "--output", "out")
        self.assertEqual(sorted(self.results("out")), ["winter", "winter-slip0.1-drop0.1-kidnap1"])
        demo[demo.index("1..5")] = "1..2"
        said = self.run_command(*demo, "--no-dashboard", "--frames", "0:64", "--evaluate", "summer,fall", "--tasks", "200",
                                "--output", "slips")
        self.assertRegex(said, r"\nfall +0\.9")
        self.assertRegex(said, r"All of it is imperfect: slip0\.1 ")
        for interval in ("", r" \(0\.\d+ to 0\.\d+\)"):
            self.assertRegex(said, rf"\nLearning gained 0\.\d+ SPL{interval} over the untrained sequence_filter\.\n")
        self.assertRegex(said, r"gained by learning .* fall-slip0\.1 +\| 2 +\|[^|]+\| 0\.\d+")

    def test_streets_of_the_drawn_city(self):
        demo, = self.take("walk-on-streets", "./run demo --rule street")
        said = self.run_command(*demo, "--synthetic-images", "0", "--agent", "sequence_filter", "--mode", "evaluate", "--slip", "0",
                                "--evaluate", "winter", "--tasks", "50", "--no-dashboard", "--output", "out")
        self.assertIn("sequence_filter finds its way in winter", said)
        self.assertLess(self.results("out")["winter"]["spl"], 1)

    def test_drives_that_meet(self):
        self.hosts["DIR"] = self.folder / "TOWN"
        self.hosts["DIR"].mkdir()
        draw = random.Random(1)
        for day in "monday", "tuesday":  # 100 m there and, 4 m beside, back: to the east, and across to the north
            way = [(10 * i - 53, 0) for i in range(11)] + [(41 - 10 * i, 4) for i in range(10)]
            views = [[draw.gauss(0, 1) for _ in range(16)] for _ in way]
            for season in "", "-night":
                rows = [",".join(f"{x + draw.gauss(0, 0.2 * bool(season)):.4f}" for x in view) for view in views]
                places = [f"{b / 111195},{a / 111195}" if day == "monday" else f"{a / 111195},{b / 111195}" for a, b in way]
                for ending, lines in (".csv", rows), (".poses.csv", ["lat,lon", *places]):
                    (self.hosts["DIR"] / (day + season + ending)).write_text("\n".join(lines) + "\n")
        demo, = self.take("walk-on-streets", "./run demo --data DIR --rule street")
        self.run_command(*demo, "--agent", "sequence_filter", "--mode", "evaluate", "--slip", "0", "--tasks", "100",
                         "--no-dashboard", "--output", "out")
        results = self.results("out")
        self.assertEqual(sorted(results), ["monday-night_tuesday-night", "monday_tuesday"])
        for season, result in results.items():
            self.assertGreater(result["spl"], 0.9, season)
        log = (self.folder / "out/logs/env-monday+tuesday.log").read_text()
        self.assertIn("junctions 1, dead ends 4, one-way links 0", log)
        self.assertIn("frames at places of these streets: 21 of 21 of monday, 21 of 21 of tuesday", log)

    def test_recordings_of_ones_own(self):
        self.write_recordings()
        demo, check, drawn, listed, _ = self.take("train-on-your-recordings", "./run demo --data DIR --frames 0:128 --train",
                                                  "./run data check DIR", "./run data check DIR --picture", "./run data list",
                                                  "./run data check DIR")
        self.assertIn("nordland", self.run_command(*listed))
        self.assertIn("0 bad", self.run_command(*check))
        demo[demo.index("0:128")] = "0:80"  # as many as there are
        self.assertIn("in summer, where it trained", self.run_command(*demo, "--tasks", "200"))
        places, = self.take("measure-place-recognition", "./run vpr --data DIR")
        self.assertRegex(self.run_command(*places), r"patchnorm.*winter|winter.*patchnorm")
        by_sight, = self.take("train-on-your-recordings", "./run demo --data DIR --align-by sight")
        for picture in sorted((self.hosts["DIR"] / "winter").iterdir())[20:60:2]:
            picture.unlink()
        self.assertRegex(self.run_command(*check), r"winter: (5\d|60) of 60 frames show places of summer.*--align-by sight")
        self.run_command(*drawn)
        self.assertIn("winter (upwards) by sight", (self.folder / "match.svg").read_text())
        short = [*SHORT, "--no-dashboard"]
        self.assertRegex(self.run_command(*by_sight, *short), r"winter: (5\d|60) of 60 frames show places of summer")
        by_sight[by_sight.index("--align-by"):] = []
        self.assertRegex(self.run_command(*by_sight, *short), r"'winter' 60: frames that look alike are taken for one place")

    def test_a_training_ends_in_time_and_seeds_are_compared(self):
        stopped, limited, experiences, moved, seeds, other, table = self.take(
            "train-on-your-recordings", "./run demo --stop-when", "./run demo --time-limit", "./run demo --train summer,fall",
            "./run demo --train summer,summer-left", "./run demo --agent place_filter --seeds",
            "./run demo --agent place_filter --learner", "./run policy --mode table")
        drawn = ["--no-dashboard", "--frames", "0:64", "--tasks", "50"]
        steps = re.search(r"trained \d+ episodes, (\d+) steps", self.run_command(*stopped, *drawn, "--evaluate", "summer"))
        self.assertLess(int(steps[1]), 40000)
        limited[limited.index("60")] = "1"
        begun = time.monotonic()
        self.run_command(*limited, *drawn, "--evaluate", "summer", "--steps", "100000000")
        self.assertLess(time.monotonic() - begun, PATIENCE / 2)
        self.assertIn("in winter", self.run_command(*experiences, *drawn))
        self.assertIn("finds its way in shifted", self.run_command(*moved, *drawn, "--evaluate", "shifted"))
        for words in (seeds, other):
            words[words.index("1..5")] = "1..2"
            self.learn(words, "--no-dashboard", "--evaluate", "summer")
        self.assertRegex(self.run_command(*table), r"relabel")

    def test_an_encoder_in_python(self):
        (self.folder / "my_encoder.py").write_text((SOURCE / "tests/support/encoder.py").read_text())
        self.environment["CITYLEARN_PYTHON"] = "/usr/bin/python3"
        demo, vpr, _ = self.take("use-a-python-encoder", "./run demo", "./run vpr", "./run encoder --encoder my_encoder.py")
        self.learn(demo, "--no-dashboard", "--evaluate", "summer,fall", "--slip", "0", "--output", "out")
        self.assertGreater(self.results("out")["summer"]["spl"], 0.5)
        self.assertRegex(self.run_command(*vpr, "--frames", "0:64", "--no-pictures"), r"my_encoder\.py .*fall")
        (self.folder / "my_encoder.py").write_text("import citylearn\n1 / 0\n")
        said = self.run_command(*demo, "--no-dashboard", status=1)
        self.assertIn("my_encoder.py:2: ZeroDivisionError: division by zero", said)

    def test_a_run_is_recorded_and_replayed(self):
        self.hosts["NAME"] = "first"
        record, shown, replay = self.take(
            "record-and-replay", "./run record", "./run dashboard --open a.mcap shows", "./run replay a.mcap --speed")
        record = record[:record.index("a.mcap") + 1]  # the page says on the same line what it does
        recording, said = self.start(*record)
        self.wait_for("records to", said)
        for words in (["env_service", "--synthetic-images", "0", "--session", "first"],
                      ["policy_service", "--role", "actor", "--session", "first"]):
            self.start(*words)
        self.learn(["policy_service", "--role", "learner", "--train", "summer", "--session", "first", "--output", "out"])
        self.assertEqual(self.end(recording), 0, said.read_text())
        process, page = self.start(*shown[:shown.index("a.mcap") + 1], "--port", "0")
        self.wait_for("http://", page)
        self.end(process)
        self.run_command(*replay[:replay.index("max") + 1])


if __name__ == "__main__":
    unittest.main()
