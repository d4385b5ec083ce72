//! Batches: the heartbeats of several agents of one daemon in one message, each as one line of
//! JSON.
//!
//! Each message must be routed by every router, takes a place in every queue and, in a secured
//! ecosystem, needs a signature at one end and its verification at the other. If a hundred
//! heartbeats are sent in one message, this cost is incurred once.

use acl::{AgentId, sender_of};
use bytes::Bytes;
use memchr::memchr_iter;

/// Maximum length of a batch of heartbeats, in bytes; the heartbeats that do not fit go into
/// further batches. Together with its key and its seal, a batch fits into one batch of Zenoh's
/// (65,535 bytes), so that it is not fragmented.
const BUNDLE_BYTES_MAX: usize = 60 << 10;

/// Maximum number of heartbeats in a batch: four times as many as fit if they have any content. A
/// received batch with more is ignored: a batch of bare names could otherwise contain thousands of
/// messages.
const BUNDLE_MESSAGES_MAX: usize = 1_024;

/// A message that carries one or several heartbeats.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum HeartbeatMessage {
    /// Heartbeat of one agent, under the agent's key.
    Single(AgentId, Bytes),
    /// Heartbeats of several agents, under their daemon's key.
    Batch(Bytes),
}

/// Packs heartbeats into as few messages as possible, and keeps their order.
pub(crate) fn pack(beats: Vec<(AgentId, Bytes)>) -> Vec<HeartbeatMessage> {
    let mut parcels = Vec::new();
    let mut gathered = Vec::new();
    let mut bytes = 0;
    for (sender, payload) in beats {
        let is_line = !payload.is_empty() && !payload.contains(&b'\n');
        if !is_line || payload.len() >= BUNDLE_BYTES_MAX {
            // A payload with a line break, or an empty one, could not be separated from the next.
            parcels.push(HeartbeatMessage::Single(sender, payload));
            continue;
        }
        if bytes + payload.len() + 1 > BUNDLE_BYTES_MAX || gathered.len() >= BUNDLE_MESSAGES_MAX {
            parcels.extend(closed(&mut gathered));
            bytes = 0;
        }
        bytes += payload.len() + 1;
        gathered.push((sender, payload));
    }
    parcels.extend(closed(&mut gathered));
    parcels
}

fn closed(gathered: &mut Vec<(AgentId, Bytes)>) -> Option<HeartbeatMessage> {
    if gathered.len() == 1 {
        return gathered.pop().map(|(sender, payload)| HeartbeatMessage::Single(sender, payload));
    }
    let lines: Vec<Bytes> = gathered.drain(..).map(|(_, payload)| payload).collect();
    (!lines.is_empty()).then(|| HeartbeatMessage::Batch(Bytes::from(lines.join(&b'\n'))))
}

/// Returns the heartbeats in a batch, each with the sender that it names. Lines that name no sender
/// are left out, because the batch comes from outside. The heartbeats share the memory of the batch.
/// Returns `None` if the batch is larger than [`pack`] makes batches.
pub(crate) fn unpack(bundle: &Bytes) -> Option<Vec<(AgentId, Bytes)>> {
    if bundle.len() > BUNDLE_BYTES_MAX {
        return None;
    }
    let (mut words, mut count, mut start) = (Vec::new(), 0, 0);
    let ends = memchr_iter(b'\n', bundle).chain([bundle.len()]);
    for end in ends {
        let line = start..end;
        start = end + 1;
        if line.is_empty() {
            continue;
        }
        count += 1;
        if count > BUNDLE_MESSAGES_MAX {
            return None;
        }
        if let Some(sender) = sender_of(&bundle[line.clone()]) {
            words.push((sender, bundle.slice(line)));
        }
    }
    Some(words)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beat(sender: &str, length: usize) -> (AgentId, Bytes) {
        let text = format!(r#"{{"sender":"{sender}","x":"{}"}}"#, "x".repeat(length));
        (AgentId::new(sender).expect("a name"), Bytes::from(text))
    }

    /// Returns the heartbeats after packing and unpacking them, and the number of messages that
    /// carried them.
    fn carried(beats: Vec<(AgentId, Bytes)>) -> (Vec<(AgentId, Bytes)>, usize) {
        let parcels = pack(beats);
        let count = parcels.len();
        let heard = parcels.into_iter().flat_map(|parcel| match parcel {
            HeartbeatMessage::Single(sender, payload) => vec![(sender, payload)],
            HeartbeatMessage::Batch(bundle) => {
                assert!(bundle.len() <= BUNDLE_BYTES_MAX);
                unpack(&bundle).expect("it was packed here")
            }
        });
        (heard.collect(), count)
    }

    #[test]
    fn a_batch_is_unpacked_to_the_packed_heartbeats() {
        let hundred: Vec<_> = (0..100).map(|agent| beat(&format!("a-{agent}"), 400)).collect();
        assert_eq!(carried(hundred.clone()), (hundred, 1));
        let long: Vec<_> = (0..10).map(|agent| beat(&format!("a-{agent}"), 20 << 10)).collect();
        assert_eq!(carried(long.clone()), (long, 5));
        assert_eq!(carried(Vec::new()), (Vec::new(), 0));
    }

    #[test]
    fn a_single_heartbeat_is_sent_under_its_own_key() {
        let (sender, payload) = beat("a", 1);
        let parcels = pack(vec![(sender.clone(), payload.clone())]);
        assert_eq!(parcels, [HeartbeatMessage::Single(sender, payload)]);
    }

    #[test]
    fn a_payload_that_is_no_line_is_sent_alone() {
        let odd = |text: &str| (AgentId::new("odd").expect("a name"), Bytes::from(text.to_owned()));
        let beats = vec![beat("a", 1), odd("(define\n)"), odd(""), beat("b", 1)];
        let (mut heard, count) = carried(beats.clone());
        let mut said = beats;
        heard.sort();
        said.sort();
        assert_eq!((heard, count), (said, 3));
    }

    #[test]
    fn garbage_contains_no_heartbeats() {
        for garbage in ["", "\n\n", "x", "{}", r#"{"sender":"A/b"}"#, "\u{0}"] {
            assert_eq!(unpack(&Bytes::from(garbage.to_owned())), Some(vec![]), "{garbage:?}");
        }
        let mixed = Bytes::from("x\n{\"sender\":\"a\"}\n\n{");
        assert_eq!(unpack(&mixed).map(|words| words.len()), Some(1));
    }

    #[test]
    fn a_batch_beyond_the_limits_is_not_unpacked() {
        let bare: Vec<_> = (0..2_000).map(|agent| beat(&format!("a-{agent}"), 0)).collect();
        assert_eq!(carried(bare.clone()), (bare.clone(), 2));
        let lines: Vec<_> = bare.into_iter().map(|(_, payload)| payload).collect();
        assert_eq!(unpack(&Bytes::from(lines.join(&b'\n'))), None, "too many");
        let (_, long) = beat("a", BUNDLE_BYTES_MAX);
        assert_eq!(unpack(&long), None, "too long");
    }
}
