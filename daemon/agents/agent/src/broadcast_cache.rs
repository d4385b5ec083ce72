//! Cache of broadcasts: the last one of each kind from each sender, for agents that start later
//! (the paper's “cache broadcast messages”).
//!
//! Nearly all heartbeats repeat the previous one, and a thousand agents send a thousand of them per
//! second to every daemon. So the text of a heartbeat is first compared with the text of the
//! previous heartbeat of its sender. If only the message id and the sequence number differ, the
//! heartbeat is not decoded.

use std::collections::BTreeMap;
use std::ops::Range;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Heartbeat, Inform};
use acl::{AgentId, Incarnation, Message, Performative};
use bytes::Bytes;
use tokio::time::Instant;

/// Maximum length of an announcement of a model, in bytes, including the heartbeat in it; a longer
/// one is not read. The largest model that `capability::limits` allows, with a hundred actions and
/// a thousand objects, takes a quarter of this length. Each daemon caches one announcement per
/// agent.
pub(crate) const MODEL_BYTES_MAX: usize = 1 << 20;

/// Maximum length of a heartbeat, in bytes; a longer one is not read. This length has room for four
/// thousand facts of sixty bytes, the most that an agent may claim. An agent sends one heartbeat
/// per second.
pub(crate) const HEARTBEAT_BYTES_MAX: usize = 256 << 10;

/// Maximum length of an announcement of a Domain Maintainer, in bytes; a longer one is not read.
/// Each such announcement contains the changes that the requests of all agents have made: at most
/// sixteen times as many facts as one agent may claim.
pub(crate) const EPOCH_BYTES_MAX: usize = 4 << 20;

/// Returns the maximum length, in bytes, of a message with this kind of content. `None` if the
/// content is not cached; such a message has no bound of its own.
pub(crate) fn bytes_max(inform: &Inform) -> Option<usize> {
    match inform {
        Inform::Model(_) => Some(MODEL_BYTES_MAX),
        Inform::Heartbeat(_) => Some(HEARTBEAT_BYTES_MAX),
        Inform::Epoch(_) => Some(EPOCH_BYTES_MAX),
        Inform::Answer(_) => None,
    }
}

/// Returns the content of a message if it is an `inform` that can be read; otherwise `None`.
pub(crate) fn inform_of(message: &Message) -> Option<Inform> {
    let is_inform = message.performative == Performative::Inform;
    is_inform.then(|| message.content_as().ok()).flatten()
}

/// The last broadcasts of each agent, by sender.
#[derive(Default)]
pub(crate) struct BroadcastCaches(BTreeMap<AgentId, BroadcastCache>);

/// The last broadcasts of one agent. The broadcasts are not decoded, because most are never read
/// again.
#[derive(Default)]
pub(crate) struct BroadcastCache {
    model: Option<Bytes>,
    heartbeat: Option<CachedHeartbeat>,
    epoch: Option<Bytes>,
    /// Time at which the last heartbeat, or the last model, arrived.
    heard: Option<Instant>,
}

/// The last heartbeat of one agent: the last one that was decoded, and how it was repeated since.
struct CachedHeartbeat {
    /// The text of the decoded heartbeat.
    text: Bytes,
    /// Pattern that recognises a repetition of this heartbeat; `None` if repetitions cannot be
    /// recognised by comparing texts.
    repeatable: Option<HeartbeatPattern>,
    /// The message id of the last repetition; empty if there is none yet.
    repeated_id: String,
    /// The sequence number of the last repetition, or of the decoded heartbeat.
    sequence: u64,
}

/// Pattern of one heartbeat, with which a later repetition of that heartbeat is recognised.
struct HeartbeatPattern {
    said: Arc<HeartbeatContent>,
    /// Byte range of the message id in the heartbeat's text. The next field is the byte range of
    /// the sequence number, which comes after the id.
    id: Range<usize>,
    number: Range<usize>,
}

/// The content that a heartbeat shares with its repetitions.
pub(crate) struct HeartbeatContent {
    pub(crate) incarnation: Incarnation,
    pub(crate) digest: String,
    pub(crate) period: Duration,
}

/// A heartbeat that repeats the previous one, which has the sequence number `before`.
pub(crate) struct HeartbeatRepetition {
    pub(crate) said: Arc<HeartbeatContent>,
    pub(crate) before: u64,
    pub(crate) sequence: u64,
    /// Byte range of the message id in the text of the repetition.
    id: Range<usize>,
}

const ID: &str = "\"id\":\"";
const NUMBER: &str = "\"sequence\":";

// === impl BroadcastCaches ===

impl BroadcastCaches {
    /// Returns all stored broadcasts, in an order in which a receiver can handle them.
    pub(crate) fn all(&self) -> impl Iterator<Item = Bytes> {
        self.0.values().flat_map(BroadcastCache::all)
    }

    /// Returns all stored broadcasts by sender.
    pub(crate) fn by_sender(&self) -> BTreeMap<AgentId, Vec<Bytes>> {
        let copy =
            |(sender, cache): (&AgentId, &BroadcastCache)| (sender.clone(), cache.all().collect());
        self.0.iter().map(copy).collect()
    }

    /// Stores a broadcast in place of the sender's last broadcast of the same kind. Returns the time
    /// since the sender's last heartbeat, as [`BroadcastCache::keep`] does.
    pub(crate) fn keep(
        &mut self,
        text: Bytes,
        message: &Message,
        inform: &Inform,
    ) -> Option<Duration> {
        self.0.entry(message.sender.clone()).or_default().keep(text, message, inform)
    }

    /// Compares a text with the last heartbeat of `sender`. Returns `None` if the text does not
    /// repeat that heartbeat.
    pub(crate) fn repetition(&self, sender: &AgentId, text: &[u8]) -> Option<HeartbeatRepetition> {
        self.0.get(sender)?.is_again(text)
    }

    /// Records that the last heartbeat of `sender` was repeated. Does nothing if no heartbeat of
    /// `sender` is stored. Returns the time since the sender's last heartbeat, as
    /// [`BroadcastCache::keep`] does.
    pub(crate) fn keep_repetition(
        &mut self,
        sender: &AgentId,
        text: &[u8],
        repetition: &HeartbeatRepetition,
    ) -> Option<Duration> {
        self.0.get_mut(sender)?.keep_again(text, repetition)
    }

    /// Whether the last heartbeat of `sender` was recognised as a repetition.
    #[cfg(test)]
    pub(crate) fn is_repeated(&self, sender: &AgentId) -> bool {
        let heartbeat = self.0.get(sender).and_then(|cache| cache.heartbeat.as_ref());
        heartbeat.is_some_and(|heartbeat| !heartbeat.repeated_id.is_empty())
    }

    /// Removes the broadcasts of an agent that has left.
    pub(crate) fn forget(&mut self, sender: &AgentId) {
        self.0.remove(sender);
    }
}

// === impl BroadcastCache ===

impl BroadcastCache {
    /// Stores a broadcast in place of the sender's last broadcast of the same kind. Returns the time
    /// since the sender's last heartbeat; a model contains one. `None` if the broadcast is no
    /// heartbeat, or the first one.
    pub(crate) fn keep(
        &mut self,
        text: Bytes,
        message: &Message,
        inform: &Inform,
    ) -> Option<Duration> {
        match inform {
            Inform::Model(_) => self.model = Some(text),
            Inform::Heartbeat(heartbeat) => {
                let repeatable = HeartbeatPattern::of(&text, message, heartbeat);
                let (repeated_id, sequence) = (String::new(), heartbeat.sequence);
                self.heartbeat = Some(CachedHeartbeat { text, repeatable, repeated_id, sequence });
            }
            Inform::Epoch(_) => {
                self.epoch = Some(text);
                return None;
            }
            Inform::Answer(_) => return None,
        }
        self.heard_again()
    }

    /// Records that a heartbeat arrives now. Returns the time since the one before it.
    fn heard_again(&mut self) -> Option<Duration> {
        let now = Instant::now();
        self.heard.replace(now).map(|before| now - before)
    }

    /// Returns all stored broadcasts in the order in which a receiver must handle them.
    pub(crate) fn all(&self) -> impl Iterator<Item = Bytes> {
        let heartbeat = self.heartbeat.as_ref().map(CachedHeartbeat::last_text);
        self.model.iter().cloned().chain(heartbeat).chain(self.epoch.clone())
    }

    /// Compares a text with the last heartbeat. Returns `None` if the text does not repeat that
    /// heartbeat.
    pub(crate) fn is_again(&self, text: &[u8]) -> Option<HeartbeatRepetition> {
        self.heartbeat.as_ref()?.is_again(text)
    }

    /// Records that the last heartbeat was repeated by `text`. Returns the time since the last one.
    pub(crate) fn keep_again(
        &mut self,
        text: &[u8],
        again: &HeartbeatRepetition,
    ) -> Option<Duration> {
        let heartbeat = self.heartbeat.as_mut()?;
        // Another heartbeat may have come meanwhile.
        let said = &heartbeat.repeatable.as_ref()?.said;
        if !Arc::ptr_eq(said, &again.said) {
            return None;
        }
        heartbeat.sequence = again.sequence;
        heartbeat.repeated_id.clear();
        // A repetition has an id of graphic ASCII characters.
        heartbeat.repeated_id.extend(text[again.id.clone()].iter().copied().map(char::from));
        self.heard_again()
    }
}

// === impl CachedHeartbeat ===

impl CachedHeartbeat {
    /// Returns the text of the last heartbeat: of the decoded one, or of its last repetition.
    fn last_text(&self) -> Bytes {
        let CachedHeartbeat { text, repeatable, repeated_id, sequence } = self;
        let Some(HeartbeatPattern { id, number, .. }) = repeatable else { return text.clone() };
        if repeated_id.is_empty() {
            return text.clone();
        }
        let sequence = sequence.to_string();
        let parts = [
            &text[..id.start],
            repeated_id.as_bytes(),
            &text[id.end..number.start],
            sequence.as_bytes(),
            &text[number.end..],
        ];
        Bytes::from(parts.concat())
    }

    fn is_again(&self, text: &[u8]) -> Option<HeartbeatRepetition> {
        let HeartbeatPattern { said, id, number } = self.repeatable.as_ref()?;
        let before = &self.text;
        let head = &before[..id.start];
        let rest = text.strip_prefix(head)?;
        let own_id = rest.iter().position(|byte| *byte == b'"')?;
        if own_id == 0
            || !rest[..own_id].iter().all(|byte| byte.is_ascii_graphic() && *byte != b'\\')
        {
            return None;
        }
        let between = &before[id.end..number.start];
        let rest = rest[own_id..].strip_prefix(between)?;
        let digits = rest.iter().take_while(|byte| byte.is_ascii_digit()).count();
        if rest[digits..] != before[number.end..] || (digits > 1 && rest[0] == b'0') {
            return None;
        }
        let sequence = std::str::from_utf8(&rest[..digits]).ok()?.parse().ok()?;
        let id = head.len()..head.len() + own_id;
        Some(HeartbeatRepetition { said: Arc::clone(said), before: self.sequence, sequence, id })
    }
}

// === impl HeartbeatPattern ===

impl HeartbeatPattern {
    /// Finds the message id and the sequence number in the text of a heartbeat. Returns `None` if
    /// one of the two keys occurs a second time, or if the heartbeat has facts that expire.
    fn of(text: &[u8], message: &Message, heartbeat: &Heartbeat) -> Option<HeartbeatPattern> {
        // The time left of a fact counts from arrival, so the same text means something else each
        // time.
        if !heartbeat.known_for.is_empty() {
            return None;
        }
        let text = std::str::from_utf8(text).ok()?;
        let id = value_of(text, ID, message.id.as_str())?;
        let number = value_of(text, NUMBER, &heartbeat.sequence.to_string())?;
        let (digest, period) = (heartbeat.digest.clone(), heartbeat.period.0);
        let said = Arc::new(HeartbeatContent { incarnation: message.incarnation, digest, period });
        (id.end < number.start).then_some(HeartbeatPattern { said, id, number })
    }
}

/// Returns the byte range of `value` where it follows `key` in `text`. `None` if `key` is missing
/// or occurs a second time, or if another value follows it.
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
            "version": 2, "id": id, "performative": "inform", "sender": "lamp", "incarnation": 7,
            "content": { "of": "heartbeat", "digest": "d", "facts": "(lit lamp)", "period": 1000,
                "sequence": sequence },
            "conversation_id": "lamp"
        })
    }

    fn heard(text: &str) -> BroadcastCache {
        let message = acl::decode(text.as_bytes()).expect("a message");
        let inform = message.content_as().expect("an inform");
        let mut hearsay = BroadcastCache::default();
        hearsay.keep(Bytes::from(text.to_owned()), &message, &inform);
        hearsay
    }

    /// Returns the message as Althing's own encoder writes it.
    fn written(value: &Value) -> String {
        let message = acl::decode(value.to_string().as_bytes()).expect("a message");
        String::from_utf8(acl::encode(&message).to_vec()).expect("it is JSON")
    }

    #[test]
    fn a_heartbeat_that_differs_in_id_and_sequence_only_is_a_repetition() {
        let mut hearsay = heard(&written(&beat("lamp.7.9", 9)));
        for number in [10, 11, 12, 1_000] {
            let text = written(&beat(&format!("lamp.7.{number}"), number));
            let again = hearsay.is_again(text.as_bytes()).expect("it says the same");
            assert_eq!(again.sequence, number);
            assert!(again.before < number);
            hearsay.keep_again(text.as_bytes(), &again);
            assert_eq!(hearsay.all().collect::<Vec<_>>(), [text]);
        }
    }

    #[test]
    fn each_sender_has_its_own_broadcasts_until_it_leaves() {
        let text = |id: &str| Bytes::from(written(&beat(id, 9)));
        let keep = |caches: &mut BroadcastCaches, text: &Bytes| {
            let message = acl::decode(text).expect("a message");
            let inform = inform_of(&message).expect("an inform");
            caches.keep(text.clone(), &message, &inform);
        };
        let (mut caches, lamp) =
            (BroadcastCaches::default(), AgentId::new("lamp").expect("a name"));
        let (first, next) = (text("lamp.7.9"), Bytes::from(written(&beat("lamp.7.10", 10))));
        keep(&mut caches, &first);
        assert_eq!(caches.by_sender(), [(lamp.clone(), vec![first])].into());
        let other = AgentId::new("other").expect("a name");
        assert!(caches.repetition(&other, &next).is_none());
        let repetition = caches.repetition(&lamp, &next).expect("it says the same");
        caches.keep_repetition(&lamp, &next, &repetition);
        assert_eq!(caches.all().collect::<Vec<_>>(), [next]);

        let last = Bytes::from(written(&beat("lamp.7.11", 11)));
        let repetition = caches.repetition(&lamp, &last).expect("it says the same");
        caches.forget(&lamp);
        caches.keep_repetition(&lamp, &last, &repetition);
        assert_eq!(caches.all().count(), 0, "it has left");
    }

    #[test]
    fn a_heartbeat_that_differs_elsewhere_is_no_repetition() {
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
    fn an_ambiguous_heartbeat_is_no_repetition() {
        let mut passing = beat("lamp.7.9", 9);
        passing["content"]["known_for"] = json!({ "(warm lamp)": 9 });
        let mut twice = beat("lamp.7.9", 9);
        twice["x-note"] = json!({ "id": "lamp.7.9" });
        for odd in [passing, twice] {
            let text = written(&odd);
            assert!(heard(&text).is_again(text.as_bytes()).is_none(), "{text}");
        }
        assert!(BroadcastCache::default().is_again(b"").is_none());
    }
}
