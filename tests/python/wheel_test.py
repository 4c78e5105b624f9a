# SPDX-License-Identifier: Apache-2.0
"""pip makes and installs the package without a network."""

import importlib.util
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import unittest
from pathlib import Path

from support import BUILD, SOURCE

import numpy as np

if not importlib.util.find_spec("pip"):
    print("skipped: pip is missing")
    sys.exit(77)

MODULE = f"_native{sysconfig.get_config_var('EXT_SUFFIX')}"


class Wheel(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-"))).resolve()

    def install(self, build, start=None, source=SOURCE / "python"):
        """Lets pip install the package of a build, in a shell whose folder is `start`; returns how that ended."""
        start = str(start or self.folder)
        environment = {**os.environ, "CITYLEARN_BUILD": str(build), "PIP_NO_INDEX": "1", "PWD": start}
        command = [sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--target",
                   self.folder / "installed", source]
        return subprocess.run(command, env=environment, cwd=start, capture_output=True, text=True, check=False)

    def half(self, *missing):
        """Returns a build folder that lacks these files."""
        package = Path(tempfile.mkdtemp(dir=self.folder), "python/citylearn")
        package.mkdir(parents=True)
        for path in (BUILD / "python/citylearn").glob("*.*"):
            if not any(path.match(name) for name in missing):
                (package / path.name).symlink_to(path)
        return package.parents[1]

    def test_pip_installs_a_package_that_works(self):
        for build, start in ((os.path.relpath(BUILD, SOURCE), SOURCE), (BUILD.name, BUILD.parent),
                             (os.path.relpath(BUILD, SOURCE), self.folder)):
            with self.subTest(build=build, start=start):
                done = self.install(build, start)
                self.assertEqual(done.returncode, 0, done.stderr)
                installed = self.folder / "installed"
                program = ("import citylearn\n"
                           "env = citylearn.VectorEnv(synthetic_images=0, synthetic_frames=40, agents=2)\n"
                           "print(citylearn.__file__, env.reset(seed=1)[0]['features'].shape)")
                done = subprocess.run([sys.executable, "-c", program], env={**os.environ, "PYTHONPATH": str(installed)},
                                      cwd=self.folder, capture_output=True, text=True, check=False)
                self.assertEqual(done.stdout, f"{installed}/citylearn/__init__.py (2, 64)\n", done.stderr)
                shutil.rmtree(installed)

    def test_an_editable_installation_reads_the_sources(self):
        python = self.folder / "env/bin/python"
        environment = {**os.environ, "CITYLEARN_BUILD": str(BUILD), "PIP_NO_INDEX": "1"}
        program = "import citylearn; print(citylearn.__file__)"
        for command in ((sys.executable, "-m", "venv", "--system-site-packages", self.folder / "env"),
                        (python, "-m", "pip", "install", "--quiet", "--no-deps", "--editable", SOURCE / "python"),
                        (python, "-c", program)):
            done = subprocess.run(command, env=environment, cwd=self.folder, capture_output=True, text=True, check=False)
            self.assertEqual(done.returncode, 0, done.stderr)
        module = BUILD / "python/citylearn/__init__.py"
        self.assertEqual(done.stdout, f"{module}\n")
        self.assertEqual(module.resolve(), (SOURCE / "python/citylearn/__init__.py").resolve())

    def test_an_archive_of_the_sources_installs_too(self):
        program = "import backend, sys; print(backend.build_sdist(sys.argv[1]))"
        done = subprocess.run([sys.executable, "-B", "-c", program, self.folder], cwd=SOURCE / "python", capture_output=True,
                              text=True, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        done = self.install(BUILD, source=self.folder / done.stdout.strip())
        self.assertEqual(done.returncode, 0, done.stderr)
        self.assertTrue((self.folder / "installed/citylearn/evaluation.py").is_file())

    def package(self, part, depends, files):
        """Makes a Debian package citylearn-PART as `./run package` does, of `files`: texts of programs by path below /usr."""
        folder = self.folder / part
        for path, text in {"usr/" + path: text for path, text in files.items()}.items():
            (folder / path).parent.mkdir(parents=True, exist_ok=True)
            (folder / path).write_text(text)
            (folder / path).chmod(0o755)
        (folder / "DEBIAN").mkdir()
        (folder / "DEBIAN/control").write_text(f"Package: citylearn-{part}\nVersion: 1\nArchitecture: all\nMaintainer: nobody\n"
                                               f"Description: none\nDepends: {depends}\n")
        packages = self.folder / "build/packages"
        packages.mkdir(parents=True, exist_ok=True)
        subprocess.run(["dpkg-deb", "--build", folder, packages / f"citylearn-{part}_1_all.deb"], check=True,
                       stdout=subprocess.DEVNULL)

    def test_with_debian_packages_it_has_their_programs_and_the_command(self):
        needed = "libc6 (>= 2.3), no-such-library2 (>= 1) | other"
        self.package("services", needed, {"bin/citylearn": "#!/bin/sh\necho $0 $@\n", "share/citylearn/tools/a.sh": "",
                                          "lib/systemd/system/a.service": ""})
        self.package("dashboard", "citylearn-services (= 1), bash", {"share/citylearn/page/index.html": "<p>"})
        (self.folder / "build/python").symlink_to(BUILD / "python")
        done = self.install(self.folder / "build")
        self.assertEqual(done.returncode, 0, done.stderr)
        installed = self.folder / "installed"
        programs = installed / "citylearn/installed"
        self.assertEqual(sorted(str(path.relative_to(programs)) for path in programs.rglob("*") if path.is_file()),
                         ["bin/citylearn", "share/citylearn/page/index.html", "share/citylearn/tools/a.sh"])

        def call(*path):
            environment = {**os.environ, "PYTHONPATH": str(installed), "PATH": ":".join((*path, os.environ["PATH"]))}
            return subprocess.run([installed / "bin/citylearn", "demo", "--seed", "2"], env=environment, capture_output=True,
                                  text=True, check=False)

        # What dpkg does not know is no matter while each program finds its libraries.
        self.assertEqual(call().stdout, f"{programs}/bin/citylearn demo --seed 2\n")
        ldd = self.folder / "tools/ldd"
        ldd.parent.mkdir()
        ldd.write_text("#!/bin/sh\ncase $* in */_native.*) echo 'libno.so.2 => not found' ;; esac\n")
        ldd.chmod(0o755)
        done = call(str(ldd.parent))
        self.assertEqual((done.returncode, done.stdout, done.stderr),
                         (1, "", "citylearn: its programs need packages of the system: "
                                 "apt-get install --no-install-recommends no-such-library2\n"))
        # The module reads exported agents with a library that not all programs need.
        (metadata,) = installed.glob("*.dist-info/METADATA")
        self.assertRegex(metadata.read_text(), r"\nRequires-External: libopencv-dnn\d+\n")
        module = installed / "citylearn" / MODULE
        module.write_bytes(module.read_bytes().replace(b"libopencv_dnn.", b"libopencv_non."))
        done = subprocess.run([sys.executable, "-c", "import citylearn"], env={**os.environ, "PYTHONPATH": str(installed)},
                              cwd=self.folder, capture_output=True, text=True, check=False)
        self.assertRegex(done.stderr, r"needs a package of the system: libopencv_non\.so.*; the command `citylearn` of the")

    def test_a_build_that_is_none_installs_nothing(self):
        other, cut = self.half("_native.*"), self.half("_native.*")
        (other / "python/citylearn/_native.cpython-39-x86_64-linux-gnu.so").touch()
        (cut / f"python/citylearn/{MODULE}").write_bytes((BUILD / f"python/citylearn/{MODULE}").read_bytes()[:100000])
        for build, told in (
            ("nowhere", f"there is no build in {self.folder}/nowhere or {SOURCE}/nowhere; make one"),
            (self.half("_native.*"), f"/python/citylearn has no {MODULE}; finish the build"),
            (self.half("evaluation.py"), "/python/citylearn has no evaluation.py; finish the build"),
            (other, f"has no {MODULE}, which {sys.executable} needs, but _native.cpython-39-x86_64-linux-gnu.so; "
                    "take the Python"),
            (cut, f"{MODULE} does not load; remove it"),
        ):
            with self.subTest(told=told):
                done = self.install(build)
                self.assertNotEqual(done.returncode, 0)
                lines = [line for line in done.stderr.splitlines() if "CITYLEARN_BUILD: " in line]
                self.assertEqual(len(lines), 1, done.stderr)
                self.assertIn(told, lines[0])
                self.assertFalse((self.folder / "installed").exists())


class Import(unittest.TestCase):
    """A copy of the package whose module in C++ is replaced."""

    def told(self, module):
        """Returns the last line of what importing the package says."""
        with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
            shutil.copytree(BUILD / "python/citylearn", f"{folder}/citylearn",
                            ignore=shutil.ignore_patterns("_native*"))
            for name, text in module.items():
                Path(folder, "citylearn", name).write_text(text)
            done = subprocess.run([sys.executable, "-B", "-c", "from citylearn import VectorEnv"], text=True, check=False,
                                  capture_output=True, env={**os.environ, "PYTHONPATH": folder})
            self.assertEqual(done.returncode, 1)
            return done.stderr.strip().splitlines()[-1]

    def test_arrays_with_wrong_strides_are_refused(self):
        told = self.told({"_native.py": "import numpy\n"
                          "def sample_arrays(): return [numpy.zeros(3), numpy.broadcast_to(numpy.zeros(()), 3)]\n"})
        self.assertIn(f"ImportError: citylearn's arrays have wrong strides under NumPy {np.__version__}; install", told)

    def test_a_module_of_another_python_is_named(self):
        told = self.told({"_native.cpython-39-x86_64-linux-gnu.so": ""})
        self.assertIn(f"ImportError: citylearn's module does not load in {sys.implementation.cache_tag} "
                      f"({sys.executable}); there is _native.cpython-39-x86_64-linux-gnu.so; build it", told)
        self.assertIn("there is none; build it", self.told({}))


if __name__ == "__main__":
    unittest.main()
