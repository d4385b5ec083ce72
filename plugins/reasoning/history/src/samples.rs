//! Events for tests.

use acl::content::{HistoryKind, HistoryRoot};

use crate::event::{EventDescription, RecordedEvent};

/// Returns events that follow from a seed, for tests.
pub(crate) fn random_events(seed: u64, count: u64) -> Vec<RecordedEvent> {
    let mut random = fastrand::Rng::with_seed(seed);
    let (mut number, mut at_ms) = (random.u64(..200), 1_700_000_000_000_u64);
    let places = ["office1", "office2", "hall", "käfig"];
    let mut next = || {
        number += if random.u8(..20) == 0 { random.u64(1..90) } else { 1 };
        // Clocks are set back now and then.
        at_ms = at_ms + random.u64(..2_000) - random.u64(..300);
        let place = places[random.usize(..places.len())];
        let agent = format!("sensor-{}", random.u8(..9));
        let kind = HistoryKind::ALL[random.usize(..HistoryKind::ALL.len())];
        let is_fact = kind == HistoryKind::Fact;
        let value = f64::from(random.u8(..80)) / 2.0;
        let from = random.bool().then(|| (value + 0.5).to_string().into());
        RecordedEvent {
            number,
            at_ms,
            kind,
            subject: match is_fact {
                true => format!("(temperature {place})"),
                false => format!("(move {agent} {place} corridor)"),
            }
            .into(),
            agent: agent.as_str().into(),
            conversation: format!("cli-1.{}", random.u8(..4)).into(),
            what: match is_fact {
                true => EventDescription::Change { from, to: value.to_string().into() },
                false => EventDescription::Sentence(format!("{agent} says {value}").into()),
            },
            cause: random
                .bool()
                .then(|| number.saturating_sub(random.u64(1..70)))
                .filter(|n| *n > 0),
            root: [HistoryRoot::Person, HistoryRoot::Sensor, HistoryRoot::Death][random.usize(..3)],
            worked: random.bool(),
            private: random.u8(..9) == 0,
        }
    };
    (0..count).map(|_| next()).collect()
}
