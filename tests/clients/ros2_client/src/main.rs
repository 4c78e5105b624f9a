// SPDX-License-Identifier: Apache-2.0
//! A node of ROS 2 over ros2-client: ros2_client_peer DOMAIN enhanced|cyclone. It says, a line each, which nodes and topics
//! it sees, where a robot is, and what becomes of a goal and of calls, until it is ended.
use std::{collections::BTreeSet, env, fmt::{Debug, Formatter, Result}, net::Ipv4Addr, thread, time::Duration};

use ros2_client::dds::rustdds::DomainParticipantBuilder;
use ros2_client::qos::{Durability, History, Reliability, WhenFull};
use ros2_client::{
    Client, Context, Message, MessageTypeName, Name, Node, NodeEvent, NodeName, NodeOptions, QosProfile, ServiceMapping,
    ServiceTypeName,
};
use serde::{Deserialize, Serialize};

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct Header {
    seconds: i32,
    nanoseconds: u32,
    frame_id: String,
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct PoseStamped {
    header: Header,
    position: [f64; 3],
    orientation: [f64; 4],
}
impl Message for PoseStamped {}

#[derive(Clone, Default, Serialize, Deserialize)]
struct Plan {
    header: Header,
    poses: Vec<PoseStamped>,
}
impl Message for Plan {}
impl Debug for Plan {
    fn fmt(&self, f: &mut Formatter) -> Result {
        write!(f, "{:?}", self.poses.iter().map(|pose| pose.position[0]).collect::<Vec<_>>())
    }
}

#[derive(Clone, Debug, Default, Serialize, Deserialize)]
struct PlanRequest {
    start: PoseStamped,
    goal: PoseStamped,
    tolerance: f32,
}
impl Message for PlanRequest {}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct SetBoolResponse {
    success: bool,
    message: String,
}
impl Message for SetBoolResponse {}

#[derive(Clone, Debug, Serialize, Deserialize)]
struct SetBoolRequest {
    data: bool,
}
impl Message for SetBoolRequest {}

fn qos(depth: u16) -> QosProfile {
    QosProfile::publisher_default()
        .reliability(Reliability::Reliable { when_full: WhenFull::DEFAULT })
        .durability(Durability::Volatile)
        .history(History::KeepLast { depth: depth.into() })
}

fn at(x: f64) -> PoseStamped {
    PoseStamped { position: [x, 0.0, 0.0], orientation: [0.0, 0.0, 0.0, 1.0], ..Default::default() }
}

/// A service that is called again until it answers.
struct Call<Request: Message, Response: Message> {
    name: &'static str,
    client: Client<Request, Response>,
    answered: bool,
}

impl<Request: Message + Clone + 'static, Response: Message + Debug + 'static> Call<Request, Response> {
    fn new(node: &mut Node, mapping: ServiceMapping, name: &'static str, kind: (&str, &str)) -> Self {
        let client = node
            .create_client(mapping, &Name::parse(name).unwrap(), &ServiceTypeName::new(kind.0, kind.1), qos(10), qos(10))
            .unwrap();
        Call { name, client, answered: false }
    }
    fn poll(&mut self, ask: bool, request: Request) {
        if !self.answered && ask {
            self.client.send_request(request).unwrap();
        }
        while let Ok(Some((_, response))) = self.client.receive_response() {
            if !self.answered {
                println!("{} {response:?}", self.name);
            }
            self.answered = true;
        }
    }
}

fn main() {
    let arguments: Vec<String> = env::args().collect();
    let mapping = if arguments[2] == "cyclone" { ServiceMapping::Cyclone } else { ServiceMapping::Enhanced };
    let domain = DomainParticipantBuilder::new(arguments[1].parse().unwrap());
    let participant = domain.with_only_networks([Ipv4Addr::LOCALHOST]).build().unwrap();
    let context = Context::from_domain_participant(participant.clone()).unwrap();
    let mut node = context.new_node(NodeName::new("/", "rust").unwrap(), NodeOptions::new()).unwrap();
    let spinner = node.spinner().unwrap();
    thread::spawn(move || futures::executor::block_on(spinner.spin()));
    let events = node.status_receiver().unwrap();
    let topic = |name, package, kind| {
        node.create_topic(&Name::parse(name).unwrap(), MessageTypeName::new(package, kind), &qos(10)).unwrap()
    };
    let (goal, status, pose) = (
        topic("/goal_pose", "geometry_msgs", "PoseStamped"),
        topic("/citylearn/status", "std_msgs", "String"),
        topic("/pose", "geometry_msgs", "PoseStamped"),
    );
    let goals = node.create_publisher::<PoseStamped>(&goal, None).unwrap();
    let statuses = node.create_subscription::<String>(&status, None).unwrap();
    let poses = node.create_subscription::<PoseStamped>(&pose, None).unwrap();
    let mut record: Call<SetBoolRequest, SetBoolResponse> =
        Call::new(&mut node, mapping, "/citylearn/teach/record", ("std_srvs", "SetBool"));
    let mut plan: Call<PlanRequest, Plan> =
        Call::new(&mut node, mapping, "/citylearn/env_robot/get_plan", ("nav_msgs", "GetPlan"));
    let mut said = BTreeSet::new();
    let mut say = |line: String| {
        if said.insert(line.clone()) {
            println!("{line}");
        }
    };
    for round in 0.. {
        let ask = round % 50 == 0; // once a second: what comes before two have met is lost
        while let Ok(event) = events.try_recv() {
            if let NodeEvent::ParticipantEntities(seen) = event {
                seen.nodes().iter().for_each(|node| say(format!("node {}", node.fully_qualified_name())));
            }
        }
        for writer in participant.discovered_writers() {
            let topic = &writer.publication_topic_data;
            let user_data = String::from_utf8_lossy(&writer.user_data); // it begins with its length, and is padded
            let hash = user_data.find("typehash=").map_or("", |at| user_data[at..].trim_end_matches('\0'));
            say(format!("topic {} {} {hash}", topic.topic_name, topic.type_name));
        }
        while let Ok(Some((message, _))) = poses.take() {
            say(format!("pose in {}", message.header.frame_id));
        }
        while let Ok(Some((message, _))) = statuses.take() {
            say(format!("status {message}"));
        }
        if ask {
            goals.publish(at(1e5)).unwrap();
        }
        record.poll(ask, SetBoolRequest { data: false });
        plan.poll(ask, PlanRequest { start: at(0.1), goal: at(1.9), tolerance: 0.0 });
        thread::sleep(Duration::from_millis(20));
    }
}
