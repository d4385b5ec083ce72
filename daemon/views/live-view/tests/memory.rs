//! The memory of a view has a bound: a flood of the longest messages of every kind, from as many
//! agents, goals and conversations as there are messages, ends in limited memory.

use acl::{EcosystemId, Message};
use live_view::{LiveView, Moment, ViewEvent, ViewLimits};
use peak_alloc::PeakAlloc;
use serde_json::{Value, json};

#[global_allocator]
static ALLOCATOR: PeakAlloc = PeakAlloc;

/// Number of messages of each kind. Without limits their contents would take some hundred
/// mebibytes.
const MESSAGES: u64 = 150;

/// Length of a long text, in bytes.
const LONG: usize = 40_000;

/// Memory that the view may take, in mebibytes.
const MEBIBYTES_MAX: f64 = 12.0;

fn limits() -> ViewLimits {
    ViewLimits {
        agents: 100,
        goals: 100,
        goals_bytes: 2 << 20,
        facts_bytes: 2 << 20,
        models_bytes: 1 << 20,
        conversations: 100,
        messages: 500,
        activity: 300,
        ..ViewLimits::default()
    }
}

/// Returns the contents of one message of each kind, with long texts and long lists.
fn contents(number: u64) -> Vec<(&'static str, &'static str, Value)> {
    let long = "x".repeat(LONG);
    let list: Vec<_> = (0..500).map(|index| format!("(p {number} {index})")).collect();
    let plan: String = (0..500).map(|step| format!("(move robot-{number} a b{step})\n")).collect();
    let facts: String = (0..500).map(|index| format!("(p{number} {index} {index})")).collect();
    let model = format!("(define (agent r) (:domain d) (:constants {plan}))");
    let proposals: Vec<_> =
        (0..5).map(|_| json!({ "covers": list, "plan": plan, "cost": 1.0 })).collect();
    let token = json!({
        "term": 1, "conversation": format!("g{number}"), "round": 1, "step": number,
    });
    vec![
        ("request", "goal", json!({ "act": "achieve", "goal": long })),
        ("confirm", "goal", json!({ "outcome": "progress", "detail": long, "plan": plan })),
        ("cfp", "contract-net", json!({ "conjuncts": list })),
        ("agree", "contract-net", json!({ "proposals": proposals, "domain_digest": "" })),
        (
            "request",
            "execution",
            json!({
                "act": "execute", "domain": "", "problem": "", "plan": plan, "epoch": 1,
                "term": 1, "round": number,
            }),
        ),
        (
            "request",
            "action",
            json!({
                "act": "act", "action": format!("(move r {long})"), "method": "m",
                "arguments": {}, "token": token,
            }),
        ),
        ("query-ref", "query", json!({ "text": long })),
        (
            "request",
            "state-change",
            json!({ "act": "stop", "id": format!("{number}{long}"), "by": "ann", "scope": list }),
        ),
        ("not-understood", "goal", json!({ "reason": "unreadable", "detail": long })),
        (
            "inform",
            "",
            json!({
                "of": "model", "model": model, "digest": long, "sequence": 1, "facts": facts,
                "period": 1000,
            }),
        ),
        (
            "inform",
            "",
            json!({ "of": "epoch", "epoch": 1, "revision": 1, "believed": format!("(q {long})") }),
        ),
    ]
}

fn message(number: u64, kind: usize, (act, protocol, content): (&str, &str, Value)) -> Message {
    let mut message = json!({
        "version": 2, "id": format!("m{number}-{kind}"), "performative": act,
        "sender": format!("agent-{number}"), "incarnation": 1, "receiver": ["requester"],
        "conversation_id": format!("g{number}"), "content": content,
    });
    let opens = ["request", "cfp", "query-ref"].contains(&act);
    if !protocol.is_empty() {
        message["protocol"] = json!(protocol);
        let key = if opens { "reply_with" } else { "in_reply_to" };
        message[key] = json!(format!("x{number}-{protocol}"));
    }
    serde_json::from_value(message).expect("a message")
}

#[test]
fn a_flood_of_long_messages_ends_in_limited_memory() {
    let before = ALLOCATOR.current_usage_as_mb();
    let mut view = LiveView::new(EcosystemId::new("test").expect("a name"), limits());
    for number in 0..MESSAGES {
        for (kind, content) in contents(number).into_iter().enumerate() {
            let message = Box::new(message(number, kind, content));
            view.observe(Moment(number * 100), ViewEvent::Message(message));
        }
    }
    let kept = f64::from(ALLOCATOR.current_usage_as_mb() - before);
    assert!(kept < MEBIBYTES_MAX, "{kept} MiB");
    // The flood was observed, and what is shown of it is long.
    let now = Moment(MESSAGES * 100);
    assert!(view.goals(now).len() > 3 && view.facts(now).len() > 500);
    assert!(view.overview(now).counts.messages >= 9 * MESSAGES);
}
