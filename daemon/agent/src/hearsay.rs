//! What a daemon has heard agents say to all: the last of each kind, for those who start later (the
//! paper's “cache broadcast messages”).
//!
//! Nearly all heartbeats say what the one before said, and of a thousand agents a thousand come each
//! second, to every daemon. So a heartbeat is first held against the one before, byte by byte: if it
//! differs in its id and its number alone, nobody has to read it.

use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Heartbeat, Inform};
use acl::{Incarnation, Message};
use bytes::Bytes;

/// The longest model that is read, with all that was said of it. The widest that
/// `capability::limits` takes, with a hundred actions and a thousand objects, is a quarter of it;
/// and of a thousand agents each daemon keeps one.
pub(crate) const MODEL_BYTES_MAX: usize = 1 << 20;

/// The longest heartbeat: it comes once a second. Four thousand facts of sixty bytes, which is all
/// that an agent may claim.
pub(crate) const HEARTBEAT_BYTES_MAX: usize = 256 << 10;

/// The longest announcement of a Domain Maintainer, of which there are few: it tells what everybody's
/// requests have changed, at most sixteen times what one agent may claim.
pub(crate) const EPOCH_BYTES_MAX: usize = 4 << 20;

/// How long what is said in these words may be; no bound of its own, if it is not kept.
pub(crate) fn bytes_max(inform: &Inform) -> Option<usize> {
    match inform {
        Inform::Model(_) => Some(MODEL_BYTES_MAX),
        Inform::Heartbeat(_) => Some(HEARTBEAT_BYTES_MAX),
        Inform::Epoch(_) => Some(EPOCH_BYTES_MAX),
        Inform::Answer(_) => None,
    }
}

/// The last words of one agent, as they came: few will ever read them again.
#[derive(Default)]
pub(crate) struct Hearsay {
    model: Option<Bytes>,
    heartbeat: Option<Heard>,
    epoch: Option<Bytes>,
}

/// A heartbeat that was heard.
struct Heard {
    text: Bytes,
    /// What it needs to recognise the next.
    repeatable: Option<Repeatable>,
}

/// A heartbeat that may be said again.
pub(crate) struct Repeatable {
    pub(crate) said: Arc<Said>,
    pub(crate) sequence: u64,
    /// Where in its text its id is, and then its number.
    id: Range<usize>,
    number: Range<usize>,
}

/// What all heartbeats have in common that say the same.
pub(crate) struct Said {
    pub(crate) incarnation: Incarnation,
    pub(crate) digest: String,
    pub(crate) period: Duration,
}

/// A heartbeat that says what the one before said, and the number of that one.
pub(crate) struct Again {
    pub(crate) before: u64,
    pub(crate) now: Repeatable,
}

const ID: &str = "\"id\":\"";
const NUMBER: &str = "\"sequence\":";

// === impl Hearsay ===

impl Hearsay {
    /// Keeps what was said, in place of the last of its kind.
    pub(crate) fn keep(&mut self, text: Bytes, message: &Message, inform: &Inform) {
        match inform {
            Inform::Model(_) => self.model = Some(text),
            Inform::Heartbeat(heartbeat) => {
                let repeatable = Repeatable::of(&text, message, heartbeat);
                self.heartbeat = Some(Heard { text, repeatable });
            }
            Inform::Epoch(_) => self.epoch = Some(text),
            Inform::Answer(_) => (),
        }
    }

    /// Everything kept, in the order in which it makes sense.
    pub(crate) fn all(&self) -> impl Iterator<Item = &Bytes> {
        let heartbeat = self.heartbeat.as_ref().map(|heard| &heard.text);
        self.model.iter().chain(heartbeat).chain(&self.epoch)
    }

    /// Whether a text is the last heartbeat again.
    pub(crate) fn is_again(&self, text: &[u8]) -> Option<Again> {
        let Heard { text: before, repeatable } = self.heartbeat.as_ref()?;
        repeatable.as_ref()?.is_again(before, text)
    }

    /// Keeps a heartbeat that is the last one again.
    pub(crate) fn keep_again(&mut self, text: Bytes, again: Again) {
        self.heartbeat = Some(Heard { text, repeatable: Some(again.now) });
    }
}

// === impl Repeatable ===

impl Repeatable {
    /// Where the id and the number stand. Where either key stands elsewhere too, nothing is recognised.
    fn of(text: &[u8], message: &Message, heartbeat: &Heartbeat) -> Option<Repeatable> {
        // What is known for a while only is never the same again.
        if !heartbeat.known_for.is_empty() {
            return None;
        }
        let text = std::str::from_utf8(text).ok()?;
        let id = value_of(text, ID, message.id.as_str())?;
        let number = value_of(text, NUMBER, &heartbeat.sequence.to_string())?;
        let Heartbeat { digest, period, sequence, .. } = heartbeat;
        let (digest, period) = (digest.clone(), period.0);
        let said = Arc::new(Said { incarnation: message.incarnation, digest, period });
        let sequence = *sequence;
        (id.end < number.start).then_some(Repeatable { said, sequence, id, number })
    }

    fn is_again(&self, before: &[u8], text: &[u8]) -> Option<Again> {
        let Repeatable { said, sequence, id, number } = self;
        let head = &before[..id.start];
        let rest = text.strip_prefix(head)?;
        let own_id = rest.iter().position(|byte| *byte == b'"')?;
        if !rest[..own_id].iter().all(|byte| byte.is_ascii_graphic() && *byte != b'\\') {
            return None;
        }
        let between = &before[id.end..number.start];
        let rest = rest[own_id..].strip_prefix(between)?;
        let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
        if rest[digits..] != before[number.end..] || (digits > 1 && rest[0] == b'0') {
            return None;
        }
        let own_number = std::str::from_utf8(&rest[..digits]).ok()?.parse().ok()?;
        let id = head.len()..head.len() + own_id;
        let start = id.end + between.len();
        let (said, number) = (Arc::clone(said), start..start + digits);
        let now = Repeatable { said, sequence: own_number, id, number };
        Some(Again { before: *sequence, now })
    }
}

/// Where the value stands that follows a key, if there is no other such place.
fn value_of(text: &str, key: &str, value: &str) -> Option<Range<usize>> {
    let mut places = text.match_indices(key).map(|(place, _)| place + key.len());
    let start = places.next().filter(|_| places.next().is_none())?;
    let end = start + value.len();
    let follows = text.as_bytes().get(end)?;
    let is_it = text[start..].starts_with(value) && !follows.is_ascii_alphanumeric();
    is_it.then_some(start..end)
}

#[cfg(test)]
mod tests {
    use serde_json::{Value, json};

    use super::*;

    fn beat(id: &str, sequence: u64) -> Value {
        json!({
            "version": 1, "id": id, "performative": "inform", "sender": "lamp", "incarnation": 7,
            "content": { "of": "heartbeat", "digest": "d", "facts": "(lit lamp)", "period": 1000,
                "sequence": sequence },
            "conversation_id": "lamp"
        })
    }

    fn heard(text: &str) -> Hearsay {
        let message = acl::decode(text.as_bytes()).expect("a message");
        let inform = message.content_as().expect("an inform");
        let mut hearsay = Hearsay::default();
        hearsay.keep(Bytes::from(text.to_owned()), &message, &inform);
        hearsay
    }

    /// A text as our own encoder writes it.
    fn written(value: &Value) -> String {
        let message = acl::decode(value.to_string().as_bytes()).expect("a message");
        String::from_utf8(acl::encode(&message).to_vec()).expect("it is JSON")
    }

    #[test]
    fn what_differs_in_id_and_number_alone_is_the_same_again() {
        let mut hearsay = heard(&written(&beat("lamp.7.9", 9)));
        for number in [10, 11, 12, 1_000] {
            let text = written(&beat(&format!("lamp.7.{number}"), number));
            let again = hearsay.is_again(text.as_bytes()).expect("it says the same");
            assert_eq!(again.now.sequence, number);
            assert!(again.before < number);
            hearsay.keep_again(Bytes::from(text.clone()), again);
            assert_eq!(hearsay.all().collect::<Vec<_>>(), [&Bytes::from(text)]);
        }
    }

    #[test]
    fn what_differs_in_anything_else_is_not() {
        let hearsay = heard(&written(&beat("lamp.7.9", 9)));
        let next = beat("lamp.7.10", 10);
        let with = |place: &str, value: Value| {
            let mut other = next.clone();
            *other.pointer_mut(place).expect("it is there") = value;
            written(&other)
        };
        let mut others = vec![
            with("/content/facts", json!("(lit lamp) (hot lamp)")),
            with("/content/digest", json!("e")),
            with("/content/period", json!(2000)),
            with("/incarnation", json!(8)),
            with("/sender", json!("lamb")),
            with("/conversation_id", json!("other")),
        ];
        let next = written(&next);
        others.push(next.replace("\"sequence\":10", "\"sequence\":010"));
        others.push(next.replace("\"sequence\":10", "\"sequence\":-10"));
        others.push(next.replace("\"sequence\":10", "\"sequence\":1e1"));
        others.push(next.replace("\"sequence\":10", "\"sequence\":99999999999999999999999"));
        others.push(next.replace("lamp.7.10", "lamp\\u002e7.10"));
        others.push(next.replace("lamp.7.10", "lamp\n10"));
        others.push(format!("{next} "));
        others.push(next[..next.len() - 1].to_owned());
        others.push(String::new());
        for other in others {
            assert!(hearsay.is_again(other.as_bytes()).is_none(), "{other}");
        }
        assert!(hearsay.is_again(next.as_bytes()).is_some());
    }

    #[test]
    fn what_cannot_be_told_apart_is_read() {
        let mut passing = beat("lamp.7.9", 9);
        passing["content"]["known_for"] = json!({ "(warm lamp)": 9 });
        let mut twice = beat("lamp.7.9", 9);
        twice["x-note"] = json!({ "id": "lamp.7.9" });
        for odd in [passing, twice] {
            let text = written(&odd);
            assert!(heard(&text).is_again(text.as_bytes()).is_none(), "{text}");
        }
        assert!(Hearsay::default().is_again(b"").is_none());
    }
}
