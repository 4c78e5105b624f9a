# SPDX-License-Identifier: Apache-2.0
"""What real shells offer for command lines that are half typed: bash and, where it is there, zsh."""

import os
import pty
import re
import select
import shutil
import time
import unittest

from support import BUILD, PREFIX, SOURCE, CommandLine

BASH = """
. {prefix}/share/bash-completion/completions/{command}
COMP_LINE=$1 COMP_POINT=${{#1}}
# Words as bash divides them, `=` being one of its own.
read -ra COMP_WORDS <<<"${{1//=/ = }}"
[[ $1 != *[\\ =] ]] || COMP_WORDS+=('')
[[ $1 != *= ]] || unset 'COMP_WORDS[-1]'
COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
{function}
printf '%s\\n' "${{COMPREPLY[@]}}"
"""


class Bash(CommandLine):
    def offered(self, line):
        command = line.split()[0].split("/")[-1]
        script = BASH.format(prefix=PREFIX, command="citylearn" if command == "run" else command, function="_citylearn")
        return self.run_command("bash", "-c", script, "bash", line).split()

    def test_commands(self):
        self.assertEqual(self.offered("citylearn d"), ["demo", "dashboard", "data", "doctor"])
        self.assertGreater(len(self.offered("citylearn ")), 10)
        self.assertEqual(self.offered("citylearn nothing"), [])

    def test_options_are_those_of_the_programs(self):
        for command, program in (("env", "env_service"), ("policy", "policy_service"), ("vpr", "citylearn_vpr")):
            shown = self.run_command(program, "--help-all")
            options = set(re.findall(r"^  (?:-h,)?(--[a-z][a-z0-9_-]*)", shown, re.MULTILINE))
            self.assertGreater(len(options), 15)
            self.assertEqual(set(self.offered(f"citylearn {command} --")), options)
            self.assertEqual(set(self.offered(f"{program} --")), options)
        self.assertEqual(self.offered("citylearn policy --seed 1 --vtrace-rh"), ["--vtrace-rho"])
        self.assertLessEqual({"--frames", "--no-wait", "--kitti-camera", "--hog-bins", "--learner", "--dimension"},
                             set(self.offered("citylearn demo --")))

    def test_names_are_those_that_are_registered(self):
        shown = self.run_command("policy_service", "--list").split("\n\n")
        learners = re.findall(r"^  ([a-z]\w*)", shown[1], re.MULTILINE)
        self.assertIn("Learners", shown[1])
        self.assertEqual(self.offered("citylearn demo --learner "), learners)
        self.assertEqual(self.offered("citylearn policy --learner=v"), ["vtrace"])
        self.assertEqual(self.offered("citylearn policy --learner="), learners)
        self.assertIn("place_filter", self.offered("citylearn policy --agent "))
        self.assertEqual(self.offered("citylearn demo --encoder hog"), ["hog", "hog_vlad"])
        self.assertEqual(self.offered("citylearn vpr --dataset nord"), ["nordland"])
        self.assertEqual(self.offered("citylearn doctor --middleware fast"), ["fastdds"])
        self.assertEqual(self.offered("encoder_service --centring ru"), ["running"])

    def test_files_and_subcommands(self):
        self.assertEqual(self.offered("citylearn demo --data "), [], "bash then offers files")
        self.assertEqual(self.offered("citylearn data "), ["list", "check", "info"])
        self.assertIn("--json", self.offered("citylearn data info --"))

    def test_run_is_completed_too(self):
        self.environment["CITYLEARN_BUILD"] = str(BUILD)
        self.folder = SOURCE  # its name is ./run
        self.assertEqual(self.offered("./run cov"), ["coverage"])
        self.assertEqual(self.offered("./run policy --learner v"), ["vtrace"])


class Typed(CommandLine):
    """Keys that are typed into an interactive shell on a terminal."""

    def completes(self, shell, setup, typed, wanted):
        try:
            pid, terminal = pty.fork()
        except OSError as error:
            self.skipTest(f"there are no terminals here: {error}")
        if pid == 0:
            os.chdir(self.folder)
            os.execvpe(shell[0], shell, self.environment | {"TERM": "dumb", "PS1": "$ "})
        try:
            seen = ""

            def until(text, what):
                nonlocal seen
                deadline = time.monotonic() + 60
                while text not in seen:
                    self.assertGreater(deadline, time.monotonic(), f"{what}: {seen!r}")
                    if select.select([terminal], [], [], 1)[0]:
                        seen += os.read(terminal, 4096).decode(errors="replace")

            os.write(terminal, f"{setup}; echo rea''dy\n".encode())
            until("ready", "the shell starts")
            seen = ""
            os.write(terminal, typed.encode() + b"\t")
            until(wanted, "completion")
        finally:
            os.kill(pid, 9)
            os.waitpid(pid, 0)
            os.close(terminal)

    def test_bash(self):
        where = f". {PREFIX}/share/bash-completion/completions/citylearn"
        self.completes(["bash", "--norc", "-i"], where, "citylearn policy --learner vt", "vtrace")
        self.completes(["bash", "--norc", "-i"], where, "citylearn policy --learner=vt", "=vtrace")

    def test_bash_finds_it_by_itself(self):
        loader = "/usr/share/bash-completion/bash_completion"
        if not os.path.exists(loader):
            self.skipTest("package bash-completion is missing")
        self.environment["XDG_DATA_DIRS"] = f"{PREFIX}/share"
        self.completes(["bash", "--norc", "-i"], f". {loader}", "policy_service --learner vt", "vtrace")

    def test_zsh(self):
        if not shutil.which("zsh"):
            self.skipTest("package zsh is missing")
        setup = f"fpath=({PREFIX}/share/zsh/site-functions $fpath); autoload -U compinit; compinit -D -u"
        for typed, wanted in (("citylearn dem", "demo"), ("citylearn policy --learner vt", "vtrace"),
                              ("policy_service --learner=vt", "=vtrace"), ("citylearn demo --no-w", "--no-wait")):
            self.completes(["zsh", "-f", "-i"], setup, typed, wanted)


if __name__ == "__main__":
    unittest.main(verbosity=2)
