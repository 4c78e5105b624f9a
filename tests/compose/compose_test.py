# SPDX-License-Identifier: Apache-2.0
"""Each compose file under podman-compose: it trains to the end though services are killed, and leaves nothing."""

import os
import re
import signal
import subprocess
import tempfile
import unittest
from contextlib import ExitStack
from pathlib import Path

import support
from support import COMPOSE, Project, call, wait_for


class SingleNode(unittest.TestCase):
    def test_trains_to_the_end_though_services_are_killed(self):
        with Project("single-node.yaml") as project:
            project.up()
            project.expect_all_healthy()
            page = call("curl", "-sS", "--max-time", "10", f"http://localhost:{project.settings['PORT']}/")
            self.assertIn("<!doctype html>", page.lower())
            project.kill("env-train")
            project.finish(self)

    def test_services_at_their_memory_limit_come_back_and_nothing_is_lost(self):
        def train(disturb):
            options = "--lockstep --steps 1000000 --tasks 50 --checkpoint-every 20"
            with Project("single-node.yaml", POLICY_OPTIONS=options) as project:
                text = re.sub(r"memory: \dg", "memory: 300m", project.file.read_text())
                text = text.replace("environment: &wire\n", "environment: &wire\n    LD_PRELOAD: /leak.so\n")
                project.file.write_text(text.replace("volumes: [", f'volumes: ["{support.MEMORY_LEAK}:/leak.so:ro", '))
                project.up()
                checkpoints = project.volume("runs") / "trial/checkpoints"
                wait_for("a checkpoint", 60, lambda: any(checkpoints.glob("*.clk")), project.report)
                for service in ("policy", "env-train", "encoder", "dashboard") if disturb else ():
                    project.kill(service, by=signal.SIGUSR2)
                wait_for("it has trained", 200, lambda: project.inspect("policy", ".State.Status") == "exited", project.report)
                self.assertEqual(project.inspect("policy", ".State.ExitCode"), "0", project.report())
                if disturb:
                    self.assertIn("resuming after update", project.log("policy"))
                return support.newest_checkpoint(project.volume("runs") / "trial")

        self.assertEqual(train(True), train(False))


class ScaleOut(unittest.TestCase):
    def test_all_can_be_scaled_while_it_trains(self):
        with Project("scale-out.yaml", ENVS=2) as project:
            project.up(ACTORS=1, ENCODERS=1)
            project.expect_all_healthy()
            project.up(ACTORS=3, ENCODERS=2)
            project.expect_all_healthy()
            wait_for("three actors", 60, lambda: len(set(re.findall(r"actor '(\S+)' joins", project.log("learner")))) == 3, project.report)
            for service, number in (("actor", 2), ("encoder", 1), ("env", 2)):
                project.kill(service, number)
            project.finish(self, "learner")


class MultiHost(unittest.TestCase):
    """Two network namespaces are the hosts."""

    def setUp(self):
        self.stack = ExitStack()
        self.addCleanup(self.stack.close)
        bridge = f"cl{os.getpid()}"
        self.ip("link", "add", bridge, "type", "bridge")
        self.stack.callback(self.ip, "link", "delete", bridge)
        self.ip("link", "set", bridge, "up")
        self.hosts = {}
        for number in (1, 2):
            name = f"{bridge}-{number}"
            self.ip("netns", "add", name)
            self.stack.callback(self.ip, "netns", "delete", name)
            self.ip("link", "add", f"{bridge}v{number}", "master", bridge, "up", "type", "veth", "peer", "wire", "netns", name)
            self.ip("-n", name, "address", "add", f"198.51.100.{number}/24", "dev", "wire")
            self.ip("-n", name, "link", "set", "wire", "up")
            self.ip("-n", name, "link", "set", "lo", "up")
            self.hosts[number] = f"/run/netns/{name}"

    @staticmethod
    def ip(*words):
        call("ip", *words)

    def start(self, project):
        for host, services in ((1, ["env-train", "env-evaluate", "encoder"]), (2, ["dashboard", "policy"])):
            project.entering |= dict.fromkeys(services, ["nsenter", f"--net={self.hosts[host]}"])
            project.up(*services, before=project.entering[services[0]],
                       options=["--podman-path", COMPOSE / "podman-host-network"])

    def test_two_hosts_find_each_other_by_unicast_and_again_when_one_is_killed(self):
        for middleware in ("cyclonedds", "fastdds"):
            with self.subTest(middleware), Project("multi-host.yaml", PEERS="198.51.100.1,198.51.100.2", INTERFACE="wire",
                                                   MIDDLEWARE=middleware, PORT=8080) as project:
                self.start(project)
                project.expect_all_healthy()
                project.kill("env-train")
                project.finish(self)


class Secure(unittest.TestCase):
    def setUp(self):
        self.keys = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-"))) / "keys"

    def make_keys(self):
        """The commands of the file's own comment."""
        text = (COMPOSE / "secure.yaml").read_text()
        commands = re.search(r"^#   compose/keystore create.*?^#   END$.*?\n#   sudo chown.*?$", text, re.MULTILINE | re.DOTALL)[0]
        script = re.sub(r"compose/keys\b", str(self.keys), re.sub(r"^#   (sudo )?", "", commands, flags=re.MULTILINE))
        subprocess.run(["bash", "-euc", script], cwd=support.SOURCE, check=True, stdout=subprocess.DEVNULL)

    def test_trains_to_the_end_though_a_service_is_killed(self):
        self.make_keys()
        for middleware in ("cyclonedds", "fastdds"):
            with self.subTest(middleware), Project("secure.yaml", MIDDLEWARE=middleware, KEYS=self.keys) as project:
                project.up()
                project.expect_all_healthy()
                project.finish(self)

    def test_a_service_without_its_keys_does_not_start(self):
        with Project("secure.yaml", KEYS=self.keys) as project:
            project.up("env-train")
            wait_for("a complaint", 30, lambda: "/keys/env-train" in project.log("env-train"), project.report)


if __name__ == "__main__":
    support.main(support.missing(["podman-compose", "curl", "ip", "nsenter"]))
