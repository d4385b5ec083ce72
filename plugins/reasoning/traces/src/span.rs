//! A span: one piece of work on a goal, with its beginning and its end, as OpenTelemetry defines it.
//! Identifiers follow from the conversation, so that every process computes the same ones.

use std::fmt;

use ring::digest::{Context, SHA256};

/// Maximum length of a text in an attribute, in characters; the rest is cut off.
const TEXT_CHARS_MAX: usize = 1_024;

/// Identifier of a trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct TraceId([u8; 16]);

/// Identifier of a span in its trace.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct SpanId([u8; 8]);

/// Time since 1970, in nanoseconds.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct UnixNanos(pub(crate) u64);

/// Value of an attribute.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum AttributeValue {
    Text(String),
    Integer(i64),
    Number(f64),
    Flag(bool),
    Texts(Vec<String>),
}

/// Attribute of a span, a link or a resource.
pub(crate) type Attribute = (&'static str, AttributeValue);

/// How the work of a span ended.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) enum SpanStatus {
    /// The work was neither done nor did it fail: it was cancelled, or its end is not known.
    #[default]
    Unset,
    Done,
    /// The work failed; the text says why.
    Failed(String),
}

/// Reference to a span that another one continues or replaces.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct SpanLink {
    pub(crate) trace: TraceId,
    pub(crate) span: SpanId,
    /// How the two belong together.
    pub(crate) relation: &'static str,
}

/// One piece of work.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct TraceSpan {
    pub(crate) trace: TraceId,
    pub(crate) id: SpanId,
    /// The work that this work is a part of; `None` for the root of a trace.
    pub(crate) parent: Option<SpanId>,
    /// Name of the kind of work: one of a few, or of as many as there are actions.
    pub(crate) name: String,
    pub(crate) start: UnixNanos,
    pub(crate) end: UnixNanos,
    pub(crate) attributes: Vec<Attribute>,
    pub(crate) links: Vec<SpanLink>,
    pub(crate) status: SpanStatus,
}

/// Returns the first bytes of the SHA-256 digest of these parts, which are kept apart.
fn derived<const N: usize>(parts: &[&[u8]]) -> [u8; N] {
    let mut context = Context::new(&SHA256);
    for part in parts {
        context.update(&(part.len() as u64).to_be_bytes());
        context.update(part);
    }
    let digest = context.finish();
    let mut bytes = [0; N];
    bytes.copy_from_slice(&digest.as_ref()[..N]);
    // An identifier of zeros is invalid in OpenTelemetry.
    if bytes == [0; N] {
        bytes[N - 1] = 1;
    }
    bytes
}

fn write_hex(f: &mut fmt::Formatter<'_>, bytes: &[u8]) -> fmt::Result {
    bytes.iter().try_for_each(|byte| write!(f, "{byte:02x}"))
}

// === impl TraceId ===

impl TraceId {
    /// Returns the trace of a conversation.
    pub(crate) fn of(ecosystem: &str, conversation: &str) -> TraceId {
        TraceId(derived(&[b"althing", ecosystem.as_bytes(), conversation.as_bytes()]))
    }
}

impl fmt::Display for TraceId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_hex(f, &self.0)
    }
}

// === impl SpanId ===

impl SpanId {
    /// Returns the span of the work with this name and key in a trace.
    pub(crate) fn of(trace: TraceId, name: &str, key: &str) -> SpanId {
        SpanId(derived(&[&trace.0, name.as_bytes(), key.as_bytes()]))
    }
}

impl fmt::Display for SpanId {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write_hex(f, &self.0)
    }
}

// === impl AttributeValue ===

impl From<&str> for AttributeValue {
    fn from(text: &str) -> AttributeValue {
        AttributeValue::Text(text.chars().take(TEXT_CHARS_MAX).collect())
    }
}

impl From<u64> for AttributeValue {
    fn from(number: u64) -> AttributeValue {
        AttributeValue::Integer(i64::try_from(number).unwrap_or(i64::MAX))
    }
}

// === impl TraceSpan ===

impl TraceSpan {
    pub(crate) fn set(&mut self, name: &'static str, value: impl Into<AttributeValue>) {
        self.attributes.push((name, value.into()));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn identifiers_follow_from_the_conversation() {
        let trace = TraceId::of("lab", "c1");
        assert_eq!(trace, TraceId::of("lab", "c1"));
        assert_ne!(trace, TraceId::of("la", "bc1"), "the parts are kept apart");
        assert_eq!(trace.to_string().len(), 32);
        let span = SpanId::of(trace, "goal", "");
        assert_ne!(span, SpanId::of(trace, "action", ""));
        assert_ne!(span, SpanId::of(TraceId::of("lab", "c2"), "goal", ""));
        assert_eq!(span.to_string().len(), 16);
    }

    #[test]
    fn long_texts_are_cut() {
        let AttributeValue::Text(text) = AttributeValue::from("é".repeat(9_999).as_str()) else {
            panic!("a text")
        };
        assert_eq!(text.chars().count(), TEXT_CHARS_MAX);
    }
}
