# SPDX-License-Identifier: Apache-2.0
"""compose/hosts itself, on services that are a line of shell each."""

import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

import support


class Engine(unittest.TestCase):
    def setUp(self):
        self.folder = Path(tempfile.mkdtemp(prefix="citylearn-"))
        self.addCleanup(shutil.rmtree, self.folder)

    def file(self, text):
        path = self.folder / "trial.yaml"
        path.write_text(text)
        return path

    def up(self, text, *options, **more):
        return support.Up(self.file(text), *options, **more)

    def test_a_service_has_its_own_process_network_mounts_user_and_names(self):
        with self.up("""
services:
  one:
    command: [sh, -c, "echo I am $$$$ $$(id -u):$$(id -g) on $$(hostname); getent hosts two far; touch /shared/ours; ls -A /tmp;
      touch /forbidden || touch /usr/forbidden || touch /etc/forbidden || ls /proc | grep -c '^[0-9]'; ip -br address show eth0"]
    user: "12345:12345"
    read_only: true
    tmpfs: [/tmp]
    extra_hosts: {far: 10.9.9.9}
    volumes: ["shared:/shared"]
    networks: {net: {ipv4_address: 10.99.0.7}}
  two: {command: [sleep, infinity], networks: [net]}
networks: {net: {ipam: {config: [{subnet: 10.99.0.0/24}]}}}
volumes: {shared: {}}
""", "--exit-code-from", "one") as up:
            self.assertEqual(up.end(), 0, up.report())
            said = up.log("one")
            self.assertIn("I am 1 12345:12345 on one\n", said)
            self.assertRegex(said, r"10\.99\.0\.2 +two\n10\.9\.9\.9 +far\n")
            self.assertEqual(said.count("Read-only file system") + said.count("Permission denied"), 3, said)
            self.assertRegex(said, r"\n[123]\n", "it sees no processes but its own")
            self.assertIn("10.99.0.7/24", said)
            self.assertEqual((up.volumes / "shared/ours").stat().st_uid, 12345)
            self.assertEqual(up.leftovers(), [])

    def test_services_reach_each_other_and_nobody_else(self):
        with self.up("""
services:
  ear: {command: [bash, -c, "exec python3 -m http.server 8000 --bind 0.0.0.0 --directory /tmp"], tmpfs: /tmp,
    healthcheck: {test: [CMD, bash, -c, "exec 3<>/dev/tcp/127.0.0.1/8000"], interval: 200ms}}
  mouth: {command: [bash, -c, "(exec 3<>/dev/tcp/ear/8000) && echo heard; ! (exec 3<>/dev/tcp/192.0.2.1/80)"],
    depends_on: {ear: {condition: service_healthy}}}
""", "--exit-code-from", "mouth") as up:
            self.assertEqual(up.end(), 0, up.report())
            self.assertIn("heard", up.log("mouth"))
            self.assertIn("unreachable", up.log("mouth"))

    def test_restarts_follow_the_policy_and_wait_longer_each_time(self):
        with self.up("""
services:
  failing: {command: [sh, -c, "exit 3"], restart: on-failure:3}
  ending: {command: "true", restart: on-failure}
  always: {command: "true", restart: always}
  never: {command: [sh, -c, "exit 4"]}
""") as up:
            for service, status, restarts in (("failing", 3, 3), ("ending", 0, 0), ("never", 4, 0)):
                up.wait_state(service, "state", "exited")
                state = up.states()[service]
                self.assertEqual((state["status"], state["restarts"]), (status, restarts), service)
            support.wait_for("always is started again", 10, lambda: up.states()["always"]["restarts"] >= 3)
            for pause in ("0.1 s", "0.2 s", "0.4 s"):
                self.assertIn(f"failing: ended with status 3, starts again in {pause}", up.output.read_text())

    def test_health_and_dependencies(self):
        with self.up("""
services:
  first: {command: [sh, -c, "exit 0"]}
  second: {command: [sleep, infinity], depends_on: {first: {condition: service_completed_successfully}},
    healthcheck: {test: [CMD, test, -e, /flags/good], interval: 100ms, retries: 2}, volumes: ["flags:/flags"]}
  third: {command: [sh, -c, "echo here"], depends_on: {second: {condition: service_healthy}}}
volumes: {flags: }
""") as up:
            up.wait_state("second", "health", "unhealthy")
            self.assertEqual(up.states()["third"]["state"], "created")
            (up.volumes / "flags/good").touch()
            up.wait_state("third", "state", "exited")
            self.assertEqual(up.log("third"), "here\n")
            (up.volumes / "flags/good").unlink()
            up.wait_state("second", "health", "unhealthy")

    def test_limits_are_kept_or_their_absence_is_said(self):
        with self.up("""
services:
  greedy:
    command: [python3, -c, "print(len(b'x' * 300_000_000))"]
    deploy: {resources: {limits: {memory: 64m, cpus: "0.5", pids: 50}}}
""", "--exit-code-from", "greedy") as up:
            status = up.end()
            said = up.output.read_text()
            if "without its limit" in said:
                self.assertRegex(said, r"greedy: runs without its limit of (memory|cpu|pids) \(")
            else:
                self.assertEqual(status, 137, said)

    def test_replicas_are_services_of_their_own(self):
        with self.up("""
services:
  many: {command: [sleep, infinity], deploy: {replicas: 3}, networks: [net]}
  one: {command: [sleep, infinity], networks: {net: {ipv4_address: 10.99.0.2}}}
networks: {net: {ipam: {config: [{subnet: 10.99.0.0/24, ip_range: 10.99.0.128/29}]}}}
""") as up:
            for number in (1, 2, 3):
                up.wait_state(f"many-{number}", "state", "running")
            self.assertEqual([state["address"] for state in up.states().values()],
                             ["10.99.0.129", "10.99.0.130", "10.99.0.131", "10.99.0.2"])

    def test_sigterm_ends_dependents_first_and_leaves_nothing(self):
        with self.up("""
services:
  base: {command: &trap [sh, -c, "trap 'echo bye; exit 0' TERM; while :; do sleep 0.05; done"]}
  user: {command: *trap, depends_on: [base]}
  deaf: {command: [sh, -c, "trap '' TERM; while :; do sleep 0.05; done"], stop_grace_period: 300ms}
""") as up:
            for service in ("base", "user", "deaf"):
                up.wait_state(service, "state", "running")
            command = [support.COMPOSE / "hosts", "ps", self.folder / "trial.yaml", "--project", up.project]
            self.assertIn("running", subprocess.run(command, capture_output=True, text=True, check=True).stdout)
            self.assertEqual(up.inside("user", "hostname"), "user\n")
            logs = subprocess.run([*command[:1], "logs", *command[2:], "deaf"], capture_output=True, text=True, check=False)
            self.assertEqual((logs.returncode, logs.stdout), (0, ""))
            subprocess.run([*command[:1], "down", *command[2:]], check=True)
            self.assertEqual(up.end(), 0)
            said = up.output.read_text()
            self.assertLess(said.index("user: ended with status 0"), said.index("base: ended with status 0"), said)
            self.assertIn("deaf: did not end within 0.3 s and is killed", said)
            self.assertEqual(up.leftovers(), [])
            self.assertEqual(up.log("base"), "bye\n")

    def test_what_a_killed_one_left_is_removed_by_the_next(self):
        text = "services: {one: {command: [sleep, '98765'], deploy: {resources: {limits: {memory: 64m}}}}}"
        with self.up(text) as up:
            up.wait_state("one", "state", "running")
            pid = up.states()["one"]["pid"]
            up.process.kill()
            up.process.wait()
            support.wait_for("its service dies with it", 10, lambda: not Path(f"/proc/{pid}").exists())
            self.assertNotEqual(up.leftovers(), [])
            with self.up(text) as other:
                other.wait_state("one", "state", "running")
                self.assertEqual(up.leftovers(), [])

    def test_one_project_runs_once(self):
        with self.up("services: {one: {command: [sleep, infinity]}}") as up:
            up.wait_state("one", "state", "running")
            with self.up("services: {one: {command: [sleep, infinity]}}") as other:
                self.assertEqual(other.end(), 2)
                self.assertIn("runs already (--project gives another name)", other.output.read_text())


if __name__ == "__main__":
    support.main([support.without_yaml(), support.without_namespaces()])
