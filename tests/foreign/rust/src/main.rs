// SPDX-License-Identifier: Apache-2.0
//! A learner over RustDDS that shares nothing with policy_service but idl/ and docs/how-to/write-a-peer.md: it counts
//! where each action leads, then takes the one that leads towards the goal. It meets env_services by unicast.
mod messages;

use messages::*;
use rustdds::no_key::{DataReaderCdr, DataWriterCdr};
use rustdds::policy::{Durability, History, Reliability};
use rustdds::{DomainParticipant, DomainParticipantBuilder, QosPolicies, QosPolicyBuilder, TopicKind};
use serde::{Deserialize, Serialize};
use std::io::Write;
use std::sync::mpsc::{channel, RecvTimeoutError};
use std::time::{Duration, Instant, SystemTime};

const PROTOCOL: u32 = 15;
const FLAG_FIRST: u8 = 1;
const IDLE: u32 = 0; // Mode
const TRAIN: u32 = 1;
const RUNNING: u32 = 2; // State
const STOPPING: u32 = 3;
const READS: u32 = 0; // ReaderState
const LEAVES: u32 = 2;
const GONE: Duration = Duration::from_secs(3); // a process that was silent for so long counts as gone,
const HANDOVER: Duration = Duration::from_secs(2); // or for so long, while another one with its id was heard
const SECOND: Duration = Duration::from_secs(1); // between heartbeats, and between acknowledgements
const SETTINGS_AGAIN: Duration = Duration::from_millis(100);
const EXPLORE: u64 = 100; // steps

fn fail(what: String) -> ! {
    eprintln!("foreign_rust: {what}");
    std::process::exit(1)
}

// ---- The wire -------------------------------------------------------------------------------------------------------

/// Says which of several processes speaks for one id: the one that was heard first, until it is silent. Incarnations
/// are only compared for equality.
#[derive(Default)]
struct Incumbent {
    incarnation: u64,
    heard: Option<Instant>,
    rival: Option<(u64, Instant)>,
}

impl Incumbent {
    /// Notes a message of a process. Returns whether it speaks for the id.
    fn hear(&mut self, incarnation: u64) -> bool {
        let now = Instant::now();
        if incarnation != self.incarnation && self.heard.is_some_and(|heard| now - heard < GONE) {
            let (_, since) = *self.rival.filter(|rival| rival.0 == incarnation).get_or_insert((incarnation, now));
            self.rival = Some((incarnation, since));
            if now - since < HANDOVER {
                return false;
            }
        }
        (self.incarnation, self.heard, self.rival) = (incarnation, Some(now), None);
        true
    }
}

/// Returns the name of a topic of one service.
fn topic_of(session: &str, id: &str, message: &str) -> String {
    let escaped = |name: &str| name.replace('_', "_u").replace('-', "_m").replace('.', "_d");
    format!("citylearn/{}/{}/{message}", escaped(session), escaped(id))
}

fn quality(depth: i32) -> QosPolicies {
    let max_blocking_time = rustdds::Duration::from_millis(100);
    QosPolicyBuilder::new().reliability(Reliability::Reliable { max_blocking_time })
        .durability(Durability::TransientLocal).history(History::KeepLast { depth }).build()
}

struct Wire {
    participant: DomainParticipant,
    me: Header,
    poll: mio::Poll,
}

/// Writes messages of one type and numbers them.
struct Writer<M: Serialize> {
    writer: DataWriterCdr<M>,
    me: Header,
}

impl<M: Serialize> Writer<M> {
    fn send(&mut self, make: impl FnOnce(Header) -> M) {
        self.me.message += 1;
        if let Err(error) = self.writer.write(make(self.me.clone()), None) {
            eprintln!("foreign_rust: cannot send: {error}");
        }
    }
}

impl Wire {
    fn topic(&self, name: &str, kind: &str, depth: i32) -> rustdds::Topic {
        let (kind, qos) = (format!("citylearn::msg::{kind}"), quality(depth));
        self.participant.create_topic(name.into(), kind, &qos, TopicKind::NoKey).expect("a topic")
    }
    fn writer<M: Serialize>(&self, name: &str, kind: &str, depth: i32) -> Writer<M> {
        let publisher = self.participant.create_publisher(&quality(depth)).expect("a publisher");
        let writer = publisher.create_datawriter_no_key_cdr(&self.topic(name, kind, depth), None).expect("a writer");
        Writer { writer, me: self.me.clone() }
    }
    /// A deep one, as all writers of a topic share its history.
    fn reader<M: for<'a> Deserialize<'a> + 'static>(&mut self, name: &str, kind: &str) -> DataReaderCdr<M> {
        let subscriber = self.participant.create_subscriber(&quality(1024)).expect("a subscriber");
        let mut reader = subscriber.create_datareader_no_key_cdr(&self.topic(name, kind, 1024), None).expect("a reader");
        let registry = self.poll.registry();
        registry.register(&mut reader, mio::Token(0), mio::Interest::READABLE).expect("a registration");
        reader
    }
    /// Waits until there may be something to take, for 20 ms at most.
    fn wait(&mut self) {
        let _ = self.poll.poll(&mut mio::Events::with_capacity(16), Some(Duration::from_millis(20)));
    }
    fn ours(&self, header: &Header) -> bool {
        header.protocol == PROTOCOL && header.session == self.me.session && header.incarnation != 0
    }
}

/// Takes all messages that came; what cannot be decoded is skipped.
fn take_all<M: for<'a> Deserialize<'a> + 'static>(reader: &mut DataReaderCdr<M>) -> Vec<M> {
    let mut all = vec![];
    loop {
        match reader.take_next_sample() {
            Ok(Some(sample)) => all.push(sample.into_value()),
            Ok(None) => return all,
            Err(error) => eprintln!("foreign_rust: skips a message: {error}"),
        }
    }
}

// ---- The learner ----------------------------------------------------------------------------------------------------

/// How often each action led back, nowhere or ahead.
#[derive(Default)]
struct Brain {
    moves: [[u64; 3]; 3],
    place: Vec<u32>,
    steps: u64,
}

impl Brain {
    fn decide(&mut self, seen: &Observation) -> Vec<u8> {
        let agents = 0..seen.position.len();
        for i in agents.clone().filter(|i| seen.flags[*i] & FLAG_FIRST == 0 && self.steps > 0) {
            let moved = i64::from(seen.position[i]) - i64::from(self.place[i]);
            if seen.previous_action[i] < 3 && moved.abs() <= 1 {
                self.moves[usize::from(seen.previous_action[i])][(moved + 1) as usize] += 1;
            }
        }
        let choose = |i: usize| {
            let allowed: Vec<u8> = (0..3).filter(|action| seen.allowed[i] >> action & 1 == 1).collect();
            if self.steps < EXPLORE {
                // Kept up for some steps: an agent that turns at each step hardly leaves its place.
                return allowed.get((self.steps / 8 + i as u64) as usize % allowed.len().max(1)).copied().unwrap_or(0);
            }
            let wanted = if seen.goal[i] > seen.position[i] { 2 } else { 0 };
            let share = |action: &u8| {
                let counts = self.moves[usize::from(*action)];
                counts[wanted] * 1000 / (1 + counts.iter().sum::<u64>())
            };
            allowed.into_iter().max_by_key(share).unwrap_or(0)
        };
        let choice = agents.map(choose).collect();
        self.place = seen.position.clone();
        self.steps += 1;
        choice
    }
}

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let known = ["--domain", "--session", "--id", "--train", "--steps", "--seconds", "--record", "--golden"];
    if let Some(wrong) = arguments[1..].chunks(2).find(|pair| !known.contains(&pair[0].as_str()) || pair.len() < 2) {
        fail(format!("{}: unknown, or without a value (known: {})", wrong[0], known.join(" ")));
    }
    let text = |option: &str, default: &str| {
        let at = arguments.iter().position(|argument| argument == option);
        at.map_or(default.to_string(), |at| arguments[at + 1].clone())
    };
    let number = |option: &str, default: &str| -> u64 {
        let text = text(option, default);
        text.parse().unwrap_or_else(|_| fail(format!("{option}: '{text}' is no number")))
    };
    let golden = text("--golden", "");
    if !golden.is_empty() {
        let file = std::fs::read_to_string(&golden).unwrap_or_else(|error| fail(format!("{golden}: {error}")));
        let count = check_golden(&file).unwrap_or_else(|wrong| fail(wrong));
        return println!("{count} messages have the golden bytes");
    }
    let (session, id, train) = (text("--session", "default"), text("--id", "foreign-rust"), text("--train", "summer"));
    let (domain, steps) = (number("--domain", "0") as u16, number("--steps", "1000"));
    let deadline = Instant::now() + Duration::from_secs(number("--seconds", "120"));
    let record = text("--record", "/dev/null");
    let mut file = std::fs::File::create(&record).unwrap_or_else(|error| fail(format!("{record}: {error}")));

    let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).expect("a clock after 1970");
    let incarnation = now.as_micros() as u64;
    let participant = DomainParticipantBuilder::new(domain).with_only_networks([std::net::Ipv4Addr::LOCALHOST]).build()
        .unwrap_or_else(|error| fail(format!("cannot join domain {domain}: {error}")));
    let me = Header { protocol: PROTOCOL, session: session.clone(), sender: id.clone(), incarnation, message: 0 };
    let mut wire = Wire { participant, me, poll: mio::Poll::new().expect("a poll") };

    // Heartbeats, however long a step takes: on the learner's own topic, by which it keeps its env_service, and on that
    // of all, by which others name it.
    let own_status = topic_of(&session, &id, "service_status");
    let mut hearts = [own_status.as_str(), "citylearn/service_status"].map(|name| wire.writer(name, "ServiceStatus", 1));
    let (end, ended) = channel::<()>();
    let mut pause = Duration::ZERO;
    let heart = std::thread::spawn(move || loop {
        let ends = ended.recv_timeout(pause) != Err(RecvTimeoutError::Timeout);
        pause = SECOND;
        for heart in &mut hearts {
            heart.send(|header| ServiceStatus {
                header,
                service: "policy_service".into(),
                middleware: "rustdds".into(),
                process: std::process::id(),
                service_state: if ends { STOPPING } else { RUNNING }, // then the next learner need not wait
                activity: "learning by counting".into(),
                ..Default::default()
            });
        }
        if ends {
            return hearts.iter().for_each(|heart| _ = heart.writer.wait_for_acknowledgments(SECOND / 2));
        }
    });

    let mut infos = wire.reader::<TraversalInfo>("citylearn/traversal_info", "TraversalInfo");
    let mut episodes = wire.reader::<EpisodeStat>("citylearn/episode_stat", "EpisodeStat");
    let mut info = loop {
        wire.wait();
        let fits = |info: &TraversalInfo| info.traversal == train && info.feature_dimension > 0 && wire.ours(&info.header);
        if let Some(found) = take_all(&mut infos).into_iter().find(fits) {
            break found;
        }
        if Instant::now() > deadline {
            fail(format!("no env_service with features on '{train}' in session '{session}'"));
        }
    };
    let env = info.header.sender.clone();
    let own = |message: &str| topic_of(&session, &env, message);
    let mut observations = wire.reader::<Observation>(&own("observation"), "Observation");
    let mut commands = wire.writer::<TaskSettings>(&own("task_settings"), "TaskSettings", 64);
    let mut actions = wire.writer::<Action>(&own("action"), "Action", 1);
    let mut acknowledgements =
        wire.writer::<LogAcknowledgement>(&own("episode_acknowledgement"), "LogAcknowledgement", 64);

    let (mut process, mut brain) = (Incumbent::default(), Brain::default());
    process.hear(info.header.incarnation);
    // The settings given last, whether they are in force, and the answer to the newest step under them.
    let (mut version, mut task_mode, mut in_force, mut answer) = (1, TRAIN, false, None::<Action>);
    let (mut next_settings, mut next_acknowledgement) = (Instant::now(), Instant::now());
    let (mut recorded, mut finished, mut spl, mut newest) = (0, 0u64, 0.0, Instant::now());
    // Its last episodes may come after the word that the env_service is idle.
    while task_mode != IDLE || !in_force || newest.elapsed() < SECOND / 2 {
        let now = Instant::now();
        if now > deadline {
            fail(format!("env_service '{env}' did not answer, or works for another policy_service"));
        }
        if brain.steps >= steps && task_mode != IDLE {
            (version, task_mode, in_force, newest) = (version + 1, IDLE, false, now); // the next learner need not wait
        }
        let settings = SettingsId { incarnation, version };
        if !in_force && now >= next_settings {
            let (environment, settings, policy) = (env.clone(), settings.clone(), "rust".into());
            let (frames, max_steps) = if task_mode == TRAIN { (64, 64) } else { (0, 0) };
            commands.send(|header| TaskSettings {
                header, environment, settings, task_mode, frames, max_steps, seed: 1, policy, ..Default::default()
            });
            next_settings = now + SETTINGS_AGAIN;
        }
        let mut acknowledge = |number: u64, state: u32| {
            let (writer, writer_incarnation) = (env.clone(), process.incarnation);
            acknowledgements.send(|header| LogAcknowledgement {
                header, writer, writer_incarnation, number, state, ..Default::default()
            });
        };
        if now >= next_acknowledgement {
            acknowledge(recorded, READS);
            next_acknowledgement = now + SECOND;
        }
        wire.wait();
        let (mut lost, mut restarted) = (false, false);
        for new in take_all(&mut infos) {
            let before = process.incarnation;
            if new.header.sender != env || !wire.ours(&new.header) || !process.hear(new.header.incarnation) {
                continue;
            }
            if before != process.incarnation {
                (recorded, next_acknowledgement, restarted) = (0, now, true); // it was restarted and knows nothing
            } else if new.header.message < info.header.message {
                continue; // overtaken on the way
            }
            in_force |= new.settings == settings;
            lost |= in_force && new.settings.version != 0 && new.settings.incarnation != incarnation;
            info = new;
        }
        for seen in take_all(&mut observations) {
            if !wire.ours(&seen.header) || seen.header.incarnation != process.incarnation {
                continue;
            }
            process.hear(seen.header.incarnation);
            in_force |= seen.settings == settings;
            let next = answer.as_ref().filter(|last| last.settings == settings).map_or(0, |last| last.step + 1);
            if seen.settings != settings || task_mode == IDLE || (seen.step != next && seen.step + 1 != next) {
                continue; // old
            }
            if seen.step == next {
                answer = Some(Action {
                    environment: env.clone(),
                    environment_incarnation: seen.header.incarnation,
                    settings: seen.settings.clone(),
                    step: seen.step,
                    choice: brain.decide(&seen),
                    ..Default::default()
                });
            }
            // A step that comes again was answered, but the answer was lost: it is sent again as it was.
            let again = answer.clone().unwrap_or_default();
            actions.send(|header| Action { header, ..again });
        }
        for episode in take_all(&mut episodes) {
            if !wire.ours(&episode.header) || episode.header.incarnation != process.incarnation {
                continue;
            }
            recorded = recorded.max(episode.log.first - 1); // those never come
            next_acknowledgement = now;
            if episode.log.number != recorded + 1 {
                continue; // known, or what is missing comes again
            }
            (recorded, newest) = (recorded + 1, now);
            if episode.settings.incarnation == incarnation {
                let written = writeln!(file, "{},{}", episode.header.incarnation, episode.log.number);
                written.unwrap_or_else(|error| fail(format!("{record}: {error}")));
                finished += 1;
                if episode.completed {
                    spl += f64::from(episode.shortest) / f64::from(episode.steps.max(episode.shortest).max(1));
                }
            }
        }
        if (lost || restarted) && task_mode != IDLE {
            (version, in_force) = (version + 1, false); // the same settings, under an id that it has not seen
        }
    }
    acknowledgements.send(|header| LogAcknowledgement {
        header, writer: env.clone(), writer_incarnation: process.incarnation, number: recorded, state: LEAVES,
        ..Default::default()
    });
    let _ = acknowledgements.writer.wait_for_acknowledgments(SECOND / 2);
    drop(end);
    let _ = heart.join();
    println!("{} steps, {finished} episodes, SPL {:.3}", brain.steps, spl / finished as f64);
}
