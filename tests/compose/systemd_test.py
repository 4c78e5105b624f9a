# SPDX-License-Identifier: Apache-2.0
"""The units under a real systemd, in a container: verified, scored, started by their target, restarted when killed."""

import json
import re
import subprocess
import tempfile
import unittest
from pathlib import Path

import support
from support import COMPOSE, PREFIX, podman, wait_for

IMAGE = f"localhost/citylearn-systemd:{support.TAG}"
NAME = f"{support.OWN}-systemd"
UNITS = ("citylearn-dashboard", "citylearn-encoder", "citylearn-env@summer", "citylearn-env@fall", "citylearn-policy@first")
# `systemd-analyze security` of each unit, 0 (confined) to 10 (exposed); docs/how-to/run-on-a-cluster.md states it.
MOST_EXPOSED = 1.6
SETTINGS = """CITYLEARN_SESSION=trial
CITYLEARN_INTERFACE=lo
ENV_OPTIONS="--dataset synthetic --frames 0:48 --agents 8 --recorders dashboard"
ENCODER_OPTIONS="--reference summer --dimension 24"
POLICY_OPTIONS="--train summer --evaluate summer,fall --frames 0:48 --tasks 50 --steps 60000 --wait 100"
DASHBOARD_OPTIONS="--port 8080"
"""
# The libraries come from the image of the services; the programs and units from where `cmake --install` put them.
CONTAINERFILE = f"""FROM {support.BASE}
RUN apt-get update && apt-get install -y --no-install-recommends systemd && rm -rf /var/lib/apt/lists/*
COPY --from={support.SERVICES} /usr/lib /usr/lib
COPY --from={support.SERVICES} /etc/alternatives /etc/alternatives
COPY --from=prefix / /usr/local
RUN systemd-sysusers && install -D /usr/local/share/citylearn/citylearn.env /etc/citylearn/example.env
"""


def without_image():
    """Builds the image; why there is none, where its packages cannot be fetched."""
    with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
        path = Path(folder) / "Containerfile"
        path.write_text(CONTAINERFILE)
        done = subprocess.run(["podman", "build", "--quiet", "--build-context", f"prefix={PREFIX}", "--tag", IMAGE, "--file", path, folder],
                              capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return ""
    if re.search("Failed to fetch|Unable to locate package|has no installation candidate", done.stdout + done.stderr):
        return "the package systemd cannot be fetched into an image here"
    raise SystemExit(done.stdout + done.stderr)


class Systemd(unittest.TestCase):
    def setUp(self):
        self.addCleanup(podman, "rm", "--force", "--time", "5", "--volumes", NAME, check=False)
        # --privileged stays out: systemd needs the right to make namespaces for the confinement of the units.
        podman("run", "--detach", "--systemd=always", "--cap-add", "SYS_ADMIN", "--security-opt", "seccomp=unconfined",
               "--name", NAME, IMAGE, "/lib/systemd/systemd")
        wait_for("systemd runs", 60, lambda: self.inside("systemctl", "is-system-running", check=False) in ("running", "degraded"))

    def inside(self, *words, check=True):
        return podman("exec", NAME, *words, check=check)

    def property_of(self, unit, name):
        return self.inside("systemctl", "show", "--value", "-p", name, unit)

    def report(self):
        return self.inside("journalctl", "--no-pager", "-n", "60", check=False)

    def test_verify_finds_nothing_and_each_is_confined(self):
        units = [f"/usr/local/lib/systemd/system/{path.name}" for path in sorted((COMPOSE / "systemd").glob("citylearn*.[st]*"))
                 if path.suffix in (".service", ".target")]
        self.assertEqual(len(units), 6)
        self.assertEqual(self.inside("systemd-analyze", "verify", *units), "")
        for unit in UNITS:
            said = self.inside("systemd-analyze", "security", "--no-pager", unit)
            score = float(re.search(r"Overall exposure level for \S+: ([\d.]+)", said)[1])
            print(f"{unit}: {score}", flush=True)
            self.assertLessEqual(score, MOST_EXPOSED, said)

    def test_the_target_starts_all_and_systemd_restarts_what_dies(self):
        with tempfile.NamedTemporaryFile("w", suffix=".env") as file:
            file.write(SETTINGS)
            file.flush()
            podman("cp", file.name, f"{NAME}:/etc/citylearn/citylearn.env")
        self.inside("systemctl", "enable", "citylearn.target", *UNITS)
        self.inside("systemctl", "start", "citylearn.target")
        for unit in UNITS[:-1]:
            wait_for(f"{unit} runs", 30, lambda unit=unit: self.property_of(unit, "ActiveState") == "active", self.report)
            self.assertEqual(self.property_of(unit, "User"), "citylearn")
        self.inside("systemctl", "kill", "--signal", "KILL", "citylearn-env@summer")
        wait_for("the env_service is restarted", 30, lambda: self.property_of("citylearn-env@summer", "NRestarts") == "1" and
                 self.property_of("citylearn-env@summer", "ActiveState") == "active", self.report)
        summary = "/var/lib/citylearn/runs/first/summary.json"
        wait_for("the run's results", 120, lambda: '"evaluate"' in self.inside("cat", summary, check=False), self.report)
        for figures in json.loads(self.inside("cat", summary))["evaluate"].values():
            self.assertGreater(figures["spl"], 0.95)
        wait_for("the policy_service has ended well", 30, lambda: self.property_of(UNITS[-1], "ActiveState") == "inactive", self.report)
        self.assertEqual(self.property_of(UNITS[-1], "Result"), "success", self.report())

    def test_a_wrong_option_is_not_tried_again(self):
        self.inside("sh", "-c", "echo 'ENCODER_OPTIONS=--no-such-option' >/etc/citylearn/encoder.env")
        self.inside("systemctl", "start", "citylearn-encoder")
        wait_for("it has failed", 30, lambda: self.property_of("citylearn-encoder", "ActiveState") == "failed", self.report)
        self.assertEqual(self.property_of("citylearn-encoder", "NRestarts"), "0")
        self.assertIn("no-such-option", self.report())


if __name__ == "__main__":
    reason = support.missing(images=(support.SERVICES, support.BASE)) or without_image()
    unittest.addModuleCleanup(podman, "image", "rm", "--force", IMAGE, check=False)
    support.main(reason)
