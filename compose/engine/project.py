# SPDX-License-Identifier: Apache-2.0
"""A topology that runs: who is started when, watched, restarted and ended. One thread; a coroutine a service."""

import asyncio
import contextlib
import dataclasses
import fcntl
import json
import os
import re
import shutil
import signal
import sys
import time
from pathlib import Path

from engine import container as containers
from engine import network as networks
from engine.container import Container, Limits
from engine.errors import ComposeError
from engine.network import signal_to

STATES = Path("/run/citylearn-hosts")  # a folder each project: who runs, what they said
SHORTEST_PAUSE, LONGEST_PAUSE = 0.1, 60.0  # s before a restart; it doubles, as the engines do it
STEADY = 10.0  # s after which a service that ran has earned the shortest pause again


def pause_before(restarts):
    """Seconds before the restart that follows so many in a row."""
    return min(LONGEST_PAUSE, SHORTEST_PAUSE * 2 ** min(restarts, 20))


def restarted(service, status, restarts):
    """Whether a service that ended by itself with this status is to be started again."""
    if service.restart in ("always", "unless-stopped"):
        return True
    return service.restart == "on-failure" and status != 0 and (service.restarts == 0 or restarts < service.restarts)


def folder_of(project):
    if not re.fullmatch(r"[a-z0-9][a-z0-9_-]{0,40}", project):
        raise ComposeError(f"'{project}' is no project's name", "name", "small letters, digits, - and _")
    return STATES / project


def states_of(project):
    """Process id of the `up` that runs a project, and the state of each service."""
    try:
        content = json.loads((folder_of(project) / "state.json").read_text())
    except OSError:
        content = {"owner": 0}
    if not networks.is_ours(content["owner"]):
        raise ComposeError(f"'{project}' does not run", "", "compose/hosts up FILE starts it")
    return content["owner"], content["services"]


class Running:
    """A container and what is known of it."""

    def __init__(self, container):
        self.container, self.service = container, container.service
        self.state, self.health, self.status = "created", "starting" if container.service.health else "", None
        self.restarts, self.pid, self.process = 0, None, None
        self.changed = asyncio.Event()  # set at each change, by whoever made it
        self.ended = False  # for good

    def meets(self, condition):
        if condition == "service_healthy":
            return self.health == "healthy"
        if condition == "service_completed_successfully":
            return self.ended and self.status == 0
        return self.state in ("running", "restarting") or self.ended


class Project:
    def __init__(self, topology, prefix, volumes, wanted):
        self.topology, self.prefix, self.wanted = topology, prefix.resolve(), wanted
        self.folder = folder_of(topology.name)
        self.volumes = (volumes or Path("/var/lib/citylearn-hosts") / topology.name).resolve()
        names = [service.name for service in topology.services]
        if wanted and wanted not in names:
            raise ComposeError(f"there is no '{wanted}'", "--exit-code-from", "known: " + ", ".join(names))
        if not (self.prefix / "bin").is_dir():
            raise ComposeError("has no bin", f"--prefix {prefix}", "cmake --install build/release --prefix DIR makes one")
        self.running, self.stopping, self.network = {}, None, None

    # ---- from nothing to nothing

    async def run(self):
        self.stopping = asyncio.Event()
        for name in (signal.SIGTERM, signal.SIGINT, signal.SIGHUP):
            asyncio.get_running_loop().add_signal_handler(name, self.stopping.set)
        STATES.mkdir(exist_ok=True)
        with open(STATES / f"{self.topology.name}.lock", "w", encoding="ascii") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                raise ComposeError(f"'{self.topology.name}' runs already", "up", "--project gives another name") from None
            networks.clean()
            containers.clean(networks.PREFIX, networks.is_ours)
            shutil.rmtree(self.folder, ignore_errors=True)
            self.folder.mkdir()
            self.network = networks.Network(self.topology)
            try:
                self.prepare()
                await self.serve()
            finally:
                self.network.remove()
                for each in self.running.values():
                    each.container.limits.remove()
                (self.folder / "state.json").unlink(missing_ok=True)
        return self.status()

    def prepare(self):
        self.network.open()
        for service in self.topology.services:
            self.network.reserve(service.network, service.address)
        for service in self.topology.services:
            for number in range(1, service.replicas + 1):
                name = service.name if service.replicas == 1 else f"{service.name}-{number}"
                self.add(name, service)
        addresses = {each.container.host: each.container.address for each in self.running.values()}
        for each in self.running.values():
            each.container.write_names(addresses)
        self.save()

    def add(self, name, service):
        limits = Limits(f"{networks.PREFIX}{os.getpid()}-{name}", service)
        if limits.broken:
            self.say(name, "runs without its limit of " + ", ".join(limits.broken))
        volumes = []
        for volume in service.volumes:
            source = str(self.volumes / volume.source) if volume.named else volume.source
            containers.prepare_volume(source, service.user)
            volumes.append(dataclasses.replace(volume, source=source))
        container = Container(name, service, self.prefix, self.folder, volumes, limits)
        container.address = self.network.join(container.host, service.network, service.address)
        for port in service.ports:
            self.say(name, f"port {port} is not published: it is reached at {container.address} from within")
        self.running[name] = Running(container)

    async def serve(self):
        """Until all have ended, the wanted one has, or somebody wants us to stop."""
        tasks = [asyncio.create_task(self.supervise(each)) for each in self.running.values()]
        stop = asyncio.create_task(self.stopping.wait())
        if self.wanted:
            ends = [task for task, each in zip(tasks, self.running.values()) if each.service.name == self.wanted]
        else:
            ends = [asyncio.gather(*tasks)]
        try:
            done, _ = await asyncio.wait([stop, *ends], return_when=asyncio.FIRST_COMPLETED)
            for task in done:
                task.result()
        finally:
            self.stopping.set()
            await self.stop()
            stop.cancel()
            await asyncio.gather(stop, *tasks, *ends, return_exceptions=True)

    async def stop(self):
        """Whoever depends on somebody ends before it."""
        left = dict(self.running)
        while left:
            needed = {name for each in left.values() for name in each.service.depends_on}
            now = [each for each in left.values() if each.service.name not in needed] or list(left.values())
            await asyncio.gather(*(self.end(each) for each in now))
            for each in now:
                del left[each.container.name]

    async def end(self, each):
        """SIGTERM, and SIGKILL after the grace period."""
        if not each.process or each.process.returncode is not None:
            return
        if each.pid:
            signal_to(each.pid, signal.SIGTERM)
        else:
            signal_to(each.process.pid, signal.SIGKILL)
        try:
            await asyncio.wait_for(each.process.wait(), each.service.grace)
        except asyncio.TimeoutError:
            self.say(each.container.name, f"did not end within {each.service.grace:g} s and is killed")
            signal_to(each.process.pid, signal.SIGKILL)
            await each.process.wait()

    def status(self):
        """Of the wanted service: 0 when all its replicas ended well."""
        ended = [each.status for each in self.running.values() if each.service.name == self.wanted]
        return next((status for status in ended if status), 0)

    # ---- one service

    async def supervise(self, each):
        await self.dependencies(each)
        in_a_row = 0
        while not self.stopping.is_set():
            begin = time.monotonic()
            await self.start(each)
            if self.stopping.is_set():
                await self.end(each)  # stop() may have come by while it was starting
            health = asyncio.create_task(self.watch(each)) if each.service.health else None
            status = await each.process.wait()
            if health:
                health.cancel()
            each.status = 128 - status if status < 0 else status  # as shells say it
            each.pid = None
            each.health = "starting" if each.service.health else ""
            if self.stopping.is_set() or not restarted(each.service, each.status, each.restarts):
                break
            in_a_row = 0 if time.monotonic() - begin >= STEADY else in_a_row
            pause = pause_before(in_a_row)
            self.change(each, "restarting", f"ended with status {each.status}, starts again in {pause:g} s")
            in_a_row += 1
            each.restarts += 1
            try:
                await asyncio.wait_for(self.stopping.wait(), pause)
            except asyncio.TimeoutError:
                pass
        each.ended = True
        self.change(each, "exited", f"ended with status {each.status}" if each.status is not None else "never started")

    async def dependencies(self, each):
        for name, condition in each.service.depends_on.items():
            for other in [other for other in self.running.values() if other.service.name == name]:
                while not other.meets(condition) and not self.stopping.is_set():
                    if other.ended:
                        self.say(each.container.name, f"waits for {name} in vain: it has ended ({condition})")
                        await self.stopping.wait()
                        return
                    other.changed.clear()
                    changed = asyncio.create_task(other.changed.wait())
                    stop = asyncio.create_task(self.stopping.wait())
                    await asyncio.wait([changed, stop], return_when=asyncio.FIRST_COMPLETED)
                    changed.cancel()
                    stop.cancel()

    async def start(self, each):
        container = each.container
        with open(container.log, "ab") as log:
            command = container.command(self.network.namespace(container.host))
            each.process = await asyncio.create_subprocess_exec(
                *command, stdin=asyncio.subprocess.DEVNULL, stdout=log, stderr=log, start_new_session=True)
        while each.process.returncode is None and each.pid is None:
            each.pid = container.inside(each.process.pid)
            await asyncio.sleep(0.01)
        self.change(each, "running", "" if each.restarts else f"started at {container.address}")

    async def watch(self, each):
        """Health: healthy after a check that succeeds, unhealthy after so many in a row that did not."""
        health, failed, begin = each.service.health, 0, time.monotonic()
        while True:
            await asyncio.sleep(health.interval)
            good = await self.check(each)
            failed = 0 if good else failed + (time.monotonic() - begin >= health.start_period)
            now = "healthy" if good else "unhealthy" if failed >= health.retries else each.health
            if now != each.health:
                each.health = now
                self.change(each, each.state, now)

    async def check(self, each):
        try:
            process = await asyncio.create_subprocess_exec(
                *containers.enter(each.pid, each.service.health.test), stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.STDOUT)
        except OSError:
            return False  # it has just ended
        try:
            said, _ = await asyncio.wait_for(process.communicate(), each.service.health.timeout)
        except asyncio.TimeoutError:
            with contextlib.suppress(ProcessLookupError):
                process.kill()
            await process.wait()
            said = b"took too long\n"
        except asyncio.CancelledError:
            with contextlib.suppress(ProcessLookupError):  # it may have ended with its service
                process.kill()
            raise
        with open(self.folder / "logs" / f"{each.container.name}.health", "ab") as log:
            log.write(b"status %d: %s\n" % (process.returncode, said.strip()))
        return process.returncode == 0

    # ---- telling

    def change(self, each, state, news):
        each.state = state
        each.changed.set()
        if news:
            self.say(each.container.name, news)
        self.save()

    @staticmethod
    def say(name, news):
        print(f"{name}: {news}", file=sys.stderr, flush=True)

    def save(self):
        services = {name: {"state": each.state, "status": each.status, "health": each.health, "restarts": each.restarts,
                           "pid": each.pid, "address": each.container.address} for name, each in self.running.items()}
        path = self.folder / "state.json"
        path.with_suffix(".new").write_text(json.dumps({"owner": os.getpid(), "services": services}))
        path.with_suffix(".new").rename(path)
