# SPDX-License-Identifier: Apache-2.0
"""Runs the script of a client of clients.toml with that client's packages: run.py SOURCE BUILD CLIENT

Its virtual environment stays in the build folder, or in the one that $CITYLEARN_CLIENTS names. The test is skipped (77) where
Python has no venv, cargo is missing, or the package registry is out of reach."""

import fcntl
import os
import re
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

SOURCE, BUILD = (Path(folder).resolve() for folder in sys.argv[1:3])
HERE, PAGE = SOURCE / "tests/clients", "docs/reference/clients.md"
CLIENTS = tomllib.loads((HERE / "clients.toml").read_text())
NO_REGISTRY = "connection broken|Could not fetch URL|Failed to establish|Temporary failure|No module named 'ensurepip'"


def skip(reason):
    print(f"skipped: {reason}")
    sys.exit(77)


def call(*command):
    """Ends the test where making an environment fails: skipped if that is for want of a registry."""
    done = subprocess.run(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode:
        lines = [line for line in done.stdout.splitlines() if line.strip()]
        missing = next((line for line in lines if re.search(NO_REGISTRY, line)), None)
        if missing:
            skip(missing)
        sys.exit("\n".join(lines[-20:]))


def python_of(name):
    """Returns the Python of an environment, which is made where it is not there or has other packages."""
    packages, newest, sources = (CLIENTS["environments"][name].get(each) for each in ("packages", "newest_python", "sources"))
    if newest and [*sys.version_info[:2]] > newest:
        skip(f"{packages[0]} has no wheel for Python {sys.version.split()[0]}")
    folder = Path(os.environ.get("CITYLEARN_CLIENTS", BUILD / "clients")) / name
    folder.parent.mkdir(parents=True, exist_ok=True)
    made, wanted = folder / "packages", "\n".join([sys.version, *packages])
    with open(f"{folder}.lock", "w") as lock:  # tests run side by side
        fcntl.flock(lock, fcntl.LOCK_EX)
        if not made.exists() or made.read_text() != wanted:
            shutil.rmtree(folder, ignore_errors=True)
            call(sys.executable, "-m", "venv", folder)
            call(folder / "bin/pip", "install", "--quiet", "--disable-pip-version-check", "--retries=1",
                 "--only-binary=:all:", *([f"--no-binary={sources}"] if sources else []), *packages)
            made.write_text(wanted)
    return folder / "bin/python"


def built(crate):
    """Builds a program in Rust, whose source is in the folder of that name. Returns it."""
    folder = Path(os.environ.get("CITYLEARN_CLIENTS", BUILD / "clients")) / crate
    done = subprocess.run(["sh", SOURCE / "tests/support/cargo.sh", HERE / crate, folder], check=False)
    if done.returncode:
        sys.exit(done.returncode)
    return folder / "target/release" / f"{crate}_peer"


def row_of(name):
    """Returns the client's row in the table of the documentation."""
    client = CLIENTS["clients"][name]
    versions = dict(package.split("==") for package in CLIENTS["environments"][client["environment"]]["packages"])
    if "crate" in client:
        crates = tomllib.loads((HERE / client["crate"] / "Cargo.toml").read_text())["dependencies"]
        versions[name] = crates[name]["version"].lstrip("=")
    return f"| {', '.join(f'{each} {versions[each]}' for each in client.get('packages', [name]))} | {client['uses']} |"


def main(name):
    client = CLIENTS["clients"][name]
    if row_of(name) not in (SOURCE / PAGE).read_text():
        sys.exit(f"{PAGE} lacks the row\n{row_of(name)}")
    python = python_of(client["environment"])
    path = ":".join(map(str, (BUILD / "python", SOURCE / "tests/python", SOURCE / "tests/support", HERE)))
    environment = {**os.environ, "PYTHONPATH": path, "OMP_NUM_THREADS": "1"}  # threads that wait disturb others
    if "crate" in client:
        environment["PEER"] = str(built(client["crate"]))
    for script in client["scripts"]:
        done = subprocess.run([python, "-B", HERE / script, SOURCE, BUILD], env=environment, check=False)
        if done.returncode:
            sys.exit(f"{name}: {script} failed ({done.returncode})")


if __name__ == "__main__":
    main(sys.argv[3])
