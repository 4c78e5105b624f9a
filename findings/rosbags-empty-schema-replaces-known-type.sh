#!/usr/bin/env bash
# rosbags 0.11.9: a channel of MCAP whose ros2msg schema has no text makes a message type without fields, and this takes
# the place of the type of that name in `default_typestore`, which is given for bags without definitions. So
# std_msgs/msg/String, that the store knows, cannot be read: "CDR message size mismatch". Bags of SQLite up to version 6
# have no definitions, so a program that copies messages from them into MCAP must bring the texts itself.
# Seen: with the text "string data" the message is read, with an empty one AnyReaderError, with the store or without.
# Needs python3.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet rosbags==0.11.9 mcap==1.6.0
cd "$folder"
venv/bin/python - <<'END'
import sys
from pathlib import Path
from mcap.writer import Writer
from rosbags.highlevel import AnyReader, AnyReaderError
from rosbags.typesys import Stores, get_typestore

store = get_typestore(Stores.ROS2_JAZZY)
name = "std_msgs/msg/String"
message = bytes(store.serialize_cdr(store.types[name]("hello"), name))
seen = {}
for text in (b"string data\n", b""):
    path = Path(f"{len(text)}.mcap")
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start(profile="ros2", library="")
        schema = writer.register_schema(name=name, encoding="ros2msg", data=text)
        channel = writer.register_channel(topic="/note", message_encoding="cdr", schema_id=schema, metadata={"offered_qos_profiles": ""})
        writer.add_message(channel, log_time=1, publish_time=1, sequence=0, data=message)
        writer.finish()
    for given in (None, store):
        try:
            with AnyReader([path], default_typestore=given) as reader:
                found = [reader.deserialize(data, connection.msgtype).data for connection, _, data in reader.messages()]
        except AnyReaderError as error:
            found = str(error)
        seen[text, given is store] = found
        print("rosbags 0.11.9, schema", text, "default_typestore", given is store, ":", found)
lost = "CDR message size mismatch for 'std_msgs/msg/String'."
sys.exit(seen != {(b"string data\n", False): ["hello"], (b"string data\n", True): ["hello"], (b"", False): lost, (b"", True): lost})
END
