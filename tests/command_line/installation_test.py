# SPDX-License-Identifier: Apache-2.0
"""The command `citylearn` of an installation, and `./run`, which is the same command in the repository."""

import json
import re
import shutil
import sqlite3
import unittest
from contextlib import closing

from support import BUILD, PREFIX, SOURCE, CommandLine

SHORT = ["--frames", "0:40", "--evaluate", "summer", "--steps", "512", "--tasks", "4", "--no-wait"]


class Installation(CommandLine):
    def test_help_fits_a_screen(self):
        shown = self.run_command("citylearn", "--help")
        self.assertEqual(shown, self.run_command("citylearn"))
        self.assertLessEqual(len(shown.splitlines()), 24)
        for line in shown.splitlines() + self.run_command("citylearn", "demo", "--help").splitlines():
            self.assertLessEqual(len(line), 80, line)

    def test_every_command_of_the_help_has_a_help(self):
        shown = self.run_command("citylearn", "--help")
        commands = re.findall(r'^  ([a-z0-9]+) |"([a-z-]+)" (?:plays|sends|is one)', shown, re.MULTILINE)
        commands = {one or other for one, other in commands}
        listed = self.run_command("citylearn", "unknown", status=1)
        self.assertEqual(commands, set(re.search("there are: (.*)", listed)[1].split()) - {"help"})
        for command in commands:
            with self.subTest(command):
                self.assertRegex(self.run_command("citylearn", command, "--help"), "--|again")
        self.assertIn("Lists the datasets", self.run_command("citylearn", "data", "--help"))
        self.assertRegex(self.run_command("citylearn", "--version"), r"^\S+")

    def test_an_unknown_command_is_one_line_with_the_known_ones(self):
        said = self.run_command("citylearn", "trian", status=1)
        self.assertRegex(said, r"^citylearn: unknown command 'trian'; there are: demo .*\n$")
        self.environment["CITYLEARN_BUILD"] = str(BUILD)
        said = self.run_command(SOURCE / "run", "trian", status=1)
        self.assertRegex(said, r"^run: unknown command 'trian'; there are: demo .* test .*\n$")

    def test_run_has_the_same_commands(self):
        self.environment["CITYLEARN_BUILD"] = str(BUILD)
        shown = self.run_command("citylearn", "--help").replace("citylearn ", f"{SOURCE}/run ")
        self.assertTrue(self.run_command(SOURCE / "run", "--help").startswith(shown))
        for command in ("data", "demo"):
            self.assertEqual(self.run_command(SOURCE / "run", command, "--help").replace(f"{SOURCE}/run", "citylearn"),
                             self.run_command("citylearn", command, "--help"))

    def test_programs_load_what_decodes_pictures_when_they_need_it(self):
        linked = self.run_command("ldd", PREFIX / "bin/citylearn_data")
        for library in re.findall(r"\S*(?:imgcodecs|libav|libsws|libheif)\S*(?= =>)", linked):
            (self.folder / library).write_text("")
        self.environment["LD_LIBRARY_PATH"] = str(self.folder)
        self.assertIn("libopencv_imgcodecs", self.run_command(PREFIX / "bin/citylearn_data", "list", status=127))
        for program in ("env_service", "encoder_service", "dashboard"):
            self.run_command(PREFIX / "bin" / program, "--help")
        said = self.run_command(PREFIX / "bin/env_service", "--dataset", "synthetic", "--traversal", "winter", "--align-to",
                                "summer", "--align-by", "sight", "--show", status=127)
        self.assertRegex(said, r"env_service: \S*libopencv_imgcodecs\S+: file too short \(install the package that has this")

    def test_the_doctor_looks_at_this_machine(self):
        said = self.run_command("citylearn", "doctor", "--seconds", "1", status=1)
        self.assertIn(f"PROBLEM: no participant was heard in domain {self.domain} on lo", said)

    def test_a_demo_trains_here_and_is_repeated(self):
        said = self.run_command("citylearn", "demo", *SHORT, "--output", "first run", "--no-dashboard")
        self.assertIn("Next:\n  citylearn again first\\ run --agent features\n", said)
        self.assertNotIn("./run", said)
        self.assertIn("summer-slip0.1", json.loads((self.folder / "first run/summary.json").read_text())["evaluate"])
        manifest = json.loads((self.folder / "first run/manifest.json").read_text())
        self.assertIn("--session", manifest["command"]["words"])
        self.assertEqual(manifest["origins"]["steps"], "command line")
        self.assertEqual(manifest["origins"]["ppo-learning-rate"], "recommended by place_filter")
        said = self.run_command("citylearn", "again", "first run", "--seed", "2")
        self.assertIn("citylearn demo --frames 0:40", said)
        self.assertEqual(len(list(self.folder.glob("runs/*/summary.json"))), 1)
        self.assertIn("'nowhere': is no folder of a demo's run", self.run_command("citylearn", "again", "nowhere", status=1))

    def test_an_open_dashboard_shows_and_records_later_demos(self):
        dashboard, said = self.start("citylearn", "dashboard", "--port", "0")
        self.wait_for("dashboard: http", said)
        self.assertIn("open http://", self.run_command("citylearn", "dashboard", "--port", "0", status=1))
        demo = self.run_command("citylearn", "demo", *SHORT, "--output", "later")
        self.assertIn(re.search(r"^dashboard: \S+$", said.read_text(), re.M)[0], demo)
        self.assertFalse((self.folder / "later/dashboard.sqlite").exists())
        self.assertIn("citylearn again later --agent features", demo)
        self.assertEqual(self.end(dashboard), 0, said.read_text())
        with closing(sqlite3.connect(self.folder / "runs/dashboard.sqlite")) as store:
            runs = store.execute("SELECT session, ended, recorded FROM runs").fetchall()
        self.assertEqual([(session, ended) for session, ended, _ in runs], [("later", 1)])
        self.assertGreater(runs[0][2], 4 * 6)  # of the training, and the tasks of each policy

    def test_a_demo_is_repeated_from_another_folder(self):
        data = self.folder / "my drives"
        data.mkdir()
        for name in ("there", "back"):
            (data / f"{name}.csv").write_text("".join(f"{i % 7},{i * i % 11},{i}\n" for i in range(24)))
        self.environment["CITYLEARN_BUILD"] = str(BUILD)
        said = self.run_command(SOURCE / "run", "demo", "--data", "my drives", "--train", "there", "--steps", "512", "--tasks", "4",
                                "--output", "first", "--no-wait", "--no-dashboard")
        self.assertIn(f"Next:\n  {SOURCE}/run again first --agent features\n", said)
        self.assertNotIn("demo --data", said)  # what it would do again
        elsewhere = self.folder / "elsewhere"
        elsewhere.mkdir()
        self.folder = elsewhere
        said = self.run_command("citylearn", "again", "../first", "--seed", "2")
        self.assertIn(str(data).replace(" ", "\\ "), said)
        (again,) = elsewhere.glob("runs/*/manifest.json")
        manifest = json.loads(again.read_text())
        self.assertEqual(manifest["seed"], 2)
        self.assertEqual(again.with_name("demo.words").read_text().split("\0")[:2], ["--data", str(data)])

    def test_a_build_says_at_its_start_how_long_it_takes(self):
        function = re.search(r"^seconds_left\(\).*$", (SOURCE / "run").read_text(), re.M)[0]
        # 332 steps of 7.75 s take 2,573 s, whatever the first ones took; in the end, what was seen counts most.
        for done, seconds, low, high in ((0, 0, 2573, 2573), (3, 2, 2200, 2573), (3, 60, 2573, 3000), (166, 600, 600, 900)):
            left = int(self.run_command("bash", "-c", f"{function}; seconds_left {done} 332 7750 {seconds}"))
            self.assertTrue(low <= left <= high, (done, seconds, left))

    def test_a_demo_with_the_programs_of_packages(self):
        for name, programs in (("services", ["env_service", "encoder_service", "policy_service"]), ("dashboard", ["dashboard"])):
            root = self.folder / name
            for folder in ("DEBIAN", "usr/bin", "usr/share/citylearn/page"):
                (root / folder).mkdir(parents=True)
            for program in programs:
                shutil.copy(PREFIX / "bin" / program, root / "usr/bin" / program)
            (root / "DEBIAN/control").write_text(f"Package: citylearn-{name}\nVersion: 1\nArchitecture: amd64\nMaintainer: a <a@b.invalid>\n"
                                                 "Depends: bash (>= 5), awk, citylearn-services | none\nDescription: programs\n")
            self.run_command("dpkg-deb", "-Znone", "-b", root, self.folder)
        self.environment["CITYLEARN_BUILD"] = "mine"
        said = self.run_command(SOURCE / "run", "demo", "--from-packages", ".", *SHORT, "--output", "first")
        self.assertNotIn("installing", said)  # mawk or gawk provides awk
        self.assertIn("mine/packaged/usr/bin/policy_service", (self.folder / "first/manifest.json").read_text())
        self.assertIn("--train", self.run_command(SOURCE / "run", "policy", "--show-config", "first"))
        self.assertIn("there is no 'first/citylearn-services_", self.run_command(SOURCE / "run", "demo", "--from-packages", "first", status=1))

    def test_a_program_that_is_not_installed_is_named(self):
        copy = self.folder / "bin"
        (self.folder / "share/citylearn/tools").mkdir(parents=True)
        copy.mkdir()
        for name in ("commands.sh", "demo.sh"):
            file = self.folder / "share/citylearn/tools/citylearn" / name
            file.parent.mkdir(exist_ok=True)
            file.write_text((SOURCE / "tools/citylearn" / name).read_text())
        (copy / "citylearn").write_text((SOURCE / "tools/citylearn/citylearn").read_text())
        said = self.run_command("bash", copy / "citylearn", "vpr", status=1)
        self.assertRegex(said, r"^citylearn: vpr: its program '\S+/bin/citylearn_vpr' is missing")


if __name__ == "__main__":
    unittest.main(verbosity=2)
