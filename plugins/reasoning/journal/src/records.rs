//! All records of a Journal in memory: the newest version of each, by key. This module does no I/O.

use std::collections::BTreeMap;

use acl::content::Record;

/// Maximum number of records. At the maximum, the oldest markers of deleted records are dropped to
/// make room. A goal has two records, and a building has at most some hundreds of goals.
const RECORDS_MAX: usize = 4_096;

/// Maximum length of a record's key in bytes, and maximum length of a record's body as JSON in
/// bytes; a record that exceeds one of them is refused. The composite domain of a large building is
/// below 1 MiB.
const KEY_BYTES_MAX: usize = 512;
const BODY_BYTES_MAX: usize = 4 << 20;

/// All records of a Journal: the newest version of each, by key.
#[derive(Debug, Default)]
pub(crate) struct Records(BTreeMap<String, Record>);

/// Records of another Journal, split into those that this Journal can keep and the others.
#[derive(Debug, Default)]
pub(crate) struct SplitRecords {
    pub(crate) kept: Vec<Record>,
    /// Reasons why records can never be kept here.
    pub(crate) malformed: Vec<String>,
    /// Number of records for which there is no room now.
    pub(crate) without_room: usize,
}

// === impl Records ===

impl Records {
    /// Whether a record is newer than the stored version of its key.
    pub(crate) fn is_newer(&self, record: &Record) -> bool {
        self.0.get(&record.key).is_none_or(|kept| kept.version < record.version)
    }

    /// Stores a record, if it is newer than the stored version of its key.
    pub(crate) fn insert_if_newer(&mut self, record: Record) {
        if self.is_newer(&record) {
            self.0.insert(record.key.clone(), record);
        }
    }

    pub(crate) fn remove_key(&mut self, key: &str) {
        self.0.remove(key);
    }

    /// Returns the reason why the Journal must refuse these records; `None` if it accepts them.
    pub(crate) fn rejection_reason(&self, records: &[Record]) -> Option<String> {
        if let Some(reason) = records.iter().find_map(malformation) {
            return Some(reason);
        }
        let new = records.iter().filter(|record| self.is_new(record)).count();
        (new > self.room()).then(|| format!("{RECORDS_MAX} records are kept already"))
    }

    /// Splits records of another Journal into those that this Journal can keep, and the others.
    pub(crate) fn split(&self, records: Vec<Record>) -> SplitRecords {
        let mut split = SplitRecords::default();
        let mut room = self.room();
        for record in records {
            let is_new = self.is_new(&record);
            if let Some(reason) = malformation(&record) {
                split.malformed.push(reason);
            } else if is_new && room == 0 {
                split.without_room += 1;
            } else {
                room -= usize::from(is_new);
                split.kept.push(record);
            }
        }
        split
    }

    fn is_new(&self, record: &Record) -> bool {
        !self.0.contains_key(&record.key)
    }

    /// Returns the number of records for which there is room under new keys.
    fn room(&self) -> usize {
        RECORDS_MAX.saturating_sub(self.0.len() - self.deletion_markers().count())
    }

    /// Returns the keys that must be dropped to make room for `more` records: those of the oldest
    /// markers of deleted records.
    pub(crate) fn keys_to_evict(&self, more: usize) -> Vec<String> {
        let surplus = (self.0.len() + more).saturating_sub(RECORDS_MAX);
        let mut forgotten: Vec<_> = self.deletion_markers().collect();
        forgotten.sort_by_key(|record| record.version);
        forgotten.into_iter().take(surplus).map(|record| record.key.clone()).collect()
    }

    fn deletion_markers(&self) -> impl Iterator<Item = &Record> {
        self.0.values().filter(|record| record.body.is_null())
    }

    /// Returns all records as a JSON array; `None` if they cannot be serialized.
    pub(crate) fn to_json(&self) -> Option<String> {
        serde_json::to_string(&self.0.values().collect::<Vec<_>>()).ok()
    }
}

/// Returns the reason why no Journal keeps this record; `None` if it is well-formed.
fn malformation(record: &Record) -> Option<String> {
    let len = record.key.len();
    if len == 0 || len > KEY_BYTES_MAX {
        return Some(format!("a key has 1 to {KEY_BYTES_MAX} bytes, this one {len}"));
    }
    let is_long = serde_json::to_vec(&record.body).is_ok_and(|body| body.len() > BODY_BYTES_MAX);
    is_long.then(|| format!("`{}` has more than {BODY_BYTES_MAX} bytes", record.key))
}

#[cfg(test)]
mod tests {
    use acl::content::Version;
    use serde_json::{Value, json};

    use super::*;

    fn record(key: &str, count: u64, body: Value) -> Record {
        Record { key: key.to_owned(), version: Version { term: 1, count }, body }
    }

    #[test]
    fn the_newest_version_is_kept_in_any_order() {
        let mut records = Records::default();
        for count in [2, 1, 3, 2] {
            records.insert_if_newer(record("goal/a", count, json!(count)));
        }
        assert_eq!(records.0["goal/a"].body, json!(3));
        let later_term =
            Record { version: Version { term: 2, count: 0 }, ..record("goal/a", 0, json!(0)) };
        assert!(records.is_newer(&later_term));
    }

    #[test]
    fn deletion_markers_are_dropped_to_make_room() {
        let mut records = Records::default();
        for number in 0..RECORDS_MAX {
            let body = if number < 10 { Value::Null } else { json!(number) };
            records.insert_if_newer(record(&format!("goal/{number}"), number as u64, body));
        }
        let more: Vec<_> =
            (0..11).map(|number| record(&format!("plan/{number}"), 1, json!(1))).collect();
        assert_eq!(records.rejection_reason(&more[..10]), None);
        assert_eq!(records.keys_to_evict(3), ["goal/0", "goal/1", "goal/2"]);
        assert!(records.rejection_reason(&more).is_some());
        assert!(records.rejection_reason(&[record("", 1, json!(1))]).is_some());
        let long = json!("x".repeat(BODY_BYTES_MAX));
        assert!(records.rejection_reason(&[record("goal/11", 9_999, long)]).is_some());
    }
    #[test]
    fn records_of_another_journal_are_kept_as_far_as_there_is_room() {
        let mut records = Records::default();
        for number in 0..RECORDS_MAX - 1 {
            records.insert_if_newer(record(&format!("goal/{number}"), 1, json!(number)));
        }
        let long = json!("x".repeat(BODY_BYTES_MAX));
        let split = records.split(vec![
            record("goal/0", 2, json!(0)),
            record("goal/1", 2, long),
            record("plan/0", 1, json!(0)),
            record("plan/1", 1, json!(1)),
            record("goal/2", 2, json!(2)),
        ]);
        let kept: Vec<_> = split.kept.iter().map(|record| record.key.as_str()).collect();
        assert_eq!(kept, ["goal/0", "plan/0", "goal/2"]);
        assert_eq!((split.malformed.len(), split.without_room), (1, 1));
    }
}
