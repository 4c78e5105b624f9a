# SPDX-License-Identifier: Apache-2.0
"""Checks that the commands in README.md and docs/ use programs and options that exist: docs_commands.py SOURCE BUILD."""

import re
import subprocess
import sys
from pathlib import Path

SOURCE, BUILD = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
sys.path.insert(0, str(SOURCE / "tests/support"))
from pages import commands
PROGRAMS = {
    "env_service": "env_service/env_service",
    "encoder_service": "encoder_service/encoder_service",
    "policy_service": "policy_service/policy_service",
    "dashboard": "dashboard/dashboard",
    "doctor": "tools/doctor/citylearn_doctor",
    "record": "tools/record/citylearn_record",
    "replay": "tools/record/citylearn_replay",
    "ros2": "tools/ros2/citylearn_ros2",
    "vpr": "tools/vpr/citylearn_vpr",
    "export": "tools/export/citylearn_export",
    "paper": "tools/paper/citylearn_paper",
}
PLUGINS_OF_READERS = ("--mine-", "--a2c-", "--patch_means-", "--photo_log-", "--gru-")  # that the pages have them write
# What `./run demo` passes on to.
DEMO = ["env_service", "encoder_service", "policy_service"]
SERVICES = {"env": "env_service", "encoder": "encoder_service", "policy": "policy_service"}


def options(command: list[str]) -> set[str]:
    """Returns the options in the help of a program."""
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        sys.exit(f"{' '.join(command)}: {done.stderr}")
    return set(re.findall(r"--[a-z_0-9][a-z_0-9-]*", done.stdout))


KNOWN = {}
for name, path in PROGRAMS.items():
    text = options([str(BUILD / path), "--help"])
    KNOWN[name] = text | (options([str(BUILD / path), "--help-all"]) if "--help-all" in text else set())
KNOWN["demo"] = options([str(SOURCE / "run"), "demo", "--help"]).union(*(KNOWN[name] for name in DEMO))
KNOWN["again"] = KNOWN["demo"]
KNOWN["forward"] = options([sys.executable, str(SOURCE / "python/citylearn/forward.py"), "--help"])
KNOWN["test"] = options([str(SOURCE / "run"), "test", "--help"])


def program_of(words: list[str]) -> str | None:
    """Returns the program that a command runs; none if it is not one of ours."""
    if words[:1] == ["./run"] and len(words) > 1:
        return SERVICES.get(words[1], words[1])
    name = Path(words[0]).name if words else ""
    name = name.removeprefix("citylearn_")
    return name if name in PROGRAMS else None


faults, seen = [], 0
for page in [SOURCE / "README.md", *sorted((SOURCE / "docs").rglob("*.md"))]:
    if "decisions" in page.parts or "results" in page.parts:
        continue
    for number, words in commands(page):
        program = program_of(words)
        if program not in KNOWN:
            continue
        seen += 1
        for word in words:
            option = re.match(r"--[a-z_0-9][a-z_0-9-]*", word)
            if option and option[0] not in KNOWN[program] and not word.startswith(PLUGINS_OF_READERS):
                faults.append(f"{page.relative_to(SOURCE)}:{number}: {program} has no option {option[0]}")
print("\n".join(faults) or f"{seen} commands use options that exist")
sys.exit(1 if faults or seen < 30 else 0)
