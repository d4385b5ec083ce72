//! Refusal of a message that is not passed on to its receiver.

use std::sync::atomic::{AtomicU64, Ordering};

use acl::content::{Reason, Refusal, value};
use acl::{AgentId, Incarnation, Message, MessageId, Performative, SCHEMA_VERSION};
use serde_json::Map;

/// Builds a refusal of `message` in the name of its receiver `agent`, for the given reason.
pub(crate) fn refusal(
    agent: &AgentId,
    incarnation: Incarnation,
    message: Message,
    reason: Reason,
    detail: String,
) -> Message {
    static REFUSALS: AtomicU64 = AtomicU64::new(0);
    let count = REFUSALS.fetch_add(1, Ordering::Relaxed);
    Message {
        version: SCHEMA_VERSION,
        id: MessageId::new(&format!("{agent}.unheard.{}.{count}", message.id)),
        performative: Performative::Refuse,
        sender: agent.clone(),
        incarnation,
        receiver: vec![message.sender.clone()],
        content: value(&Refusal::new(reason, detail)),
        in_reply_to: message.reply_with.clone(),
        reply_with: None,
        reply_within: None,
        via: Vec::new(),
        unknown: Map::new(),
        ..message
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_answers_the_message_in_the_name_of_its_receiver() {
        let text = r#"{"version": 2, "id": "m", "performative": "request", "sender": "user",
            "incarnation": 3, "receiver": ["robot"], "content": null, "conversation_id": "c",
            "reply_with": "t", "protocol": "action"}"#;
        let message = || acl::decode(text.as_bytes()).expect("a message");
        let robot = AgentId::new("robot").expect("a name");
        let refuse =
            || refusal(&robot, Incarnation(7), message(), Reason::Busy, "it is busy".to_owned());
        let (first, second) = (refuse(), refuse());
        let refused = message();
        assert_eq!((&first.sender, first.incarnation), (&robot, Incarnation(7)));
        assert_eq!(first.receiver, [refused.sender]);
        assert_eq!((first.in_reply_to, first.reply_with), (refused.reply_with, None));
        assert_eq!(first.conversation_id, refused.conversation_id);
        let content: Refusal = serde_json::from_value(first.content).expect("a refusal");
        assert_eq!(content.reason, Reason::Busy);
        assert_ne!(first.id, second.id, "or the second would be taken for a copy");
    }
}
