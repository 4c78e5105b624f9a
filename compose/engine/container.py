# SPDX-License-Identifier: Apache-2.0
"""One service's process, and what it sees: a root of its own with /usr of this machine, the installed programs at
/usr/local, its volumes, a /tmp and a /proc of its own; only root's children outside see it, it sees nobody."""

import os
import shlex
from pathlib import Path


CGROUPS = Path("/sys/fs/cgroup")
MARK = "container=compose-hosts"  # in a service's environment, as other engines leave theirs


def prepare_volume(source, user):
    """Folders of volumes are made where they are missing, for the service's user, as the image's are."""
    path = Path(source)
    if path.exists():
        return
    path.mkdir(parents=True)
    os.chown(path, *(int(each) for each in user.split(":")))


class Limits:
    """Memory, processors and number of processes by control groups, of version 2 or 1; what cannot be kept is said."""

    def __init__(self, name, service):
        self.folders, self.broken = [], []
        wanted = {"memory": service.memory, "cpu": service.cpus, "pids": service.pids}
        for controller, value in wanted.items():
            if not value:
                continue
            try:
                self.limit(name, controller, value)
            except OSError as error:
                self.broken.append(f"{controller} ({error.strerror})")

    def limit(self, name, controller, value):
        unified = (CGROUPS / "cgroup.controllers").exists()
        base = CGROUPS if unified else CGROUPS / controller
        if unified and controller not in (base / "cgroup.subtree_control").read_text().split():
            (base / "cgroup.subtree_control").write_text("+" + controller)
        if not unified and not (base / "cgroup.procs").exists():
            raise OSError(0, "this kernel has no such control group here")
        folder = base / name
        folder.mkdir(exist_ok=True)
        if folder not in self.folders:
            self.folders.append(folder)
        period = 100000  # microseconds
        if controller == "memory":
            (folder / ("memory.max" if unified else "memory.limit_in_bytes")).write_text(str(value))
        elif controller == "pids":
            (folder / "pids.max").write_text(str(value))
        elif unified:
            (folder / "cpu.max").write_text(f"{int(value * period)} {period}")
        else:
            (folder / "cpu.cfs_period_us").write_text(str(period))
            (folder / "cpu.cfs_quota_us").write_text(str(int(value * period)))

    def remove(self):
        for folder in self.folders:
            try:
                folder.rmdir()
            except OSError:
                pass  # the next start cleans


def clean(prefix, is_ours):
    """Removes control groups of processes that are no more."""
    for folder in [*CGROUPS.glob(f"{prefix}*"), *CGROUPS.glob(f"*/{prefix}*")]:
        owner = folder.name.removeprefix(prefix).partition("-")[0]
        if owner.isdigit() and not is_ours(int(owner)):
            try:
                folder.rmdir()
            except OSError:
                pass


def script(container):
    """Shell, run as root in fresh namespaces: builds the root, then becomes the service."""
    root, service = shlex.quote(str(container.root)), container.service
    lines = ["set -e"]
    lines += [f"echo 0 >{shlex.quote(str(folder / 'cgroup.procs'))}" for folder in container.limits.folders]
    lines += [f"hostname {shlex.quote(container.hostname)}", f"mount -t tmpfs -o mode=755 tmpfs {root}", f"cd {root}"]

    def bind(source, target, read_only, folder=True):
        where = shlex.quote("." + target)
        parent = shlex.quote("." + os.path.dirname(target))
        lines.append(f"mkdir -p {where}" if folder else f"mkdir -p {parent}; [ -e {where} ] || : >{where}")
        lines.append(f"mount --bind {shlex.quote(str(source))} {where}")
        if read_only:
            lines.append(f"mount -o remount,bind,ro {where}")

    for name in ("bin", "sbin", "lib", "lib32", "lib64", "libx32"):
        path = Path("/") / name
        if path.is_symlink():
            lines.append(f"ln -s {shlex.quote(os.readlink(path))} {name}")
        elif path.is_dir():
            bind(path, f"/{name}", True)
    bind("/usr", "/usr", True)
    bind("/etc", "/etc", True)
    bind("/dev", "/dev", False)
    lines += ["mkdir proc run tmp", "mount -t proc proc proc", "mount -t tmpfs -o mode=1777 tmpfs dev/shm", "chmod 1777 tmp"]
    bind(container.prefix, "/usr/local", True)
    bind(container.names, "/etc/hosts", True, False)
    if not Path("/etc/resolv.conf").is_symlink():  # nobody answers in here: an empty one says so at once
        bind("/dev/null", "/etc/resolv.conf", False, False)
    for volume in container.volumes:
        bind(volume.source, volume.target, volume.read_only, Path(volume.source).is_dir())
    for target in service.tmpfs:
        lines += [f"mkdir -p .{shlex.quote(target)}", f"mount -t tmpfs -o mode=1777 tmpfs .{shlex.quote(target)}"]
    if service.read_only:
        lines.append("mount -o remount,ro .")
    user, group = service.user.split(":")
    rights = ["--reuid", user, "--regid", group, "--clear-groups", "--no-new-privs", "--bounding-set", "-all",
              "--pdeathsig", "KILL"]  # again: a change of user forgets it
    command = ["chroot", ".", "setpriv", *rights, "env", "-i", *container.environment, *service.command]
    lines.append("exec " + shlex.join(command))
    return "\n".join(lines)


class Container:
    """A service, or one of its replicas; started as often as it takes."""

    def __init__(self, name, service, prefix, folder, volumes, limits):
        self.name, self.service, self.prefix = name, service, prefix
        self.host = service.host or name
        self.hostname = service.host or service.hostname or name
        self.root, self.names, self.log = folder / "roots" / name, folder / "names" / name, folder / "logs" / f"{name}.log"
        self.volumes, self.limits = volumes, limits
        self.address = ""
        known = {"PATH": "/usr/local/bin:/usr/bin:/bin", "HOME": "/", "HOSTNAME": self.hostname} | service.environment
        self.environment = [MARK, *(f"{name}={value}" for name, value in known.items())]
        for path in (self.root, self.names.parent, self.log.parent):
            path.mkdir(parents=True, exist_ok=True)

    def write_names(self, addresses):
        """/etc/hosts: every service by name, and the file's own extra_hosts."""
        names = {"localhost": "127.0.0.1"} | addresses | {self.hostname: self.address} | self.service.extra_hosts
        self.names.write_text("".join(f"{address} {name}\n" for name, address in names.items()))

    def command(self, namespace):
        """Dies with compose/hosts, and all inside dies with it. The shell in between is there for the status of a service that
        is killed, which `unshare --fork` of Debian 12 loses."""
        dying = ["setpriv", "--pdeathsig", "KILL"]
        return [*dying, "nsenter", f"--net=/run/netns/{namespace}", "unshare", "--mount", "--pid", "--uts", "--ipc",
                "sh", "-c", '"$@" & wait $!', "sh", *dying, "sh", "-c", script(self)]

    @staticmethod
    def inside(pid):
        """The service's own process, a child of the one that was started; None while its root is still being built."""
        try:
            child = Path(f"/proc/{pid}/task/{pid}/children").read_text().split()[0]
            is_service = MARK in environment_of(child)
        except (OSError, IndexError):
            return None
        return int(child) if is_service else None


def environment_of(pid):
    return [each for each in Path(f"/proc/{pid}/environ").read_text().split("\0") if each]


def enter(pid, words):
    """A command inside a running service: in its namespaces, as its user, with its environment."""
    facts = os.stat(f"/proc/{pid}")
    return ["setpriv", "--pdeathsig", "KILL", "nsenter", "--target", str(pid), "--mount", "--uts", "--ipc", "--net", "--pid",
            "--root", "--wd", "setpriv", "--reuid", str(facts.st_uid), "--regid", str(facts.st_gid), "--clear-groups",
            "env", "-i", *environment_of(pid), *words]
