# SPDX-License-Identifier: Apache-2.0
"""env_services for tests in Python."""

import contextlib
import os
import signal
import subprocess

from support import BUILD, DRAWN
from domain import own_domain

DOMAIN = own_domain()
WHERE = {"middleware": "cyclonedds", "domain": DOMAIN, "interface": "lo", "log_level": "error"}


def as_options(keywords):
    return [f"--{name.replace('_', '-')}={value}" for name, value in keywords.items()]


def service(name, *options, middleware=WHERE["middleware"]):
    return subprocess.Popen([BUILD / name / name, *as_options({**WHERE, "middleware": middleware}), *options])


@contextlib.contextmanager
def running(*services, end=signal.SIGKILL):
    """Yields services, and ends them."""
    try:
        yield services
    finally:
        for process in services:
            process.send_signal(signal.SIGCONT)
            process.send_signal(end)
            process.wait()


def put_to_sleep(process):
    """Stops a process, and returns once it stands: until then it may still answer."""
    process.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, process.pid, os.WSTOPPED)


def env_services(count=2, agents=8, traversal="summer", data=None, **where):
    options = as_options({name: value for name, value in (data or DRAWN).items() if name != "frames"})
    return [service("env_service", f"--agents={agents}", "--linger=0", f"--traversal={traversal}",
                    f"--id=env-{traversal}-{i}", *options, **where) for i in range(count)]
