# SPDX-License-Identifier: Apache-2.0
"""A Slurm cluster of Debian's own daemons on one machine. The process that calls `enter` moves into namespaces of its own; each node
is a network namespace with a host name there. All ends with that process."""

import os
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from support import call, wait_for

NODES = 4
INSIDE = "CITYLEARN_SLURM_INSIDE"
CONFIGURATION = """ClusterName=citylearn
SlurmctldHost=node0(198.51.100.10)
SlurmUser=root
AuthInfo=socket={folder}/munge.socket
StateSaveLocation={folder}/state
SlurmdSpoolDir={folder}/spool-%n
SlurmctldPidFile={folder}/slurmctld.pid
SlurmdPidFile={folder}/slurmd-%n.pid
ProctrackType=proctrack/linuxproc
TaskPlugin=task/none
SelectType=select/cons_tres
SelectTypeParameters=CR_Core
SchedulerParameters=bf_interval=1,sched_interval=1,sched_min_interval=1000
# Nodes pretend to have more processors than the machine.
SlurmdParameters=config_overrides
MpiDefault=none
MailProg=/bin/true
KillWait=5
NodeName=node[1-{nodes}] CPUs=8 RealMemory=16000
PartitionName=all Nodes=ALL Default=YES
"""


def unavailable():
    """Why no cluster can run here; empty when one can."""
    if os.geteuid() != 0:
        return "only root can make namespaces for the nodes"
    for program, package in (("slurmctld", "slurmctld"), ("slurmd", "slurmd"), ("munged", "munge"), ("sbatch", "slurm-client"),
                             ("bridge", "iproute2")):
        if not shutil.which(program):
            return f"{program} is missing (package {package})"
    trial = subprocess.run([*NAMESPACES, "sh", "-c", "mount -t tmpfs none /run && ip link add name hub type bridge"],
                           capture_output=True, text=True, check=False)
    return f"no namespaces here: {trial.stderr.strip()}" if trial.returncode != 0 else ""


NAMESPACES = ["unshare", "--mount", "--uts", "--net", "--pid", "--fork", "--kill-child", "--mount-proc"]


def enter():
    """Starts this program anew in namespaces of its own, unless it is there."""
    if INSIDE not in os.environ:
        os.execvpe("unshare", [*NAMESPACES, sys.executable, "-B", *sys.orig_argv[sys.orig_argv.index(sys.argv[0]):]],
                   os.environ | {INSIDE: "1"})


class Cluster:
    def __init__(self):
        self.temporary = tempfile.TemporaryDirectory(prefix="citylearn-")
        self.folder = Path(self.temporary.name)
        self.daemons = []

    def __enter__(self):
        for place in ("/run", "/dev/shm"):
            call("mount", "-t", "tmpfs", "none", place)
        hosts = self.folder / "hosts"
        hosts.write_text("127.0.0.1 localhost\n" + "".join(f"198.51.100.1{i} node{i}\n" for i in range(NODES + 1)))
        call("mount", "--bind", hosts, "/etc/hosts")
        call("hostname", "node0")
        self.ip("link add name hub up type bridge", "address add 198.51.100.10/24 dev hub", "link set lo up")
        for i in range(1, NODES + 1):
            self.ip(f"netns add node{i}", f"link add port{i} master hub up type veth peer wire netns node{i}",
                    f"-n node{i} address add 198.51.100.1{i}/24 dev wire", f"-n node{i} link set wire up", f"-n node{i} link set lo up")
            call("bridge", "link", "set", "dev", f"port{i}", "mcast_flood", "off")
        self.start_daemons()
        return self

    @staticmethod
    def ip(*commands):
        for command in commands:
            call("ip", *command.split())

    def start_daemons(self):
        key = self.folder / "munge.key"
        key.write_bytes(os.urandom(1024))
        key.chmod(0o600)
        (self.folder / "slurm.conf").write_text(CONFIGURATION.format(folder=self.folder, nodes=NODES))
        os.environ["SLURM_CONF"] = str(self.folder / "slurm.conf")
        (self.folder / "state").mkdir()
        munge = [f"--{name}={self.folder}/munge.{name.split('-')[0]}" for name in ("key-file", "socket", "pid-file", "log-file", "seed-file")]
        self.daemon("munged", "munged", "--foreground", "--force", *munge)
        wait_for("munged answers", 20, lambda: (self.folder / "munge.socket").exists(), self.report)
        self.daemon("slurmctld", "slurmctld", "-D", "-i")
        for i in range(1, NODES + 1):
            (self.folder / f"spool-node{i}").mkdir()
            self.daemon(f"slurmd-node{i}", "nsenter", f"--net=/run/netns/node{i}", "unshare", "--uts", "sh", "-c",
                        f"hostname node{i} && exec slurmd -D -N node{i}")
        wait_for("all nodes are idle", 60, lambda: call("sinfo", "-h", "-o", "%t %D", check=False).strip() == f"idle {NODES}", self.report)

    def daemon(self, name, *command):
        with open(self.folder / f"{name}.log", "wb") as log:
            self.daemons.append(subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT))

    def report(self):
        """What each daemon said last, and the queue."""
        logs = [f"---- {log.name}\n{log.read_text(errors='replace')[-1500:]}" for log in sorted(self.folder.glob("*.log"))]
        return "\n".join([*logs, call("squeue", check=False), call("sinfo", check=False)])

    def __exit__(self, *_):
        for daemon in reversed(self.daemons):
            daemon.terminate()
        for daemon in self.daemons:
            daemon.wait()
        self.temporary.cleanup()


def state_of(job):
    """The states of a job, a task of an array or all parts of a heterogeneous job, as COMPLETED."""
    shown = call("scontrol", "--oneliner", "show", "job", job, check=False)
    return {word.partition("=")[2] for word in shown.split() if word.startswith("JobState=")}
