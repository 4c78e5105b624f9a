# SPDX-License-Identifier: Apache-2.0
"""CityLearn's messages for any Python with the wheel cyclonedds, and how to meet the services that speak them. What to send and
when says docs/how-to/write-a-peer.md, what each field means the folder idl/ beside this file."""

import hashlib
import logging
import os
import re
import socket
import threading
import time

from cyclonedds._clayer import ddspy_take, ddspy_write
from cyclonedds.core import DDSException, ReadCondition, SampleState, ViewState, InstanceState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.qos import Policy, Qos
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from ._types import *
from ._types import TOPICS

DEPTHS = {"state": 1, "command": 64, "durable": 256}  # of writers
READER_DEPTH = 1024  # all writers of a topic share it
MAX_TOPIC = 108
LOOK_SECONDS = 1e-4
ANY = SampleState.Any | ViewState.Any | InstanceState.Any
give_way = getattr(os, "sched_yield", lambda: time.sleep(0))


def topic_name(message, session="", service=""):
    """Returns the name of the topic of a message, as "Observation": that of all, or that of one service in a session."""
    base = TOPICS[message][1]
    if not service:
        return base
    parts = [re.sub("[-._]", lambda sign: {"-": "_m", ".": "_d", "_": "_u"}[sign[0]], name) for name in (session, service)]
    name = base.replace("citylearn/", "citylearn/{}/{}/".format(*parts))
    return name if len(name) <= MAX_TOPIC else name[:90] + "_x" + hashlib.sha256(name.encode()).hexdigest()[:16]


def quality(depth):
    """Returns the quality of service of all our readers and writers."""
    last = Policy.History.KeepLast(depth)
    return Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.Durability.TransientLocal, last,
               Policy.DurabilityService(0, last, -1, -1, -1), Policy.WriterDataLifecycle(autodispose=False),
               Policy.DataRepresentation(use_cdrv0_representation=True))


class Writer:
    """Writes messages of one kind and numbers them."""

    def __init__(self, peer, message, writer):
        self.kind, self._writer = TOPICS[message][0], writer
        self._header = Header(session=peer.session, sender=peer.sender, incarnation=peer.incarnation)

    def write(self, **fields):
        """Writes a message with these fields. Raises ValueError that names a wrong one, TypeError an unknown one."""
        self._header.message += 1
        data = self.kind(header=self._header, **fields).serialize()
        result = ddspy_write(self._writer._ref, data + bytes(-len(data) % 4))
        if result < 0:
            raise DDSException(result, f"cannot write {self.kind.__name__}")


class Peer:
    """A process of a session under an id of its own, which shows each second that it lives. Use it in a `with` statement, or call
    close(). It talks to processes on this host unless `interface` (the address of one of this host) and `peers` say otherwise;
    $CYCLONEDDS_URI replaces both. Only one Peer of a process is in a domain."""

    def __init__(self, sender, *, session="default", domain=0, interface="127.0.0.1", peers=("127.0.0.1",), service="policy_service"):
        for name in (sender, session):
            if not re.fullmatch("(?!\\.+$)[A-Za-z0-9._-]{1,64}", name):
                raise ValueError(f"'{name}' must have 1 to 64 of A-Z a-z 0-9 . _ -, not dots alone")
        self.sender, self.session, self.incarnation = sender, session, time.time_ns() // 1000
        hosts = "".join(f'<Peer address="{peer}"/>' for peer in peers)
        network = (
            f'<General><Interfaces><NetworkInterface address="{interface}" multicast="false"/></Interfaces>'
            "<AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>"
            f"<MaxAutoParticipantIndex>47</MaxAutoParticipantIndex><Peers>{hosts}</Peers></Discovery>"
            "<Internal><GenerateKeyhash>true</GenerateKeyhash></Internal>")  # so that Fast DDS sees us leave
        try:
            self._domain = None if "CYCLONEDDS_URI" in os.environ else Domain(domain, network)
            self.participant = DomainParticipant(domain)
        except DDSException as error:
            raise OSError(f"cannot join domain {domain} (0..230, one Peer a process) by {interface}, which must be an address of "
                          f"this host: {error.msg}") from None
        self._waitset, self._writers, self._readers, self._look_first = WaitSet(self.participant), [], [], True
        self._status = [self.writer("ServiceStatus", to) for to in (sender, "")]
        self._status_fields = {"service": service, "host": socket.gethostname()[:64], "middleware": "cyclonedds",
                               "process": os.getpid()}
        self._closing = threading.Event()
        self._heart = threading.Thread(target=self._show_life, daemon=True)
        self._heart.start()

    def _endpoint(self, make, message, service, depth):
        topic = Topic(self.participant, topic_name(message, self.session, service), TOPICS[message][0])
        return make(self.participant, topic, quality(depth))

    def writer(self, message, service=""):
        """Returns a Writer of a kind of message, as "Action", on the topic of all or of one service."""
        self._writers.append(self._endpoint(DataWriter, message, service, DEPTHS[TOPICS[message][2]]))
        return Writer(self, message, self._writers[-1])

    def reader(self, message, service=""):
        """Returns a function that takes what has come on a topic: messages of this protocol and session. What cannot be decoded
        is dropped and logged."""
        reader = self._endpoint(DataReader, message, service, READER_DEPTH)
        self._waitset.attach(ReadCondition(reader, ANY))

        kind, batches = TOPICS[message][0], []
        self._readers.append((reader._ref, batches))

        def take():
            batches.append(ddspy_take(reader._ref, ANY, READER_DEPTH))
            messages = []
            while batches:
                batch = batches.pop(0)
                if isinstance(batch, int):
                    raise DDSException(batch, f"cannot take from {message}")
                for data, info in batch:
                    try:
                        one = info.valid_data and kind.deserialize(data)
                    except ValueError as error:
                        logging.getLogger(__name__).warning("drops a message: %s", error)
                        continue
                    if one and one.header.protocol == PROTOCOL and one.header.session in (self.session, ""):
                        messages.append(one)
            return messages

        return take

    def wait(self, seconds):
        """Waits until a reader has something, so long at most. Like our services it looks for a while before it sleeps, if that
        would have been enough the last time: waking up takes longer than an answer from the same machine."""
        patience = time.monotonic() + min(seconds, LOOK_SECONDS)
        while True:
            for reader, batches in self._readers:
                batch = ddspy_take(reader, ANY, READER_DEPTH)
                if batch:
                    batches.append(batch)
                if batches:
                    return
            if not self._look_first or time.monotonic() > patience:
                break
            give_way()  # Cyclone DDS's thread may need this very processor
        self._waitset.wait(duration(seconds=seconds))
        self._look_first = time.monotonic() < patience

    def _show_life(self):
        ended = False
        while not ended:
            ended = self._closing.wait(1)
            for writer in self._status:
                writer.write(**self._status_fields, service_state=State.STOPPING if ended else State.RUNNING)

    def close(self):
        """Says that this process ends, waits for 2 s at most until all have what was written, and leaves."""
        self._closing.set()
        self._heart.join()
        for writer in self._writers:
            writer.wait_for_acks(duration(seconds=2))
        all_of_it = self._domain or self.participant
        all_of_it._delete(all_of_it._ref)

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self.close()
