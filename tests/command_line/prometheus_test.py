# SPDX-License-Identifier: Apache-2.0
"""compose/prometheus with Debian's Prometheus and real services on loopback: what they serve, what it scrapes, and its alerts."""

import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
import unittest
import urllib.error
import urllib.parse
import urllib.request

from support import BUILD, SOURCE, CommandLine, free_ports

FILES = SOURCE / "compose/prometheus"
PATH = f"{os.environ['PATH']}:{BUILD}/prometheus/usr/bin"  # where `./run test` unpacks the package
PROMETHEUS, PROMTOOL = (shutil.which(program, path=PATH) for program in ("prometheus", "promtool"))


def get(port, path):
    """Status and text of an answer; status 0 when nobody answers."""
    try:
        with urllib.request.urlopen(f"http://127.0.0.1:{port}{path}", timeout=5) as answer:
            return answer.status, answer.read().decode()
    except urllib.error.HTTPError as error:
        return error.code, error.read().decode()
    except OSError as error:
        return 0, str(error)


class Files(CommandLine):
    def promtool(self, *words):
        said = self.run_command(PROMTOOL, *words)
        self.assertIn("SUCCESS", said)
        self.assertNotRegex(said, "(?i)warn|fail|error")

    def test_promtool_finds_nothing(self):
        self.promtool("check", "config", FILES / "prometheus.yml")
        self.promtool("check", "rules", FILES / "alerts.yml")

    def test_alerts_are_raised_by_what_they_are_for(self):
        self.promtool("test", "rules", SOURCE / "tests/command_line/alerts_test.yml")


class Run(CommandLine):
    """A training with two env_services and the dashboard, watched by a Prometheus."""

    def setUp(self):
        super().setUp()
        names = ("env-train", "env-evaluate", "encoder", "policy", "dashboard", "page", "prometheus")
        self.ports = dict(zip(names, free_ports(len(names))))
        self.processes = {}
        self.addCleanup(lambda: [self.end_named(name) for name in list(self.processes)])

    def start_named(self, name, *words):
        self.end_named(name)
        with open(self.folder / f"{name}.log", "ab") as log:
            self.processes[name] = subprocess.Popen([str(word) for word in words], cwd=self.folder, env=self.environment,
                                                    stdin=subprocess.DEVNULL, stdout=log, stderr=log)

    def serve(self, name, program, *words):
        self.start_named(name, program, "--id", name, "--metrics", self.ports[name], "--log-format", "json", *words)

    def serve_env(self, name, traversal):
        self.serve(name, "env_service", "--dataset", "synthetic", "--traversal", traversal, "--frames", "0:64", "--agents", 8)

    def end_named(self, name, how=signal.SIGKILL):
        process = self.processes.pop(name, None)
        if process:
            process.send_signal(how)
            process.wait(30)

    def wait_until(self, what, condition, seconds=90):
        until = time.monotonic() + seconds
        while not condition():
            self.assertLess(time.monotonic(), until, f"not in time: {what}\n" + self.logs())
            time.sleep(0.1)

    def logs(self):
        return "".join(f"--- {log.name}\n{log.read_text()[-1500:]}" for log in sorted(self.folder.glob("*.log")))

    def query(self, expression):
        """Value by instance."""
        status, text = get(self.ports["prometheus"], "/api/v1/query?query=" + urllib.parse.quote(expression))
        if status != 200:
            return {}
        return {each["metric"].get("instance", ""): float(each["value"][1]) for each in json.loads(text)["data"]["result"]}

    def firing(self):
        """Alerts that fire, with their instances."""
        alerts = json.loads(get(self.ports["prometheus"], "/api/v1/alerts")[1])["data"]["alerts"]
        return {(each["labels"]["alertname"], each["labels"].get("instance", "")) for each in alerts if each["state"] == "firing"}

    def start_prometheus(self):
        """With the settings of compose/ but for where the services are and how long everything takes."""
        settings = (FILES / "prometheus.yml").read_text()
        settings, intervals = re.subn(r"_interval: 5s\n  eval\w+: 5s", "_interval: 1s\n  evaluation_interval: 1s", settings)
        targets = [f"127.0.0.1:{port}" for name, port in self.ports.items() if name not in ("page", "prometheus")]
        settings, places = re.subn(r"    dns_sd_configs:\n(      .*\n)+", f"    static_configs: [{{targets: {json.dumps(targets)}}}]\n", settings)
        alerts, delays = re.subn(r"for: \w+", "for: 1s", (FILES / "alerts.yml").read_text())
        self.assertEqual((intervals, places), (1, 1))
        self.assertGreater(delays, 3)
        (self.folder / "prometheus.yml").write_text(settings)
        (self.folder / "alerts.yml").write_text(alerts)
        self.start_named("prometheus", PROMETHEUS, "--config.file=prometheus.yml", "--storage.tsdb.path=data",
                   f"--web.listen-address=127.0.0.1:{self.ports['prometheus']}")

    def test_prometheus_watches_a_training(self):
        self.serve_env("env-train", "summer")
        self.serve_env("env-evaluate", "fall")
        self.serve("encoder", "encoder_service", "--reference", "summer", "--store", "none")
        self.serve("dashboard", "dashboard", "--port", self.ports["page"], "--store", "dashboard.sqlite")
        self.serve("policy", "policy_service", "--train", "summer", "--evaluate", "fall", "--frames", "0:64", "--agent", "place_filter",
                   "--steps", 1_000_000_000, "--output", "results")
        self.start_prometheus()
        services = {name: f"127.0.0.1:{port}" for name, port in self.ports.items() if name not in ("page", "prometheus")}
        self.wait_until("all are scraped", lambda: self.query('up{job="citylearn"}') == dict.fromkeys(services.values(), 1.0))
        self.wait_until("training figures", lambda: self.query("citylearn_training_update > 3").keys() == {services["policy"]})
        self.wait_until("steps", lambda: services["env-train"] in self.query("citylearn_steps_per_second > 0"))
        self.wait_until("nothing is wrong", lambda: not self.firing())

        scraped = set(json.loads(get(self.ports["prometheus"], "/api/v1/label/__name__/values")[1])["data"])
        for file in ("grafana.json", "alerts.yml"):
            named = set(re.findall(r"\bcitylearn_[a-z_]+", (FILES / file).read_text()))
            self.assertGreater(len(named), 4)
            self.assertEqual(named - scraped, set(), file)
        for name, port in self.ports.items():
            if name != "prometheus":
                self.assertEqual(get(port, "/healthz"), (200, "ok\n"), name)
                status, text = get(port, "/metrics")
                self.assertEqual(status, 200)
                lint = subprocess.run([PROMTOOL, "check", "metrics"], input=text, capture_output=True, text=True, check=False)
                self.assertEqual((lint.returncode, lint.stdout + lint.stderr), (0, ""), name)

        gone = ("CitylearnServiceGone", services["env-evaluate"])
        self.end_named("env-evaluate")
        self.wait_until("an alert of the env_service that was killed", lambda: gone in self.firing())
        self.serve_env("env-evaluate", "fall")
        self.wait_until("its end", lambda: not self.firing())

        self.processes["env-train"].send_signal(signal.SIGSTOP)
        self.wait_until("an alert that nobody moves", lambda: ("CitylearnServiceGone", services["env-train"]) in self.firing())
        self.processes["env-train"].send_signal(signal.SIGCONT)
        self.wait_until("its end", lambda: not self.firing())

        for name in ("policy", "env-train", "env-evaluate", "encoder", "dashboard"):
            self.end_named(name, signal.SIGTERM)
            for line in (self.folder / f"{name}.log").read_text().splitlines():
                if not line.startswith("dashboard: http"):  # what it prints is not of its log
                    self.assertEqual(json.loads(line)["service"], re.sub("-.*", "", name) + ("" if name == "dashboard" else "_service"), line)


if __name__ == "__main__":
    if not PROMTOOL or not PROMETHEUS:
        print("skipped: prometheus is missing (package prometheus)")
        sys.exit(77)
    unittest.main(verbosity=2)
