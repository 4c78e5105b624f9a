#!/usr/bin/env bash
# ros2-client 0.12.1: a node's spinner subscribes to /clock as builtin_interfaces/Time. ROS 2's type is rosgraph_msgs/Clock,
# which has the same bytes but another name, and DDS matches by name. So with `use_sim_time` a node never hears a simulator's
# time: time_now() stays zero, without an error.
# Seen: of two writers on rt/clock over Cyclone DDS 11.0.1, that of rosgraph_msgs::msg::dds_::Clock_ has no reader and
# time_now() stays 0; that of builtin_interfaces::msg::dds_::Time_ has one, and time_now() is the 1000 s that it says.
# Needs cargo, python3, unshare and ip.
set -euo pipefail
folder=$(mktemp -d); trap 'rm -rf "$folder"' EXIT
python3 -m venv "$folder/venv"
"$folder/venv/bin/pip" install --quiet cyclonedds==11.0.1
mkdir -p "$folder/src"
cat >"$folder/Cargo.toml" <<'END'
[package]
name = "node"
version = "1.0.0"
edition = "2024"
[dependencies]
ros2-client = "=0.12.1"
futures = "0.3"
[profile.dev]
debug = false
END
cat >"$folder/src/main.rs" <<'END'
use ros2_client::{Context, NodeName, NodeOptions, ParameterValue};
use std::{thread, time::Duration};

fn main() {
    let mut node = Context::new().unwrap().new_node(NodeName::new("/", "node").unwrap(), NodeOptions::new()).unwrap();
    node.set_parameter("use_sim_time", ParameterValue::Boolean(true)).unwrap();
    let spinner = node.spinner().unwrap();
    thread::spawn(move || futures::executor::block_on(spinner.spin()));
    loop {
        println!("{}", node.time_now().to_nanos());
        thread::sleep(Duration::from_millis(100));
    }
}
END
cat >"$folder/clock.py" <<'END'
import subprocess
import sys
import time
from dataclasses import dataclass
from cyclonedds.core import Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.idl import IdlStruct, types
from cyclonedds.pub import DataWriter
from cyclonedds.topic import Topic
from cyclonedds.util import duration

@dataclass
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    sec: types.int32
    nanosec: types.uint32

@dataclass
class Clock(IdlStruct, typename="rosgraph_msgs::msg::dds_::Clock_"):
    clock: Time

participant = DomainParticipant(0)
qos = Qos(Policy.Reliability.Reliable(duration(seconds=1)), Policy.Durability.Volatile)
seen = []
for kind, message in ((Clock, Clock(Time(1000, 0))), (Time, Time(1000, 0))):
    node = subprocess.Popen([sys.argv[1]], stdout=subprocess.PIPE, text=True)
    writer = DataWriter(participant, Topic(participant, "rt/clock", kind), qos)
    for line in range(80):  # 8 s, ten times what the second one takes
        writer.write(message)
        now = int(node.stdout.readline())
    seen.append((bool(writer.get_matched_subscriptions()), now))
    node.kill()
    del writer
print("ros2-client 0.12.1: reader of rt/clock and time_now() with ROS 2's type:", seen[0], "with builtin_interfaces/Time:", seen[1])
sys.exit(seen != [(False, 0), (True, 1000 * 10**9)])
END
cd "$folder"
cargo build --quiet
unshare -rn sh <<END
unset CYCLONEDDS_URI
ip link set lo up
ip link set lo multicast on
ip route add 224.0.0.0/4 dev lo
exec "$folder/venv/bin/python" "$folder/clock.py" "$folder/target/debug/node"
END
