//! The log of requests: it is kept, bounded, for its user alone, and says what is lost.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::Duration;

use super::{HOME, name, start};
use crate::{LoggedRequest, RequestLog};

fn request(number: u64, what: &str) -> LoggedRequest {
    LoggedRequest {
        at: start() + Duration::from_millis(number),
        person: number.is_multiple_of(2).then(|| name("anna")),
        from: HOME,
        through: "hall-pi".to_owned(),
        what: what.to_owned(),
        outcome: "done".to_owned(),
    }
}

fn newest(folder: &Path) -> String {
    fs::read_to_string(folder.join("requests.jsonl")).expect("a file")
}

#[test]
fn requests_outlive_the_daemon() {
    let folder = tempfile::tempdir().expect("a folder");
    let all: Vec<_> = (0..10).map(|number| request(number, "goal (lit office1)")).collect();
    {
        let log = RequestLog::open(folder.path()).expect("a log");
        all.iter().cloned().for_each(|request| log.record(request));
        assert_eq!(log.recent(3), all[7..]);
        assert_eq!(log.recent(usize::MAX), all);
    }
    assert_eq!(RequestLog::read(folder.path()).expect("a log"), all);
    let log = RequestLog::open(folder.path()).expect("a log");
    assert_eq!(log.recent(100), all);
    let mode = fs::metadata(folder.path().join("requests.jsonl")).expect("a file");
    assert_eq!(mode.permissions().mode() & 0o777, 0o600);
}

#[test]
fn a_line_obeys_no_terminal_and_is_one_line() {
    let folder = tempfile::tempdir().expect("a folder");
    let what = "a\u{1b}[31m\nb\u{9b}c\u{202e}d\u{e0041}";
    RequestLog::open(folder.path()).expect("a log").record(request(0, what));
    let text = newest(folder.path());
    assert_eq!(text.lines().count(), 1);
    let line = text.trim_end_matches('\n');
    let hidden = ['\u{1b}', '\u{9b}', '\u{202e}', '\u{e0041}'];
    assert!(!line.chars().any(|c| c.is_control() || hidden.contains(&c)), "{line:?}");
    assert_eq!(RequestLog::read(folder.path()).expect("a log")[0].what, what);
}

#[test]
fn the_log_is_bounded_and_the_newest_requests_stay() {
    let folder = tempfile::tempdir().expect("a folder");
    let long = "é".repeat(5_000);
    for batch in 0..12_u64 {
        // The end of a log waits for its lines, so none is lost here.
        let log = RequestLog::open(folder.path()).expect("a log");
        for number in 0..500 {
            log.record(request(batch * 500 + number, &long));
        }
    }
    let bytes: u64 = fs::read_dir(folder.path())
        .expect("a folder")
        .map(|entry| entry.expect("a file").metadata().expect("a file").len())
        .sum();
    assert!(bytes <= 2 * (4 << 20), "{bytes}");
    let kept = RequestLog::read(folder.path()).expect("a log");
    assert!(kept.len() > 1_500 && kept.len() < 6_000, "{}", kept.len());
    assert_eq!(kept.last().map(|request| request.at), Some(start() + Duration::from_millis(5_999)));
    assert!(kept.iter().all(|request| request.what.len() <= 2_003), "long texts are cut");
    assert!(kept.is_sorted_by_key(|request| request.at));
}

#[test]
fn a_line_that_a_crash_has_cut_costs_no_other() {
    let folder = tempfile::tempdir().expect("a folder");
    RequestLog::open(folder.path()).expect("a log").record(request(0, "one"));
    let text = newest(folder.path());
    let torn = format!("{text}{}", &text[..text.len() / 2]);
    fs::write(folder.path().join("requests.jsonl"), torn).expect("ours");
    RequestLog::open(folder.path()).expect("a log").record(request(1, "two"));
    let read = RequestLog::read(folder.path()).expect("a log");
    let whats: Vec<_> = read.iter().map(|request| request.what.as_str()).collect();
    assert_eq!(whats, ["one", "two"]);
}

/// A folder in the place of the file is a disk that takes no line, also for a superuser.
#[test]
fn a_disk_that_takes_nothing_delays_no_request_and_the_loss_is_written() {
    let folder = tempfile::tempdir().expect("a folder");
    let log = RequestLog::open(folder.path()).expect("a log");
    let path = folder.path().join("requests.jsonl");
    fs::create_dir(&path).expect("a folder");
    for number in 0..2_000 {
        log.record(request(number, "x"));
    }
    assert_eq!(log.recent(usize::MAX).len(), 1_000, "pages show them all the same");
    drop(log);
    fs::remove_dir(&path).expect("ours");
    let log = RequestLog::open(folder.path()).expect("a log");
    assert!(log.recent(1).is_empty());
    fs::create_dir(&path).expect("a folder");
    log.record(request(1, "lost"));
    // The writer fails at some time before the disk is there again, or writes both; each is right.
    let _ = fs::remove_dir(&path);
    log.record(request(2, "kept"));
    drop(log);
    let read = RequestLog::read(folder.path()).expect("a log");
    assert_eq!(read.last().map(|request| request.what.as_str()), Some("kept"));
    let lost = newest(folder.path()).lines().any(|line| line == "{\"lost\":1}");
    assert!(lost || read.len() == 2, "{read:?}");
}
