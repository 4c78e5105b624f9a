# SPDX-License-Identifier: Apache-2.0
"""Builds the images of the tests (`build`), or removes them (`remove`): the targets of compose/Containerfile from the finished
build and this machine's libraries. Nothing is compiled or fetched."""

import shutil
import subprocess
import sys
import tempfile

import support


def build():
    reason = support.missing(["ldd"], [])
    if reason:
        print("skipped:", reason)
        sys.exit(77)
    with tempfile.TemporaryDirectory(prefix="citylearn-") as folder:
        for target, image in (("services", support.SERVICES), ("dashboard", support.DASHBOARD)):
            support.call(support.COMPOSE / "image-root", target, f"{folder}/{target}", support.PREFIX)
            support.podman("build", "--quiet", "--build-context", f"runtime={folder}", "--target", target, "--tag", image,
                           "--file", support.COMPOSE / "Containerfile", support.SOURCE)
    trial = subprocess.run(["podman", "run", "--rm", support.SERVICES, "bash", "-c", ":"], capture_output=True, text=True, check=False)
    if trial.returncode == 125:  # podman's own errors
        remove()
        print("skipped: podman cannot run a container here:", trial.stderr.strip())
        sys.exit(77)
    if trial.returncode != 0:
        sys.exit(trial.stderr)


def remove():
    if not shutil.which("podman"):
        return
    for image in (support.SERVICES, support.DASHBOARD):
        support.podman("image", "rm", "--force", image, check=False)


if __name__ == "__main__":
    {"build": build, "remove": remove}[sys.argv[1]]()
