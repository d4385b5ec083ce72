//! A process that keeps a history is killed at any time: what was written before is whole.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::Duration;

use acl::content::{HISTORY_EVENTS_MAX, HistoryKind, HistoryQuery, HistoryRoot, ReadHistory};
use history::{EventDescription, HistoryLimits, HistoryStore, RecordedEvent};

/// Environment variable with the folder in which the child process writes.
const FOLDER: &str = "HISTORY_CRASH_FOLDER";

const LIMITS: HistoryLimits = HistoryLimits { keep_ms: u64::MAX, bytes_max: 16 << 20 };

fn event(number: u64) -> RecordedEvent {
    RecordedEvent {
        number,
        at_ms: 1_700_000_000_000 + number,
        kind: HistoryKind::Fact,
        subject: format!("(temperature office{})", number % 37).as_str().into(),
        agent: format!("thermometer-{}", number % 37).as_str().into(),
        conversation: "".into(),
        what: EventDescription::Change {
            from: None,
            to: (number % 1_009).to_string().as_str().into(),
        },
        cause: (number.is_multiple_of(3) && number > 3).then(|| number - 3),
        root: HistoryRoot::Sensor,
        worked: true,
        private: false,
    }
}

#[test]
#[ignore = "it is the child process of the test below"]
fn child_that_writes_until_it_is_killed() {
    let folder = std::env::var(FOLDER).expect("the folder is given");
    let (store, opened) = HistoryStore::open(Path::new(&folder), LIMITS).expect("opened");
    let mut next = opened.newest + 1;
    for batch in (1..).map(|count| 1 + count * 7 % 300) {
        let events: Vec<_> = (next..next + batch).map(event).collect();
        store.append(&events, 0, 0).expect("written");
        next += batch;
        println!("WRITTEN {}", next - 1);
    }
}

/// Starts the child, kills it after a while, and returns the number of the last event that it has
/// reported as written.
fn write_until_killed(folder: &Path, after: Duration) -> u64 {
    let mut child = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", "child_that_writes_until_it_is_killed", "--ignored", "--nocapture"])
        .env(FOLDER, folder)
        .stdout(Stdio::piped())
        .spawn()
        .expect("started");
    let mut output = BufReader::new(child.stdout.take().expect("piped"));
    let mut last = next_written(&mut output).expect("the child writes");
    // Not a wait for an event: the process is to be killed at any time.
    std::thread::sleep(after);
    child.kill().expect("killed");
    while let Some(next) = next_written(&mut output) {
        last = next;
    }
    child.wait().expect("ended");
    last
}

/// Returns the next number that the child has reported; `None` if it has ended.
fn next_written(output: &mut impl BufRead) -> Option<u64> {
    output.lines().find_map(|line| {
        let line = line.expect("text");
        line.split("WRITTEN ").nth(1)?.parse().ok()
    })
}

#[test]
fn what_was_written_is_whole_after_a_kill_at_any_time() {
    let folder = tempfile::tempdir().expect("a folder");
    for round in 0..10 {
        let last = write_until_killed(folder.path(), Duration::from_millis(17 * round));
        let (store, opened) = HistoryStore::open(folder.path(), LIMITS).expect("opened");
        assert!(opened.notices.is_empty(), "{:?}", opened.notices);
        assert!(opened.newest >= last, "{last} was written, {} is there", opened.newest);
        let query = HistoryQuery::Events { about: None, kinds: vec![], from_ms: None, to_ms: None };
        let (mut before, mut expected) = (None, opened.newest);
        loop {
            let read = ReadHistory {
                limit: HISTORY_EVENTS_MAX,
                before,
                ..ReadHistory::new(query.clone())
            };
            let page = history::answer(&store, &read).expect("readable");
            for (found, _) in &page.events {
                assert_eq!(*found, event(expected));
                expected -= 1;
            }
            match page.next {
                Some(next) => before = Some(next),
                None => break,
            }
        }
        assert_eq!(expected, 0, "no event is missing");
    }
}
