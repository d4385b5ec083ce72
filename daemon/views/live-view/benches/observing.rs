//! Measures how many events a view takes per second, how long each page takes, and how much memory
//! the view keeps, beside their targets.
//!
//! ```text
//! cargo bench -p live-view --bench observing
//! ```
//!
//! The building has a thousand agents with ten facts each. Every agent sends a heartbeat per second;
//! in one of twenty a fact has changed. Beside them goals are requested, planned and executed.

use std::time::Instant;

use acl::{EcosystemId, Message};
use live_view::{LiveView, Moment, ViewEvent, ViewLimits};
use peak_alloc::PeakAlloc;
use serde_json::{Value, json};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Number of agents, and of facts of each.
const AGENTS: u64 = 1_000;
const FACTS_EACH: u64 = 10;

/// Heartbeats of which one tells a changed fact.
const UNCHANGED: u64 = 20;

/// Targets: events per second, milliseconds per page, and mebibytes.
const EVENTS_AIM: f64 = 50_000.0;
const PAGE_AIM_MS: f64 = 16.0;
const MEMORY_AIM_MIB: f64 = 100.0;

fn main() {
    // Without `--bench`, Cargo only checks that the benchmark runs.
    let is_measured = std::env::args().any(|argument| argument == "--bench");
    let rounds = if is_measured { 60 } else { 2 };
    let before = ALLOCATOR.current_usage();
    let ecosystem = EcosystemId::new("campus").expect("a name");
    let mut view = LiveView::new(ecosystem, ViewLimits::default());
    for agent in 0..AGENTS {
        observe(&mut view, 0, announcement(agent));
    }
    let (mut events, mut rates) = (0u32, Vec::new());
    for round in 1..=rounds {
        let batch = round_of(round);
        let count = u32::try_from(batch.len()).expect("a small batch");
        events += count;
        let began = Instant::now();
        for message in batch {
            observe(&mut view, round * 1_000, message);
        }
        rates.push(f64::from(count) / began.elapsed().as_secs_f64());
    }
    let now = Moment(rounds * 1_000);
    let facts = view.facts(now).len();
    println!("{AGENTS} agents, {facts} facts, {events} events");
    rates.sort_by(f64::total_cmp);
    let per_second = rates[rates.len() / 2];
    println!("events per second, median of {rounds}: {per_second:.0} (aim: {EVENTS_AIM:.0})");
    let kept = (ALLOCATOR.current_usage() - before) as f64 / f64::from(1 << 20);
    println!("memory: {kept:.1} MiB (aim: {MEMORY_AIM_MIB:.0})");
    let goal = view.goals(now).first().map(|row| row.conversation.clone()).expect("a goal");
    page("overview", || drop(view.overview(now)));
    page("goals", || drop(view.goals(now)));
    page("goal", || drop(view.goal(&goal, now)));
    page("agents", || drop(view.agents(now)));
    page("facts", || drop(view.facts(now)));
    page("floor", || drop(view.floor(now)));
    page("conversations", || drop(view.conversations()));
    page("topology", || drop(view.topology(now)));
    page("a copy of the view", || drop(view.clone()));
}

/// Prints the median time of some runs.
fn page(name: &str, make: impl Fn()) {
    const RUNS: usize = 21;
    let time = |_| {
        let began = Instant::now();
        make();
        began.elapsed().as_secs_f64() * 1_000.0
    };
    let mut times: Vec<_> = (0..RUNS).map(time).collect();
    times.sort_by(f64::total_cmp);
    println!("{name}: {:.2} ms, at best {:.2} (aim: {PAGE_AIM_MS:.0})", times[RUNS / 2], times[0]);
}

fn observe(view: &mut LiveView, at: u64, message: Message) {
    view.observe(Moment(at), ViewEvent::Message(Box::new(message)));
}

/// Returns the messages of one second.
fn round_of(round: u64) -> Vec<Message> {
    let mut messages: Vec<_> = (0..AGENTS).map(|agent| heartbeat(agent, round)).collect();
    for goal in 0..20 {
        messages.extend(work(round * 100 + goal));
    }
    messages
}

fn message(line: [&str; 5], content: Value, id: &str) -> Message {
    let [sender, receiver, performative, protocol, conversation] = line;
    let mut message = json!({
        "version": 2, "id": id, "performative": performative, "sender": sender, "incarnation": 1,
        "conversation_id": conversation, "content": content,
    });
    if !receiver.is_empty() {
        message["receiver"] = json!([receiver]);
    }
    if !protocol.is_empty() {
        message["protocol"] = json!(protocol);
        let opens = performative == "request";
        let key = if opens { "reply_with" } else { "in_reply_to" };
        message[key] = json!(format!("{conversation}-{protocol}"));
    }
    serde_json::from_value(message).expect("a message")
}

fn facts_of(agent: u64, round: u64) -> String {
    let changed = (round + agent) / UNCHANGED;
    let mut facts = format!("(at robot-{agent} room-{})", (agent + changed) % 200);
    for fact in 1..FACTS_EACH {
        facts.push_str(&format!(" (= (value-{fact} robot-{agent}) {})", fact + changed));
    }
    facts
}

fn heartbeat(agent: u64, round: u64) -> Message {
    let name = format!("robot-{agent}");
    let content = json!({
        "of": "heartbeat", "digest": "d", "sequence": round + 1, "facts": facts_of(agent, round),
        "period": 1000,
    });
    message([&name, "", "inform", "", &name], content, &format!("{name}.{round}"))
}

fn announcement(agent: u64) -> Message {
    let name = format!("robot-{agent}");
    let model = format!(
        "(define (agent {name}) (:domain campus) (:init (connected room-{} room-{}))
         (:action move :agent ?b - robot :parameters (?from ?to - location)
          :precondition (and (at ?b ?from) (connected ?from ?to))
          :effect (and (not (at ?b ?from)) (at ?b ?to))))",
        agent % 200,
        (agent / 3) % 200,
    );
    let content = json!({
        "of": "model", "model": model, "digest": "d", "sequence": 1, "facts": facts_of(agent, 0),
        "period": 1000,
    });
    message([&name, "", "inform", "", &name], content, &format!("{name}.0"))
}

/// Returns the messages of one goal: request, plan, action, and the end of each.
fn work(number: u64) -> Vec<Message> {
    let goal = format!("g{number}");
    let robot = format!("robot-{}", number % AGENTS);
    let step = format!("(move {robot} room-1 room-2)");
    let token = json!({ "term": 1, "conversation": goal, "round": 1, "step": 0 });
    let done = json!({ "outcome": "done", "detail": "arrived at room-2" });
    let parts = [
        (
            ["alice", "requester", "request", "goal"],
            json!({ "act": "achieve", "goal": format!("(at {robot} room-2)") }),
        ),
        (
            ["requester", "executor", "request", "execution"],
            json!({
                "act": "execute", "domain": "", "problem": "", "plan": step, "epoch": 1,
                "term": 1, "round": 1,
            }),
        ),
        (
            ["executor", &robot, "request", "action"],
            json!({
                "act": "act", "action": step, "method": "m", "arguments": {}, "token": token,
            }),
        ),
        ([&robot, "executor", "agree", "action"], json!({ "token": token })),
        ([&robot, "executor", "confirm", "action"], done.clone()),
        (["executor", "requester", "confirm", "execution"], done.clone()),
        (["requester", "alice", "confirm", "goal"], done),
    ];
    let numbered = (0..).zip(parts);
    let made = numbered.map(|(index, ([from, to, act, protocol], content))| {
        message([from, to, act, protocol, &goal], content, &format!("{goal}.{index}"))
    });
    made.collect()
}
