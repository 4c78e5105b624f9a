# SPDX-License-Identifier: Apache-2.0
"""Network namespaces, joined by bridges that live in a namespace of their own: this machine's network sees none of it."""

import ipaddress
import os
import signal
import subprocess
from pathlib import Path

from engine.errors import ComposeError

PREFIX = "citylearn-hosts-"  # of namespaces, followed by the process id of whoever made them


def ip(*words):
    done = subprocess.run(["ip", *words], stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, check=False)
    if done.returncode != 0:
        raise ComposeError(done.stdout.strip().replace("\n", "; "), "ip " + " ".join(words))
    return done.stdout


class Network:
    """Everything is removed by `remove`; what a process that was killed left behind, by the next one's `clean`."""

    def __init__(self, topology):
        self.prefix = f"{PREFIX}{os.getpid()}-"
        self.bridges = self.prefix + "bridges"
        self.numbers = {name: number for number, name in enumerate(topology.networks)}
        self.ranges = {name: given.subnet or ipaddress.IPv4Network(f"10.213.{number}.0/24")
                       for number, (name, given) in enumerate(topology.networks.items())}
        self.chosen = {name: given.chosen or self.ranges[name] for name, given in topology.networks.items()}
        if "hosts" in self.ranges:
            first = next(iter(topology.hosts.values()))
            self.ranges["hosts"] = ipaddress.IPv4Network(f"{first}/24", strict=False)
        self.taken = {name: set() for name in self.ranges}
        self.addresses = {}  # host -> address
        self.links = 0

    def open(self):
        try:
            ip("netns", "add", self.bridges)
        except ComposeError as error:
            raise ComposeError(f"no network namespace can be made here: {error}") from None
        for name, number in self.numbers.items():
            bridge = ["-n", self.bridges, "link"]
            ip(*bridge, "add", f"bridge{number}", "type", "bridge", "mcast_snooping", "0")
            ip(*bridge, "set", f"bridge{number}", "up")

    def reserve(self, network, address):
        """Addresses that are given by the file, before any is chosen."""
        if address:
            self.check(network, address)
            self.taken[network].add(address)

    def check(self, network, address):
        try:
            fits = ipaddress.IPv4Address(address) in self.ranges[network]
        except ValueError as error:
            raise ComposeError(str(error), f"network {network}") from None
        if not fits:
            raise ComposeError(f"{address} is not in {self.ranges[network]}", f"network {network}")

    def join(self, host, network, address=""):
        """Makes the host where it is not there yet, with eth0 on the network. Returns its address."""
        if host in self.addresses:
            return self.addresses[host]
        if not address:
            gateway = self.ranges[network].network_address + 1  # the engines' own
            free = (str(each) for each in self.chosen[network].hosts() if each != gateway)
            address = next((each for each in free if each not in self.taken[network]), "")
            if not address:
                raise ComposeError(f"{self.chosen[network]} has no address left", f"network {network}")
            self.taken[network].add(address)
        space, link = self.namespace(host), f"link{self.links}"
        self.links += 1
        ip("netns", "add", space)
        ip("-n", self.bridges, "link", "add", link, "type", "veth", "peer", "name", "eth0", "netns", space)
        ip("-n", self.bridges, "link", "set", link, "master", f"bridge{self.numbers[network]}", "up")
        ip("-n", space, "address", "add", f"{address}/{self.ranges[network].prefixlen}", "dev", "eth0")
        ip("-n", space, "link", "set", "lo", "up")
        ip("-n", space, "link", "set", "eth0", "up")
        self.addresses[host] = address
        return address

    def namespace(self, host):
        return self.prefix + host

    def remove(self):
        remove_namespaces(self.prefix)


def remove_namespaces(prefix):
    for line in ip("netns", "list").splitlines():
        name = line.split()[0]
        if name.startswith(prefix):
            ip("netns", "delete", name)


def clean():
    """Removes the namespaces of processes that are no more, and what may still run in them."""
    folder = Path("/run/netns")
    for name in sorted(entry.name for entry in folder.iterdir()) if folder.is_dir() else []:
        owner = name.removeprefix(PREFIX).partition("-")[0]
        if name.startswith(PREFIX) and owner.isdigit() and not is_ours(int(owner)):
            for pid in ip("netns", "pids", name).split():
                signal_to(int(pid), signal.SIGKILL)
            ip("netns", "delete", name)


def signal_to(pid, number):
    try:
        os.kill(pid, number)
    except ProcessLookupError:
        pass


def is_ours(pid):
    """Whether the process lives and is one of compose/hosts."""
    try:
        return b"hosts\0up\0" in Path(f"/proc/{pid}/cmdline").read_bytes()
    except OSError:
        return False
