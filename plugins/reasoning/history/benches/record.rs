//! What a history costs: the share of a core that recording takes, bytes per fact, and the time of
//! a question. `cargo bench -p history --bench record` prints the figures of docs/history.md.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use acl::content::{
    Achieve, Act, ActionToken, Execute, Heartbeat, HistoryQuery, Inform, Keep, Outcome,
    ReadHistory, Report, Request, value,
};
use acl::{
    AgentId, ConversationId, Incarnation, Message, MessageId, Millis, Performative, Protocol,
    ReplyToken, SCHEMA_VERSION,
};
use history::{EventRecorder, HistoryLimits, HistoryStore};

/// Number of devices.
const DEVICES: u64 = 1_000;

/// Simulated seconds of recording at one fact per second and device.
const SECONDS: u64 = 60;

/// Simulated minutes of the day in which questions are asked; each device reports one fact a
/// minute.
const MINUTES: u64 = 24 * 60;

/// Number of questions.
const QUESTIONS: usize = 2_000;

const START_MS: u64 = 1_700_000_000_000;
const LIMITS: HistoryLimits = HistoryLimits { keep_ms: u64::MAX, bytes_max: 1 << 30 };

fn main() {
    // Cargo also runs benchmarks as tests.
    if !std::env::args().any(|argument| argument == "--bench") {
        return;
    }
    record();
    ask();
}

/// Records one fact per second and device, in the batches of the agent.
fn record() {
    let folder = tempfile::tempdir().expect("a folder");
    let (store, _) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    let mut recorder = recorder();
    let mut random = fastrand::Rng::with_seed(1);
    let payloads: Vec<Vec<_>> = (0..SECONDS)
        .map(|second| (0..DEVICES).map(|device| heartbeat(device, second, &mut random)).collect())
        .collect();
    let (began, mut count) = (cpu_time(), 0);
    for (second, batch) in (0..).zip(payloads) {
        for half in batch.chunks(batch.len() / 2) {
            for payload in half {
                let message = acl::decode(payload).expect("a message");
                recorder.hear(message, START_MS + second * 1_000);
            }
            let events = recorder.take_events();
            count += events.len();
            store.append(&events, 0, START_MS).expect("written");
        }
    }
    let cost = cpu_time() - began;
    drop(store);
    let bytes = bytes_in(folder.path());
    let (rate, facts) = (count as u64 / SECONDS, count as f64);
    let share = 100.0 * cost.as_secs_f64() / SECONDS as f64;
    println!("recording {rate} facts/s, from JSON to the disk: {share:.1} % of a core");
    println!("on disk: {:.0} bytes a fact ({count} facts, {bytes} bytes)", bytes as f64 / facts);
}

/// Asks for the cause of steps in a day of all devices.
fn ask() {
    let folder = tempfile::tempdir().expect("a folder");
    let (store, _) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    let mut recorder = recorder();
    let mut random = fastrand::Rng::with_seed(2);
    let mut steps = Vec::new();
    for minute in 0..MINUTES {
        let at_ms = START_MS + minute * 60_000;
        for device in 0..DEVICES {
            let payload = heartbeat(device, minute, &mut random);
            recorder.hear(acl::decode(&payload).expect("a message"), at_ms);
        }
        steps.push(goal(&mut recorder, minute, at_ms));
        store.append(&recorder.take_events(), 0, at_ms).expect("written");
    }
    let ask = |query: HistoryQuery| {
        let began = Instant::now();
        let page = history::answer(&store, &ReadHistory::new(query)).expect("readable");
        (began.elapsed(), page.events.len())
    };
    let mut times = Vec::new();
    for _ in 0..QUESTIONS {
        let subject = steps[random.usize(..steps.len())].clone();
        let (time, links) = ask(HistoryQuery::Why { subject });
        assert!(links >= 3, "the chain leads to the person");
        times.push(time);
    }
    times.sort();
    let at = |share: usize| times[times.len() * share / 1_000 - 1].as_secs_f64() * 1e3;
    println!(
        "why of a step, in {} events: p50 {:.1} ms, p99 {:.1} ms, worst {:.1} ms",
        MINUTES * (DEVICES + 5),
        at(500),
        at(990),
        at(1_000)
    );
    let (time, _) = ask(HistoryQuery::Last { about: "device-77".to_owned() });
    println!("when did a device last work: {:.1} ms", time.as_secs_f64() * 1e3);
    let fact = "(temperature office-77)".to_owned();
    let (time, values) = ask(HistoryQuery::Values { fact, from_ms: None, to_ms: None });
    println!("{values} values of a fact: {:.1} ms", time.as_secs_f64() * 1e3);
    let query = HistoryQuery::Why { subject: "(temperature nowhere)".to_owned() };
    println!("a word that does not occur: {:.1} ms", ask(query).0.as_secs_f64() * 1e3);
}

/// Returns a recorder that knows the models of all devices.
fn recorder() -> EventRecorder {
    let mut recorder = EventRecorder::new(0);
    for device in 0..DEVICES {
        recorder.learn_model(&agent(&format!("device-{device}")), "(define (agent device))");
    }
    recorder
}

fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

fn message(
    performative: Performative,
    from: &str,
    to: Option<&str>,
    content: serde_json::Value,
) -> Message {
    Message {
        version: SCHEMA_VERSION,
        id: MessageId::new(&format!("m{}", fastrand::u64(..))),
        performative,
        sender: agent(from),
        incarnation: Incarnation(1),
        receiver: to.map(agent).into_iter().collect(),
        content,
        language: None,
        ontology: None,
        protocol: None,
        conversation_id: ConversationId::new(from),
        reply_with: None,
        in_reply_to: None,
        reply_within: None,
        via: Vec::new(),
        unknown: serde_json::Map::new(),
    }
}

/// Returns the heartbeat of a device, in which one of five facts is another than before.
fn heartbeat(device: u64, sequence: u64, random: &mut fastrand::Rng) -> Vec<u8> {
    let value = 15.0 + random.f64() * 10.0;
    let facts = format!(
        "(located device-{device} office-{device}) (working device-{device}) \
         (= (temperature office-{device}) {value:.2}) (= (battery device-{device}) 90) \
         (known-temperature office-{device})"
    );
    let heartbeat = Heartbeat {
        digest: "0011223344556677".to_owned(),
        sequence: sequence + 1,
        facts,
        known_for: BTreeMap::new(),
        period: Millis(Duration::from_secs(1)),
        stops: Vec::new(),
    };
    let content = acl::content::value(&Inform::Heartbeat(heartbeat));
    let message = message(Performative::Inform, &format!("device-{device}"), None, content);
    acl::encode(&message).to_vec()
}

/// Records a goal with a plan of one step, and returns the step.
fn goal(recorder: &mut EventRecorder, minute: u64, at_ms: u64) -> String {
    let conversation = format!("ann.5.{minute}");
    let (device, action) =
        (minute % DEVICES, format!("(measure device-{} office-{minute})", minute % DEVICES));
    let mut say =
        |protocol, performative, from: &str, to: &str, token: &str, opens: bool, content| {
            let mut message = message(performative, from, Some(to), content);
            message.protocol = Some(protocol);
            message.conversation_id = ConversationId::new(&conversation);
            let token = Some(ReplyToken::new(&format!("{token}-{minute}")));
            if opens {
                message.reply_with = token;
            } else {
                message.in_reply_to = token;
            }
            recorder.hear(message, at_ms);
        };
    let device = format!("device-{device}");
    let goal = format!("(known-temperature office-{minute})");
    let achieve = value(&Request::Achieve(Achieve::new(goal, Keep::Achieve, 0)));
    say(Protocol::Goal, Performative::Request, "ann", "requester", "g", true, achieve);
    let execute = Execute {
        domain: String::new(),
        problem: String::new(),
        plan: action.clone(),
        epoch: 1,
        term: 1,
        round: 1,
        done: Vec::new(),
        offers: BTreeMap::new(),
        knowledge: BTreeMap::new(),
    };
    let execute = value(&Request::Execute(Box::new(execute)));
    say(Protocol::Execution, Performative::Request, "requester", "executor", "e", true, execute);
    let act = Act {
        action: action.clone(),
        method: "measure".to_owned(),
        arguments: BTreeMap::new(),
        token: ActionToken {
            term: 1,
            conversation: ConversationId::new(&conversation),
            round: 1,
            step: 0,
        },
        ready_for: None,
    };
    let act = value(&Request::Act(Box::new(act)));
    say(Protocol::Action, Performative::Request, "executor", &device, "s", true, act);
    let done = value(&Report::new(Outcome::Done, "measured"));
    say(Protocol::Action, Performative::Confirm, &device, "executor", "s", false, done);
    action
}

/// Returns the processor time of this process, as the system counts it.
fn cpu_time() -> Duration {
    let text = std::fs::read_to_string("/proc/self/schedstat").unwrap_or_default();
    let nanoseconds = text.split_whitespace().next().and_then(|number| number.parse().ok());
    Duration::from_nanos(nanoseconds.unwrap_or_default())
}

fn bytes_in(folder: &std::path::Path) -> u64 {
    let files = std::fs::read_dir(folder).expect("a folder");
    files.map(|file| file.expect("a file").metadata().expect("a file").len()).sum()
}
