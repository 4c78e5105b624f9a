# SPDX-License-Identifier: Apache-2.0
"""The messages as a Python package over the wheel cyclonedds: their bytes, and a learner over both vendors."""

import json
import re
import select
import socket
import subprocess
import sys
import tempfile
import time
import unittest
from array import array
from unittest import mock

from support import BUILD, SOURCE, DRAWN
from actors import DOMAIN, env_services, running

FOLDER = tempfile.TemporaryDirectory(prefix="citylearn-")
subprocess.run([sys.executable, "-m", "pip", "install", "--quiet", "--no-deps", "--no-index", "--target", FOLDER.name,
                SOURCE / "python/messages"], check=True)
sys.path.insert(0, FOLDER.name)

import citylearn_messages as messages
from citylearn_messages import Action, Header, Observation


def examples():
    """Yields the name, fields by path, and bytes of each example of tests/golden/messages.txt."""
    for example in (SOURCE / "tests/golden/messages.txt").read_text().strip().split("\n\n"):
        name, fields, data = re.fullmatch(r"(\w+)\n(.*)\nbytes \d+\n(.*)", example, re.S).groups()
        yield name, dict(re.findall(r"^ *(\S+) = (.*)$", fields, re.M)), bytes.fromhex(data)


class Bytes(unittest.TestCase):
    def test_every_message_is_read_and_written_as_by_our_services(self):
        names = set()
        for name, fields, data in examples():
            with self.subTest(name):
                kind = messages.TOPICS[name][0] if name in messages.TOPICS else getattr(messages, name)
                message = kind.deserialize(data)
                for path, expected in fields.items():
                    value = message
                    for part in path.split("."):
                        value = getattr(value, part)
                    value = value.tolist() if isinstance(value, array) else getattr(value, "value", value)
                    self.assertEqual(value, json.loads(expected), path)
                self.assertEqual(message.serialize(), data)
                self.assertEqual(kind.__idl__.serialize(kind.__idl__.deserialize(data)), data, "the wheel's own CDR")
                names.add(kind.__name__)
        self.assertEqual(len(names), 18)

    def test_lengths_differ_from_message_to_message(self):
        for count, environment in (0, "a"), (256, "a"), (3, "bcd"), (3, "bcde"), (0, "a"):
            data = Action(choice=[2] * count, environment=environment, step=count).serialize()
            self.assertEqual(Action.__idl__.serialize(Action.__idl__.deserialize(data)), data, "the wheel's own CDR")
            read = Action.deserialize(data)
            self.assertEqual((read.choice.tolist(), read.environment, read.step), ([2] * count, environment, count))
        with self.assertRaisesRegex(ValueError, "Action.environment: is not a text of CDR"):  # as long, but without its end
            Action.deserialize(data.replace(b"a\0", b"aa"))

    def test_the_other_order_of_bytes(self):
        data = bytes.fromhex("00000000 0000000f 00000002 61000000 00000002 6200000000000000 0000000000000001 0000000000000002")
        self.assertEqual(Header.deserialize(data), Header(session="a", sender="b", incarnation=1, message=2))
        data = bytes.fromhex("00000000 00000002 00000001 00000102 00000000 00000000 00000000")
        self.assertEqual(messages.Belief.deserialize(data).likely.tolist(), [1, 0x102])

    def test_wrong_fields_are_named(self):
        for fields, told in (({"environment": "x" * 65}, "Action.environment: has 65 bytes; a text has at most 64"),
                             ({"environment": "a\0b"}, "none of them 0"),
                             ({"choice": [0] * 257}, "Action.choice: has 257 entries, may have 256"),
                             ({"choice": [256]}, "Action.choice: "), ({"step": -1}, "Action.step: "),
                             ({"step": "1"}, "Action.step: "), ({"header": None}, "Header.protocol: "),
                             ({"belief": messages.Belief(lost=["a"])}, "Action.belief: Belief.lost: ")):
            with self.subTest(told), self.assertRaisesRegex(ValueError, told):
                Action(**fields).serialize()
        data = Action(choice=[1, 2], environment="env").serialize()
        for wrong, told in ((data[:-6], "Action.belief: Belief.entropy"), (b"\0\7" + data[2:], "does not begin as CDR does"), (b"", "does not begin"),
                            (data[:12] + b"\xff" + data[13:], "Action.header: Header.session: ")):
            with self.subTest(told), self.assertRaisesRegex(ValueError, told):
                Action.deserialize(wrong)
        with self.assertRaises(TypeError):
            Observation(colour=1)

    def test_topics_are_those_of_the_page(self):
        self.assertEqual(messages.topic_name("Action", "default", "env-summer"), "citylearn/default/env_msummer/action")
        self.assertEqual(messages.topic_name("TraversalInfo"), "citylearn/traversal_info")
        long = messages.topic_name("EpisodeAcknowledgement", "a" * 64, "b_" * 32)
        self.assertRegex(long, "^citylearn/a{64}/b_ub.*_x[0-9a-f]{16}$")
        self.assertEqual(len(long), 90 + 2 + 16)
        with self.assertRaisesRegex(ValueError, "'a b' must have 1 to 64 of"):
            messages.Peer("a b")
        for wrong in {"domain": 500}, {"domain": DOMAIN, "interface": "192.0.2.1"}:
            with self.assertRaisesRegex(OSError, "cannot join domain .* must be an address of this host"):
                messages.Peer("python", **wrong)


class Learner(unittest.TestCase):
    def test_what_cannot_be_decoded_is_dropped(self):
        with messages.Peer("python", domain=DOMAIN) as peer:
            take, write = peer.reader("ServiceStatus"), peer.writer("ServiceStatus").write
            write(service="before")
            with self.assertLogs("citylearn_messages") as said:
                serialize = messages.ServiceStatus.serialize
                with mock.patch.object(messages.ServiceStatus, "serialize", lambda message, **_: serialize(message).replace(
                        b"wrong", b"wr\xffng")):  # not UTF-8, which Cyclone DDS lets pass
                    write(service="wrong")
                self.wait_for(peer, take, lambda _: said.output)
            write(service="after")
            self.wait_for(peer, take, lambda seen: "after" in seen)
            write(service="not taken")
            begin = time.monotonic()
            for _ in range(2):
                peer.wait(60)
            self.assertLess(time.monotonic(), begin + 50)
            self.assertIn("not taken", [one.service for one in take()])
        self.assertRegex(said.output[0], "drops a message: ServiceStatus.service: .* byte 0xff")

    def wait_for(self, peer, take, condition):
        deadline, seen = time.monotonic() + 20, set()
        while not condition(seen):
            self.assertLess(time.monotonic(), deadline)
            peer.wait(0.1)
            seen |= {one.service for one in take()}

    def test_services_notice_that_it_leaves(self):
        peer, heard = messages.Peer("python", domain=DOMAIN), []  # before the env_service, so it has the first ports
        infos = peer.reader("TraversalInfo")
        with running(*env_services(1, middleware="fastdds")):
            self.wait_for(peer, lambda: heard.extend(infos()) or (), lambda _: heard)
            peer.close()
            with socket.socket(type=socket.SOCK_DGRAM) as discovery, socket.socket(type=socket.SOCK_DGRAM) as data:
                for offset, port in enumerate((discovery, data)):
                    port.bind(("127.0.0.1", 7410 + offset + 250 * DOMAIN))
                announced = 0  # once a second, as are TraversalInfos, which go to those that read them
                while announced < 3:
                    self.assertEqual(select.select([discovery, data], [], [], 20)[0], [discovery])
                    announced += b"\0\1\0\xc2" in discovery.recv(65536)

    def test_it_completes_every_task_over_both_vendors_and_a_lossy_wire(self):
        program = SOURCE / "python/examples/peer.py"
        self.assertLessEqual(len(program.read_text().splitlines()), 60)
        for vendor in "cyclonedds", "fastdds", "lossy,drop=0.05,repeat=0.05,reorder=0.05,seed=3:cyclonedds":
            with self.subTest(vendor), running(*env_services(1, middleware=vendor)):
                done = subprocess.run([sys.executable, "-B", program, f"--domain={DOMAIN}", "--frames=32", "--tasks=64"],
                                      env={"PYTHONPATH": FOLDER.name}, capture_output=True, text=True, timeout=100, check=False)
                self.assertRegex(done.stdout, r"^SPL 1.000 of 64 tasks, \d+ steps/s\n$", done.stderr)
                self.assertEqual(done.stderr, "")


if __name__ == "__main__":
    unittest.main()
