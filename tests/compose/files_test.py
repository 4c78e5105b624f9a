# SPDX-License-Identifier: Apache-2.0
"""What compose/ says is true of this repository: files, image, units and scripts, as far as can be told without an engine."""

import os
import re
import shutil
import subprocess
import tempfile
import unittest
from pathlib import Path

import support
from support import COMPOSE, PREFIX, SOURCE

FILES = sorted(COMPOSE.glob("*.yaml"))
UNITS = sorted((COMPOSE / "systemd").glob("*.service"))


def settings(**more):
    """An environment in which no setting of the caller counts."""
    names = set(re.findall(r"\$\{([A-Z_]+)", "".join(path.read_text() for path in FILES)))
    return {name: value for name, value in os.environ.items() if name not in names} | {"PEERS": "a,b"} | more


def topology(path, **more):
    from engine.file import load
    before = dict(os.environ)
    os.environ.clear()
    os.environ.update(settings(**more))
    try:
        return load(path, None, ["*"])
    finally:
        os.environ.clear()
        os.environ.update(before)


def said_by(*command):
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


class ComposeFiles(unittest.TestCase):
    def test_the_topologies_are_there_and_are_understood(self):
        self.assertEqual([path.stem for path in FILES], ["multi-host", "scale-out", "secure", "single-node"])
        for path in FILES:
            self.assertEqual(topology(path).name, f"citylearn-{path.stem}")

    def test_an_engine_understands_them_too(self):
        found = shutil.which("docker")
        if not found or subprocess.run([found, "compose", "version"], capture_output=True, check=False).returncode != 0:
            self.skipTest("docker compose is missing")
        for path in FILES:
            done = subprocess.run([found, "compose", "-f", path, "--profile", "*", "config", "--quiet"], env=settings(),
                                  capture_output=True, text=True, check=False)
            self.assertEqual((done.returncode, done.stderr), (0, ""), path)

    def test_each_service_is_watched_restarted_and_bounded(self):
        for path in FILES:
            for service in topology(path).services:
                where = f"{path.name}: {service.name}"
                self.assertIsNotNone(service.health, where)
                self.assertEqual(service.restart, "on-failure", where)
                self.assertTrue(service.memory and service.pids, where)
                self.assertTrue(service.read_only and service.user == "10001:10001", where)
                # One that is alone in its network says so itself; what the page's server says is enough of the dashboard.
                if "citylearn_doctor" in " ".join(service.health.test):
                    said = " ".join(service.command)
                    asked = re.search(r"--service[ ,]+(\S+)", " ".join(service.health.test))[1]
                    own = re.search(r"--id (\S+)", said)
                    self.assertEqual(asked, own[1] if own else service.name, where)
                else:
                    self.assertEqual(service.name, "dashboard", where)

    def test_peers_are_names_that_the_file_knows(self):
        for path in FILES:
            for service in topology(path).services:
                peers = service.environment["CITYLEARN_PEERS"].split(",")
                if service.host:
                    self.assertEqual(peers, ["a", "b"])
                    continue
                self.assertEqual(sorted(peers), sorted(service.extra_hosts), f"{path.name}: {service.name}")
                if service.address:
                    self.assertEqual(service.extra_hosts[service.name], service.address, f"{path.name}: {service.name}")

    def test_no_shell_reads_a_setting(self):
        def scripts(path, **more):
            for service in topology(path, **more).services:
                for command in (service.command, service.health.test):
                    yield from (word for flag, word in zip(command, command[1:]) if flag == "-c")

        names = ("SOURCE", "TRAIN", "EVALUATE", "FRAMES", "AGENTS", "PLACES", "SEED", "SESSION", "ENV_OPTIONS", "ENCODER_OPTIONS",
                 "POLICY_OPTIONS", "ACTOR_OPTIONS")
        for path in FILES:
            odd = dict.fromkeys(names + (("PORT",) if path.stem == "multi-host" else ()), "a;$(b)`c`")
            self.assertTrue(list(scripts(path)), path)
            self.assertEqual(list(scripts(path, **odd)), list(scripts(path)), path)

    def test_example_env_lists_every_setting_with_its_value(self):
        listed = dict(re.findall(r"^#([A-Z_]+)=(.*)$", (COMPOSE / "example.env").read_text(), re.MULTILINE))
        used = {}
        for path in FILES:
            for name, how, value in re.findall(r"\$\{([A-Z_]+)(:[-?])([^}]*)\}", path.read_text()):
                used.setdefault(name, set()).add(value if how == ":-" else "hostA,hostB")
        of_hosts = {"ENVS_ADDRESS", "LEARNER_ADDRESS"}  # of compose/hosts alone
        self.assertEqual(sorted(listed), sorted(set(used) - of_hosts))
        for name, value in listed.items():
            self.assertIn(value, used[name], name)
            self.assertTrue(name == "NET" or len(used[name]) == 1, f"{name} has several values: {used[name]}")


class WhatIsNotUnderstood(unittest.TestCase):
    def complaint(self, text, **variables):
        from engine.errors import ComposeError
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "trial.yaml"
            path.write_text(text)
            with self.assertRaises(ComposeError) as caught:
                topology(path, **variables)
            return str(caught.exception)

    def test_is_named(self):
        for text, wanted in (
                ("services: {x: {command: a, foo: 1}}", "service x: 'foo' is not understood"),
                ("services: {x: {command: a}}\nfoo: 1", "'foo' is not understood"),
                ("services: {x: {command: a, deploy: {resources: {reservations: {}}}}}",
                 "service x: deploy.resources: 'reservations' is not understood"),
                ("services: {x: {command: a, restart: sometimes}}", "service x: restart: 'sometimes' is not understood"),
                ("services: {x: {command: a, healthcheck: {test: [RUN, a]}}}", "service x: healthcheck.test: must be"),
                ("services: {x: {command: a, healthcheck: {test: a, interval: soon}}}", "'soon' is no duration"),
                ("services: {x: {command: a, depends_on: [y]}}", "service x: depends on 'y', which is not there"),
                ("services: {x: {command: a, volumes: ['v:/v']}}", "service x: volume 'v' is not among"),
                ("services: {x: {command: a, networks: [n]}}", "service x: network 'n' is not among"),
                ("services: {x: {command: a, network_mode: host}}", "service x: which host's network?"),
                ("services: {x: {image: a}}", "service x: has no command"),
                ("services: {x: {command: a, user: me}}", "service x: user 'me' is not understood"),
                ("services: {x: {command: '$A$'}}", "services.x.command: '$A$' has a $ that is no variable"),
                ("services: {x: {command: '${A:?the answer}'}}", "services.x.command: A is not set: the answer"),
                ("services: [", "trial.yaml: while parsing")):
            self.assertIn(wanted, self.complaint(text), text)

    def test_variables_are_as_in_an_engine(self):
        from engine.file import substitute
        variables = {"SET": "value", "EMPTY": ""}
        for text, wanted in (("$SET ${SET}", "value value"), ("${NONE:-a b}", "a b"), ("${EMPTY:-x}${EMPTY-y}", "x"),
                             ("${NONE-y}", "y"), ("$$SET", "$SET"), ("${SET:---option} ${NONE:---option c}", "value --option c"),
                             ("${NONE}", "")):
            self.assertEqual(substitute(text, variables, ""), wanted, text)


class Image(unittest.TestCase):
    TEXT = (COMPOSE / "Containerfile").read_text()

    def stages(self):
        return re.split(r"^FROM ", re.sub(r"\\\n", " ", self.TEXT), flags=re.MULTILINE)[1:]

    def test_what_is_copied_exists_and_is_not_ignored(self):
        ignored = [line for line in (SOURCE / ".dockerignore").read_text().splitlines() if line and line[0] != "#"]
        for sources in re.findall(r"^COPY (?!--from)(.+) \S+$", self.TEXT, re.MULTILINE):
            for source in sources.split():
                self.assertTrue((SOURCE / source).exists(), source)
        needed = [line for line in re.findall(r"add_subdirectory\((\S+)\)", (SOURCE / "CMakeLists.txt").read_text())
                  if line not in ("tests", "bench")]
        needed += ["run", "cmake", "compose/systemd", "dashboard/web/src", "dashboard/web/package-lock.json"]
        for path in needed:
            self.assertTrue((SOURCE / path).exists(), path)
            self.assertFalse([each for each in ignored if path == each or path.startswith(each + "/")], path)

    def test_programs_are_for_any_processor_and_run_as_nobody_in_particular(self):
        self.assertIn("-DCITYLEARN_NATIVE=OFF", self.TEXT)
        for stage in self.stages()[-2:]:
            self.assertRegex(stage, r"^scratch AS (dashboard|services)\n")
            self.assertRegex(stage, r"\nUSER 10001:10001\n")

    def test_the_small_image_has_the_libraries_of_the_programs_and_no_others(self):
        for tool in ("dpkg", "readelf", "ldd"):
            if not shutil.which(tool):
                self.skipTest(f"{tool} is missing")
        programs = sorted((PREFIX / "bin").iterdir())
        self.assertGreaterEqual(len(programs), 4)
        libraries = set()
        for program in programs:
            needed = set(re.findall(r"\(NEEDED\).*\[(.*)\]", said_by("readelf", "-d", program)))
            linked = dict(re.findall(r"(\S+) => (/\S+)", said_by("ldd", program)))
            libraries |= {linked[name] for name in needed & set(linked)}
        # The linker's names may lead through /lib, which is a link to /usr/lib.
        paths = {Path(path) for path in libraries} | {Path(path).resolve() for path in libraries}
        owned = subprocess.run(["dpkg", "-S", *paths], capture_output=True, text=True, check=False).stdout
        owners = {str(Path(path).resolve()): package for package, path in re.findall(r"^(\S+?):.* (/\S+)$", owned, re.MULTILINE)}
        packages = {owners[str(Path(path).resolve())] for path in libraries}
        packages -= {"libc6", "libgcc-s1", "libstdc++6"}  # others bring them
        listed = re.search(r"--no-install-recommends(.*?)&&", self.TEXT, re.DOTALL)[1].replace("\\", "").split()
        self.assertEqual(sorted(listed), sorted(packages))


class Units(unittest.TestCase):
    def test_systemd_finds_nothing_wrong(self):
        if not shutil.which("systemd-analyze"):
            self.skipTest("systemd-analyze is missing (package systemd)")
        self.assertEqual(len(UNITS), 5)
        with tempfile.TemporaryDirectory() as folder:
            shutil.copytree(COMPOSE / "systemd", folder, dirs_exist_ok=True)
            for unit in UNITS:
                text = unit.read_text().replace("/usr/local/bin/", f"{PREFIX}/bin/")
                (Path(folder) / unit.name).write_text(text)
            for unit in UNITS:
                path = Path(folder) / unit.name
                done = subprocess.run(["systemd-analyze", "verify", path], capture_output=True, text=True, check=False)
                said = "\n".join(line for line in done.stderr.splitlines() if folder in line or "citylearn" in line)
                self.assertEqual((done.returncode, said), (0, ""), unit.name)

    def test_their_commands_are_the_programs(self):
        variables = set(re.findall(r"^([A-Z_]+)=", (COMPOSE / "systemd/citylearn.env").read_text(), re.MULTILINE))
        for unit in UNITS:
            command = re.search(r"^ExecStart=(.*)$", unit.read_text(), re.MULTILINE)[1]
            program, *words = command.split()
            self.assertTrue((PREFIX / "bin" / Path(program).name).exists(), command)
            helped = said_by(PREFIX / "bin" / Path(program).name, "--help")
            for word in words:
                if word.startswith("--"):
                    self.assertIn(f"{word} ", helped, command)
                if word.startswith("$"):
                    self.assertIn(word[1:], variables, command)

    def test_each_is_restarted_and_shut_in(self):
        common = (COMPOSE / "systemd/citylearn-.service.d/common.conf").read_text()
        for unit in UNITS:
            text = common + unit.read_text()
            for line in ("Restart=on-failure", "StartLimitIntervalSec=0", "RestartPreventExitStatus=2",
                         "NoNewPrivileges=yes", "ProtectSystem=strict", "CapabilityBoundingSet=", "User=citylearn"):
                self.assertRegex(text, rf"(?m)^{re.escape(line)}$", unit.name)


class Scripts(unittest.TestCase):
    def test_shell(self):
        script = COMPOSE / "slurm/train.sbatch"
        subprocess.run(["bash", "-n", script], check=True)


if __name__ == "__main__":
    support.main([support.without_yaml()])
