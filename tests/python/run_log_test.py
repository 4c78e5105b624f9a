# SPDX-License-Identifier: Apache-2.0
"""Runs logged from Python: to a file, to a dashboard that comes and goes, and what remains of programs that are killed.
`run_log_test.py SOURCE BUILD [KILLS]`."""

import contextlib
import http.client
import http.server
import json
import os
import random
import signal
import subprocess
import sys
import tempfile
import threading
import time
import unittest
import urllib.parse
from pathlib import Path

KILLS = int(sys.argv.pop(3)) if len(sys.argv) > 3 else 15

from support import BUILD, SOURCE, ClearErrors

import citylearn
from citylearn import run_log

PATIENCE = 120  # seconds

# Logs to one run until it is killed. What log() has acknowledged goes into a second file.
LOGGER = """
import os, sys, time
import citylearn
run = citylearn.init("kills", sys.argv[1], dir=sys.argv[2], resume=True)
acknowledged = os.open(sys.argv[3], os.O_WRONLY | os.O_APPEND | os.O_CREAT)
number = run.step
while True:
    citylearn.log({"number": number, "half/of it": number / 2})
    os.write(acknowledged, b"%d\\n" % number)
    number += 1
    time.sleep(0.001)
"""


class Dashboard:
    """The real one, without DDS."""

    def __init__(self, folder, port=0):
        self.folder, self.port, self.process = Path(folder), port, None
        self.start()

    def start(self):
        log = self.folder / "dashboard.log"
        with open(log, "wb") as output:
            self.process = subprocess.Popen(
                [BUILD / "dashboard/dashboard", "--middleware", "inprocess", "--port", str(self.port),
                 "--store", self.folder / "store.sqlite", "--page", ""], stdout=output, stderr=output)
        deadline = time.monotonic() + PATIENCE
        while b"dashboard: http" not in log.read_bytes():
            if self.process.poll() is not None or time.monotonic() > deadline:
                raise AssertionError(log.read_text())
            time.sleep(0.02)
        said = log.read_text().split("dashboard: ")[1].split()[0]
        self.url = said.rstrip("/")
        self.port = urllib.parse.urlsplit(said).port

    def end(self, sent=signal.SIGTERM):
        self.process.send_signal(sent)
        self.process.wait(PATIENCE)

    def get(self, path, **parameters):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=PATIENCE)
        with contextlib.closing(connection):
            query = f"?{urllib.parse.urlencode(parameters)}" if parameters else ""
            connection.request("GET", f"/api/{path}{query}")
            answer = connection.getresponse()
            text = answer.read().decode()
            if answer.status != 200:
                raise AssertionError(text)
            return json.loads(text)

    def points(self, run, metric):
        return self.get("sql", limit=100_000, q=f"SELECT step, value FROM curves WHERE run = '{run}' AND metric = '{metric}' "
                                                "ORDER BY step")["rows"]


class InAFolder(ClearErrors):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="citylearn-", ignore_cleanup_errors=True)
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        self.addCleanup(os.chdir, os.getcwd())
        os.chdir(self.folder)
        self.addCleanup(citylearn.finish, 0.0)

    def dashboard(self):
        started = Dashboard(self.folder)
        self.addCleanup(lambda: started.process.poll() is None and started.end(signal.SIGKILL))
        return started

    def until(self, true, what):
        deadline = time.monotonic() + PATIENCE
        while not true():
            self.assertLess(time.monotonic(), deadline, what)
            time.sleep(0.02)


class Logging(InAFolder):
    def test_needs_python_alone(self):
        (self.folder / "run_log.py").write_text((SOURCE / "python/citylearn/run_log.py").read_text())
        program = ("import sys, run_log\nrun = run_log.init('p', 'n', offline=True)\nrun_log.log({'loss': 1})\nrun_log.finish()\n"
                   "print('numpy' in sys.modules)")
        done = subprocess.run([sys.executable, "-I", "-S", "-c", f"import sys\nsys.path.insert(0, '.')\n{program}"],
                              capture_output=True, text=True, check=False)
        self.assertEqual(done.stdout, "False\n", done.stderr)
        self.assertIn('"values":{"loss":1.0}', (self.folder / "runs/logged/p-n/log.jsonl").read_text())
        loaded = subprocess.run([sys.executable, "-c", "import sys, citylearn\nprint('numpy' in sys.modules, citylearn.VectorEnv)"],
                                env={**os.environ, "PYTHONPATH": str(BUILD / "python")}, capture_output=True, text=True, check=False)
        self.assertEqual(loaded.stdout, "False <class 'citylearn.vector_env.VectorEnv'>\n", loaded.stderr)

    def test_a_run_appears_with_its_options_and_curves(self):
        dashboard = self.dashboard()
        run = citylearn.init("walks", "one", {"rate": 0.1, "net": {"width": 8}}, dashboard=dashboard.url, title="first try", tags=["night"])
        for step in range(300):
            run.log({"loss": 1 / (step + 1), "test": {"spl": step / 300}}, step=10 * step)
        run.config.batch = 32
        run.log({"loss": float("nan")})
        run.summary["best"] = 0.5
        self.assertTrue(citylearn.finish())
        listed = dashboard.get("runs")["runs"][0]
        self.assertEqual((listed["id"], listed["state"], listed["title"], listed["tags"], listed["source"], listed["updates"]),
                         ("walks/one", "ended", "first try", ["night"], "python", 301))
        manifest = dashboard.get("runs/walks%2Fone")["manifest"]
        self.assertEqual((manifest["rate"], manifest["net"], manifest["batch"]), (0.1, {"width": 8}, 32))
        curve = dashboard.get("runs/walks%2Fone/curve", metric="test/spl")
        self.assertEqual(curve["columns"]["x"], [10 * step for step in range(300)])
        loss = dashboard.points("walks/one", "loss")
        self.assertEqual(loss[-2:], [[2990.0, 1 / 300], [2991.0, None]])
        self.assertIn({"key": "best", "values": ["0.5"], "differs": False},
                      dashboard.get("compare", runs="walks/one", all=1)["figures"])

    def test_wrong_use_is_told(self):
        self.expect(RuntimeError, "call citylearn.init", citylearn.log, {"a": 1})
        run = citylearn.init("p", "n", offline=True)
        self.expect(TypeError, "'a' must be a number, is str", run.log, {"a": "3"})
        self.expect(TypeError, "'a/b' must be a number, is list", run.log, {"a": {"b": [1]}})
        self.expect(ValueError, "one line of 1 to 256", run.log, {"a\nb": 1})
        self.expect(TypeError, "step must be a finite number", run.log, {"a": 1}, step="3")
        self.expect(AttributeError, "there is no 'rate'", lambda: run.config.rate)
        citylearn.finish()
        self.expect(RuntimeError, "is finished", run.log, {"a": 1})
        self.expect(FileExistsError, "log of another run", citylearn.init, "p", "n", offline=True)
        self.expect(ValueError, "project '' must be", citylearn.init, "", offline=True)
        self.expect(ValueError, "give an address", citylearn.init, "p", dashboard="ftp://x")
        self.expect(FileNotFoundError, "holds no log.jsonl", citylearn.sync, self.folder / "nothing", "127.0.0.1:1")

    def test_values_and_steps_of_other_types(self):
        import numpy as np
        run = citylearn.init("p", "n", offline=True, title=None, tags=None)
        for step in (np.int64(3), np.float32(4.5), np.array([7])):
            run.log({"a": np.float32(2), "huge": 10**400}, step=step)
        records = [json.loads(line) for line in Path(run.dir, "log.jsonl").read_text().splitlines()]
        self.assertEqual([(record["step"], record["values"]) for record in records if "step" in record],
                         [(step, {"a": 2, "huge": None}) for step in (3, 4.5, 7)])
        for what in (None, [1], "a"):
            self.expect(TypeError, "log: needs a dictionary", run.log, what)
        for step in (10**400, np.nan, np.zeros(2), [1]):
            self.expect(TypeError, "step must be a finite number", run.log, {"a": 1}, step=step)
        self.expect(ValueError, r"'a\\ud800' must be one line", run.log, {"a\ud800": 1})

    def test_a_run_that_cannot_begin_leaves_nothing(self):
        for kind, pattern, options in [
                (TypeError, "config must be a dictionary, is str", {"config": "rate"}),
                (TypeError, "tags must be a list of texts, is 'night'", {"tags": "night"}),
                (TypeError, "title and note must be texts, are 3", {"title": 3}),
                (TypeError, "name must be a text, is 3", {"name": 3}),
                (TypeError, "project must be a text, is None", {"project": None}),
                (ValueError, "give an address", {"dashboard": "http://host:port"}),
                (ValueError, "give an address", {"dashboard": "http://127.0.0.1:99999"}),
                (FileNotFoundError, "no-token", {"token_file": "no-token"})]:
            self.expect(kind, pattern, citylearn.init, **{"project": "p", "name": "n", **options})
            self.assertFalse(Path("runs").exists(), options)
        Path("token").write_text("two\nlines")
        self.expect(ValueError, "token: a token is one line", citylearn.init, "p", "n", token_file="token")

    def test_another_server_is_told(self):
        class Page(http.server.BaseHTTPRequestHandler):
            def do_POST(self):
                self.rfile.read(int(self.headers["Content-Length"]))
                self.send_response(200)
                self.end_headers()
                self.wfile.write(b"<html>")

            def log_message(self, *_):
                pass

        with http.server.ThreadingHTTPServer(("127.0.0.1", 0), Page) as server:
            threading.Thread(target=server.serve_forever, daemon=True).start()
            run = citylearn.init("p", "n", dashboard=f"127.0.0.1:{server.server_port}")
            self.assertFalse(run.finish(wait=PATIENCE))
            self.assertRaisesRegex(run_log.DashboardError, "status 200, unlike a dashboard", citylearn.sync, "runs",
                                   f"127.0.0.1:{server.server_port}")
            server.shutdown()

    def test_damaged_logs_are_named(self):
        head = '{"run":"p/n","log":"a","started":1}\n'
        for number, (text, place) in enumerate([
                ("garbage\n", "1"), ("[1]\n", "1"), ('{"step":1}\n', "1"), ("\0\0\n", "1"), (head + "oops\n", "2"),
                (head + '{"step":1}\n\xff\n', "3")]):
            folder = Path(str(number))
            folder.mkdir()
            (folder / "log.jsonl").write_bytes(text.encode("latin-1"))
            self.expect(ValueError, rf"{number}/log.jsonl:{place}: this line is damaged", citylearn.init, "p",
                        dir=folder, resume=True, offline=True)

    def test_processes_that_are_forked_log_too(self):
        run = citylearn.init("p", "n", offline=True)
        child = os.fork()
        if child == 0:
            run.log({"of": 1})
            os._exit(0)
        os.waitpid(child, 0)
        run.log({"of": 0})
        citylearn.finish()
        text = Path(run.dir, "log.jsonl").read_text()
        self.assertEqual([text.count(f'{{"of":{who}.0}}') for who in (0, 1)], [1, 1])


class Faults(InAFolder):
    def test_a_dashboard_that_is_away_gets_all_later(self):
        dashboard = self.dashboard()
        run = citylearn.init("p", "n", dashboard=dashboard.url)
        run.log({"x": 0})
        self.until(lambda: dashboard.get("runs")["runs"] and dashboard.points("p/n", "x"), "the first point")
        dashboard.end(signal.SIGKILL)
        for step in range(1, 100):
            run.log({"x": step})
        dashboard.start()
        self.assertTrue(run.finish(wait=PATIENCE))
        self.assertEqual(dashboard.points("p/n", "x"), [[step, step] for step in range(100)])

    def test_nobody_waits_for_a_dashboard_that_is_not_there(self):
        run = citylearn.init("p", "n", dashboard="127.0.0.1:1")
        run.log({"x": 1})
        self.assertFalse(run.finish(wait=0.5))
        dashboard = self.dashboard()
        done = subprocess.run([sys.executable, "-m", "citylearn.sync", "--dashboard", dashboard.url, "runs"],
                              env={**os.environ, "PYTHONPATH": str(BUILD / "python")}, capture_output=True, text=True, check=False)
        self.assertEqual((done.returncode, done.stdout), (0, "p/n: the dashboard has all 4 records\n"), done.stderr)
        self.assertEqual(dashboard.points("p/n", "x"), [[0, 1]])
        again = subprocess.run([sys.executable, "-m", "citylearn.sync", "--dashboard", "127.0.0.1:1", "runs"],
                               env={**os.environ, "PYTHONPATH": str(BUILD / "python")}, capture_output=True, text=True, check=False)
        self.assertEqual(again.returncode, 1)
        self.assertRegex(again.stderr, "^citylearn sync: .* does not answer.*\n$")

    def test_a_record_that_was_cut_off_was_never_acknowledged(self):
        run = citylearn.init("p", "n", offline=True)
        run.log({"x": 1})
        citylearn.finish()
        with open(Path(run.dir, "log.jsonl"), "a", encoding="utf-8") as file:
            file.write('{"step":1,"ti')
        dashboard = self.dashboard()
        self.assertEqual(citylearn.sync("runs", dashboard.url), [("p/n", 4)])
        run = citylearn.init("p", "n", dir=run.dir, resume=True, dashboard=dashboard.url)
        run.log({"x": 2})
        self.assertTrue(citylearn.finish())
        self.assertEqual(dashboard.points("p/n", "x"), [[0, 1], [1, 2]])

    def test_a_damaged_log_does_not_keep_others(self):
        for name, text in (("a", ""), ("b", '{"run":'), ("c", "garbage\n"), ("d", '{"run":"p/d","log":"d","started":1}\n\xff\n')):
            Path("logs", name).mkdir(parents=True)
            Path("logs", name, "log.jsonl").write_bytes(text.encode("latin-1"))
        run = citylearn.init("p", "n", dir="logs/n", offline=True)
        run.log({"x": 1})
        citylearn.finish()
        dashboard = self.dashboard()
        done = subprocess.run([sys.executable, "-m", "citylearn.sync", "--dashboard", dashboard.url, "logs"],
                              env={**os.environ, "PYTHONPATH": str(BUILD / "python")}, capture_output=True, text=True, check=False)
        self.assertEqual((done.returncode, done.stdout), (1, "p/n: the dashboard has all 4 records\n"), done.stderr)
        damaged, refused = done.stderr.splitlines()
        self.assertRegex(damaged, "^citylearn sync: logs/c/log.jsonl:1: this line is damaged")
        self.assertRegex(refused, "^citylearn sync: logs/d/log.jsonl:2: this line is damaged")
        self.expect(ValueError, "logs/c/log.jsonl:1", citylearn.sync, "logs", dashboard.url)

    def test_what_the_dashboard_acknowledged_it_keeps(self):
        dashboard = self.dashboard()
        to = run_log.Dashboard(dashboard.url)
        self.addCleanup(to.close)
        received = 0
        for turn in range(5):
            lines = ['{"step":%d,"time":1,"values":{"x":%d}}' % (number, number) for number in range(received, received + 50)]
            received = to.send("p/n", "log", received + 1, lines)
            dashboard.end(signal.SIGKILL)
            dashboard.start()
            self.assertEqual(to.send("p/n", "log", 1, []), received, turn)
        self.assertEqual(dashboard.points("p/n", "x"), [[number, number] for number in range(250)])

    def test_two_programs_do_not_share_a_run(self):
        dashboard = self.dashboard()
        citylearn.init("p", "n", dir="a", dashboard=dashboard.url)
        citylearn.finish()
        run = citylearn.init("p", "n", dir="b", dashboard=dashboard.url)
        run.log({"x": 1})
        self.assertFalse(citylearn.finish())

    def test_killed_programs_lose_nothing_that_was_acknowledged(self):
        dashboard = self.dashboard()
        chance = random.Random(1)
        (self.folder / "logger.py").write_text(LOGGER)
        environment = {**os.environ, "PYTHONPATH": str(BUILD / "python"), "CITYLEARN_DASHBOARD": dashboard.url}
        names = [f"run{number}" for number in range(5)]

        def start(name):
            with open(f"{name}.log", "ab") as output:
                return subprocess.Popen([sys.executable, "logger.py", name, name, f"{name}.acknowledged"], env=environment,
                                        stdout=output, stderr=output)

        def acknowledged(name):
            path = Path(f"{name}.acknowledged")
            return path.stat().st_size if path.exists() else 0

        programs = {name: start(name) for name in names}
        seen = {name: 0 for name in names}
        for kill in range(KILLS):
            name = names[kill % len(names)]
            self.until(lambda: acknowledged(name) > seen[name] or programs[name].poll() is not None, "it logs")
            self.assertIsNone(programs[name].poll(), Path(f"{name}.log").read_text())
            time.sleep(chance.random() * 0.2)  # it is killed at any place
            programs[name].kill()
            programs[name].wait()
            seen[name] = acknowledged(name)
            if kill % 20 == 9:
                dashboard.end(signal.SIGKILL)
                dashboard.start()
            programs[name] = start(name)
        for program in programs.values():
            program.kill()
            program.wait()
        citylearn.sync(self.folder, dashboard.url)
        for name in names:
            numbers = {int(line) for line in Path(f"{name}.acknowledged").read_text().split()}
            self.assertGreater(len(numbers), 0)
            for metric, part in (("number", 1), ("half/of it", 0.5)):
                values = [row[1] for row in dashboard.points(f"kills/{name}", metric)]
                self.assertEqual(len(values), len(set(values)), "each once")
                self.assertEqual({part * number for number in numbers} - set(values), set(), "nothing acknowledged is lost")


if __name__ == "__main__":
    unittest.main()
