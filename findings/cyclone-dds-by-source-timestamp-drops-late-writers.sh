#!/usr/bin/env bash
# Cyclone DDS 11.0.1: one would expect a reader that orders BY_SOURCE_TIMESTAMP to give the samples of several writers
# in the order in which they were written, and with RELIABLE and KEEP_ALL all of them. It drops what is older than the
# newest that it has received of the instance, even if nobody has read that yet. A topic without key is one instance: a
# robot whose clock is half a second behind is not heard while another one writes. Only the status SAMPLE_LOST tells.
# With the robot as key, or BY_RECEPTION_TIMESTAMP (the default), all arrive.
# It hurts those who record several robots and want one order: the recording has some of them alone.
# Seen, of robot 1 with 10 to 13 and robot 2 with 20 to 23, half a second older: by reception and by source with a key
# all eight, by source without a key 10 11 12 13 and four lost. Needs python3, unshare and ip.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cyclonedds==11.0.1
cat >"$folder/robots.py" <<'END'
import sys
import time
from dataclasses import dataclass
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import key
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

@dataclass
class Step(IdlStruct, typename="Step"):
    robot: int
    number: int

@dataclass
class KeyedStep(IdlStruct, typename="KeyedStep"):
    robot: int
    key("robot")
    number: int

by_reception, by_source = Policy.DestinationOrder.ByReceptionTimestamp, Policy.DestinationOrder.BySourceTimestamp
participant, seen = DomainParticipant(), []
for name, kind, order in ("a", Step, by_reception), ("b", Step, by_source), ("c", KeyedStep, by_source):
    qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.History.KeepAll, order)
    topic = Topic(participant, name, kind)
    reader = DataReader(participant, topic, qos)
    writers = DataWriter(participant, topic, qos), DataWriter(participant, topic, qos)
    now = time.time_ns()
    for i in range(4):
        for robot, writer in enumerate(writers):
            writer.write(kind(robot + 1, 10 * robot + 10 + i), now + i * 10**8 - robot * 5 * 10**8)
    time.sleep(1)  # all of it, as more could come
    lost = reader.get_sample_lost_status().total_count
    seen.append((sorted(step.number for step in reader.take(20)), lost))
print("Cyclone DDS 11.0.1, samples and lost by reception, by source, by source with a key:", *seen)
both = [10, 11, 12, 13, 20, 21, 22, 23]
sys.exit(seen != [(both, 0), (both[:4], 4), (both, 0)])
END
unshare -rn sh <<END
unset CYCLONEDDS_URI
ip link set lo up
exec "$folder/venv/bin/python" "$folder/robots.py"
END
