//! Tests of the store: what was written is read, also after a restart, damage, and deletion.

use std::fs;
use std::ops::ControlFlow;

use super::part::Part;
use super::*;
use crate::event::{RecordedEvent, test_event};
use crate::samples::random_events;

const LIMITS: HistoryLimits = HistoryLimits { keep_ms: u64::MAX, bytes_max: 64 << 20 };

fn all(store: &HistoryStore, filter: &ScanFilter) -> Vec<RecordedEvent> {
    let mut events = Vec::new();
    let read = store.read(|reader| {
        reader.scan(filter, usize::MAX, |event| {
            events.push(event.clone());
            ControlFlow::Continue(())
        })
    });
    assert!(!read.expect("readable").is_exhausted);
    events
}

fn oldest_first() -> ScanFilter {
    ScanFilter { is_newest_first: false, ..ScanFilter::default() }
}

#[test]
fn what_was_written_is_there_after_each_reopening() {
    let folder = tempfile::tempdir().expect("a folder");
    let events = random_events(5, 10_000);
    let mut written = 0;
    let mut random = fastrand::Rng::with_seed(5);
    while written < events.len() {
        let (store, opened) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
        assert!(opened.notices.is_empty());
        for _ in 0..random.usize(1..6) {
            let next = (written + random.usize(1..700)).min(events.len());
            // The last events are given again, as after a failure.
            let from = written.saturating_sub(3);
            store.append(&events[from..next], 0, 0).expect("written");
            written = next;
        }
        assert_eq!(all(&store, &oldest_first()), events[..written]);
    }
    let (store, opened) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    assert_eq!(opened.newest, events[events.len() - 1].number);
    let mut reversed = all(&store, &ScanFilter::default());
    reversed.reverse();
    assert_eq!(reversed, events);
    let found = store.read(|reader| reader.event(events[77].number)).expect("readable");
    assert_eq!(found.as_ref(), Some(&events[77]));
    assert!(matches!(
        HistoryStore::open(folder.path(), LIMITS),
        Err(HistoryStoreError::InUse { .. })
    ));
}

#[test]
fn the_number_of_lost_messages_survives() {
    let folder = tempfile::tempdir().expect("a folder");
    let (store, _) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    store.append(&[test_event(1)], 7, 0).expect("written");
    store.append(&[], 9, 0).expect("written");
    drop(store);
    let (_, opened) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    assert_eq!(opened.lost, 9);
}

#[test]
fn the_files_stay_within_their_size_and_the_oldest_events_go_first() {
    let folder = tempfile::tempdir().expect("a folder");
    let limits = HistoryLimits { bytes_max: 16 << 20, ..LIMITS };
    let (store, _) = HistoryStore::open(folder.path(), limits).expect("opened");
    let mut random = fastrand::Rng::with_seed(1);
    let (mut number, mut peak) = (0, 0);
    for _ in 0..170 {
        let mut noisy = || {
            number += 1;
            let text: String = std::iter::repeat_with(|| random.alphanumeric()).take(150).collect();
            let what = crate::event::EventDescription::Sentence(text.into());
            RecordedEvent { what, ..test_event(number) }
        };
        let events: Vec<_> = (0..1_000).map(|_| noisy()).collect();
        store.append(&events, 0, 0).expect("written");
        peak = peak.max(store.file_bytes());
    }
    let on_disk: u64 = fs::read_dir(folder.path())
        .expect("a folder")
        .map(|file| file.expect("a file").metadata().expect("a file").len())
        .sum();
    assert_eq!(on_disk, store.file_bytes());
    assert!(peak <= limits.bytes_max, "{peak} bytes");
    let kept = all(&store, &oldest_first());
    assert!(kept.len() > 50_000, "{} of {number} events are kept", kept.len());
    assert_eq!(kept.last().map(|event| event.number), Some(number));
    let first = kept[0].number;
    assert!(kept.iter().map(|event| event.number).eq(first..=number), "no hole");
}

#[test]
fn old_segments_are_deleted() {
    let folder = tempfile::tempdir().expect("a folder");
    let limits = HistoryLimits { keep_ms: 10_000, ..LIMITS };
    let (store, _) = HistoryStore::open(folder.path(), limits).expect("opened");
    let events: Vec<_> = (1..=20_000).map(test_event).collect();
    store.append(&events, 0, 0).expect("written");
    assert_eq!(all(&store, &oldest_first()).len(), 20_000);
    store.append(&[], 0, 1_020_000).expect("written");
    let first = all(&store, &oldest_first())[0].number;
    assert!((10_000 - SEGMENT_EVENTS..=10_000).contains(&first), "{first}");
}

#[test]
fn a_damaged_file_is_moved_aside_and_the_others_stay() {
    let folder = tempfile::tempdir().expect("a folder");
    let limits = HistoryLimits { bytes_max: 16 << 20, ..LIMITS };
    let events = random_events(9, 60_000);
    let (store, _) = HistoryStore::open(folder.path(), limits).expect("opened");
    for batch in events.chunks(5_000) {
        store.append(batch, 0, 0).expect("written");
    }
    drop(store);
    let paths = Part::paths(folder.path()).expect("readable");
    assert!(paths.len() > 1, "{paths:?}");
    let newest = paths.last().expect("a file");
    let whole = fs::read(newest).expect("readable");
    for broken in [vec![7; 100_000], whole[..whole.len() / 2].to_vec(), whole[..100].to_vec()] {
        let newest = Part::paths(folder.path()).expect("readable").pop().expect("a file");
        fs::write(&newest, &broken).expect("written");
        let (store, opened) = HistoryStore::open(folder.path(), limits).expect("opened");
        assert!(opened.notices[0].contains("was broken and is now"), "{:?}", opened.notices);
        assert!(opened.newest > events[events.len() - 1].number, "no number is used twice");
        let left = all(&store, &oldest_first());
        assert!(!left.is_empty() && left[..] == events[..left.len()]);
        let next = RecordedEvent { number: opened.newest + 1, ..test_event(1) };
        store.append(std::slice::from_ref(&next), 0, 0).expect("written");
        assert_eq!(all(&store, &ScanFilter::default())[0], next);
    }
}

#[test]
fn a_newer_format_is_refused_and_left_unchanged() {
    let folder = tempfile::tempdir().expect("a folder");
    let (store, _) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
    store.append(&[test_event(1)], 0, 0).expect("written");
    drop(store);
    let path = Part::path_of(folder.path(), 0);
    Part::open(&path).ok().expect("a part").write_format(FORMAT + 1);
    let before = fs::read(&path).expect("readable").len();
    let refused = HistoryStore::open(folder.path(), LIMITS).map(drop).expect_err("newer");
    assert!(refused.to_string().contains("a newer Althing wrote it (format 2"), "{refused}");
    assert!(!refused.is_transient());
    assert_eq!(fs::read(&path).expect("readable").len(), before);

    let folder = tempfile::tempdir().expect("a folder");
    drop(HistoryStore::open(folder.path(), LIMITS).expect("opened"));
    let path = Part::path_of(folder.path(), 0);
    let mut bytes = fs::read(&path).expect("readable");
    // Each of the two commit slots begins with its version.
    for slot in [64, 64 + 128] {
        bytes[slot] = 9;
    }
    fs::write(&path, &bytes).expect("written");
    let refused = HistoryStore::open(folder.path(), LIMITS).map(drop).expect_err("newer");
    assert!(matches!(refused, HistoryStoreError::Foreign { .. }), "{refused}");
    assert_eq!(fs::read(&path).expect("readable"), bytes);
}
