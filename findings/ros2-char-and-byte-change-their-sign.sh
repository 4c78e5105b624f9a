#!/usr/bin/env bash
# ROS 2 makes both `char` and `byte` of a .msg an unsigned octet (rosidl_adapter: uint8 and octet). Of the two Python
# readers of bags without ROS, each reads the other one with a sign: mcap-ros2-support 0.6.0 takes 200 in a `char` for
# -56, rosbags 0.11.9 in a `byte`, alone and in arrays. One would expect one drive to have the same numbers in both;
# those who record statuses, classes or raw octets over 127 find them negative in one of them, without a word.
# Seen: char -56 and byte 200 by mcap-ros2-support, char 200 and byte -56 by rosbags. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet rosbags==0.11.9 mcap==1.6.0 mcap-ros2-support==0.6.0 numpy==2.4.6
venv/bin/python - <<'END'
import sys
from pathlib import Path
from mcap.writer import Writer
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

text = "char letter\nbyte status\nchar[2] letters\nbyte[2] states\n"
with open("signs.mcap", "wb") as file:
    writer = Writer(file)
    writer.start(profile="ros2", library="")
    schema = writer.register_schema(name="drive/msg/Signs", encoding="ros2msg", data=text.encode())
    qos = {"offered_qos_profiles": ""}
    channel = writer.register_channel(topic="/signs", message_encoding="cdr", schema_id=schema, metadata=qos)
    writer.add_message(channel, log_time=1, publish_time=1, sequence=0, data=b"\0\1\0\0" + bytes([200] * 6))
    writer.finish()
with AnyReader([Path("signs.mcap")]) as bag:
    messages = [bag.deserialize(data, connection.msgtype) for connection, _, data in bag.messages()]
messages.append(next(iter(read_ros2_messages("signs.mcap"))).ros_msg)
seen = [(m.letter, m.status, *map(int, m.letters), *map(int, m.states)) for m in messages]
for reader, numbers in zip(("rosbags 0.11.9", "mcap-ros2-support 0.6.0"), seen):
    print(reader, "reads 200 as: char %d, byte %d, char[] %d %d, byte[] %d %d" % numbers)
sys.exit(seen != [(200, -56, 200, 200, -56, -56), (-56, 200, -56, -56, 200, 200)])
END
