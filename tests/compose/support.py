# SPDX-License-Identifier: Apache-2.0
"""What the tests in containers share: images of this build, compose projects, and waiting. Each test is called with the folder
into which the programs are installed. Needs root, podman and podman-compose; no registry is asked."""

import csv
import json
import os
import platform
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import unittest
import zlib
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
COMPOSE = SOURCE / "compose"
PREFIX = Path(sys.argv.pop(1)) if len(sys.argv) > 1 else Path("/usr/local")
BASE = f"docker.io/library/debian:{platform.freedesktop_os_release().get('VERSION_CODENAME')}"  # what the programs were built on
OWN = f"citylearn-test-{os.getpid()}"  # begins every name: several tests do not meet
TAG = f"test-{zlib.crc32(bytes(PREFIX)):x}"  # of images; two builds do not share them
SERVICES, DASHBOARD = f"localhost/citylearn-dds:{TAG}", f"localhost/citylearn-dashboard:{TAG}"
MEMORY_LEAK = os.environ.get("CITYLEARN_MEMORY_LEAK", "")  # preloaded into a service, it makes it exceed its limit at SIGUSR2


def call(*words, check=True, **options):
    """What a command says. An error shows the command and all that it said."""
    done = subprocess.run([str(word) for word in words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace",
                          check=False, **options)
    if check and done.returncode != 0:
        raise AssertionError(f"status {done.returncode}: {' '.join(map(str, words))}\n{done.stdout}")
    return done.stdout


def podman(*words, check=True):
    return call("podman", "--log-level=fatal", *words, check=check).strip()


def status_of(*words):
    return subprocess.run(list(map(str, words)), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL, check=False).returncode


def wait_for(what, seconds, condition, report=None):
    """Until `condition` holds; AssertionError after so long, with what `report` returns."""
    until = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > until:
            raise AssertionError(f"not within {seconds} s: {what}\n{report() if report else ''}")
        time.sleep(0.1)


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def missing(programs=(), images=(SERVICES, DASHBOARD)):
    """Why nothing can be tested here; empty when it can."""
    if os.geteuid() != 0:
        return "only root can make containers and networks here"
    for program in ("podman", *programs):
        if not shutil.which(program):
            return f"{program} is missing"
    backend = subprocess.run(["podman", "info", "--format", "{{.Host.NetworkBackend}}"], capture_output=True, text=True, check=False)
    if backend.returncode != 0:
        return "podman does not run here (`podman info` says why)"
    if backend.stdout.strip() != "netavark":
        return "podman's networks have no names (packages netavark and aardvark-dns; `podman system reset` chooses them)"
    for image in images:
        if status_of("podman", "image", "exists", image) != 0:
            return f"the image {image} is not in podman's store"
    return ""


def build_image(image, containerfile, *options):
    """Builds an image; why there is none, where its packages cannot be fetched."""
    with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
        path = Path(folder) / "Containerfile"
        path.write_text(containerfile)
        done = subprocess.run(["podman", "build", "--quiet", *options, "--tag", image, "--file", path, folder],
                              capture_output=True, text=True, check=False)
    if done.returncode == 0:
        return ""
    if re.search("Failed to fetch|Unable to locate package|has no installation candidate", done.stdout + done.stderr):
        return "its packages cannot be fetched into an image here"
    raise SystemExit(done.stdout + done.stderr)


def main(reason):
    """Runs the calling file's tests, or says why not. A signal ends it as an error does: everything is removed."""
    if reason:
        print("skipped:", reason)
        sys.exit(77)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    unittest.main(verbosity=2)


class Project:
    """A compose file under podman-compose, as a context: gone with its containers, networks and volumes, whatever happened."""

    SETTINGS = {
        "IMAGE": SERVICES, "DASHBOARD_IMAGE": DASHBOARD, "SESSION": "trial", "FRAMES": "0:48", "PLACES": "48",
        "ENCODER_OPTIONS": "--dimension 24",
        # A file in the volume, so that the test says when it has trained long enough: `finish`. The learning rate falls with the
        # steps done, here never: the recommended one is too high for that.
        "POLICY_OPTIONS": "--config /runs/limit.toml --steps 100000000 --tasks 50 --checkpoint-every 20 --ppo-learning-rate 0.002",
    }

    def __init__(self, file, **settings):
        self.name = f"{OWN}-{Path(file).stem}"
        # A .env beside the file, as an engine reads it. podman-compose makes folders that it does not find beside it, too.
        self.temporary = tempfile.TemporaryDirectory(prefix="citylearn-")
        self.file = Path(self.temporary.name) / Path(file).name
        shutil.copy(COMPOSE / file, self.file)
        self.entering = {}  # of services on another host's network: the command that enters it
        self.settings = self.SETTINGS | {"PORT": free_port()} | settings

    def __enter__(self):
        podman("volume", "create", "--label", f"io.podman.compose.project={self.name}", f"{self.name}_runs")
        os.chown(self.volume("runs"), 10001, 10001)
        self.limit(3600)
        return self

    def limit(self, seconds):
        (self.volume("runs") / "limit.toml").write_text(f"time-limit = {seconds}\n")

    def __exit__(self, kind, error, trace):
        if kind:
            print(self.report(), file=sys.stderr)
        for what, words in (("ps", ["rm", "--force", "--time", "2", "--volumes"]), ("network ls", ["network", "rm", "--force"]),
                            ("volume ls", ["volume", "rm", "--force"])):
            found = self.all_of(what)
            if found:
                podman(*words, *found, check=False)
        self.temporary.cleanup()

    def all_of(self, what):
        """Names of this project's containers (`ps`), networks or volumes."""
        words = [*what.split(), *(["--all", "--format", "{{.Names}}"] if what == "ps" else ["--format", "{{.Name}}"])]
        return podman(*words, "--filter", f"label=io.podman.compose.project={self.name}").split()

    def compose(self, *words, before=(), options=()):
        """podman-compose, with the project's settings and none of the caller's."""
        known = set(re.findall(r"\$\{([A-Z_]+)", "".join(path.read_text() for path in COMPOSE.glob("*.yaml"))))
        self.file.with_name(".env").write_text("".join(f"{name}={value}\n" for name, value in self.settings.items()))
        clean = {name: value for name, value in os.environ.items() if name not in known}
        return call(*before, "podman-compose", *options, "-p", self.name, "-f", self.file, *words, env=clean)

    def up(self, *services, before=(), options=(), **settings):
        self.settings |= settings
        return self.compose("up", "-d", "--no-build", *services, before=before, options=options)

    def container(self, service, number=1):
        return f"{self.name}_{service}_{number}"

    def inspect(self, service, field, number=1):
        return podman("inspect", "--type", "container", "--format", "{{" + field + "}}", self.container(service, number), check=False)

    def log(self, service, number=1):
        return podman("logs", self.container(service, number), check=False)

    def report(self):
        """What every container said last, for a test that failed."""
        text = podman("ps", "--all", "--filter", f"label=io.podman.compose.project={self.name}", check=False)
        for name in self.all_of("ps"):
            text += f"\n---- {name}\n" + "\n".join(podman("logs", "--tail", "25", name, check=False).splitlines()[-25:])
        return text

    def volume(self, name):
        return Path(podman("volume", "inspect", "--format", "{{.Mountpoint}}", f"{self.name}_{name}"))

    def healthy(self, name):
        entering = self.entering.get(name.removeprefix(f"{self.name}_").rpartition("_")[0], [])
        return status_of(*entering, "podman", "healthcheck", "run", name) == 0

    def expect_all_healthy(self, seconds=60):
        """Each container's own health check succeeds, all while the learner still learns."""
        def expect_healthy(name):
            wait_for(f"{name} is healthy", seconds, lambda: self.healthy(name), self.report)

        with ThreadPoolExecutor() as pool:
            list(pool.map(expect_healthy, self.all_of("ps")))
        wait_for("a checkpoint", seconds, lambda: any((self.volume("runs") / "trial/checkpoints").glob("*.clk")), self.report)

    def kill(self, service, number=1, by=signal.SIGKILL):
        """Ends it, and the engine starts it again."""
        before = int(self.inspect(service, ".State.Pid", number))
        os.kill(before, by)
        wait_for(f"{service} runs again", 30, lambda: int(self.inspect(service, ".State.Pid", number) or 0) not in (0, before), self.report)

    def finish(self, test, learner="policy", seconds=120):
        """Kills the learner, which then continues for a second only. It ends well, is on record, and the agent navigates. Then
        nothing is left after `down`."""
        self.limit(1)
        self.kill(learner)
        wait_for(f"{learner} has ended", seconds, lambda: self.inspect(learner, ".State.Status") == "exited", self.report)
        test.assertEqual(self.inspect(learner, ".State.ExitCode"), "0", self.log(learner)[-2000:])
        test.assertIn("resuming after update", self.log(learner))
        folder = self.volume("runs") / "trial"
        evaluated = json.loads((folder / "summary.json").read_text())["evaluate"]
        test.assertEqual(sorted(evaluated), ["fall", "summer"])
        for figures in evaluated.values():
            test.assertGreater(figures["spl"], 0.95, evaluated)
        with open(folder / "episodes.csv", encoding="utf-8") as file:
            episodes = [(row["environment"], row["incarnation"], row["episode"]) for row in csv.DictReader(file)]
        test.assertGreater(len(episodes), 100)
        test.assertEqual(len(episodes), len(set(episodes)), "an episode stands there twice")
        self.compose("down", "-v", "-t", "10")
        test.assertEqual(self.all_of("ps") + self.all_of("volume ls"), [])
        podman("network", "rm", *self.all_of("network ls"))  # podman-compose 1.0.3 leaves it


def newest_checkpoint(folder):
    """Its name and bytes."""
    newest = max((folder / "checkpoints").glob("checkpoint-*.clk"))
    return newest.name, newest.read_bytes()


UNITS = ("citylearn-dashboard", "citylearn-encoder", "citylearn-env@summer", "citylearn-env@fall", "citylearn-policy@first")
SETTINGS = """CITYLEARN_SESSION=trial
CITYLEARN_INTERFACE=lo
ENV_OPTIONS="--dataset synthetic --frames 0:48 --agents 8 --recorders dashboard"
ENCODER_OPTIONS="--reference summer --dimension 24"
POLICY_OPTIONS="--train summer --evaluate summer,fall --frames 0:48 --tasks 50 --steps 60000 --wait 100"
DASHBOARD_OPTIONS="--port 8080"
"""


class SystemdCase(unittest.TestCase):
    """Each test has a container of IMAGE, in which a real systemd runs."""

    IMAGE = ""
    NAME = f"{OWN}-systemd"

    def setUp(self):
        self.addCleanup(podman, "rm", "--force", "--time", "5", "--volumes", self.NAME, check=False)
        # --privileged stays out: systemd needs the right to make namespaces for the confinement of the units.
        podman("run", "--detach", "--systemd=always", "--cap-add", "SYS_ADMIN", "--security-opt", "seccomp=unconfined",
               "--name", self.NAME, self.IMAGE, "/lib/systemd/systemd")
        wait_for("systemd runs", 60, lambda: self.inside("systemctl", "is-system-running", check=False) in ("running", "degraded"))

    def inside(self, *words, check=True):
        return podman("exec", self.NAME, *words, check=check)

    def property_of(self, unit, name):
        return self.inside("systemctl", "show", "--value", "-p", name, unit)

    def report(self):
        return self.inside("journalctl", "--no-pager", "-n", "60", check=False)

    def start_target(self):
        """Starts citylearn.target with all UNITS, as the user citylearn."""
        with tempfile.NamedTemporaryFile("w", suffix=".env") as file:
            file.write(SETTINGS)
            file.flush()
            podman("cp", file.name, f"{self.NAME}:/etc/citylearn/citylearn.env")
        self.inside("systemctl", "enable", "citylearn.target", *UNITS)
        self.inside("systemctl", "start", "citylearn.target")
        for unit in UNITS[:-1]:
            wait_for(f"{unit} runs", 30, lambda unit=unit: self.property_of(unit, "ActiveState") == "active", self.report)
            self.assertEqual(self.property_of(unit, "User"), "citylearn")

    def expect_trained(self):
        """The run ends well, and its agent navigates."""
        summary = "/var/lib/citylearn/runs/first/summary.json"
        wait_for("the run's results", 120, lambda: '"evaluate"' in self.inside("cat", summary, check=False), self.report)
        for figures in json.loads(self.inside("cat", summary))["evaluate"].values():
            self.assertGreater(figures["spl"], 0.95)
        wait_for("the policy_service has ended well", 30, lambda: self.property_of(UNITS[-1], "ActiveState") == "inactive", self.report)
        self.assertEqual(self.property_of(UNITS[-1], "Result"), "success", self.report())
