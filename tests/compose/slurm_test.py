# SPDX-License-Identifier: Apache-2.0
"""compose/slurm/train.sbatch, run on this machine's loopback: srun starts programs here, scontrol names two addresses of it."""

import json
import os
import signal
import subprocess
import tempfile
import unittest
from pathlib import Path

import support

# Takes srun's options off. scancel signals what it started, as Slurm does.
SRUN = """#!/bin/bash
while [[ $1 == --* ]]; do echo "$1" >>"$TRIAL/options"; shift; done
echo $$ >>"$TRIAL/steps"
exec "$@"
"""
SCANCEL = """#!/bin/bash
echo "$*" >>"$TRIAL/asked"
kill -TERM $(cat "$TRIAL/steps") 2>/dev/null
"""
SCONTROL = """#!/bin/bash
echo "$*" >>"$TRIAL/asked"
[ "$1 $2" != 'show hostnames' ] || printf '127.0.0.1\\n127.0.0.2\\n'
"""


class Slurm(unittest.TestCase):
    def setUp(self):
        temporary = tempfile.TemporaryDirectory(prefix="citylearn-")
        self.addCleanup(temporary.cleanup)
        self.folder = Path(temporary.name)
        for name, text in (("srun", SRUN), ("scontrol", SCONTROL), ("scancel", SCANCEL)):
            (self.folder / name).write_text(text)
            (self.folder / name).chmod(0o755)
        self.output = self.folder / "output"
        self.job = None

    def start(self, **more):
        settings = {"SLURM_JOB_ID": str(os.getpid()), "SLURM_JOB_NODELIST": "node[1-2]", "TRIAL": str(self.folder),
                    "PATH": f"{self.folder}:{os.environ['PATH']}", "BIN": str(support.PREFIX / "bin"), "ENVS": "2",
                    "OUTPUT": str(self.output), "INTERFACE": "lo", "FRAMES": "0:48", "ENCODER_OPTIONS": "--dimension 24"} | more
        self.job = subprocess.Popen(["bash", support.COMPOSE / "slurm/train.sbatch"], env=os.environ | settings,
                                    stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True)
        self.addCleanup(self.end)

    def end(self):
        if self.job.poll() is None:
            os.killpg(self.job.pid, signal.SIGKILL)
        self.job.communicate()

    def finish(self):
        said = self.job.communicate(timeout=120)[0]
        logs = "".join(f"---- {log.name}\n{log.read_text()[-2000:]}\n" for log in sorted((self.output / "logs").glob("*")))
        return said, logs

    def log(self, name):
        path = self.output / "logs" / f"{name}.log"
        return path.read_text() if path.exists() else ""

    def pid_of(self, text):
        """The job's process whose command line has this text."""
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                if text in (entry / "cmdline").read_text() and os.getsid(int(entry.name)) == self.job.pid \
                        and (entry / "comm").read_text().strip() not in ("bash", "srun"):
                    return int(entry.name)
            except (OSError, ValueError):
                continue
        return None

    def has_checkpoint(self):
        return any((self.output / "checkpoints").glob("*.clk"))

    def test_trains_on_two_nodes_and_starts_again_what_dies(self):
        self.start(POLICY_OPTIONS="--steps 100000000 --time-limit 8 --tasks 50 --checkpoint-every 10 --wait 100 "
                   "--ppo-learning-rate 0.002", DOMAIN="20")
        support.wait_for("a checkpoint", 100, self.has_checkpoint)
        os.kill(self.pid_of("env-summer-127.0.0.2-1\0"), signal.SIGKILL)
        os.kill(self.pid_of("policy_service\0"), signal.SIGKILL)
        said, logs = self.finish()
        self.assertEqual(self.job.returncode, 0, said + logs)
        self.assertIn("env-summer-127.0.0.2-1 ended with status 137, starts again in 1 s", said)
        self.assertIn("policy ended with status 137, starts again in 1 s", said)
        self.assertIn(f"done; results are in {self.output}", said)
        evaluated = json.loads((self.output / "summary.json").read_text())["evaluate"]
        self.assertGreater(evaluated["fall"]["spl"], 0.9)
        self.assertIn("all acknowledged", self.log("env-fall-127.0.0.2"))
        self.assertIn("--nodelist=127.0.0.1", (self.folder / "options").read_text())

    def test_before_its_time_is_over_it_is_queued_again_and_then_goes_on(self):
        self.start(POLICY_OPTIONS="--steps 100000000 --tasks 50 --checkpoint-every 10 --wait 100", DOMAIN="20")
        support.wait_for("a checkpoint", 100, self.has_checkpoint)
        self.job.send_signal(signal.SIGUSR1)
        said, logs = self.finish()
        self.assertEqual(self.job.returncode, 0, said + logs)
        self.assertIn(f"requeue {os.getpid()}\n", (self.folder / "asked").read_text())
        self.start(POLICY_OPTIONS="--steps 100000000 --time-limit 4 --tasks 50 --wait 100", DOMAIN="20")
        said, logs = self.finish()
        self.assertEqual(self.job.returncode, 0, said + logs)
        self.assertIn("resuming after update", self.log("policy"))

    def test_odd_settings_are_refused_and_nothing_in_them_is_run(self):
        command = f"$(touch {self.folder}/run)"
        for name, value in (("ENVS", f"PATH[{command}]"), ("ACTORS", f"PATH[{command}]"), ("RANKS", "maybe"),
                            ("ENVS", "08"), ("ENVS", "99999999999999999999"),
                            ("FRAMES", f"PATH[{command}]:128"), ("FRAMES", f"0:PATH[{command}]"), ("FRAMES", "128"),
                            ("FRAMES", "9:9"), ("TRAIN", f"a{command}"), ("TRAIN", "a\nb"), ("EVALUATE", "fall ../../fall"), ("EVALUATE", f"fall{command}"), ("EVALUATE", "*")):
            self.start(**{name: value})
            said, logs = self.finish()
            self.assertEqual((self.job.returncode, logs), (2, ""), f"{name}={value}: {said}")
            self.assertRegex(said, rf"^train.sbatch: .*{name}.*: ", f"{name}={value}")
        self.assertFalse((self.folder / "run").exists())

    def test_a_wrong_option_is_not_tried_again(self):
        self.start(POLICY_OPTIONS="--no-such-option", DOMAIN="20")
        said, _ = self.finish()
        self.assertEqual(self.job.returncode, 2, said)
        self.assertNotIn("policy ended", said)
        self.assertIn("no-such-option", self.log("policy"))


if __name__ == "__main__":
    unittest.main(verbosity=2)
