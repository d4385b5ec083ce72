//! The content of a message in few words. The answer of a person is never part of them.

use acl::content::{Inform, Refusal, Report, Request};
use acl::{Message, Performative};
use serde_json::Value;

use crate::redaction::holds_answer;
use crate::text::{number, one_line};

/// Fields of contents, the most informative first.
const TELLING: [&str; 12] = [
    "goal",
    "action",
    "plan",
    "believe",
    "retract",
    "mode",
    "conjuncts",
    "proposals",
    "detail",
    "token",
    "status",
    "act",
];

/// Summarizes the content of a message in few words, on one line. Control characters stay as they
/// are.
pub fn summarize(message: &Message) -> String {
    one_line(&said(message))
}

fn said(message: &Message) -> String {
    if holds_answer(message) {
        let question = message.content.get("question").and_then(Value::as_u64);
        return question.map_or("an answer".to_owned(), |question| {
            format!("an answer to question {question}")
        });
    }
    match message.performative {
        Performative::Confirm => message
            .content_as::<Report>()
            .map(|report| format!("{}: {}", report.outcome, report.detail))
            .unwrap_or_default(),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as::<Refusal>().map(|refusal| refusal.detail).unwrap_or_default()
        }
        Performative::Inform => match message.content_as::<Inform>() {
            Ok(Inform::Model(_)) => "its action model".to_owned(),
            Ok(Inform::Heartbeat(beat)) => format!("heartbeat {}", beat.sequence),
            Ok(Inform::Epoch(change)) => {
                format!("epoch {}, revision {}", change.epoch, change.revision)
            }
            Ok(Inform::Answer(_)) => "an answer".to_owned(),
            Err(_) => String::new(),
        },
        // Only questions have such a text; that of an answer may be a secret.
        Performative::QueryRef => {
            message.content.get("text").and_then(Value::as_str).unwrap_or_default().to_owned()
        }
        Performative::Agree => proposals(&message.content).unwrap_or_else(|| telling(message)),
        _ => match message.content.get("act").and_then(Value::as_str) {
            Some("store-records") => records(&message.content),
            Some("execute") => plan(&message.content, "plan"),
            Some("stop") => format!("stop: {}", texts(&message.content, "scope", "everything")),
            Some("release-stops") => {
                format!("release: {}", texts(&message.content, "ids", "nothing"))
            }
            _ => telling(message),
        },
    }
}

/// Returns what a message that opens a conversation is about; empty if it says nothing.
pub(crate) fn subject(message: &Message) -> String {
    match message.performative {
        Performative::Request => match message.content_as::<Request>() {
            Ok(Request::Achieve(achieve)) => achieve.goal,
            Ok(Request::Act(act)) => act.action,
            Ok(Request::StoreRecords(_)) => String::new(),
            _ => said(message),
        },
        Performative::Cfp | Performative::QueryRef => said(message),
        _ => String::new(),
    }
}

/// Returns the most informative field of a content as text; empty if it has none.
fn telling(message: &Message) -> String {
    let found = TELLING.iter().find_map(|key| message.content.get(*key));
    match found {
        Some(Value::String(text)) => text.clone(),
        Some(Value::Array(items)) => {
            let shown = items
                .iter()
                .map(|item| item.as_str().map_or_else(|| item.to_string(), str::to_owned));
            shown.collect::<Vec<_>>().join(" ")
        }
        Some(other) => other.to_string(),
        None => String::new(),
    }
}

/// Returns the proposals of a bid, each with its cost.
fn proposals(content: &Value) -> Option<String> {
    let list = content.get("proposals")?.as_array()?;
    let each = list.iter().map(|proposal| {
        let covers = proposal.get("covers").and_then(Value::as_array).into_iter().flatten();
        let covers: Vec<_> = covers.filter_map(Value::as_str).collect();
        let cost = proposal.get("cost").and_then(Value::as_f64);
        let cost = cost.map(|cost| format!(" at cost {}", number(cost))).unwrap_or_default();
        format!("{}{cost}", covers.join(" "))
    });
    Some(each.collect::<Vec<_>>().join("; "))
}

fn records(content: &Value) -> String {
    let records = content.get("records").and_then(Value::as_array).into_iter().flatten();
    let keys: Vec<_> = records.filter_map(|record| record.get("key")?.as_str()).collect();
    format!("stores {}", keys.join(", "))
}

/// Returns the texts in a list of a content, or `otherwise` if there are none.
fn texts(content: &Value, key: &str, otherwise: &str) -> String {
    let list = content.get(key).and_then(Value::as_array).into_iter().flatten();
    let texts: Vec<_> = list.filter_map(Value::as_str).collect();
    if texts.is_empty() { otherwise.to_owned() } else { texts.join(", ") }
}

fn plan(content: &Value, key: &str) -> String {
    let text = content.get(key).and_then(Value::as_str).unwrap_or_default();
    let steps = text.lines().filter(|line| line.trim_start().starts_with('('));
    steps.collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn said(performative: &str, content: Value) -> String {
        let message = json!({
            "version": 2, "id": "m1", "performative": performative, "sender": "alice",
            "incarnation": 1, "conversation_id": "c1", "content": content,
        });
        summarize(&serde_json::from_value(message).expect("a message"))
    }

    #[test]
    fn messages_are_summarized() {
        assert_eq!(said("request", json!({ "act": "achieve", "goal": "(p\n  a)" })), "(p a)");
        let bid = json!({ "proposals": [
            { "covers": ["(p a)"], "plan": "(do x)", "cost": 3.0 },
            { "covers": ["(p a)", "(p b)"], "plan": "", "cost": 4.5 },
        ], "domain_digest": "" });
        assert_eq!(said("agree", bid), "(p a) at cost 3; (p a) (p b) at cost 4.5");
        let execute = json!({ "act": "execute", "domain": "x", "problem": "y", "epoch": 1,
            "plan": "(move r a b)\n(scan r b)\n; cost = 3\n", "round": 1 });
        assert_eq!(said("request", execute), "(move r a b) (scan r b)");
        let report = json!({ "outcome": "done", "detail": "arrived" });
        assert_eq!(said("confirm", report), "done: arrived");
        let call = json!({ "conjuncts": ["(p a)", "(p b)"], "together": false });
        assert_eq!(said("cfp", call), "(p a) (p b)");
        assert_eq!(said("confirm", json!([1])), "");
        assert_eq!(said("request", json!({ "act": "stop", "id": "9f" })), "stop: everything");
        let release = json!({ "act": "release-stops", "ids": ["9f", "a0"] });
        assert_eq!(said("request", release), "release: 9f, a0");
    }

    #[test]
    fn the_answer_of_a_person_is_no_part_of_a_summary() {
        assert_eq!(said("inform", json!({ "of": "answer", "text": "2718" })), "an answer");
        let request = json!({ "act": "answer-question", "question": 3, "text": "2718" });
        assert_eq!(said("request", request), "an answer to question 3");
        assert_eq!(said("query-ref", json!({ "text": "Which room?" })), "Which room?");
    }
}
