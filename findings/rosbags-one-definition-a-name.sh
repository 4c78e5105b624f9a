#!/usr/bin/env bash
# An MCAP recording may hold several definitions of one message type, each with its channels: a fleet whose robots have
# unlike software, or two recordings joined. One would expect each message to be read by its own channel's definition,
# as mcap-ros2-support 0.6.0 does. rosbags 0.11.9 keeps one definition a name, the last, and reads all messages by it.
# Where sizes differ it fails; where fields only moved, it gives wrong numbers and no error.
# It hurts those who train on such drives: here latitudes and longitudes are exchanged.
# Seen, all written as latitude 48, longitude 11: rosbags 11 48 and 48 11, mcap-ros2-support 48 11 twice. Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT; cd "$folder"
python3 -m venv venv
venv/bin/pip install --quiet rosbags==0.11.9 mcap==1.6.0 mcap-ros2-support==0.6.0 numpy==2.4.6
venv/bin/python - <<'END'
import struct
import sys
from pathlib import Path
from mcap.writer import Writer
from mcap_ros2.reader import read_ros2_messages
from rosbags.highlevel import AnyReader

old, new = b"float64 latitude\nfloat64 longitude\n", b"float64 longitude\nfloat64 latitude\n"
with open("fleet.mcap", "wb") as file:
    writer = Writer(file)
    writer.start(profile="ros2", library="")
    for robot, text, places in ("a", old, (48, 11)), ("b", new, (11, 48)):
        schema = writer.register_schema("fleet/msg/Place", "ros2msg", text)
        channel = writer.register_channel(f"/{robot}/place", "cdr", schema, {"offered_qos_profiles": ""})
        data = b"\0\1\0\0" + struct.pack("<dd", *places)
        writer.add_message(channel, log_time=1, publish_time=1, data=data)
    writer.finish()
with AnyReader([Path("fleet.mcap")]) as bag:
    places = [bag.deserialize(data, connection.msgtype) for connection, _, data in bag.messages()]
by_rosbags = [(place.latitude, place.longitude) for place in places]
places = [message.ros_msg for message in read_ros2_messages("fleet.mcap")]
by_mcap = [(place.latitude, place.longitude) for place in places]
print("latitude, longitude of robots a and b by rosbags", *by_rosbags, "and by mcap-ros2-support", *by_mcap)
sys.exit((by_rosbags, by_mcap) != ([(11, 48), (48, 11)], [(48, 11), (48, 11)]))
END
