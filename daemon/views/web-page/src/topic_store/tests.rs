//! Tests of topics: a page that applies the events has the rows of the store, however slowly it
//! reads and however often it connects again.

use std::collections::BTreeMap;

use proptest::collection::vec;
use proptest::prelude::*;
use serde_json::Value;

use super::*;

/// A page: applies events as the pages of `assets` do.
#[derive(Default)]
struct Page {
    rows: BTreeMap<String, Value>,
    order: Vec<String>,
    last_id: Option<String>,
    fulls: usize,
    events: usize,
    largest: usize,
}

impl Page {
    fn apply(&mut self, event: &str) {
        self.events += 1;
        self.largest = self.largest.max(event.len());
        let field = |name: &str| {
            let line = event.lines().find_map(|line| line.strip_prefix(name));
            line.expect("the event has the field").to_owned()
        };
        assert!(event.ends_with("\n\n") && event.lines().count() == 4, "{event}");
        self.last_id = Some(field("id: "));
        let data: Value = serde_json::from_str(&field("data: ")).expect("JSON");
        if data["full"] == true {
            self.rows.clear();
            self.order.clear();
            self.fulls += 1;
        }
        for (key, row) in data["rows"].as_object().expect("rows") {
            self.rows.insert(key.clone(), row.clone());
        }
        for key in data["gone"].as_array().expect("keys") {
            self.rows.remove(key.as_str().expect("a key"));
        }
        if let Some(order) = data["order"].as_array() {
            self.order = order.iter().map(|key| key.as_str().expect("a key").to_owned()).collect();
        }
    }

    /// Reads all events.
    fn read(&mut self, reader: &mut RowReader) {
        while let Some(event) = reader.event(7) {
            self.apply(&event);
        }
    }
}

fn store() -> Arc<TopicStore> {
    Arc::new(TopicStore::new(0xabc))
}

fn rows(of: &[(&str, u64)], is_ordered: bool) -> RowSet {
    let mut rows = RowSet::default();
    rows.is_ordered = is_ordered;
    of.iter().for_each(|(key, value)| rows.push(key, value));
    rows
}

fn subscribe(store: &Arc<TopicStore>, last: Option<&str>) -> RowReader {
    store.subscribe(vec![TopicName::Goals], last).expect("there is room")
}

#[test]
fn only_what_has_changed_is_sent() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    assert_eq!(reader.event(7), None, "nothing is computed yet");
    store.update(&TopicName::Goals, &rows(&[("a", 1), ("b", 2)], true));
    let event = reader.event(7).expect("all rows");
    let data = r#"{"full":true,"rows":{"a":1,"b":2},"gone":[],"order":["a","b"],"now":7}"#;
    assert_eq!(event, format!("event: goals\nid: abc-4\ndata: {data}\n\n"));
    page.apply(&event);
    store.update(&TopicName::Goals, &rows(&[("a", 1), ("b", 2)], true));
    assert_eq!(reader.event(7), None, "nothing has changed");
    store.update(&TopicName::Goals, &rows(&[("b", 3), ("c", 4)], true));
    let event = reader.event(8).expect("what has changed");
    let data = r#"{"full":false,"rows":{"b":3,"c":4},"gone":["a"],"order":["b","c"],"now":8}"#;
    assert!(event.ends_with(&format!("data: {data}\n\n")), "{event}");
    assert_eq!(reader.event(8), None);
}

#[test]
fn a_key_that_occurs_twice_does_not_change_each_time() {
    let store = store();
    let mut reader = subscribe(&store, None);
    let twice = rows(&[("a", 1), ("a", 2)], false);
    store.update(&TopicName::Goals, &twice);
    reader.event(7).expect("all rows");
    assert_eq!(store.update(&TopicName::Goals, &twice), 0);
    assert_eq!(reader.event(7), None);
}

#[test]
fn a_page_that_reads_slowly_gets_the_newest_rows_only() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    for value in 0..1_000 {
        store.update(&TopicName::Goals, &rows(&[("a", value), ("b", 1)], false));
    }
    page.read(&mut reader);
    assert_eq!((page.events, &page.rows["a"]), (1, &Value::from(999)));
}

#[test]
fn a_page_that_connects_again_gets_what_it_has_missed() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    store.update(&TopicName::Goals, &rows(&[("a", 1), ("b", 2)], true));
    page.read(&mut reader);
    drop(reader);
    store.update(&TopicName::Goals, &rows(&[("b", 5)], true));
    let mut reader = subscribe(&store, page.last_id.as_deref());
    let event = reader.event(7).expect("what has changed");
    assert!(event.contains(r#""full":false,"rows":{"b":5},"gone":["a"],"order":["b"]"#), "{event}");
    for id in
        ["abd-3", "abc-", "abc-1.2", "abc-x", "abc", "", "-", "zzz-3", "abc-99999999999999999999"]
    {
        let mut other = subscribe(&store, Some(id));
        let event = other.event(7).expect("all rows");
        assert!(event.contains("\"full\":true"), "{id}: {event}");
    }
}

#[test]
fn what_nobody_has_read_for_a_while_is_computed_before_it_is_sent() {
    let store = store();
    let mut reader = subscribe(&store, None);
    store.update(&TopicName::Goals, &rows(&[("a", 1)], true));
    reader.event(7).expect("all rows");
    assert!(store.fresh_topics().is_empty());
    drop(reader);
    let mut reader = subscribe(&store, None);
    assert_eq!(reader.event(7), None, "it may have changed");
    assert_eq!(store.fresh_topics(), [TopicName::Goals]);
    // Nothing has changed, and the page is told so.
    store.update(&TopicName::Goals, &rows(&[("a", 1)], true));
    assert!(reader.newest.has_changed().expect("the store is there"));
    assert!(reader.event(7).expect("all rows").contains(r#""rows":{"a":1}"#));
    assert!(store.fresh_topics().is_empty());
}

#[test]
fn a_page_that_has_missed_more_than_is_remembered_gets_all_rows() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    store.update(&TopicName::Goals, &rows(&[("old", 1)], false));
    page.read(&mut reader);
    for round in 0..GONE_MAX + 10 {
        store.update(&TopicName::Goals, &rows(&[(&format!("k{round}"), 1)], false));
    }
    page.read(&mut reader);
    assert_eq!((page.fulls, page.rows.len()), (2, 1));
    let table = store.table();
    let topic = &table.topics[&TopicName::Goals];
    assert!(topic.changes.len() <= GONE_MAX + 1, "what is remembered is bounded");
    assert!(topic.gone.len() <= GONE_MAX && topic.gone_order.len() <= GONE_MAX);
}

#[test]
fn a_large_topic_comes_in_parts() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    let long = "x".repeat(300);
    let mut many = rows(&[], true);
    for number in 0..1_000 {
        many.push(&format!("k{number:04}"), &long);
    }
    store.update(&TopicName::Goals, &many);
    page.apply(&reader.event(7).expect("the first part"));
    assert!(page.rows.len() < 1_000 && page.order.is_empty());
    // The connection is lost, and the next one goes on.
    let mut reader = subscribe(&store, page.last_id.as_deref());
    page.read(&mut reader);
    assert_eq!((page.rows.len(), page.order.len(), page.fulls), (1_000, 1_000, 1));
    assert!(page.largest < EVENT_BYTES_MAX + 10_000, "{}", page.largest);
}

#[test]
fn rows_that_add_to_others_leave_them() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    for (first, new) in [("1", "1"), ("1", "2"), ("2", "3")] {
        let mut added = rows(&[(new, 1)], false);
        added.adds_from = Some(first.to_owned());
        store.update(&TopicName::Goals, &added);
        page.read(&mut reader);
    }
    assert_eq!(page.rows.keys().collect::<Vec<_>>(), ["2", "3"]);
    assert_eq!(page.fulls, 1);
}

#[test]
fn a_busy_topic_keeps_no_other_waiting() {
    let store = store();
    let topics = vec![TopicName::Goals, TopicName::Stops];
    let mut reader = store.subscribe(topics, None).expect("there is room");
    let mut names = Vec::new();
    for value in 0..4 {
        store.update(&TopicName::Goals, &rows(&[("a", value)], false));
        store.update(&TopicName::Stops, &rows(&[("b", value)], false));
        names.push(reader.event(7).expect("an event"));
    }
    let of = |name: &str| names.iter().filter(|event| event.starts_with(name)).count();
    assert_eq!((of("event: goals\n"), of("event: stops\n")), (2, 2));
}

#[test]
fn something_unknown_is_an_answer_too() {
    let store = store();
    let mut reader = subscribe(&store, None);
    store.update(&TopicName::Goals, &RowSet::default());
    let event = reader.event(7).expect("the answer that there is nothing");
    assert!(event.contains(r#"{"full":true,"rows":{},"gone":[],"order":null,"now":7}"#), "{event}");
    assert_eq!(reader.event(7), None);
}

#[test]
fn the_number_of_topics_is_bounded() {
    let store = store();
    let goal = |number: usize| TopicName::Goal(acl::ConversationId::new(&format!("g{number}")));
    let readers: Vec<_> =
        (0..THINGS_MAX).map(|number| store.subscribe(vec![goal(number)], None)).collect();
    assert!(readers.iter().all(Result::is_ok));
    assert!(store.subscribe(vec![goal(THINGS_MAX)], None).is_err());
    assert!(store.subscribe(vec![goal(0)], None).is_ok(), "this one is there already");
    let lists = vec![TopicName::Overview, TopicName::Goals];
    assert!(store.subscribe(lists, None).is_ok(), "lists have a place always");
    drop(readers);
    assert!(store.subscribe(vec![goal(THINGS_MAX)], None).is_ok());
}

#[test]
fn a_topic_that_was_dropped_meanwhile_is_sent_in_full() {
    let store = store();
    let (mut reader, mut page) = (subscribe(&store, None), Page::default());
    store.update(&TopicName::Goals, &rows(&[("a", 1)], false));
    page.apply(&reader.event(7).expect("a row"));
    drop(reader);
    store.table().topics.clear();
    let mut again = subscribe(&store, page.last_id.as_deref());
    store.update(&TopicName::Goals, &RowSet::default());
    page.apply(&again.event(8).expect("that there is none any more"));
    assert!(page.rows.is_empty(), "{:?}", page.rows);
}

#[derive(Clone, Debug)]
enum Deed {
    Update(Vec<(u8, u8)>),
    Read,
    ReadAll,
    Reconnect,
}

fn deed() -> impl Strategy<Value = Deed> {
    prop_oneof![
        3 => vec((0..12_u8, 0..3_u8), 0..10).prop_map(Deed::Update),
        2 => Just(Deed::Read),
        1 => Just(Deed::ReadAll),
        1 => Just(Deed::Reconnect),
    ]
}

proptest! {
    /// Whatever happens in between, a page that reads everything has the rows of the store, in its
    /// order.
    #[test]
    fn a_page_has_what_the_store_has(deeds in vec(deed(), 1..60)) {
        let store = store();
        let (mut reader, mut page) = (subscribe(&store, None), Page::default());
        let mut truth: Vec<(String, Value)> = Vec::new();
        for deed in deeds {
            match deed {
                Deed::Update(pairs) => {
                    let mut set = rows(&[], true);
                    truth.clear();
                    for (key, value) in pairs {
                        let key = format!("k{key}");
                        // Some rows are long, so that there are parts.
                        let row = Value::from("y".repeat(usize::from(value) * 9_000));
                        if truth.iter().all(|(known, _)| *known != key) {
                            set.push(&key, &row);
                            truth.push((key, row));
                        }
                    }
                    store.update(&TopicName::Goals, &set);
                }
                Deed::Read => reader.event(7).iter().for_each(|event| page.apply(event)),
                Deed::ReadAll => page.read(&mut reader),
                Deed::Reconnect => reader = subscribe(&store, page.last_id.as_deref()),
            }
        }
        page.read(&mut reader);
        let order: Vec<_> = truth.iter().map(|(key, _)| key.clone()).collect();
        prop_assert_eq!(&page.order, &order);
        prop_assert_eq!(page.rows.into_iter().collect::<Vec<_>>(), {
            truth.sort_by(|one, other| one.0.cmp(&other.0));
            truth
        });
    }
}
