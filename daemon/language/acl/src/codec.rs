//! Converts messages to and from JSON. An unreadable text still yields the fields that are needed
//! to answer it.

use std::borrow::Cow;
use std::fmt;

use bytes::Bytes;
use serde::de::{IgnoredAny, MapAccess, Visitor};
use serde::{Deserialize, Deserializer as _};
use serde_json::Value;

use crate::content::{Reason, Refusal, value};
use crate::message::SCHEMA_VERSION;
use crate::{AgentId, ConversationId, Incarnation, Message, MessageId, Performative, ReplyToken};

/// Maximum size of a message, in bytes; a longer text is rejected. An action model of a hundred
/// actions has less than 64 KiB, and a domain of a hundred agents less than 1 MiB.
pub const MESSAGE_BYTES_MAX: usize = 4 << 20;

/// Maximum size of each identifier in a message, in bytes. Those of agents consist of the agent's
/// name and two numbers.
pub const IDENTIFIER_BYTES_MAX: usize = 256;

/// Error for a text that is not a message.
#[derive(Debug, thiserror::Error)]
#[error("read an ACL message: {problem}")]
pub struct DecodeError {
    /// The mistake in the text.
    pub problem: Problem,
    /// The fields of the message that could be read.
    pub sketch: Box<Sketch>,
}

/// Mistake in a text that is not a message.
#[derive(Debug, thiserror::Error)]
pub enum Problem {
    /// The text is larger than [`MESSAGE_BYTES_MAX`], so it is not parsed.
    #[error("{bytes} bytes are more than the {MESSAGE_BYTES_MAX} that are read")]
    TooLarge {
        /// Size of the text, in bytes.
        bytes: usize,
    },
    /// The text is not JSON, or a field is missing or has the wrong type.
    #[error("{0}")]
    Shape(serde_json::Error),
    /// An identifier in the message is longer than [`IDENTIFIER_BYTES_MAX`]. Receivers remember
    /// identifiers long after the message.
    #[error("`{field}` has {bytes} bytes, and at most {IDENTIFIER_BYTES_MAX} are read")]
    LongIdentifier {
        /// Name of the field.
        field: &'static str,
        /// Size of the identifier, in bytes.
        bytes: usize,
    },
    /// The message has a protocol version that this crate does not support.
    #[error(
        "it is of version {version} of the protocol, and only version {SCHEMA_VERSION} is known here; \
         install one version of Althing on all machines"
    )]
    UnknownVersion {
        /// The protocol version that the text names.
        version: u64,
    },
}

/// Fields of an unreadable message that are needed for a `not-understood`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Sketch {
    /// Identifier of the unreadable message; `None` if it could not be read.
    pub id: Option<MessageId>,
    /// Sender of the unreadable message; `None` if it could not be read.
    pub sender: Option<AgentId>,
    /// Incarnation of the sender; `None` if it could not be read.
    pub incarnation: Option<Incarnation>,
    /// Conversation of the unreadable message; `None` if it could not be read.
    pub conversation_id: Option<ConversationId>,
    /// Token of the message's exchange; `None` if it could not be read.
    pub exchange: Option<ReplyToken>,
    /// Performative of the unreadable message as written, even if FIPA does not define it; `None`
    /// if it could not be read.
    pub performative: Option<String>,
}

// === impl DecodeError ===

impl DecodeError {
    /// Whether the message has a protocol version that this crate does not support.
    pub fn is_of_other_version(&self) -> bool {
        matches!(self.problem, Problem::UnknownVersion { .. })
    }

    /// Converts a received `not-understood` of another protocol version to a message of this
    /// version; `None` for any other message. The receiver then learns at once that its request was
    /// not understood, and does not wait for an answer.
    pub fn to_not_understood(&self) -> Option<Message> {
        let Sketch { id, sender, incarnation, conversation_id, exchange, performative } =
            &*self.sketch;
        let is_not_understood =
            performative.as_deref() == Some(Performative::NotUnderstood.as_str());
        if !is_not_understood || !self.is_of_other_version() {
            return None;
        }
        let detail = format!("the answer cannot be read: {}", self.problem);
        Some(Message {
            version: SCHEMA_VERSION,
            id: id.clone()?,
            performative: Performative::NotUnderstood,
            sender: sender.clone()?,
            incarnation: (*incarnation)?,
            receiver: Vec::new(),
            content: value(&Refusal::new(Reason::Unreadable, detail)),
            language: None,
            ontology: None,
            protocol: None,
            conversation_id: conversation_id.clone()?,
            reply_with: None,
            in_reply_to: Some(exchange.clone()?),
            reply_within: None,
            via: Vec::new(),
            unknown: serde_json::Map::new(),
        })
    }
}

/// Converts a message to JSON.
pub fn encode(message: &Message) -> Bytes {
    // A `Message` has string keys only and no failing `Serialize`, so the conversion cannot fail.
    // If it did, the receiver would answer the empty payload with `not-understood`.
    serde_json::to_vec(message).map(Bytes::from).unwrap_or_default()
}

/// Parses a message from JSON.
///
/// # Errors
///
/// Returns an error if the text has too many bytes, is not a message in JSON, or has an unsupported
/// version. The error contains the fields that are needed to answer the sender.
pub fn decode(bytes: &[u8]) -> Result<Message, DecodeError> {
    if bytes.len() > MESSAGE_BYTES_MAX {
        let problem = Problem::TooLarge { bytes: bytes.len() };
        return Err(DecodeError { problem, sketch: Box::default() });
    }
    match serde_json::from_slice::<Message>(bytes) {
        Ok(message) if message.version == SCHEMA_VERSION => match long_identifier(&message) {
            Some(problem) => Err(DecodeError { problem, sketch: Box::default() }),
            None => Ok(message),
        },
        Ok(message) => {
            let problem = Problem::UnknownVersion { version: u64::from(message.version) };
            Err(DecodeError { problem, sketch: Box::new(sketch(bytes)) })
        }
        Err(error) => {
            let sketch = Box::new(sketch(bytes));
            Err(DecodeError { problem: problem_of(bytes, error), sketch })
        }
    }
}

/// Returns the mistake of an identifier that is too long; `None` if there is none.
fn long_identifier(message: &Message) -> Option<Problem> {
    let identifiers = [
        ("id", Some(message.id.as_str())),
        ("conversation_id", Some(message.conversation_id.as_str())),
        ("reply_with", message.reply_with.as_ref().map(ReplyToken::as_str)),
        ("in_reply_to", message.in_reply_to.as_ref().map(ReplyToken::as_str)),
    ];
    identifiers.into_iter().find_map(|(field, text)| {
        let bytes = text.map_or(0, str::len);
        (bytes > IDENTIFIER_BYTES_MAX).then_some(Problem::LongIdentifier { field, bytes })
    })
}

/// Returns the sender of a message; `None` if the text has no valid sender. Parsing stops at the
/// field `sender`, because a caller that needs other fields parses the whole text anyway.
pub fn sender_of(text: &[u8]) -> Option<AgentId> {
    let mut sender = None;
    // The parser reports the skipped rest of the text as an error, which is ignored.
    let _ = serde_json::Deserializer::from_slice(text).deserialize_map(UpToSender(&mut sender));
    sender
}

struct UpToSender<'s>(&'s mut Option<AgentId>);

impl<'de> Visitor<'de> for UpToSender<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("a message")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut message: A) -> Result<(), A::Error> {
        while let Some(key) = message.next_key::<Cow<'_, str>>()? {
            if key == "sender" {
                *self.0 = Some(message.next_value()?);
                return Ok(());
            }
            message.next_value::<IgnoredAny>()?;
        }
        Ok(())
    }
}

/// Returns the mistake in a text that could not be parsed. An unsupported version takes precedence
/// over `error`, because another version may have other fields.
fn problem_of(bytes: &[u8], error: serde_json::Error) -> Problem {
    let version = serde_json::from_slice::<Value>(bytes)
        .ok()
        .and_then(|value| value.get("version").and_then(Value::as_u64));
    match version {
        Some(version) if version != u64::from(SCHEMA_VERSION) => {
            Problem::UnknownVersion { version }
        }
        _ => Problem::Shape(error),
    }
}

fn sketch(bytes: &[u8]) -> Sketch {
    let Ok(value) = serde_json::from_slice::<Value>(bytes) else { return Sketch::default() };
    let token = |field| opt::<ReplyToken>(&value, field);
    Sketch {
        id: opt(&value, "id"),
        sender: opt(&value, "sender"),
        incarnation: opt(&value, "incarnation"),
        conversation_id: opt(&value, "conversation_id"),
        exchange: token("in_reply_to").or_else(|| token("reply_with")),
        performative: opt(&value, "performative"),
    }
}

fn opt<'a, T: Deserialize<'a>>(value: &'a Value, field: &str) -> Option<T> {
    value.get(field).and_then(|field| T::deserialize(field).ok())
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;
    use serde_json::json;

    use super::*;

    fn minimal() -> Value {
        json!({
            "version": 2, "id": "m1", "performative": "request", "sender": "keyboard",
            "incarnation": 1, "conversation_id": "c1"
        })
    }

    fn with(field: &str, value: Value) -> Vec<u8> {
        let mut message = minimal();
        message[field] = value;
        message.to_string().into_bytes()
    }

    #[test]
    fn the_sender_is_read_without_parsing_the_rest() {
        for (text, expected) in [
            (r#"{"x":{"sender":"b"},"y":"\"sender\":\"c\"","sender":"a"}"#, Some("a")),
            (r#"{"sender" : "a", and so on"#, Some("a")),
            (r#"{"sender":"A/b"}"#, None),
            (r#"{"x":"sender"}"#, None),
            ("[]", None),
            ("", None),
        ] {
            let sender = sender_of(text.as_bytes());
            assert_eq!(sender.as_ref().map(AgentId::as_str), expected, "{text}");
        }
    }

    #[test]
    fn unknown_fields_survive_a_round_trip() {
        let bytes = with("x-signature", json!({"key": [1, 2, 3]}));
        let message = decode(&bytes).expect("an unknown field is no error");
        let again: Value = serde_json::from_slice(&encode(&message)).expect("JSON");
        assert_eq!(again, serde_json::from_slice::<Value>(&bytes).expect("JSON"));
    }

    #[test]
    fn the_error_for_an_unknown_version_contains_the_sender() {
        let error = decode(&with("version", json!(7))).expect_err("version 7");
        assert!(matches!(error.problem, Problem::UnknownVersion { version: 7 }));
        assert_eq!(error.sketch.sender, AgentId::new("keyboard").ok());
        assert_eq!(error.sketch.conversation_id, Some(ConversationId::new("c1")));
    }

    #[test]
    fn an_unknown_version_of_another_shape_is_still_a_version() {
        let bytes = json!({"version": 3, "from": "keyboard", "sender": "keyboard"}).to_string();
        let error = decode(bytes.as_bytes()).expect_err("version 3");
        assert!(matches!(error.problem, Problem::UnknownVersion { version: 3 }), "{error}");
    }

    #[test]
    fn a_not_understood_of_another_version_is_recognized() {
        let message = |version: u32, performative: &str| {
            let mut message = minimal();
            (message["version"], message["performative"]) = (json!(version), json!(performative));
            message["in_reply_to"] = json!("t");
            decode(message.to_string().as_bytes())
        };
        let error = message(1, "not-understood").expect_err("version 1");
        let answer = error.to_not_understood().expect("all fields are there");
        assert_eq!(answer.exchange(), Some(&ReplyToken::new("t")));
        let refusal: Refusal = answer.content_as().expect("a refusal");
        assert!(refusal.detail.contains("version 1 of the protocol"), "{}", refusal.detail);
        assert_eq!(decode(&encode(&answer)).expect("it is of this version"), answer);
        let other = message(1, "agree").expect_err("version 1");
        assert_eq!(other.to_not_understood(), None);
        let wrong = message(SCHEMA_VERSION, "shout").expect_err("no such performative");
        assert!(!wrong.is_of_other_version());
    }

    #[test]
    fn an_identifier_has_a_greatest_length() {
        for field in ["id", "conversation_id", "reply_with", "in_reply_to"] {
            let longest = "x".repeat(IDENTIFIER_BYTES_MAX);
            assert!(decode(&with(field, json!(longest))).is_ok(), "{field}");
            let error = decode(&with(field, json!(longest + "x"))).expect_err("one too many");
            assert!(error.to_string().contains(&format!("`{field}` has 257 bytes")), "{error}");
            assert_eq!(error.sketch, Box::default(), "nothing of it is sent back");
        }
    }

    #[test]
    fn a_wrong_field_is_named() {
        let error = decode(&with("performative", json!("shout"))).expect_err("no such act");
        assert!(error.to_string().contains("shout"), "{error}");
        assert_eq!(error.sketch.performative.as_deref(), Some("shout"));
        let error = decode(&with("sender", json!("Key/board"))).expect_err("no such name");
        assert!(error.to_string().contains("cannot be the name of an agent"), "{error}");
    }

    proptest! {
        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            let _ = decode(&bytes);
        }

        #[test]
        fn no_json_panics(field in "[a-z_]{1,12}", text in ".{0,20}") {
            let _ = decode(&with(&field, json!(text)));
        }

        #[test]
        fn content_survives(number in any::<i64>(), text in ".{0,40}") {
            let bytes = with("content", json!({"n": number, "t": text}));
            let message = decode(&bytes).expect("any content is fine");
            prop_assert_eq!(decode(&encode(&message)).expect("what was written"), message);
        }
    }
}
