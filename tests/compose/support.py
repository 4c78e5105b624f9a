# SPDX-License-Identifier: Apache-2.0
"""What the tests of compose/ share. Each is called with the folder into which the programs are installed."""

import csv
import json
import os
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
COMPOSE = SOURCE / "compose"
PREFIX = Path(sys.argv.pop(1)) if len(sys.argv) > 1 else Path("/usr/local")
STATES = Path("/run/citylearn-hosts")
sys.path.insert(0, str(COMPOSE))


def main(needs=()):
    """Runs the calling file's tests; `needs`: reasons to skip all of them, empty ones count for nothing."""
    for reason in needs:
        if reason:
            print("skipped:", reason)
            sys.exit(77)
    unittest.main(verbosity=2)


def without_yaml():
    try:
        import yaml  # noqa: F401
    except ImportError:
        return "python3-yaml is missing"
    return ""


def without_namespaces():
    """Why no host can be made here; empty when one can."""
    if os.geteuid() != 0:
        return "only root can make network namespaces"
    name = f"citylearn-test-{os.getpid()}"
    try:
        said = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
        if said.returncode == 0:
            subprocess.run(["ip", "netns", "delete", name], check=True)
            said = subprocess.run(["unshare", "--mount", "--pid", "--fork", "--uts", "--ipc", "true"],
                                  capture_output=True, text=True, check=False)
    except FileNotFoundError:
        return "ip is missing (package iproute2)"
    return "" if said.returncode == 0 else f"no namespaces here: {said.stderr.strip()}"


def wait_for(what, seconds, condition):
    """Until `condition` holds; AssertionError after so long."""
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise AssertionError(f"not within {seconds} s: {what}")
        time.sleep(0.05)


class Up:
    """`compose/hosts up FILE`, as a context: ends with it, whatever happened."""

    def __init__(self, file, *options, settings=None, seconds=120):
        self.file = file
        self.options = [option for option in options if option == "--profile" or option == "*"]
        self.project = f"test-{os.getpid()}-{Path(file).stem}"
        self.seconds = seconds
        self.temporary = tempfile.TemporaryDirectory(prefix="citylearn-")
        self.folder = Path(self.temporary.name)
        self.volumes = self.folder / "volumes"
        env_file = self.folder / "settings.env"
        env_file.write_text("".join(f"{name}={value}\n" for name, value in (settings or {}).items()))
        self.output = self.folder / "output"
        command = [COMPOSE / "hosts", "up", file, "--prefix", PREFIX, "--volumes", self.volumes, "--project", self.project,
                   "--env-file", env_file, *options]
        clean = {name: value for name, value in os.environ.items() if name not in (settings or {})}
        with open(self.output, "wb") as output:
            self.process = subprocess.Popen([str(word) for word in command], stderr=output, stdout=output, env=clean)

    def __enter__(self):
        return self

    def __exit__(self, kind, error, trace):
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGTERM)
            try:
                self.process.wait(30)
            except subprocess.TimeoutExpired:
                self.process.kill()
                self.process.wait()
        if kind:
            print(self.report(), file=sys.stderr)
        self.temporary.cleanup()
        shutil.rmtree(STATES / self.project, ignore_errors=True)
        (STATES / f"{self.project}.lock").unlink(missing_ok=True)

    def report(self):
        """What everybody said, for a test that failed."""
        text = f"---- compose/hosts\n{self.output.read_text()}"
        for log in sorted((STATES / self.project / "logs").glob("*")):
            text += f"---- {log.name}\n" + "\n".join(log.read_text(errors="replace").splitlines()[-25:]) + "\n"
        return text

    def states(self):
        try:
            state = json.loads((STATES / self.project / "state.json").read_text())
        except OSError:
            return {}
        return state["services"] if state["owner"] == self.process.pid else {}  # else of one that was killed

    def log(self, service):
        path = STATES / self.project / "logs" / f"{service}.log"
        return path.read_text(errors="replace") if path.exists() else ""

    def inside(self, service, *words):
        """What a command that runs inside a service says."""
        command = [COMPOSE / "hosts", "exec", self.file, "--project", self.project, "--env-file", self.folder / "settings.env"]
        return subprocess.run([*command, *self.options, service, *words], capture_output=True, text=True, check=True).stdout

    def wait_state(self, service, key, value):
        def holds():
            if self.process.poll() is not None:
                raise AssertionError(f"compose/hosts has ended; {service}'s {key} was to become {value}")
            return self.states().get(service, {}).get(key) == value
        wait_for(f"{service}'s {key} is {value}", self.seconds, holds)

    def kill(self, service):
        """-9, and it is there again with one restart more."""
        before = self.states()[service]
        os.kill(before["pid"], signal.SIGKILL)
        self.wait_state(service, "restarts", before["restarts"] + 1)
        self.wait_state(service, "state", "running")

    def end(self):
        """Waits for its own end and returns the status."""
        return self.process.wait(self.seconds)

    def leftovers(self):
        """Namespaces, control groups and processes of this one that are still there."""
        mine = f"citylearn-hosts-{self.process.pid}-"
        found = subprocess.run(["ip", "netns", "list"], capture_output=True, text=True, check=True).stdout.split()
        found += [str(path) for path in Path("/sys/fs/cgroup").glob(f"*/{mine}*")]
        found += [str(path) for path in Path("/sys/fs/cgroup").glob(f"{mine}*")]
        return [name for name in found if mine in name]


class Topology(unittest.TestCase):
    """A run of the drawn city in a compose file's services: small, and long enough for somebody to be killed in it."""

    SETTINGS = {
        "SESSION": "trial", "FRAMES": "0:48", "PLACES": "48", "ENCODER_OPTIONS": "--dimension 24", "HEALTH_INTERVAL": "1s",
        # The learning rate falls with the steps done, here never: the recommended one is too high for that.
        "POLICY_OPTIONS": "--steps 100000000 --time-limit 10 --tasks 50 --checkpoint-every 20 --ppo-learning-rate 0.002",
    }

    def expect_all_healthy(self, up, learner):
        """All at once, while the learner still learns. Without the program that asks, the dashboard alone is asked."""
        asked = (PREFIX / "bin/citylearn_doctor").exists()

        def good():
            if up.process.poll() is not None:
                raise AssertionError("the run has ended before all were healthy")
            states = up.states()
            return bool(states) and all(
                state["state"] == "running" and (state["health"] == "healthy" or not asked and name != "dashboard")
                for name, state in states.items())
        wait_for("all are healthy", up.seconds, good)
        checkpoints = up.volumes / "runs/trial/checkpoints"
        wait_for(f"{learner} has a checkpoint", up.seconds, lambda: any(checkpoints.glob("*.clk")))

    def expect_good_run(self, up):
        """It ended well, is on record, and the agent navigates."""
        self.assertEqual(up.end(), 0)
        folder = up.volumes / "runs/trial"
        evaluated = json.loads((folder / "summary.json").read_text())["evaluate"]
        self.assertEqual(sorted(evaluated), ["fall", "summer"])
        for figures in evaluated.values():
            self.assertGreater(figures["spl"], 0.9, evaluated)
        with open(folder / "episodes.csv", encoding="utf-8") as file:
            episodes = [(row["environment"], row["incarnation"], row["episode"]) for row in csv.DictReader(file)]
        self.assertGreater(len(episodes), 100)
        self.assertEqual(len(episodes), len(set(episodes)), "an episode stands there twice")
        self.assertEqual(up.leftovers(), [])
