# SPDX-License-Identifier: Apache-2.0
"""Our programs as nodes of ROS 2, as a peer over the wheel cyclonedds sees them in ROS 2's own topic of nodes, and their
services, which it calls as a client of rmw_cyclonedds does."""

import itertools
import subprocess
import tempfile
import time
import types
import unittest
import uuid
from dataclasses import dataclass
from pathlib import Path

from support import BUILD
from actors import as_options, running
from domain import own_domain

from cyclonedds import builtin
from cyclonedds.core import Policy, Qos, ReadCondition, SampleState, WaitSet
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.types import array, int64, sequence, uint8, uint64
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration
from rosbags.typesys import Stores, get_typestore

LOCAL = """<General><Interfaces><NetworkInterface address="127.0.0.1" multicast="false"/></Interfaces>
  <AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto</ParticipantIndex>
  <MaxAutoParticipantIndex>32</MaxAutoParticipantIndex><Peers><Peer address="127.0.0.1"/></Peers></Discovery>"""
GRAPH, GRAPH_TYPE = "ros_discovery_info", "rmw_dds_common/msg/ParticipantEntitiesInfo"
# rosbags 0.11.9 is no judge of this one, which has a `char`: as rosidl 4.9.2 computes it.
GRAPH_HASH = "RIHS01_91a0593bacdcc50ea9bdcf849a938b128412cc1ea821245c663bcd26f83c295e"
# rosbags knows no services: as rosidl 4.6.6 has them in std_srvs 5.3.6 and nav_msgs 5.3.6.
SERVICE_HASHES = {
    "std_srvs/srv/SetBool_Request": "RIHS01_c62fbb99d94e1b25e8ef9e109f9581956bb1b3361a45a4e5810c36a90d29932e",
    "std_srvs/srv/SetBool_Response": "RIHS01_d0814e7f7b4880ab77e9c57426c7aa1562ab69f11eef8e2e968812f9cbd0b059",
    "std_srvs/srv/SetBool": "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
    "nav_msgs/srv/GetPlan_Request": "RIHS01_f1bb9fab287948b4432a4a7e4f529e7ea6269cd06269ee8fcb911fdb4acd23c3",
    "nav_msgs/srv/GetPlan_Response": "RIHS01_30a947cd360777929073296c368c591dc2117a89c15b7a975a6faa0a901836fd",
    "nav_msgs/srv/GetPlan": "RIHS01_234f7aff100f5edb8150366601687b027bcdc253db47decb88fff846193fe5e8"}
TYPES = get_typestore(Stores.ROS2_JAZZY)


def message_of(gid_bytes):
    """Returns rmw_dds_common's message of nodes, with gids of that size."""
    @dataclass
    class Gid(IdlStruct, typename="rmw_dds_common::msg::dds_::Gid_"):
        data: array[uint8, gid_bytes]

    @dataclass
    class NodeEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::NodeEntitiesInfo_"):
        node_namespace: str
        node_name: str
        reader_gid_seq: sequence[Gid]
        writer_gid_seq: sequence[Gid]

    @dataclass
    class ParticipantEntitiesInfo(IdlStruct, typename="rmw_dds_common::msg::dds_::ParticipantEntitiesInfo_"):
        gid: Gid
        node_entities_info_seq: sequence[NodeEntitiesInfo]

    return ParticipantEntitiesInfo


def user_data(sample):
    text = next((policy.data for policy in sample.qos if isinstance(policy, Policy.Userdata)), b"").decode()
    return dict(pair.split("=") for pair in text.split(";")[:-1])


def uuid_of(gid):
    assert not any(gid.data[16:])
    return uuid.UUID(bytes=bytes(gid.data[:16]))


class Peer:
    """What ROS 2 knows of a domain: nodes by participant, endpoints, enclaves."""

    def __init__(self, domain, gid_bytes):
        self.domain = Domain(domain, f"<CycloneDDS><Domain>{LOCAL}</Domain></CycloneDDS>")
        self.participant = DomainParticipant(domain)
        kinds = builtin.BuiltinTopicDcpsParticipant, builtin.BuiltinTopicDcpsPublication, builtin.BuiltinTopicDcpsSubscription
        self.builtin = [builtin.BuiltinDataReader(self.participant, kind) for kind in kinds]
        self.reader = DataReader(self.participant, Topic(self.participant, GRAPH, message_of(gid_bytes)), qos=Qos(
            Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, Policy.History.KeepAll))
        self.waitset = WaitSet(self.participant)
        self.waitset.attach(ReadCondition(self.reader, SampleState.NotRead))
        self.enclaves, self.endpoints, self.nodes = {}, {}, {}

    def graph(self):
        """Returns the topics of each node: which way, name, type. A wrong hash stands behind the type."""
        for way, reader in zip(("is", "publishes", "reads"), self.builtin):
            for sample in reader.take(1000):
                if way == "is":
                    self.enclaves[sample.key] = user_data(sample).get("enclave")
                    continue
                kind, hashed = sample.type_name.replace("::dds_::", "/").replace("::", "/").rstrip("_"), user_data(sample).get("typehash")
                known = {GRAPH_TYPE: GRAPH_HASH, **SERVICE_HASHES}
                if hashed and hashed != (known.get(kind) or TYPES.hash_rihs01(kind)):
                    kind += f": {hashed}"
                if user_data(sample).get("sertypehash") != SERVICE_HASHES.get(kind.removesuffix("_Request").removesuffix("_Response")):
                    kind += f": service {user_data(sample)}"
                self.endpoints[sample.key] = (way, sample.topic_name, kind.split("/")[-1] if hashed else "no hash")
        for message in self.reader.take(1000):
            self.nodes[uuid_of(message.gid)] = message.node_entities_info_seq
        return {f"{node.node_namespace}/{node.node_name}": {
            self.endpoints.get(uuid_of(gid)) for gid in node.reader_gid_seq + node.writer_gid_seq}
            for key, nodes in self.nodes.items() if self.enclaves.get(key) == "/" for node in nodes}


AGENT = "rt/citylearn/env_summer/agent_0"
CAMERA, ODOMETRY, POSE, COMMAND = (
    ("rt/camera/image_raw/compressed", "CompressedImage"), ("rt/odom", "Odometry"), ("rt/pose", "PoseStamped"), ("rt/cmd_vel", "Twist"))
def service(node, name, kind):
    return {("reads", f"rq/citylearn/{node}/{name}Request", f"{kind}_Request"), ("publishes", f"rr/citylearn/{node}/{name}Reply", f"{kind}_Response")}


NODES = {
    "/citylearn/simulated_robot": {("publishes", *CAMERA), ("publishes", *ODOMETRY), ("publishes", *POSE), ("reads", *COMMAND)},
    "/citylearn/teach": {("reads", *CAMERA), ("reads", *ODOMETRY), *service("teach", "record", "SetBool")},
    "/citylearn/env_robot": {("reads", *CAMERA), ("reads", *POSE), ("reads", "rt/goal_pose", "PoseStamped"), ("publishes", *COMMAND),
                             ("publishes", "rt/citylearn/command", "UInt8"), ("publishes", "rt/citylearn/status", "String"),
                             *service("env_robot", "set_goal", "GetPlan"), *service("env_robot", "get_plan", "GetPlan")},
    "/citylearn/ros2_bridge": {("publishes", f"{AGENT}/{name}", kind) for name, kind in {  # those come later than the node
        "pose": "PoseStamped", "goal_pose": "PoseStamped", "action": "UInt8", "cmd_vel": "Twist", "reward": "Float32",
        "episode/spl": "Float32", "episode/reward": "Float32"}.items()},
}


def request_of(**fields):
    """Returns the type of requests of std_srvs/SetBool with these fields behind what rmw_cyclonedds puts before them."""
    annotations = {"__annotations__": {"guid": uint64, "seq": int64, **fields}}
    return dataclass(types.new_class("Request", (IdlStruct,), {"typename": "std_srvs::srv::dds_::SetBool_Request_"},
                                     lambda names: names.update(annotations)))


@dataclass
class Response(IdlStruct, typename="std_srvs::srv::dds_::SetBool_Response_"):
    guid: uint64
    seq: int64
    success: bool
    message: str


class Client:
    """A client of rmw_cyclonedds of the service /citylearn/teach/record, whose requests are of some type."""

    def __init__(self, domain, request):
        self.participant, self.request = DomainParticipant(domain), request
        qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.Volatile, Policy.History.KeepLast(10))
        self.writer = DataWriter(self.participant, Topic(self.participant, "rq/citylearn/teach/recordRequest", request), qos=qos)
        self.reader = DataReader(self.participant, Topic(self.participant, "rr/citylearn/teach/recordReply", Response), qos=qos)
        self.deadline = time.monotonic() + 30
        while not (self.writer.get_matched_subscriptions() and self.reader.get_matched_publications()):
            assert time.monotonic() < self.deadline, "the service is not found"
            time.sleep(0.01)

    def call(self, *values):
        self.writer.write(self.request(0xFEDCBA9876543210, -5, *values))
        while not (replies := self.reader.take()) and time.monotonic() < self.deadline:
            time.sleep(0.01)
        return [(reply.guid, reply.seq, reply.success, reply.message) for reply in replies]


class Services(unittest.TestCase):
    def test_teach_is_paused(self):
        for vendor in ("cyclonedds", "fastdds"):
            with self.subTest(vendor=vendor):
                self.check(vendor)

    def check(self, vendor):
        folder, domain = self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")), own_domain()
        ros = as_options({"ros_domain": domain, "ros_middleware": vendor, "ros_interface": "lo"})
        teach = [BUILD / "tools/robot/citylearn_teach", f"--output={folder}", "--traversal=taught", "--camera=/camera", *ros]
        here = Domain(domain, f"<CycloneDDS><Domain>{LOCAL}</Domain></CycloneDDS>")
        with running(subprocess.Popen(teach)):
            call, no = (0xFEDCBA9876543210, -5), (False, "the request cannot be read")
            whole = request_of(data=bool)
            client = Client(domain, whole)
            self.assertEqual(client.call(False), [(*call, True, "0 frames, paused")])
            self.assertEqual(client.call(True), [(*call, True, "0 frames")])
            self.assertEqual(Client(domain, request_of()).call(), [(*call, *no)], "it is cut short")
            self.assertEqual(Client(domain, request_of(data=bool, more=str)).call(True, "x"), [(*call, *no)], "it is too long")
            self.assertEqual(Client(domain, request_of(data=uint8)).call(7), [(*call, *no)], "it is not a boolean")
            self.assertEqual(Client(domain, whole).call(False), [(*call, True, "0 frames, paused")])
        del client, here


class Nodes(unittest.TestCase):
    maxDiff = None

    def test_programs_are_nodes(self):
        for vendor, (distro, gid_bytes) in itertools.product(("cyclonedds", "fastdds"), (("humble", 24), ("jazzy", 16))):
            with self.subTest(vendor=vendor, distro=distro):
                self.check(vendor, distro, gid_bytes)

    def check(self, vendor, distro, gid_bytes):
        folder = Path(self.enterContext(tempfile.TemporaryDirectory(prefix="citylearn-")))
        domain, log = own_domain(), self.enterContext(open(folder / "log", "w+"))
        ros = as_options({"ros_domain": domain, "ros_middleware": vendor, "ros_interface": "lo", "ros_distro": distro})
        here = as_options({"domain": own_domain(), "middleware": vendor, "interface": "lo", "log_level": "warn"})
        (folder / "summer").mkdir()
        for place in range(3):
            (folder / f"summer/{place}.ppm").write_bytes(b"P6 16 16 255\n" + bytes([place]) * 768)
        (folder / "summer.poses.csv").write_text("x,y\n0,0\n1,0\n2,0\n")
        camera = "--camera=/camera/image_raw/compressed"
        commands = [
            ["tools/robot/citylearn_robot", "--metres=1000", *ros],
            ["tools/robot/citylearn_teach", f"--output={folder}", "--traversal=taught", "--position=/odom", camera, *ros],
            ["env_service/env_service", "--dataset=live", f"--data={folder}", "--traversal=summer", "--as=robot", camera,
             "--position=/pose", "--position-type=pose", "--goal=/goal_pose", *here, *ros],
            ["env_service/env_service", "--traversal=summer", "--synthetic-images=0", "--synthetic-frames=40", *here],
            ["policy_service/policy_service", "--mode=evaluate", "--agent=shortest_path", "--evaluate=summer", "--tasks=1000000", *here],
            ["tools/ros2/citylearn_ros2", "--actions", *here, *ros]]
        peer = Peer(domain, gid_bytes)
        with running(*(subprocess.Popen([BUILD / program, *options], stdout=log, stderr=log) for program, *options in commands)):
            deadline, graph = time.monotonic() + 60, {}
            while graph != NODES and time.monotonic() < deadline:
                peer.waitset.wait(duration(milliseconds=100))
                graph = peer.graph()
        log.seek(0)
        self.assertEqual(graph, NODES, log.read())
        self.assertIn(("publishes", GRAPH, "ParticipantEntitiesInfo"), peer.endpoints.values())


if __name__ == "__main__":
    unittest.main()
