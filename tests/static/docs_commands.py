# SPDX-License-Identifier: Apache-2.0
"""Checks that the commands in README.md and docs/ use programs and options that exist: docs_commands.py SOURCE BUILD."""

import re
import subprocess
import sys
from pathlib import Path

SOURCE, BUILD = Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve()
sys.path.insert(0, str(SOURCE / "tests/support"))
from pages import commands
# The path in the build folder of each command's program.
PROGRAMS = dict(re.findall(r"\[([\w-]+)\]=([\w/]+)", (SOURCE / "tools/citylearn/commands.sh").read_text()))
del PROGRAMS["data"]  # its options are those of its subcommands
PLUGINS_OF_READERS = ("--mine-", "--a2c-", "--patch_means-", "--photo_log-", "--gru-")  # that the pages have them write
DEMO = ["env", "encoder", "policy"]  # what `./run demo` passes options on to


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
KNOWN["test"] = options([str(SOURCE / "run"), "test", "--help"])


def program_of(words: list[str]) -> str | None:
    """Returns the program that a command runs; none if it is not one of ours."""
    if words[:1] == ["./run"] and len(words) > 1:
        return words[1]
    name = Path(words[0]).name if words else ""
    return next((command for command, path in PROGRAMS.items() if Path(path).name == name), None)


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
