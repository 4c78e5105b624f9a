# SPDX-License-Identifier: Apache-2.0
"""The Debian packages on a bare Debian with systemd: package_test.py PREFIX BUILD packs the programs of the folder BUILD. They are
installed, train an agent, are removed and leave what it learned; another one is built with citylearn-dev."""

import re
import shutil
import sys
import tempfile
import unittest
from pathlib import Path

import support
from support import UNITS, call, podman, wait_for

BUILD = sys.argv.pop(1)
IMAGE = f"localhost/citylearn-bare-systemd:{support.TAG}"
PACKAGES = ("citylearn-services", "citylearn-dashboard", "citylearn-dev")
CONTAINERFILE = f"""FROM {support.BASE}
RUN apt-get update && apt-get install -y --no-install-recommends systemd && rm -rf /var/lib/apt/lists/*
"""
PAGE = "exec 3<>/dev/tcp/127.0.0.1/8080 && printf 'GET / HTTP/1.1\\r\\nHost: localhost:8080\\r\\nConnection: close\\r\\n\\r\\n' >&3 && cat <&3"


class Packages(support.SystemdCase):
    IMAGE = IMAGE

    @classmethod
    def setUpClass(cls):
        cls.folder = Path(cls.enterClassContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        call("cpack", "-D", f"CPACK_PACKAGE_DIRECTORY={cls.folder}", cwd=BUILD)
        cls.files = {file.name.partition("_")[0]: file for file in cls.folder.glob("*.deb")}

    def install(self, *names):
        self.inside("mkdir", "-p", "/packages")
        for file in self.files.values():
            podman("cp", file, f"{self.NAME}:/packages/{file.name}")
        files = [f"/packages/{self.files[name].name}" if name in self.files else name for name in names]
        self.inside("apt-get", "update")
        self.inside("env", "DEBIAN_FRONTEND=noninteractive", "apt-get", "install", "-y", "--no-install-recommends", *files)

    def test_the_files_are_what_debian_expects(self):
        self.assertEqual(sorted(self.files), sorted(PACKAGES))
        if shutil.which("lintian"):
            found = call("lintian", "--allow-root", "--fail-on", "none", *self.files.values())
            self.assertEqual(re.findall(r"^E: .*", found, re.MULTILINE), [])
        settings = call("dpkg-deb", "--info", self.files["citylearn-services"], "conffiles")
        self.assertEqual(settings.strip(), "/etc/citylearn/citylearn.env")

    def test_installed_they_train_and_removed_they_leave_the_results(self):
        self.install("citylearn-services", "citylearn-dashboard")
        self.assertEqual(self.property_of("citylearn.target", "ActiveState"), "inactive", "nobody enabled it")
        self.start_target()
        wait_for("the page", 30, lambda: "<!doctype html>" in self.inside("bash", "-c", PAGE, check=False).lower(), self.report)
        self.expect_trained()
        processes = [self.property_of(unit, "MainPID") for unit in UNITS[:4]]
        self.inside("dpkg", "--install", *(f"/packages/{self.files[name].name}" for name in PACKAGES[:2]))  # as an upgrade does
        for unit, process in zip(UNITS[:4], processes):
            wait_for(f"{unit} is another process", 30, lambda unit=unit, process=process: self.property_of(unit, "MainPID") not in
                     ("0", process), self.report)
        before = self.inside("find", "/var/lib/citylearn/runs", "-type", "f")
        self.assertIn("/first/checkpoints/", before)
        self.inside("apt-get", "remove", "-y", *PACKAGES[:2])
        self.assertEqual(self.inside("systemctl", "list-units", "--plain", "--no-legend", "--state=active", "citylearn*"), "")
        self.assertIn("CITYLEARN_INTERFACE=lo", self.inside("cat", "/etc/citylearn/citylearn.env"))
        said = self.inside("apt-get", "purge", "-y", *PACKAGES[:2])
        self.assertIn("/var/lib/citylearn stays", said)
        self.assertEqual(self.inside("find", "/var/lib/citylearn/runs", "-type", "f"), before)
        self.assertEqual(self.inside("find", "/etc", "-name", "*citylearn*", "!", "-name", "*-"), "")

    def test_the_tutorials_learner_is_built_with_dev(self):
        self.install("citylearn-services", "citylearn-dev", "cmake", "g++", "ninja-build", "libgtest-dev")
        page = (support.SOURCE / "docs/tutorials/write-a-learner.md").read_text()
        for name, text in re.findall(r"^```\w+ (\S+)\n(.*?)^```", page, re.MULTILINE | re.DOTALL):
            (self.folder / name).write_text(text)
            podman("cp", self.folder / name, f"{self.NAME}:/root/{name}")
        self.inside("sh", "-c", "cd /root && cmake -S . -B build -G Ninja -DCMAKE_BUILD_TYPE=Release && cmake --build build")
        self.assertIn("a2c", self.inside("/root/build/policy_service", "--list"))
        self.assertIn("[  PASSED  ]", self.inside("/root/build/contract", "--gtest_filter=*/a2c"))
        # A plug-in of the same file, for the installed program.
        self.inside("sh", "-c", "mkdir /root/plugin && cd /root/plugin && mv ../a2c.cc . && echo 'cmake_minimum_required(VERSION 3.25)\n"
                    "project(mine CXX)\nfind_package(citylearn REQUIRED)\ncitylearn_plugin(a2c a2c.cc)' >CMakeLists.txt && "
                    "cmake -S . -B build -G Ninja -DCMAKE_BUILD_TYPE=Release && cmake --build build")
        self.assertIn("a2c", self.inside("policy_service", "--plugin", "/root/plugin/build/plugins/a2c.so", "--list"))


if __name__ == "__main__":
    reason = support.missing(["cpack", "dpkg-shlibdeps"], [support.BASE]) or support.build_image(IMAGE, CONTAINERFILE)
    unittest.addModuleCleanup(podman, "image", "rm", "--force", IMAGE, check=False)
    support.main(reason)
