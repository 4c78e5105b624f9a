#!/usr/bin/env bash
# MCAP's registry says that a `cdr` message is "an XCDR1 or XCDR2 stream"; its first two bytes tell which. One would
# expect MCAP's own mcap-ros2-support 0.6.0 to read both or to refuse. It looks at the byte order alone and reads XCDR2
# as XCDR1: the length in front of an appendable type, which types are in DDS-XTypes unless they say otherwise, is taken
# for the first field, and every later field gets the one before it. Bytes left over are ignored, so nothing is said.
# It hurts those who record peers that write XCDR2, as Cyclone DDS does for such a type. rosbags 0.11.9 refuses it.
# Seen: x 1.5, y 2.5, heading 3.5 are read as 0.0, 1.5, 2.5. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet cyclonedds==11.0.1 mcap==1.6.0 mcap-ros2-support==0.6.0
cat >read.py <<'END'
import sys
from dataclasses import dataclass
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import appendable
from cyclonedds.idl.types import float32
from mcap.writer import Writer
from mcap_ros2.reader import read_ros2_messages

@dataclass
@appendable
class Pose(IdlStruct, typename="Pose"):
    x: float32
    y: float32
    heading: float32

seen = []
for xcdr2 in (False, True):
    data = Pose(1.5, 2.5, 3.5).serialize(use_version_2=xcdr2)
    with open("drive.mcap", "wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema("drive/msg/Pose", "ros2msg", b"float32 x\nfloat32 y\nfloat32 heading\n")
        channel = writer.register_channel("/pose", "cdr", schema)
        writer.add_message(channel, log_time=1, publish_time=1, data=data)
        writer.finish()
    pose = next(iter(read_ros2_messages("drive.mcap"))).ros_msg
    seen.append((data[:2].hex(), round(pose.x, 3), pose.y, pose.heading))
    print("mcap-ros2-support 0.6.0: header %s, x %.1f, y %.1f, heading %.1f" % seen[-1])
sys.exit(seen != [("0001", 1.5, 2.5, 3.5), ("0009", 0, 1.5, 2.5)])
END
venv/bin/python read.py
