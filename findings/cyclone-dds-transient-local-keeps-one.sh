#!/usr/bin/env bash
# Cyclone DDS 11.0.1: a writer that is TRANSIENT_LOCAL and KEEP_LAST(5) gives a late reader one sample, not five. The
# writer's HISTORY only bounds what it repeats to readers that it has; what it keeps for later ones is set by
# DURABILITY_SERVICE, which DDS defines for TRANSIENT and PERSISTENT alone and whose default is KEEP_LAST(1).
# Seen, of 0 to 9: [9] by HISTORY alone, [5, 6, 7, 8, 9] with DURABILITY_SERVICE as well. Needs python3, unshare and ip.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cyclonedds==11.0.1
cat >"$folder/late.py" <<'END'
import sys
import time
from dataclasses import dataclass
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

@dataclass
class Letter(IdlStruct, typename="Letter"):
    number: int

last = Policy.History.KeepLast(5)
qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.TransientLocal, last)
service = Qos(Policy.DurabilityService(duration(seconds=0), last, -1, -1, -1), base=qos)
seen = []
for name, writer_qos in ("alone", qos), ("service", service):
    participant = DomainParticipant()
    topic = Topic(participant, name, Letter)
    writer = DataWriter(participant, topic, writer_qos)
    for number in range(10):
        writer.write(Letter(number))
    reader = DataReader(participant, topic, qos)
    time.sleep(2)  # all of it, as more could come
    seen.append([letter.number for letter in reader.take(10)])
print("Cyclone DDS 11.0.1: a late reader gets", *seen)
sys.exit(seen != [[9], [5, 6, 7, 8, 9]])
END
unshare -rn sh <<END
unset CYCLONEDDS_URI
ip link set lo up
exec "$folder/venv/bin/python" "$folder/late.py"
END
