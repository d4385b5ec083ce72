//! Removes the answers of people from messages, because an answer may be a secret.

use acl::{Message, Performative, Protocol};
use serde_json::Value;

/// The text that is shown instead of a person's answer; it has the same length whatever the answer
/// is.
pub const REDACTED: &str = "•••";

/// Returns a copy of a message in which a person's answer is replaced, because the answer may be a
/// secret.
pub fn redact(message: &Message) -> Message {
    let mut shown = message.clone();
    if holds_answer(message) {
        match ["text", "sealed"].iter().find(|key| shown.content.get(**key).is_some()) {
            Some(key) => shown.content[*key] = Value::from(REDACTED),
            // An answer in an unknown form.
            None => shown.content = Value::from(REDACTED),
        }
    }
    shown
}

/// Whether a message contains a person's answer, or may contain one.
pub(crate) fn holds_answer(message: &Message) -> bool {
    let says = |key: &str, word: &str| message.content.get(key).is_some_and(|said| said == word);
    let answers =
        message.performative == Performative::Inform && message.protocol == Some(Protocol::Query);
    answers || says("of", "answer") || says("act", "answer-question")
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn message(performative: &str, content: &Value) -> Message {
        let message = json!({
            "version": 2, "id": "m1", "performative": performative, "sender": "alice",
            "incarnation": 1, "conversation_id": "c1", "protocol": "query", "content": content,
        });
        serde_json::from_value(message).expect("a message")
    }

    fn shown(performative: &str, content: Value) -> Value {
        redact(&message(performative, &content)).content
    }

    #[test]
    fn the_answer_of_a_person_is_replaced() {
        let answer = json!({ "of": "answer", "text": "2718" });
        assert_eq!(shown("inform", answer), json!({ "of": "answer", "text": "•••" }));
        assert_eq!(shown("inform", json!({ "pin": 2718 })), json!("•••"));
        let sealed = json!({ "of": "answer", "sealed": "00ff" });
        assert_eq!(shown("inform", sealed), json!({ "of": "answer", "sealed": "•••" }));
        let request = json!({ "act": "answer-question", "question": 3, "text": "2718" });
        let veiled = json!({ "act": "answer-question", "question": 3, "text": "•••" });
        assert_eq!(shown("request", request), veiled);
    }

    #[test]
    fn a_question_is_not_replaced() {
        let question = json!({ "text": "Which room?" });
        assert_eq!(shown("query-ref", question.clone()), question);
    }
}
