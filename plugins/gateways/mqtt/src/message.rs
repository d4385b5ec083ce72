//! MQTT messages that the gateway sends.

/// An MQTT message to send: a text for a topic.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct OutgoingMessage {
    pub(crate) topic: String,
    pub(crate) text: String,
    /// Whether the broker should retain the message.
    pub(crate) is_retained: bool,
}

impl OutgoingMessage {
    pub(crate) fn new(topic: impl Into<String>, text: impl Into<String>) -> OutgoingMessage {
        OutgoingMessage { topic: topic.into(), text: text.into(), is_retained: false }
    }
}
