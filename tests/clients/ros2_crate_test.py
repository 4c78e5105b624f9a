# SPDX-License-Identifier: Apache-2.0
"""Our nodes of ROS 2 as the crate ros2-client sees, hears, sends and calls them (ros2_client/)."""

import contextlib
import os
import subprocess
import tempfile
import threading
import unittest
from pathlib import Path

from support import BUILD
from actors import as_options, running
from domain import own_domain

from rosbags.typesys import Stores, get_typestore

TYPES = get_typestore(Stores.ROS2_JAZZY)
SECONDS, PEER = 60, os.environ["PEER"]


def topic(name, kind):
    package, _, message = kind.split("/")
    return f"topic rt/{name} {package}::msg::dds_::{message}_ typehash={TYPES.hash_rihs01(kind)};"


SAID = {
    "node /citylearn/simulated_robot", "node /citylearn/teach", "node /citylearn/env_robot",
    topic("pose", "geometry_msgs/msg/PoseStamped"), topic("odom", "nav_msgs/msg/Odometry"),
    topic("camera/image_raw/compressed", "sensor_msgs/msg/CompressedImage"), topic("cmd_vel", "geometry_msgs/msg/Twist"),
    topic("citylearn/command", "std_msgs/msg/UInt8"), topic("citylearn/status", "std_msgs/msg/String"),
    "pose in map", "status refused",  # a goal, as nobody drives
    '/citylearn/teach/record SetBoolResponse { success: true, message: "0 frames, paused" }',
    "/citylearn/env_robot/get_plan [0.0, 1.0, 2.0]"}


class Nodes(unittest.TestCase):
    maxDiff = None

    def test_they_are_seen_heard_sent_and_called(self):
        for vendor, mapping in (("cyclonedds", "cyclone"), ("fastdds", "enhanced")):
            with self.subTest(vendor=vendor, mapping=mapping):
                self.check(vendor, mapping)

    def check(self, vendor, mapping):
        folder, domain = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-"))), own_domain()
        ros = as_options({"ros_domain": domain, "ros_middleware": vendor, "ros_interface": "lo"})
        here = as_options({"domain": own_domain(), "middleware": vendor, "interface": "lo", "log_level": "error"})
        (folder / "summer").mkdir()
        for place in range(3):
            (folder / f"summer/{place}.ppm").write_bytes(b"P6 16 16 255\n" + bytes([place]) * 768)
        (folder / "summer.poses.csv").write_text("x,y\n0,0\n1,0\n2,0\n")
        commands = [
            ["tools/robot/citylearn_robot", "--metres=100", *ros],
            ["tools/robot/citylearn_teach", f"--output={folder}", "--traversal=taught", "--camera=/nothing", *ros],
            ["env_service/env_service", "--dataset=live", f"--data={folder}", "--traversal=summer", "--as=robot",
             "--camera=/nothing", "--position=/pose", "--position-type=pose", "--goal=/goal_pose", *here, *ros]]
        peer = subprocess.Popen([PEER, str(domain), mapping], stdout=subprocess.PIPE, text=True)
        with running(peer), contextlib.ExitStack() as programs:
            timer = threading.Timer(SECONDS, peer.kill)
            timer.start()
            self.addCleanup(timer.cancel)
            missing, said = set(SAID), []

            def hear(awaited):
                while awaited & missing and (line := peer.stdout.readline()):
                    said.append(line.rstrip("\n"))
                    missing.discard(said[-1])

            # One after another: of what nodes tell of themselves the crate keeps one message, whoever sent it.
            for (program, *options), node in zip(commands, ("simulated_robot", "teach", "env_robot")):
                programs.enter_context(running(subprocess.Popen([BUILD / program, *options])))
                hear({f"node /citylearn/{node}"})
            hear(SAID)
        peer.stdout.close()
        self.assertEqual(missing, set(), "\n".join(said))


if __name__ == "__main__":
    unittest.main()
