# SPDX-License-Identifier: Apache-2.0
"""Recordings in other hands: MCAP files that ours wrote, and a bag of ROS 2 that rosbags wrote for ours."""

import json
import math
import subprocess
import tempfile
import unittest
from pathlib import Path

from support import BUILD
from messages_test import messages

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore


class Recordings(unittest.TestCase):
    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))

    def run_program(self, program, *arguments):
        done = subprocess.run([BUILD / program, *arguments], capture_output=True, text=True, timeout=100, check=False)
        self.assertEqual(done.returncode, 0, done.stderr)
        return done.stdout

    def same(self, value, expected, where):
        """Compares a decoded message with JSON, which has null for NaN."""
        if isinstance(expected, dict):
            for name, field in expected.items():
                self.same(getattr(value, name), field, f"{where}.{name}")
        elif expected is None:
            self.assertTrue(math.isnan(value), where)
        else:
            self.assertEqual(list(value) if isinstance(expected, list) else value, expected, where)

    def test_mcap_reads_a_recording_whose_messages_python_decodes(self):
        path = self.folder / "sample.mcap"
        self.run_program("tests/mcap/mcap_sample", path)
        wanted = iter(json.loads(Path(f"{path}.json").read_text())["messages"])
        with path.open("rb") as file:
            for schema, channel, message in make_reader(file, validate_crcs=True).iter_messages():
                expected = next(wanted)
                self.assertEqual((channel.topic, schema.name, str(message.log_time), message.data.hex()),
                                 tuple(expected[name] for name in ("topic", "type", "time", "data")))
                decoded = getattr(messages, schema.name.split("::")[-1]).deserialize(message.data)
                self.assertEqual((decoded.header.session, decoded.header.sender, str(decoded.header.incarnation)),
                                 (expected["run"], expected["sender"], expected["incarnation"]))
                self.assertEqual(decoded.serialize(), message.data)
        self.assertIsNone(next(wanted, None))

    def test_a_recording_for_ros_2(self):
        sample, path = self.folder / "sample.mcap", self.folder / "ros2.mcap"
        self.run_program("tests/ros2/ros2_sample", sample)
        self.run_program("tools/ros2/citylearn_ros2", "--open", sample, "--output", path, "--agents", "2", "--speed", ".5")
        expected = {(each["topic"], int(each["time"])): each for each in json.loads(Path(f"{sample}.json").read_text())}
        by_mcap = {(each.channel.topic, each.log_time_ns): (each.schema.name, each.ros_msg) for each in read_ros2_messages(path)}
        types = get_typestore(Stores.ROS2_JAZZY)
        for each in read_ros2_messages(path):
            self.assertEqual(each.channel.metadata["topic_type_hash"], types.hash_rihs01(each.schema.name))
        with AnyReader([path]) as reader:
            by_rosbags = {(connection.topic, time): (connection.msgtype, reader.deserialize(data, connection.msgtype))
                          for connection, time, data in reader.messages()}
        for read in by_mcap, by_rosbags:
            self.assertEqual(read.keys(), expected.keys())
            for key, (kind, message) in read.items():
                self.assertEqual(kind, expected[key]["type"])
                self.same(message, expected[key]["fields"], key[0])

    def test_a_bag_that_rosbags_wrote_is_a_traversal(self):
        types = get_typestore(Stores.ROS2_HUMBLE)
        kinds = {name.split("/")[-1]: types.types[name] for name in types.types}
        random = np.random.default_rng(1)
        for storage in StoragePlugin.MCAP, StoragePlugin.SQLITE3:
            bag = self.folder / storage.name
            with Writer(bag, version=9, storage_plugin=storage) as writer:
                camera, position = (writer.add_connection(topic, f"sensor_msgs/msg/{kind}", typestore=types)
                                    for topic, kind in (("/camera", "Image"), ("/fix", "NavSatFix")))
                for number in range(20):
                    time = 10**18 + number * 10**9
                    header = kinds["Header"](kinds["Time"](sec=10**9 + number, nanosec=0), "map")
                    picture = random.integers(0, 256, 24 * 32 * 3, np.uint8)
                    writer.write(camera, time, types.serialize_cdr(kinds["Image"](
                        header=header, height=24, width=32, encoding="rgb8", is_bigendian=0, step=96, data=picture),
                        "sensor_msgs/msg/Image"))
                    writer.write(position, time, types.serialize_cdr(kinds["NavSatFix"](
                        header=header, status=kinds["NavSatStatus"](status=0, service=1), latitude=50 + number / 10000,
                        longitude=10.0, altitude=0.0, position_covariance=np.zeros(9), position_covariance_type=0),
                        "sensor_msgs/msg/NavSatFix"))
            said = self.run_program("tools/data/citylearn_data", "info", bag)
            self.assertRegex(said, r" 20 +211 +11\.12 +/fix +32x24 ")  # 1/10000 degree is 11.12 m


if __name__ == "__main__":
    unittest.main()
