# SPDX-License-Identifier: Apache-2.0
"""What compose/ says is true of this repository, as far as can be told without a container engine: files parse, and name programs,
options, settings, images and packages that exist. compose_test.py and its neighbours run them."""

import functools
import os
import platform
import re
import shlex
import shutil
import subprocess
import tomllib
import unittest
from pathlib import Path

import yaml

import support
from support import COMPOSE, PREFIX, SOURCE

FILES = sorted(COMPOSE.glob("*.yaml"))
UNITS = sorted((COMPOSE / "systemd").glob("*.service"))
SETTING = re.compile(r"\$\{([A-Z_]+)(:[-?])([^}]*)\}")


def services(path):
    """Name and content of each service; every setting has its default."""
    text = SETTING.sub(lambda match: match[3] if match[2] == ":-" else "hostA,hostB", path.read_text())
    return yaml.safe_load(text.replace("$$", "$"))["services"].items()


@functools.cache
def help_of(program):
    path = PREFIX / "bin" / program
    return "".join(support.call(path, option, check=False) for option in ("--help", "--help-all"))


class Commands(unittest.TestCase):
    """Every program and every option that is named exists."""

    def check(self, words, where):
        program = next((word for word in words if (PREFIX / "bin" / Path(word).name).exists()), None)
        self.assertIsNotNone(program, f"{where}: {words}")
        for word in words:
            if word.startswith("--") and len(word) > 2:
                self.assertRegex(help_of(Path(program).name), rf"(?m)(^|[ ,]){re.escape(word.partition('=')[0])}([ ,=]|$)", where)

    def test_of_compose_files(self):
        for path in FILES:
            for name, service in services(path):
                where = f"{path.name}: {name}"
                words = [word for each in shlex.split(service["command"]) for word in each.split()]
                self.check(words, where)
                if "citylearn_doctor" in service["healthcheck"]["test"]:
                    self.check(service["healthcheck"]["test"].strip("'").split(), where)

    def test_of_units(self):
        variables = set(re.findall(r"^([A-Z_]+)=", (COMPOSE / "systemd/citylearn.env").read_text(), re.MULTILINE))
        self.assertEqual(len(UNITS), 5)
        for unit in UNITS:
            words = re.search(r"^ExecStart=(.*)$", unit.read_text(), re.MULTILINE)[1].split()
            self.check(words, unit.name)
            for word in words:
                if word.startswith("$"):
                    self.assertIn(word[1:], variables, unit.name)

    def test_of_kubernetes(self):
        for path in (COMPOSE / "kubernetes").rglob("*.toml"):
            service = path.stem.partition("-")[0]
            program = service if service == "dashboard" else f"{service}_service"
            for option in tomllib.loads(path.read_text()):
                self.assertRegex(help_of(program), rf"(?m)^ +--{option} ", path)
        for path in (COMPOSE / "kubernetes").rglob("*.yaml"):
            for command in re.findall(r"\b(?:env_service|encoder_service|policy_service|dashboard|citylearn_doctor) (?:[^']*--[^']*)", path.read_text()):
                self.check(command.split(), path)

    def test_of_the_slurm_script(self):
        subprocess.run(["bash", "-n", COMPOSE / "slurm/train.sbatch"], check=True)


class ComposeFiles(unittest.TestCase):
    def test_docker_compose_understands_them_too(self):
        self.assertEqual([path.stem for path in FILES], ["multi-host", "scale-out", "secure", "single-node"])
        docker = shutil.which("docker")
        if not docker or subprocess.run([docker, "compose", "version"], capture_output=True, check=False).returncode != 0:
            self.skipTest("docker compose is missing")
        for path in FILES:
            support.call(docker, "compose", "-f", path, "--profile", "*", "config", "--quiet", env=os.environ | {"PEERS": "a,b"})

    def test_each_service_is_watched_restarted_and_bounded(self):
        for path in FILES:
            for name, service in services(path):
                where = f"{path.name}: {name}"
                self.assertEqual((service["restart"], service["read_only"], service["user"], service["cap_drop"]),
                                 ("on-failure", True, "10001:10001", ["ALL"]), where)
                limits = service["deploy"]["resources"]["limits"]
                self.assertTrue(limits["memory"] and limits["pids"], where)
                # One that is alone in its network says so itself; what the page's server says is enough of the dashboard.
                asked = re.search(r"--service (\S+)", service["healthcheck"]["test"])
                own = re.search(r"--id ([^\s']+)", service["command"])
                self.assertEqual(asked[1] if asked else "dashboard", own[1] if own else name, where)

    def test_memory_is_limited_alike_everywhere(self):
        """As the units say: MemoryMax."""
        limits = {re.match(r"citylearn-(\w+)", unit.name)[1]: re.search(r"^MemoryMax=(\d+G)$", unit.read_text(), re.MULTILINE)[1]
                  for unit in UNITS}
        for path in FILES:
            for name, service in services(path):
                kind = name.partition("-")[0].replace("learner", "policy")
                self.assertEqual(service["deploy"]["resources"]["limits"]["memory"].upper(), limits[kind], f"{path.name}: {name}")
        for path in (COMPOSE / "kubernetes").rglob("*.yaml"):
            for each in yaml.safe_load_all(path.read_text()):
                for container in each.get("spec", {}).get("template", {}).get("spec", {}).get("containers", []):
                    if "resources" in container:
                        self.assertEqual(container["resources"]["limits"]["memory"], limits[container["name"]] + "i", path)

    def test_peers_are_the_services_of_the_file(self):
        for path in FILES:
            for name, service in services(path):
                if service.get("network_mode") != "host":
                    peers = service["environment"]["CITYLEARN_PEERS"].split(",")
                    self.assertEqual(sorted(peers), sorted(f"dns:{other}" for other, _ in services(path)), f"{path.name}: {name}")

    def test_nothing_forbids_a_second_one(self):
        """`--scale`: no service has a name or an address for itself, and each of several has an id of its own."""
        for path in FILES:
            for name, service in services(path):
                self.assertFalse({"container_name", "hostname", "ipv4_address", "networks"} & set(service), f"{path.name}: {name}")
        for name, service in services(COMPOSE / "scale-out.yaml"):
            if "replicas" in service["deploy"]:
                self.assertIn("$HOSTNAME", service["command"], name)

    def test_no_shell_reads_a_setting(self):
        """It would run commands in them."""
        for path in FILES:
            content = yaml.safe_load(path.read_text())
            for name, service in content["services"].items():
                script = re.search(r"-c '([^']*)'", service["command"])
                self.assertNotIn("${", script[1] if script else "", f"{path.name}: {name}")
                self.assertNotIn("${", service["healthcheck"]["test"], f"{path.name}: {name}")

    def test_example_env_lists_every_setting_with_its_value(self):
        listed = dict(re.findall(r"^#([A-Z_]+)=(.*)$", (COMPOSE / "example.env").read_text(), re.MULTILINE))
        used = {}
        for path in FILES:
            for name, how, value in SETTING.findall(path.read_text()):
                used.setdefault(name, set()).add(value.strip() if how == ":-" else "hostA,hostB")
        self.assertEqual({name: {value} for name, value in listed.items()}, used)


class Image(unittest.TestCase):
    TEXT = (COMPOSE / "Containerfile").read_text()

    def test_the_images_of_the_files_are_its_stages(self):
        stages = set(re.findall(r"^FROM \S+ AS (\S+)$", self.TEXT, re.MULTILINE))
        self.assertLessEqual({"developer", "services", "dashboard"}, stages)
        for path in FILES:
            for name, service in services(path):
                self.assertIn(service["build"]["target"], stages, f"{path.name}: {name}")
                self.assertEqual((path.parent / service["build"]["context"] / service["build"]["dockerfile"]).resolve(),
                                 COMPOSE / "Containerfile")
        self.assertIn("cmake --preset package ", self.TEXT)
        self.assertEqual(len(re.findall(r"^USER 10001:10001$", self.TEXT, re.MULTILINE)), 2)

    def test_what_is_copied_exists_and_is_not_ignored(self):
        ignored = [line for line in (SOURCE / ".dockerignore").read_text().splitlines() if line and line[0] != "#"]
        needed = [line for line in re.findall(r"add_subdirectory\((\S+)\)", (SOURCE / "CMakeLists.txt").read_text())
                  if line not in ("tests", "bench")]
        needed += re.findall(r"^COPY (?!--from)(\w\S*) \S+$", self.TEXT, re.MULTILINE)
        needed += ["cmake", "compose/systemd", "dashboard/web/src", "dashboard/web/package-lock.json"]
        for path in needed:
            self.assertTrue((SOURCE / path).exists(), path)
            self.assertFalse([each for each in ignored if path == each or path.startswith(each + "/")], path)

    def test_its_packages_are_those_of_the_libraries_of_the_programs(self):
        for tool in ("dpkg", "readelf", "ldd"):
            if not shutil.which(tool):
                self.skipTest(f"{tool} is missing")
        programs = sorted(file for file in (PREFIX / "bin").iterdir() if file.read_bytes().startswith(b"\x7fELF"))
        self.assertGreaterEqual(len(programs), 4)
        libraries = set()
        for program in programs:
            needed = set(re.findall(r"\(NEEDED\).*\[(.*)\]", support.call("readelf", "-d", program)))
            linked = dict(re.findall(r"(\S+) => (/\S+)", support.call("ldd", program)))
            libraries |= {linked[name] for name in needed & set(linked)}
        # The linker's names may lead through /lib, which is a link to /usr/lib.
        paths = {Path(path) for path in libraries} | {Path(path).resolve() for path in libraries}
        owned = subprocess.run(["dpkg", "-S", *paths], capture_output=True, text=True, check=False).stdout
        owners = {str(Path(path).resolve()): package for package, path in re.findall(r"^(\S+?):.* (/\S+)$", owned, re.MULTILINE)}
        packages = {owners[str(Path(path).resolve())] for path in libraries}
        packages -= {"libc6", "libgcc-s1", "libstdc++6"}  # others bring them
        if any(Path("/usr/lib").glob("*/libheif/plugins/libheif-libde265.so")):
            packages.add("libheif-plugin-libde265")  # libheif loads it by name
        release = platform.freedesktop_os_release()["VERSION_CODENAME"]
        found = re.search(rf'\b{release}="(.*?)"', self.TEXT, re.DOTALL)
        if not found:
            self.skipTest(f"there are no images of {release}")
        listed = found[1].replace("\\", "").split()
        self.assertEqual(sorted(listed), sorted(packages))


if __name__ == "__main__":
    unittest.main(verbosity=2)
