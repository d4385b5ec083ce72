//! Tests of queries: every query agrees with a model that keeps the events in a list.

use std::collections::BTreeSet;

use proptest::prelude::*;

use super::*;
use crate::samples::random_events;
use crate::store::HistoryLimits;

const LIMITS: HistoryLimits = HistoryLimits { keep_ms: u64::MAX, bytes_max: 64 << 20 };

fn stored(events: &[RecordedEvent], batch: usize) -> (tempfile::TempDir, HistoryStore) {
    let folder = tempfile::tempdir().expect("a folder");
    let (store, _) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    for batch in events.chunks(batch) {
        store.append(batch, 0, 0).expect("written");
    }
    (folder, store)
}

/// Returns the numbers of the events on all pages.
fn pages(store: &HistoryStore, query: &HistoryQuery, limit: u32) -> Vec<u64> {
    let (mut numbers, mut before) = (Vec::new(), None);
    loop {
        let read = ReadHistory { limit, before, ..ReadHistory::new(query.clone()) };
        let page = answer(store, &read).expect("readable");
        assert!(page.events.len() <= limit as usize);
        numbers.extend(page.events.iter().map(|(event, _)| event.number));
        match page.next {
            Some(next) => before = Some(next),
            None => return numbers,
        }
    }
}

fn newest_first<'a>(events: impl Iterator<Item = &'a RecordedEvent>) -> Vec<u64> {
    let mut numbers: Vec<_> = events.map(|event| event.number).collect();
    numbers.reverse();
    numbers
}

fn effects_in_model(events: &[RecordedEvent], start: u64) -> Vec<u64> {
    let mut found = BTreeSet::from([start]);
    for event in events {
        if event.cause.is_some_and(|cause| found.contains(&cause)) {
            found.insert(event.number);
        }
    }
    found.into_iter().collect()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 24, ..ProptestConfig::default() })]

    #[test]
    fn all_queries_agree_with_a_list(
        seed in any::<u64>(),
        count in 1_u64..9_000,
        batch in 1_usize..3_000,
        limit in 1_u32..200,
        about in prop::sample::select(vec![
            "office1", "sensor-3", "(temperature hall)", "käfig", "cli-1.2", "move", "nothing",
            "SENSOR-1 office2",
        ]),
        times in (0_u64..12_000_000, 0_u64..12_000_000),
    ) {
        let events = random_events(seed, count);
        let (_folder, store) = stored(&events, batch);
        let (from_ms, to_ms) =
            (1_700_000_000_000 + times.0.min(times.1), 1_700_000_000_000 + times.0.max(times.1));
        for kinds in [vec![], vec![HistoryKind::Fact], vec![HistoryKind::Step, HistoryKind::Bid]] {
            let in_model = newest_first(events.iter().filter(|event| {
                is_about(event, about)
                    && (kinds.is_empty() || kinds.contains(&event.kind))
                    && (from_ms..=to_ms).contains(&event.at_ms)
            }));
            let (from_ms, to_ms) = (Some(from_ms), Some(to_ms));
            let query =
                HistoryQuery::Events { about: Some(about.to_owned()), kinds, from_ms, to_ms };
            prop_assert_eq!(pages(&store, &query, limit), in_model);
        }
        let worked = events.iter().filter(|event| event.worked && is_about(event, about));
        let query = HistoryQuery::Last { about: about.to_owned() };
        prop_assert_eq!(pages(&store, &query, limit), newest_first(worked));
        let fact = "(temperature office1)".to_owned();
        let values = newest_first(events.iter().filter(|event| *event.subject == *fact));
        let query = HistoryQuery::Values { fact, from_ms: None, to_ms: None };
        prop_assert_eq!(pages(&store, &query, limit), values);
        let some = &events[(seed % count) as usize];
        let subject = format!("#{}", some.number);
        let mut chain = vec![some];
        while let Some(cause) = chain[chain.len() - 1].cause {
            let Some(event) = events.iter().find(|event| event.number == cause) else { break };
            chain.push(event);
        }
        let chain: Vec<_> = chain.iter().map(|event| event.number).collect();
        let query = HistoryQuery::Why { subject: subject.clone() };
        prop_assert_eq!(pages(&store, &query, limit), chain);
        let effects = pages(&store, &HistoryQuery::Effects { subject }, 1_000);
        let mut in_model = effects_in_model(&events, some.number);
        in_model.truncate(effects.len());
        prop_assert!(effects.len() >= in_model.len().min(1_000));
        prop_assert_eq!(effects, in_model);
    }
}

#[test]
fn a_subject_is_found_by_its_text_or_its_words() {
    let events = random_events(2, 3_000);
    let (_folder, store) = stored(&events, 1_000);
    let first = |subject: &str| {
        let read = ReadHistory::new(HistoryQuery::Why { subject: subject.to_owned() });
        answer(&store, &read).expect("readable").events.into_iter().next().map(|(event, _)| event)
    };
    for fact in ["(temperature office1)", "temperature office1", "(= (temperature office1) 21)"] {
        let newest = events.iter().rev().find(|event| *event.subject == *"(temperature office1)");
        assert_eq!(first(fact).as_ref(), newest, "{fact}");
    }
    let agent = first("sensor-2").expect("it is known");
    assert_eq!(&*agent.agent, "sensor-2");
    assert_ne!(agent.kind, HistoryKind::Fact);
    assert_eq!(first(""), None);
    assert_eq!(first("#x"), None);
    assert_eq!(first("#999999999"), None);
}

#[test]
fn similar_words_are_named_if_there_is_nothing() {
    let (_folder, store) = stored(&random_events(2, 500), 100);
    let subject = "(temperatur ofice1)".to_owned();
    let read = ReadHistory::new(HistoryQuery::Why { subject });
    let page = answer(&store, &read).expect("readable");
    assert!(page.events.is_empty());
    assert_eq!(page.near, ["temperature", "office1"]);
}

#[test]
fn a_page_of_long_texts_is_bounded() {
    let mut events = random_events(4, 2_000);
    for event in &mut events {
        event.what = crate::event::EventDescription::Sentence("\"".repeat(500).into());
    }
    let (_folder, store) = stored(&events, 1_000);
    let query = HistoryQuery::Events { about: None, kinds: vec![], from_ms: None, to_ms: None };
    let read = ReadHistory { limit: HISTORY_EVENTS_MAX, ..ReadHistory::new(query) };
    let page = answer(&store, &read).expect("readable");
    let sent: Vec<_> = page.events.iter().map(|(event, kept)| event.to_message(*kept)).collect();
    let bytes = serde_json::to_vec(&sent).expect("plain data").len();
    assert!(bytes <= HISTORY_PAGE_BYTES_MAX && sent.len() > 100, "{bytes} bytes");
    assert!(page.next.is_some());
}

#[test]
fn what_last_worked_is_the_fact_itself_rather_than_a_goal_about_it() {
    let event = |number: u64, kind: HistoryKind, subject: &str| RecordedEvent {
        kind,
        subject: subject.into(),
        ..crate::event::test_event(number)
    };
    let events = [
        event(1, HistoryKind::Fact, "(lit hall)"),
        event(2, HistoryKind::Fact, "(lit hall)"),
        event(3, HistoryKind::Goal, "(and (lit hall) (lit lab))"),
    ];
    let (_folder, store) = stored(&events, 3);
    let last = |about: &str| pages(&store, &HistoryQuery::Last { about: about.to_owned() }, 1);
    assert_eq!(last("(lit hall)"), [2, 1]);
    assert_eq!(last("(lit lab)"), [3]);
    assert_eq!(last("hall"), [3, 2, 1]);
}
