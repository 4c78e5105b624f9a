# SPDX-License-Identifier: Apache-2.0
"""The other Debian release, 13 on a machine with 12 or the other way round, made in a folder and entered in a mount namespace: the tree
builds there with this machine's compiler cache, and its quick tests pass. Then services of both releases train together over loopback,
in every pairing of releases and vendors, and with DDS Security in every pairing of releases over Cyclone DDS: secured services of other
pairings do not meet (docs/how-to/secure-a-run.md). Called with the build folder, where the release stays for the next time (platform/)."""

import itertools
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
import unittest
from pathlib import Path

SOURCE = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(SOURCE / "tests/support"))
from domain import own_domain

BUILD = Path(sys.argv.pop(1)).resolve()
HERE = platform.freedesktop_os_release().get("VERSION_CODENAME", "")
OTHER = {"bookworm": "trixie", "trixie": "bookworm"}.get(HERE, "")
ROOT = BUILD / "platform" / OTHER
INSIDE = "CITYLEARN_PLATFORM_INSIDE"
SOURCES = Path("/etc/apt/sources.list.d/debian.sources")
ENTER = ["env", "-i", "HOME=/root", "LANG=C.UTF-8", "PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin", "chroot", str(ROOT)]
VENDORS = ("cyclonedds", "fastdds")


def run(what, *words, **options):
    """Runs a command. An error is one line that says what failed, and the command's last lines."""
    done = subprocess.run(list(map(str, words)), stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, errors="replace", check=False, **options)
    if done.returncode != 0:
        last = "\n".join(done.stdout.splitlines()[-25:])
        raise AssertionError(f"{what} failed (status {done.returncode}):\n{last}")
    return done.stdout


def unavailable():
    """Why the other release cannot be made here; empty when it can."""
    if os.geteuid() != 0:
        return "only root can enter another system"
    if not OTHER or not SOURCES.exists():
        return "this is neither Debian 12 nor 13 with its packages in debian.sources"
    for program in ("debootstrap", "unshare", "git", "ccache"):
        if not shutil.which(program):
            return f"{program} is missing"
    trial = subprocess.run(["unshare", "--mount", "mount", "-t", "tmpfs", "none", "/mnt"], capture_output=True, text=True, check=False)
    return f"no mount namespaces here: {trial.stderr.strip()}" if trial.returncode != 0 else ""


def make_release():
    """Fills ROOT with a bare system. Returns why not, where its packages cannot be fetched."""
    done = ROOT / ".complete"
    if not done.exists():
        ROOT.mkdir(parents=True, exist_ok=True)
        mirror = re.search(r"^URIs: *(\S+)", SOURCES.read_text(), re.MULTILINE)[1]
        made = subprocess.run(["debootstrap", "--variant=minbase", OTHER, ROOT, mirror], capture_output=True, text=True, check=False)
        if made.returncode != 0:
            return f"{OTHER} cannot be fetched: {(made.stdout + made.stderr).strip().splitlines()[-1]}"
        (ROOT / "etc/apt/sources.list").unlink(missing_ok=True)
        (ROOT / SOURCES.relative_to("/")).write_text(SOURCES.read_text().replace(HERE, OTHER))
        done.touch()
    # How this machine reaches its mirrors: names, proxies, authorities.
    for path in ("/etc/resolv.conf", "/etc/hosts", "/etc/apt/apt.conf.d", "/etc/npmrc", "/usr/local/share/ca-certificates", "/etc/ssl/certs/ca-certificates.crt"):
        inside = ROOT / path[1:]
        inside.parent.mkdir(parents=True, exist_ok=True)
        if Path(path).is_dir():
            shutil.copytree(path, inside, dirs_exist_ok=True)
        elif Path(path).exists():
            shutil.copyfile(path, inside)
    return ""


def mount():
    """For this namespace alone: all of it goes with the process."""
    cache = subprocess.run(["ccache", "--get-config", "cache_dir"], capture_output=True, text=True, check=True).stdout.strip()
    for options, what, where in (("-tproc", "proc", "proc"), ("-tsysfs", "sysfs", "sys"), ("--rbind", "/dev", "dev"),
                                 ("-ttmpfs", "tmpfs", "tmp"), ("--bind", cache, "root/.cache/ccache")):
        (ROOT / where).mkdir(parents=True, exist_ok=True)
        run(f"mounting {where}", "mount", options, what, ROOT / where)


def seen(release, path):
    """Returns where a program of the release finds a path in ROOT."""
    return path if release == HERE else Path("/") / path.relative_to(ROOT)


class OtherRelease(unittest.TestCase):
    def inside(self, command):
        run(f"`{command}` on Debian's {OTHER}", *ENTER, "bash", "-c", f"cd /src && {command}")

    def program(self, release, name):
        return [*ENTER, f"/src/build/release/{name}/{name}"] if release == OTHER else [BUILD / name / name]

    def service(self, release, vendor, name, keys):
        """Returns the command of a service as all of its kind begin. `keys` is the folder of a keystore, or None."""
        security = ["--security", seen(release, keys / name)] if keys else []
        return [*self.program(release, name), "--id", name, "--domain", self.domain, "--session", "platform", "--middleware", vendor, *security]

    def checkpoint(self, env, policy, keys=None):
        """Returns that of a short training whose env_service and policy_service have these releases and vendors."""
        output = ROOT / "tmp" / "-".join((*env, *policy, "secured" if keys else "open"))
        serve = [*self.service(*env, "env_service", keys), "--traversal", "summer", "--agents", 8, "--synthetic-images", 0, "--synthetic-frames", 64]
        train = [*self.service(*policy, "policy_service", keys), "--train", "summer", "--evaluate", "summer", "--frames", "0:64", "--lockstep",
                 "--agent", "place_filter", "--steps", 8192, "--tasks", 16, "--wait", 60, "--overwrite", "--output", seen(policy[0], output)]
        with tempfile.TemporaryFile() as log, subprocess.Popen(list(map(str, serve)), stdout=log, stderr=log) as service:
            try:
                run(f"training with an env_service of {' '.join(env)} and a policy_service of {' '.join(policy)}", *train, timeout=300)
            finally:
                service.terminate()
        return max((output / "checkpoints").glob("checkpoint-*.clk")).read_bytes()

    def test_builds_there_and_both_train_together(self):
        shutil.rmtree(ROOT / "src", ignore_errors=True)
        files = subprocess.run(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"], cwd=SOURCE, capture_output=True, check=True).stdout
        for name in filter(None, files.decode().split("\0")):
            if (SOURCE / name).exists():
                (ROOT / "src" / name).parent.mkdir(parents=True, exist_ok=True)
                shutil.copy2(SOURCE / name, ROOT / "src" / name)
        self.inside("./run setup --tests")
        self.inside("./run build")
        self.inside("ctest --test-dir build/release -j $(nproc) --output-on-failure -L quick")
        self.inside("ctest --test-dir build/release -j $(nproc) --output-on-failure -R '/?(Vendors|Secured)'")
        self.domain = own_domain()
        kinds = list(itertools.product((HERE, OTHER), VENDORS))
        expected = self.checkpoint(kinds[0], kinds[0])
        keystore, keys = SOURCE / "compose/keystore", ROOT / "tmp/keys"
        for words in (("create", keys), *(("add", keys, name, name) for name in ("env_service", "policy_service"))):
            run("making keys", keystore, *words)
        for env, policy in itertools.product(kinds, kinds):
            for secured in (None, keys) if env[1] == policy[1] == "cyclonedds" else (None,):
                with self.subTest(env=env, policy=policy, secured=bool(secured)):
                    self.assertEqual(self.checkpoint(env, policy, secured), expected, "it is another checkpoint")


if __name__ == "__main__":
    if INSIDE not in os.environ:
        reason = unavailable() or make_release()
        if reason:
            print("skipped:", reason)
            sys.exit(77)
        os.execvpe("unshare", ["unshare", "--mount", "--propagation", "private", sys.executable, "-B", __file__, str(BUILD), *sys.argv[1:]],
                   os.environ | {INSIDE: "1"})
    mount()
    unittest.main(verbosity=2)
