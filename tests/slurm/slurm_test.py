# SPDX-License-Identifier: Apache-2.0
"""compose/slurm/train.sbatch under Debian's Slurm: arrays, heterogeneous jobs, ranks, requeueing, wrong settings."""

import json
import os
import shutil
import signal
import subprocess
import sys
import unittest
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "compose"))
import cluster
from cluster import Cluster, state_of
from support import COMPOSE, PREFIX, call, wait_for

CLUSTER = Cluster()
BIN = PREFIX / "bin"
SMALL = {"BIN": BIN, "FRAMES": "0:48", "ENCODER_OPTIONS": "--dimension 24"}
TRAINING = "--tasks 50 --checkpoint-every 5 --wait 100"


def setUpModule():
    unittest.enterModuleContext(CLUSTER)


def process_with(words, setting=""):
    """The process of a job whose command line has these words and whose environment has NAME=VALUE."""
    for entry in Path("/proc").glob("[0-9]*"):
        try:
            command = (entry / "cmdline").read_text().replace("\0", " ")
            if words in command and "srun" not in command and setting in (entry / "environ").read_text():
                return int(entry.name)
        except OSError:
            continue
    raise AssertionError(f"no process has '{words}'")


class Slurm(unittest.TestCase):
    def setUp(self):
        self.output = CLUSTER.folder / self.id().rpartition(".")[2]
        self.output.mkdir()
        self.jobs = []
        self.addCleanup(self.cancel)

    def cancel(self):
        for job in self.jobs:
            call("scancel", job, check=False)
        wait_for("the queue is empty", 60, lambda: not call("squeue", "-h", check=False).strip(), CLUSTER.report)
        shutil.rmtree(self.output)

    def submit(self, *options, output=None, **settings):
        settings = SMALL | {"OUTPUT": output or self.output} | settings
        said = call("sbatch", "--parsable", "--output", f"{self.output}/job-%A_%a.out", "--cpus-per-task=2", "--mem=2G", *options,
                    COMPOSE / "slurm/train.sbatch", env=os.environ | {name: str(value) for name, value in settings.items()})
        self.jobs.append(said.strip())
        return self.jobs[-1]

    def report(self):
        """What the jobs and services said last."""
        logs = sorted([*self.output.rglob("*.out"), *self.output.rglob("*.log")])
        return "".join(f"---- {log.name}\n{log.read_text(errors='replace')[-1500:]}\n" for log in logs) + CLUSTER.report()

    def finish(self, job, seconds=300):
        wait_for(f"job {job} has ended", seconds, lambda: not state_of(job) & {"PENDING", "RUNNING", "COMPLETING"}, self.report)
        self.assertEqual(state_of(job), {"COMPLETED"}, self.report())

    def start_requeued(self, job):
        """Soon: Slurm waits two minutes, because a node may still refuse the credentials that it revoked."""
        wait_for(f"job {job} is queued again", 60, lambda: state_of(job) == {"PENDING"}, self.report)
        call("scontrol", "update", f"JobId={job}", "StartTime=now+3")

    def said(self):
        return "".join(file.read_text() for file in sorted(self.output.glob("*.out")))

    def log(self, name):
        path = self.output / "logs" / f"{name}.log"
        return path.read_text() if path.exists() else ""

    def expect_trained(self, folder):
        for traversal, figures in json.loads((folder / "summary.json").read_text())["evaluate"].items():
            self.assertGreater(figures["spl"], 0.9, traversal)

    def wait_for_checkpoint(self, folder):
        wait_for(f"a checkpoint in {folder}", 120, lambda: any((folder / "checkpoints").glob("*.clk")), self.report)

    def test_an_array_has_one_seed_a_task_and_a_killed_one_ends_with_the_same_bytes(self):
        options = {"POLICY_OPTIONS": f"--lockstep --steps 100000 {TRAINING}"}
        disturbed = self.submit("--nodes=1", "--array=1-4", output=self.output / "disturbed", **options)
        self.wait_for_checkpoint(self.output / "disturbed/seed-2")
        os.kill(process_with("slurm_script", "SLURM_ARRAY_TASK_ID=2\0"), signal.SIGKILL)
        wait_for("it has failed", 60, lambda: state_of(f"{disturbed}_2") == {"FAILED"}, self.report)
        self.assertFalse((self.output / "disturbed/seed-2/summary.json").exists(), "it was killed too late")
        call("scontrol", "requeue", f"{disturbed}_2")
        self.start_requeued(f"{disturbed}_2")
        for seed in range(1, 5):
            self.finish(f"{disturbed}_{seed}")
        self.assertIn("resuming after update", (self.output / "disturbed/seed-2/logs/policy.log").read_text())
        calm = self.submit("--nodes=1", "--array=1-4", output=self.output / "calm", **options)
        for seed in range(1, 5):
            self.finish(f"{calm}_{seed}")
            folders = [self.output / name / f"seed-{seed}" for name in ("calm", "disturbed")]
            newest = [max((folder / "checkpoints").glob("checkpoint-*.clk")) for folder in folders]
            self.assertEqual(newest[0].name, newest[1].name)
            self.assertTrue(newest[0].read_bytes() == newest[1].read_bytes(), f"other bytes of seed {seed}\n{self.report()}")
            self.assertEqual(*(json.loads((folder / "summary.json").read_text())["evaluate"] for folder in folders))

    def test_a_heterogeneous_job_has_a_learner_environments_and_actors(self):
        job = self.submit("--nodes=1", ":", "--nodes=2", ":", "--nodes=1", ACTORS=2,
                          POLICY_OPTIONS=f"--steps 100000000 --time-limit 12 --ppo-learning-rate 0.002 {TRAINING}")
        self.wait_for_checkpoint(self.output)
        self.assertRegex(call("squeue", "-h", "-o", "%i %N"), rf"(?m)^{job}\+0 node\d$")
        for service in ("actor", "env-summer"):
            os.kill(process_with(f"--id {service}-node"), signal.SIGKILL)
        self.finish(job)
        for service in ("actor", "env-summer"):
            self.assertRegex(self.said(), rf"{service}-node\d-[12] ended with status 137, starts again in 1 s")
        self.assertEqual(len(list((self.output / "logs").glob("env-summer-node*"))), 4)
        self.assertRegex(self.log("policy"), r"actor 'actor-node\d-2' joins")
        self.expect_trained(self.output)

    def test_ranks_learn_one_agent_though_one_is_killed(self):
        job = self.submit("--nodes=2", RANKS="yes", ENVS=1,
                          POLICY_OPTIONS=f"--steps 100000000 --time-limit 15 --ppo-learning-rate 0.002 {TRAINING}")
        self.wait_for_checkpoint(self.output / "rank-0")
        os.kill(process_with("--rank 1 "), signal.SIGKILL)
        self.finish(job)
        self.assertIn("policy-1 ended with status 137, starts again in 1 s", self.said())
        self.assertEqual(json.loads((self.output / "rank-0/manifest.json").read_text())["ranks"], 2)
        self.expect_trained(self.output / "rank-0")

    def test_srun_numbers_ranks(self):
        """The commands of docs/how-to/run-on-a-cluster.md, for less work."""
        page = (COMPOSE.parent / "docs/how-to/run-on-a-cluster.md").read_text()
        start = page.index("cat >rank.sh")
        commands = page[start:page.index("```", start)]
        commands = commands.replace("--frames 0:128", "--frames 0:24").replace("--output", "--steps 8192 --tasks 20 --wait 60 --output")
        self.assertIn("--steps 8192", commands)
        done = subprocess.run(["bash", "-euc", commands], cwd=self.output, env=os.environ | {"PATH": f"{BIN}:{os.environ['PATH']}"},
                              stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, timeout=200, check=False)
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertEqual(json.loads((self.output / "out/rank-0/manifest.json").read_text())["ranks"], 2)
        self.assertTrue((self.output / "out/rank-1/summary.json").exists(), done.stdout)

    def test_before_its_time_is_over_it_is_queued_again_and_then_goes_on(self):
        job = self.submit("--nodes=2", POLICY_OPTIONS=f"--steps 60000 {TRAINING}")
        self.wait_for_checkpoint(self.output)
        call("scancel", "--signal=USR1", "--batch", job)
        self.start_requeued(job)
        self.finish(job)
        self.assertIn("queued again", self.said())
        self.assertIn(f"done; results are in {self.output}", self.said())
        self.assertIn("stopped by a signal", self.log("policy"))
        self.assertIn("resuming after update", self.log("policy"))
        self.expect_trained(self.output)

    def test_odd_settings_are_refused_and_nothing_in_them_is_run(self):
        command = f"$(touch {self.output}/run)"
        for name, value in (("ENVS", f"PATH[{command}]"), ("ACTORS", f"PATH[{command}]"), ("RANKS", "maybe"),
                            ("ENVS", "08"), ("ENVS", "99999999999999999999"),
                            ("FRAMES", f"PATH[{command}]:128"), ("FRAMES", f"0:PATH[{command}]"), ("FRAMES", "128"),
                            ("FRAMES", "9:9"), ("TRAIN", f"a{command}"), ("TRAIN", "a\nb"), ("EVALUATE", "fall ../../fall"),
                            ("EVALUATE", f"fall{command}"), ("EVALUATE", "*")):
            settings = {"SLURM_JOB_ID": "1", "SLURM_JOB_NODELIST": "node1", "OUTPUT": f"{self.output}/odd", name: value}
            done = subprocess.run(["bash", COMPOSE / "slurm/train.sbatch"], env=os.environ | settings, capture_output=True,
                                  text=True, timeout=60, check=False)
            self.assertEqual((done.returncode, done.stdout), (2, ""), f"{name}={value}: {done.stderr}")
            self.assertRegex(done.stderr, rf"^train.sbatch: .*{name}.*: ", f"{name}={value}")
        self.assertEqual(list(self.output.iterdir()), [])

    def test_a_wrong_option_is_not_tried_again(self):
        job = self.submit("--nodes=2", POLICY_OPTIONS="--no-such-option")
        wait_for("it has failed", 60, lambda: state_of(job) == {"FAILED"}, self.report)
        self.assertNotIn("policy ended", self.said())
        self.assertIn("no-such-option", self.log("policy"))


if __name__ == "__main__":
    if cluster.INSIDE not in os.environ:
        reason = cluster.unavailable()
        if reason:
            print("skipped:", reason)
            sys.exit(77)
    cluster.enter()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    unittest.main(verbosity=2)
