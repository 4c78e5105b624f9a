# SPDX-License-Identifier: Apache-2.0
"""What a compose file says, as far as it is understood: whatever is not is an error that names it."""

import ipaddress
import os
import re
import shlex
from dataclasses import dataclass, field
from pathlib import Path

import yaml

from engine.errors import ComposeError

# Of the image or of the engine's own isolation: true here without doing anything about it.
IMAGE_KEYS = {"image", "build", "cap_drop", "security_opt", "init", "logging", "pull_policy"}
SERVICE_KEYS = IMAGE_KEYS | {
    "command", "depends_on", "deploy", "environment", "extra_hosts", "healthcheck", "network_mode", "networks", "ports",
    "profiles", "read_only", "restart", "stop_grace_period", "tmpfs", "user", "volumes", "hostname"}
CONDITIONS = ("service_started", "service_healthy", "service_completed_successfully")


@dataclass
class Health:
    test: list  # argv; ["sh", "-c", text] for CMD-SHELL
    interval: float = 30  # s, as timeout and start_period
    timeout: float = 30
    retries: int = 3
    start_period: float = 0


@dataclass
class Volume:
    source: str  # folder or file of the machine, or the name of a volume
    target: str
    named: bool
    read_only: bool


@dataclass
class Service:
    name: str
    command: list
    environment: dict = field(default_factory=dict)
    health: Health = None
    restart: str = "no"  # no, on-failure, always, unless-stopped
    restarts: int = 0  # at most, for on-failure; 0: any number
    depends_on: dict = field(default_factory=dict)  # service -> condition
    volumes: list = field(default_factory=list)
    tmpfs: list = field(default_factory=list)
    read_only: bool = False
    host: str = ""  # of the file's x-hosts: shares that one's network; empty: has one of its own
    hostname: str = ""
    network: str = ""
    address: str = ""  # on it; empty: any
    extra_hosts: dict = field(default_factory=dict)  # name -> address
    ports: list = field(default_factory=list)
    user: str = "0:0"
    grace: float = 10  # s between SIGTERM and SIGKILL
    replicas: int = 1
    cpus: float = 0  # 0: no limit, as memory (bytes) and pids
    memory: int = 0
    pids: int = 0


@dataclass
class Topology:
    name: str
    folder: Path  # of the file
    services: list
    networks: dict  # name -> Range
    hosts: dict  # host -> address, on the network "hosts"


def understand(where, mapping, known):
    if not isinstance(mapping, dict):
        raise ComposeError("must be a mapping", where)
    for key in mapping:
        if key not in known and not str(key).startswith("x-"):
            raise ComposeError(f"'{key}' is not understood", where, "known: " + ", ".join(sorted(known)))


# ---- variables

REFERENCE = re.compile(r"\$(?:(?P<dollar>\$)|(?P<plain>[A-Za-z_]\w*)|\{(?P<name>[A-Za-z_]\w*)(?:(?P<how>:?[-?])(?P<rest>[^{}]*))?\})")


def substitute(text, variables, where):
    """${NAME}, ${NAME:-standard}, ${NAME-standard}, ${NAME:?complaint} and $$, as the engines do it."""

    def value(match):
        if match["dollar"]:
            return "$"
        name, how = match["plain"] or match["name"], match["how"] or ""
        known = variables.get(name)
        if known is None or (how.startswith(":") and known == ""):
            if how.endswith("?"):
                raise ComposeError(f"{name} is not set: {match['rest']}", where)
            return match["rest"] if how else known or ""
        return known

    if "$" in REFERENCE.sub("", text):
        raise ComposeError(f"'{text}' has a $ that is no variable", where, "write $$ for a $")
    return REFERENCE.sub(value, text)


def substituted(value, variables, where):
    if isinstance(value, str):
        return substitute(value, variables, where)
    if isinstance(value, list):
        return [substituted(each, variables, where) for each in value]
    if isinstance(value, dict):
        # x- fields are anchors: what they say counts where it is used.
        return {key: each if str(key).startswith("x-") and not where else
                substituted(each, variables, f"{where}.{key}" if where else str(key)) for key, each in value.items()}
    return value


def variables_of(env_file, folder):
    """The environment goes before the file."""
    path = env_file or folder / ".env"
    variables = {}
    if env_file and not path.is_file():
        raise ComposeError("there is no such file", f"--env-file {path}")
    for number, line in enumerate(path.read_text().splitlines() if path.is_file() else [], 1):
        line = line.strip()
        if not line or line.startswith("#"):
            continue
        name, equals, value = line.partition("=")
        if not equals or not re.fullmatch(r"[A-Za-z_]\w*", name):
            raise ComposeError(f"'{line}' is not NAME=VALUE", f"{path}:{number}")
        value = value.strip()
        quoted = len(value) > 1 and value[0] == value[-1] and value[0] in "'\""
        variables[name] = value[1:-1] if quoted else re.sub(r"\s+#.*", "", value)
    return variables | dict(os.environ)


# ---- values

UNITS = {"b": 1, "k": 2**10, "m": 2**20, "g": 2**30, "kb": 2**10, "mb": 2**20, "gb": 2**30, "": 1}


def size(value, where):
    match = re.fullmatch(r"(\d+(?:\.\d+)?)([a-z]*)", str(value).lower())
    if not match or match[2] not in UNITS:
        raise ComposeError(f"'{value}' is no size, as 512m", where)
    return int(float(match[1]) * UNITS[match[2]])


def seconds(value, where):
    text = str(value)
    parts = re.findall(r"(\d+(?:\.\d+)?)(ms|us|s|m|h)", text)
    if not parts or "".join(number + unit for number, unit in parts) != text:
        raise ComposeError(f"'{value}' is no duration, as 1m30s", where)
    return sum(float(number) * {"us": 1e-6, "ms": 1e-3, "s": 1, "m": 60, "h": 3600}[unit] for number, unit in parts)


def number(value, where, kind=int):
    try:
        return kind(value)
    except (TypeError, ValueError):
        raise ComposeError(f"'{value}' is no number", where) from None


def truth(value, where):
    if str(value).lower() not in ("true", "false"):
        raise ComposeError(f"'{value}' is neither true nor false", where)
    return str(value).lower() == "true"


def words(value):
    return shlex.split(value) if isinstance(value, str) else [str(each) for each in value or []]


def pairs(value, separator, where):
    """A mapping, or a list of KEY=VALUE."""
    if isinstance(value, dict):
        return {str(key): "" if each is None else str(each) for key, each in value.items()}
    found = {}
    for each in value or []:
        key, there, rest = str(each).partition(separator)
        if not there:
            raise ComposeError(f"'{each}' is not NAME{separator}VALUE", where)
        found[key] = rest
    return found


# ---- a service

def health_of(value, where):
    understand(where, value, {"test", "interval", "timeout", "retries", "start_period", "disable"})
    test = value.get("test")
    if isinstance(test, str):
        test = ["CMD-SHELL", test]
    if value.get("disable") or test == ["NONE"]:
        return None
    if not test or test[0] not in ("CMD", "CMD-SHELL") or len(test) < 2:
        raise ComposeError("must be [CMD, program, ...] or [CMD-SHELL, text]", f"{where}.test")
    health = Health([str(each) for each in test[1:]] if test[0] == "CMD" else ["sh", "-c", test[1]])
    for key in ("interval", "timeout", "start_period"):
        if key in value:
            setattr(health, key, seconds(value[key], f"{where}.{key}"))
    health.retries = number(value.get("retries", 3), f"{where}.retries")
    return health


def volume_of(value, folder, where):
    if isinstance(value, dict):
        understand(where, value, {"type", "source", "target", "read_only"})
        kind, source, target = value.get("type"), str(value.get("source", "")), str(value.get("target", ""))
        if kind not in ("bind", "volume") or not source:
            raise ComposeError(f"type '{kind}' is not understood", where, "bind and volume, with a source, are")
        named, read_only = kind == "volume", truth(value.get("read_only", False), where)
    else:
        source, _, rest = str(value).partition(":")
        target, _, mode = rest.partition(":")
        if mode not in ("", "ro", "rw"):
            raise ComposeError(f"mode '{mode}' is not understood", where, "ro and rw are")
        named, read_only = not source.startswith((".", "/", "~")), mode == "ro"
    if not target.startswith("/"):
        raise ComposeError(f"'{target}' must be a path from /", where)
    if not named:
        source = str((folder / Path(source).expanduser()).resolve())
    return Volume(source, target, named, read_only)


def depends_on(value, where):
    if isinstance(value, list):
        return {str(each): CONDITIONS[0] for each in value}
    found = {}
    for name, how in (value or {}).items():
        understand(f"{where}.{name}", how or {}, {"condition", "restart", "required"})
        condition = (how or {}).get("condition", CONDITIONS[0])
        if condition not in CONDITIONS:
            raise ComposeError(f"condition '{condition}' is not understood", f"{where}.{name}", ", ".join(CONDITIONS))
        found[name] = condition
    return found


def restart_of(value, where):
    policy, _, most = str(value).partition(":")
    if value is False:
        policy = "no"
    if policy not in ("no", "always", "unless-stopped", "on-failure") or (most and policy != "on-failure"):
        raise ComposeError(f"'{value}' is not understood", where, "no, always, unless-stopped and on-failure[:N] are")
    return policy, number(most, where) if most else 0


def network_of(service, value, where):
    if isinstance(value, list):
        value = dict.fromkeys(value)
    if len(value) != 1:
        raise ComposeError("one network a service is understood", where)
    service.network, how = next(iter(value.items()))
    understand(f"{where}.{service.network}", how or {}, {"ipv4_address", "aliases"})
    service.address = (how or {}).get("ipv4_address", "")


def limits_of(service, value, where):
    understand(where, value, {"replicas", "resources", "mode"})
    service.replicas = number(value.get("replicas", 1), f"{where}.replicas")
    resources = value.get("resources", {})
    understand(f"{where}.resources", resources, {"limits"})
    limits = resources.get("limits", {})
    where += ".resources.limits"
    understand(where, limits, {"cpus", "memory", "pids"})
    service.cpus = number(limits.get("cpus", 0), f"{where}.cpus", float)
    service.memory = size(limits.get("memory", 0), f"{where}.memory")
    service.pids = number(limits.get("pids", 0), f"{where}.pids")


def service_of(name, value, folder, hosts):
    where = f"service {name}"
    understand(where, value, SERVICE_KEYS)
    service = Service(name, words(value.get("command")))
    if not service.command:
        raise ComposeError("has no command", where)
    service.environment = pairs(value.get("environment"), "=", f"{where}: environment")
    if "healthcheck" in value:
        service.health = health_of(value["healthcheck"], f"{where}: healthcheck")
    service.restart, service.restarts = restart_of(value.get("restart", "no"), f"{where}: restart")
    service.depends_on = depends_on(value.get("depends_on"), f"{where}: depends_on")
    service.volumes = [volume_of(each, folder, f"{where}: volumes") for each in value.get("volumes", [])]
    tmpfs = value.get("tmpfs", [])
    service.tmpfs = [str(each).partition(":")[0] for each in ([tmpfs] if isinstance(tmpfs, str) else tmpfs)]
    service.read_only = truth(value.get("read_only", False), f"{where}: read_only")
    service.extra_hosts = pairs(value.get("extra_hosts"), ":", f"{where}: extra_hosts")
    service.hostname = str(value.get("hostname", ""))
    service.ports = [str(port) for port in value.get("ports", [])]
    service.user = str(value.get("user", "0:0"))
    if not re.fullmatch(r"\d+:\d+", service.user):
        raise ComposeError(f"user '{service.user}' is not understood", where, "numbers UID:GID are")
    if "stop_grace_period" in value:
        service.grace = seconds(value["stop_grace_period"], f"{where}: stop_grace_period")
    limits_of(service, value.get("deploy", {}), f"{where}: deploy")
    mode = value.get("network_mode", "")
    if mode == "host":
        profiles = [profile for profile in value.get("profiles", []) if profile in hosts]
        if len(profiles) != 1:
            raise ComposeError("which host's network?", where, "one of its profiles must be in x-hosts: " + ", ".join(hosts))
        service.host = profiles[0]
        service.network, service.address = "hosts", hosts[service.host]
    elif mode:
        raise ComposeError(f"network_mode '{mode}' is not understood", where, "host is")
    else:
        network_of(service, value.get("networks", ["default"]), f"{where}: networks")
    return service


@dataclass
class Range:
    subnet: ipaddress.IPv4Network = None  # None: any
    chosen: ipaddress.IPv4Network = None  # part of it from which addresses are taken where none is given; None: all of it


def range_of(name, value):
    where = f"network {name}"
    understand(where, value or {}, {"driver", "ipam", "internal"})
    ipam = (value or {}).get("ipam", {})
    understand(f"{where}: ipam", ipam, {"config"})
    config = ipam.get("config", [])
    if not config:
        return Range()
    understand(f"{where}: ipam.config", config[0], {"subnet", "ip_range"})
    try:
        subnet = ipaddress.IPv4Network(config[0].get("subnet"))
        return Range(subnet, ipaddress.IPv4Network(config[0].get("ip_range", subnet)))
    except ValueError as error:
        raise ComposeError(str(error), where) from None


def load(path, env_file=None, profiles=(), project=None):
    """The topology of a file. `profiles`: of services with profiles, those with one of these; "*": all."""
    try:
        content = yaml.safe_load(path.read_text())
    except OSError as error:
        raise ComposeError(error.strerror, str(path)) from None
    except yaml.YAMLError as error:
        raise ComposeError(" ".join(str(error).split()), str(path)) from None
    understand(str(path), content, {"name", "services", "networks", "volumes"})
    folder = path.resolve().parent
    variables = variables_of(env_file, folder)
    hosts = pairs(substituted(content.get("x-hosts", {}), variables, "x-hosts"), ":", "x-hosts")
    content = substituted(content, variables, "")
    networks = {name: range_of(name, value) for name, value in (content.get("networks") or {}).items()}
    named = content.get("volumes") or {}
    for name, value in named.items():
        understand(f"volume {name}", value or {}, {"driver"})

    services = []
    for name, value in (content.get("services") or {}).items():
        wanted = value.get("profiles", []) if isinstance(value, dict) else []
        service = service_of(name, value, folder, hosts)
        if wanted and "*" not in profiles and not set(wanted) & set(profiles):
            continue
        for volume in service.volumes:
            if volume.named and volume.source not in named:
                raise ComposeError(f"volume '{volume.source}' is not among the file's volumes", f"service {name}")
        if service.network not in networks and service.network not in ("default", "hosts"):
            raise ComposeError(f"network '{service.network}' is not among the file's networks", f"service {name}")
        services.append(service)
    if not services:
        raise ComposeError("no services", str(path), "name a --profile" if content.get("services") else "")
    names = {service.name for service in services}
    for service in services:
        for other in service.depends_on:
            if other not in names:
                raise ComposeError(f"depends on '{other}', which is not there", f"service {service.name}")
    used = {service.network for service in services}
    networks = {name: networks.get(name, Range()) for name in sorted(used)}
    return Topology(project or content.get("name", folder.name), folder, services, networks, hosts)
