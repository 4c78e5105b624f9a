# SPDX-License-Identifier: Apache-2.0
"""Our nodes as ROS 2 Jazzy itself meets them, rclpy over rmw_fastrtps: it finds and calls services, and says the time."""

import json
import os
import subprocess
import sys
import tempfile
import time
import unittest
from pathlib import Path

from support import BUILD
from actors import as_options, running
from domain import own_domain

os.environ.update({"RMW_IMPLEMENTATION": "rmw_fastrtps_cpp", "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST"})
import rclpy  # noqa: E402
from geometry_msgs.msg import PoseStamped  # noqa: E402
from nav_msgs.srv import GetPlan  # noqa: E402
from rosgraph_msgs.msg import Clock  # noqa: E402
from std_srvs.srv import SetBool  # noqa: E402

SECONDS = 30


def hash_of(package, name):
    """Returns the hash that rosidl has computed of a type of a service."""
    service = name.removesuffix("_Request").removesuffix("_Response")
    told = json.loads((Path(sys.prefix) / f"share/{package}/srv/{service}.json").read_text())
    return next(each["hash_string"] for each in told["type_hashes"] if each["type_name"] == f"{package}/srv/{name}")


def pose(x, y=0.0):
    result = PoseStamped()
    result.header.frame_id, result.pose.position.x, result.pose.position.y = "map", x, y
    return result


class Nodes(unittest.TestCase):
    """A test of our nodes, which meet one of rclpy."""

    def setUp(self):
        self.folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        self.domain = own_domain()
        self.ros = as_options({"ros_domain": self.domain, "ros_middleware": "fastdds", "ros_interface": "lo"})
        rclpy.init(domain_id=self.domain)
        self.addCleanup(rclpy.try_shutdown)
        self.node = rclpy.create_node("caller")
        self.here = as_options({"domain": own_domain(), "middleware": "fastdds", "interface": "lo"})

    def robot(self, *options):
        """Starts an env_service whose robot was taught places every 2 m."""
        (self.folder / "summer").mkdir()
        for place in range(4):
            (self.folder / f"summer/{place}.ppm").write_bytes(b"P6 16 16 255\n" + bytes([place]) * 768)
        (self.folder / "summer.poses.csv").write_text("x,y\n0,0\n2,0\n4,0\n6,0\n")
        return subprocess.Popen([
            BUILD / "env_service/env_service", "--dataset=live", f"--data={self.folder}", "--traversal=summer", "--as=robot",
            "--camera=/camera", "--position=/pose", "--position-type=pose", "--goal=/goal_pose", *self.here, *self.ros, *options])

    def call(self, kind, service, request):
        client = self.node.create_client(kind, service)
        self.assertTrue(client.wait_for_service(SECONDS), service)
        reply = client.call_async(request)
        rclpy.spin_until_future_complete(self.node, reply, timeout_sec=SECONDS)
        return reply.result()


class Services(Nodes):
    def check_types(self, node, services):
        """The node has these services and no others, with the hashes of rosidl."""
        self.assertEqual(dict(self.node.get_service_names_and_types_by_node(node, "/citylearn")),
                         {f"/citylearn/{node}/{name}": [kind] for name, kind in services.items()})
        for name, kind in services.items():
            package, _, service = kind.split("/")
            for ends, topic, half in ((self.node.get_subscriptions_info_by_topic, f"rq/citylearn/{node}/{name}Request", "Request"),
                                      (self.node.get_publishers_info_by_topic, f"rr/citylearn/{node}/{name}Reply", "Response")):
                told = [str(end.topic_type_hash) for end in ends(topic, no_mangle=True) if end.node_name == node]
                self.assertEqual(told, [hash_of(package, f"{service}_{half}")], topic)

    def test_teach_is_paused(self):
        teach = [BUILD / "tools/robot/citylearn_teach", f"--output={self.folder}", "--traversal=taught", "--camera=/camera", *self.ros]
        with running(subprocess.Popen([*teach, "--start-paused"])):
            for data, told in ((False, "0 frames, paused"), (True, "0 frames"), (False, "0 frames, paused")):
                reply = self.call(SetBool, "/citylearn/teach/record", SetBool.Request(data=data))
                said = reply.message.partition(";")[0]  # behind it, after a while, that nobody publishes /camera
                self.assertEqual((reply.success, said), (True, told))
            self.check_types("teach", {"record": "std_srvs/srv/SetBool"})

    def test_a_robot_is_asked_for_the_way_and_sent(self):
        with running(self.robot()):
            way = self.call(GetPlan, "/citylearn/env_robot/get_plan", GetPlan.Request(start=pose(5.9), goal=pose(2.2))).plan
            self.assertEqual([(each.pose.position.x, each.pose.orientation.w) for each in way.poses], [(6.0, 1.0), (4.0, 1.0), (2.0, 1.0)])
            self.assertLess(abs(way.header.stamp.sec - time.time()), 60)
            for goal in (pose(2.0), pose(float("nan")), pose(1e5)):  # nobody drives it, and the others are no places
                self.assertEqual(self.call(GetPlan, "/citylearn/env_robot/set_goal", GetPlan.Request(goal=goal)).plan.poses, [])
            self.check_types("env_robot", {"get_plan": "nav_msgs/srv/GetPlan", "set_goal": "nav_msgs/srv/GetPlan"})


class Time(Nodes):
    """Its time is what a node publishes on /clock."""

    def setUp(self):
        super().setUp()
        self.ros.append("--use-sim-time")
        time_of_simulator, clock = Clock(), self.node.create_publisher(Clock, "/clock", 1)
        time_of_simulator.clock.sec, time_of_simulator.clock.nanosec = 1000, 5
        self.node.create_timer(0.05, lambda: clock.publish(time_of_simulator))

    def spin_until(self, condition):
        deadline = time.monotonic() + 2 * SECONDS
        while not condition():
            self.assertLess(time.monotonic(), deadline)
            rclpy.spin_once(self.node, timeout_sec=0.1)

    def test_a_robot_stamps_with_it(self):
        def stamp():
            way = self.call(GetPlan, "/citylearn/env_robot/get_plan", GetPlan.Request(start=pose(6.0), goal=pose(2.0))).plan
            return way.header.stamp.sec, way.header.stamp.nanosec

        with running(self.robot()):
            self.spin_until(lambda: stamp() != (0, 0))
            self.assertEqual(stamp(), (1000, 5))

    def test_so_does_the_bridge(self):
        stamps = []
        self.node.create_subscription(PoseStamped, "/citylearn/env_summer/agent_0/pose", lambda each: stamps.append(each.header.stamp), 10)
        programs = [
            ["env_service/env_service", "--traversal=summer", "--synthetic-images=0", "--synthetic-frames=40", *self.here],
            ["policy_service/policy_service", "--mode=evaluate", "--agent=shortest_path", "--evaluate=summer", "--tasks=1000000", *self.here],
            ["tools/ros2/citylearn_ros2", "--actions", "--rate=0", *self.here, *self.ros]]
        with running(*(subprocess.Popen([BUILD / program, *options], cwd=self.folder) for program, *options in programs)):
            self.spin_until(lambda: len(stamps) >= 10)
        self.assertEqual({(each.sec, each.nanosec) for each in stamps}, {(1000, 5)})


if __name__ == "__main__":
    unittest.main()
