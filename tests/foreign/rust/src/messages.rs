// SPDX-License-Identifier: Apache-2.0
//! The messages of idl/ that a learner sends and hears, field by field in the order of the wire, enums as numbers.
use byteorder::LittleEndian;
use serde::{Deserialize, Serialize};

macro_rules! message {
    ($name:ident { $($field:ident: $kind:ty),* $(,)? }) => {
        #[derive(Serialize, Deserialize, Clone, Debug, Default, PartialEq)]
        pub struct $name { $(pub $field: $kind),* }
    };
}

message!(Header { protocol: u32, session: String, sender: String, incarnation: u64, message: u64 });
message!(SettingsId { incarnation: u64, version: u32 });
message!(TraversalInfo {
    header: Header, settings: SettingsId, dataset: String, traversal: String, condition: String, hash: u64,
    frames: u32, feature_dimension: u32, agents: u32, by_reference: bool, rule: u32, places: u32, links: u32,
    streets_hash: u64, images: bool, encoder: String, encoder_service: String, encoder_incarnation: u64,
});
message!(TaskSettings {
    header: Header, environment: String, settings: SettingsId, task_mode: u32, lesson: u32, first_frame: u32,
    frames: u32, max_steps: u32, max_detour: u32, goal_radius: f32, seed: u64, tasks: u32, first_task: u32,
    shuffle: bool, policy: String, update: u64, run_id: u64, by_reference: bool,
});
message!(Observation {
    header: Header, settings: SettingsId, step: u64, traversal: String, traversal_hash: u64, by_reference: bool,
    wants_belief: bool, feature_dimension: u32, encoder_incarnation: u64, frame: Vec<u32>, position: Vec<u32>,
    goal: Vec<u32>, previous_action: Vec<u8>, allowed: Vec<u8>, flags: Vec<u8>, reward: Vec<f32>, features: Vec<f32>,
});
message!(Belief { likely: Vec<u32>, probability: Vec<f32>, entropy: Vec<f32>, lost: Vec<f32> });
message!(Action {
    header: Header, environment: String, environment_incarnation: u64, settings: SettingsId, step: u64, choice: Vec<u8>,
    belief: Belief,
});
message!(LogPosition { stream: u64, number: u64, first: u64 });
message!(EpisodeStat {
    header: Header, log: LogPosition, settings: SettingsId, agent: u32, evaluation: bool, task: u32, traversal: String,
    start: u32, goal: u32, steps: u32, shortest: u32, reward: f32, completed: bool, shuffled: bool, policy: String,
    update: u64, run_id: u64, path: Vec<u8>,
});
message!(LogAcknowledgement {
    header: Header, writer: String, writer_incarnation: u64, stream: u64, number: u64, limit: u64, state: u32,
});
message!(ServiceStatus {
    header: Header, service: String, host: String, middleware: String, process: u32, service_state: u32,
    activity: String, uptime: f64, rate: f32, processors: f32, memory: u64, sent_bytes: u64, received_bytes: u64,
    received: u64, repeated: u64, resent: u64, rejected: u64, foreign: u64, alarm: String,
});

/// Decodes each of these messages in tests/golden/messages.txt from its bytes and encodes it again. Returns how many
/// there were; an error names the first that differs.
pub fn check_golden(text: &str) -> Result<usize, String> {
    let mut known = 0;
    for part in text.split("\n\n") {
        let name = part.lines().next().unwrap_or("");
        let hex: Vec<char> = part.lines().skip_while(|line| !line.starts_with("bytes ")).skip(1)
            .flat_map(|line| line.chars()).filter(char::is_ascii_hexdigit).collect();
        let byte = |pair: &[char]| u8::from_str_radix(&String::from_iter(pair), 16).unwrap();
        let bytes: Vec<u8> = hex.chunks(2).map(byte).collect();
        known += match name {
            "TraversalInfo" => round_trip::<TraversalInfo>(name, &bytes)?,
            "TaskSettings" => round_trip::<TaskSettings>(name, &bytes)?,
            "Observation" => round_trip::<Observation>(name, &bytes)?,
            "Action" => round_trip::<Action>(name, &bytes)?,
            "EpisodeStat" => round_trip::<EpisodeStat>(name, &bytes)?,
            "LogAcknowledgement" => round_trip::<LogAcknowledgement>(name, &bytes)?,
            "ServiceStatus" => round_trip::<ServiceStatus>(name, &bytes)?,
            _ => 0,
        };
    }
    Ok(known)
}

fn round_trip<M: Serialize + for<'a> Deserialize<'a>>(name: &str, bytes: &[u8]) -> Result<usize, String> {
    let body = bytes.strip_prefix(&[0, 1, 0, 0]).ok_or(format!("{name}: not CDR_LE"))?;
    let (message, read) = cdr_encoding::from_bytes::<M, LittleEndian>(body).map_err(|e| format!("{name}: {e}"))?;
    let again = cdr_encoding::to_vec::<M, LittleEndian>(&message).map_err(|e| format!("{name}: {e}"))?;
    if read == body.len() && again == body { Ok(1) } else { Err(format!("{name}: has other bytes")) }
}
