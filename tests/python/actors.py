# SPDX-License-Identifier: Apache-2.0
"""env_services and actors for a learner in Python."""

import contextlib
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
def running(*services):
    """Yields services, and ends them."""
    try:
        yield services
    finally:
        for process in services:
            process.kill()
            process.wait()


def env_services(count=2, **where):
    data = as_options({name: value for name, value in DRAWN.items() if name != "frames"})
    return [service("env_service", "--agents=8", "--linger=0", f"--id=env-{i}", *data, **where) for i in range(count)]


def actor(number, **where):
    return service("policy_service", "--role=actor", f"--id=actor-{number}", "--threads=1", **where)
