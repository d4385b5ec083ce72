//! The messages of a made-up ecosystem.

use acl::Message;
use serde_json::{Value, json};

use super::Kind;

pub(crate) fn message(line: [&str; 5], content: Value, id: &str) -> Message {
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
        let key = if performative == "request" { "reply_with" } else { "in_reply_to" };
        message[key] =
            json!(format!("{conversation}-{protocol}-{}", id.rsplit('.').next().unwrap_or("")));
    }
    serde_json::from_value(message).expect("a message")
}

pub(crate) fn heartbeat(name: &str, sequence: u64, facts: &str, stops: &[Value]) -> Message {
    let content = json!({
        "of": "heartbeat", "digest": "d", "sequence": sequence, "facts": facts, "period": 10_000,
        "stops": stops,
    });
    message([name, "", "inform", "", name], content, &format!("{name}.{sequence}"))
}

pub(crate) fn model(name: &str, kind: Kind, rooms: usize) -> String {
    let body = match kind {
        Kind::Robot => {
            let pairs = (1..rooms).map(|room| {
                format!(
                    "(connected room-{} room-{room}) (connected room-{room} room-{})",
                    room - 1,
                    room - 1
                )
            });
            let pairs = pairs.collect::<Vec<_>>().join(" ");
            format!(
                "(:init {pairs}) (:action move :agent ?r - robot :parameters (?from ?to - location)
                 :precondition (and (at ?r ?from) (connected ?from ?to))
                 :effect (and (not (at ?r ?from)) (at ?r ?to)))
                 (:action take-picture :agent ?r - robot :parameters () :effect (seen ?r))"
            )
        }
        Kind::Thermometer => String::new(),
        Kind::Lamp => "(:action switch-on :agent ?l - lamp :parameters ()
             :precondition (not (lit ?l)) :effect (lit ?l))"
            .to_owned(),
    };
    format!("(define (agent {name}) (:domain made-up) {body})")
}

pub(crate) fn announcement(name: &str, model: &str, facts: &str) -> Message {
    let content = json!({
        "of": "model", "model": model, "digest": "d", "sequence": 1, "facts": facts, "period": 10_000,
    });
    message([name, "", "inform", "", name], content, &format!("{name}.1"))
}

pub(crate) fn goal_begins(goal: &str, person: &str, text: &str, plan: &str) -> Vec<Message> {
    let execute = json!({
        "act": "execute", "domain": "", "problem": "", "plan": plan, "epoch": 1, "term": 1, "round": 1,
    });
    vec![
        message(
            [person, "requester", "request", "goal", goal],
            json!({ "act": "achieve", "goal": text }),
            &format!("{goal}.a.0"),
        ),
        message(
            ["requester", "executor", "request", "execution", goal],
            execute,
            &format!("{goal}.b.0"),
        ),
    ]
}

pub(crate) fn step_begins(goal: &str, robot: &str, step: u64, from: usize, to: usize) -> Message {
    let token = json!({ "term": 1, "conversation": goal, "round": 1, "step": step });
    let content = json!({
        "act": "act", "action": format!("(move {robot} room-{from} room-{to})"), "method": "m",
        "arguments": {}, "token": token,
    });
    message(["executor", robot, "request", "action", goal], content, &format!("{goal}.c.{step}"))
}

pub(crate) fn step_done(goal: &str, robot: &str, step: u64) -> Message {
    let content = json!({ "outcome": "done", "detail": "arrived" });
    message([robot, "executor", "confirm", "action", goal], content, &format!("{goal}.d.{step}"))
}

pub(crate) fn goal_done(goal: &str, why: &str) -> Vec<Message> {
    ended(goal, "confirm", json!({ "outcome": "done", "detail": why }))
}

pub(crate) fn goal_cancelled(goal: &str) -> Vec<Message> {
    ended(goal, "confirm", json!({ "outcome": "cancelled", "detail": "a person cancelled it" }))
}

fn ended(goal: &str, performative: &str, content: Value) -> Vec<Message> {
    let line = |from, to, protocol| [from, to, performative, protocol, goal];
    vec![
        message(
            line("executor", "requester", "execution"),
            content.clone(),
            &format!("{goal}.e.0"),
        ),
        message(line("requester", "person", "goal"), content, &format!("{goal}.f.0")),
    ]
}
