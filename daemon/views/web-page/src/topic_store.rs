//! The topics that pages read, as rows with versions. Each row is serialized once, whatever the
//! number of pages, and a page holds only the version that it was sent last: one that reads slowly
//! gets the newest rows when it reads again.

use std::collections::{BTreeMap, HashMap, VecDeque};
use std::fmt::Write as _;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use tokio::sync::{Notify, watch};

use crate::row_set::RowSet;
use crate::topic_name::TopicName;

/// Maximum length of the rows of one event, in bytes, beside its last row: a page draws while the
/// rest of a large topic arrives, and a page that does not read holds no more than this.
const EVENT_BYTES_MAX: usize = 24 << 10;

/// Maximum number of removed keys that a topic remembers. A page that has missed more gets all rows
/// again.
const GONE_MAX: usize = 1_000;

/// How long a topic is kept without a reader: a page that connects again after a lost connection
/// gets only the rows that it has missed.
const KEPT_UNREAD: Duration = Duration::from_secs(30);

/// Maximum number of topics about one thing at a time; each is computed anew at each change. Those that
/// list all things of a kind are few, and always have a place.
const THINGS_MAX: usize = 256;

/// The topics of all pages.
pub(crate) struct TopicStore {
    topics: Mutex<TopicTable>,
    /// Wakes the task that computes, when a topic is read that was not.
    pub(crate) wanted: Notify,
    /// The version of the newest change.
    newest: watch::Sender<u64>,
    /// Tells this run from others, whose versions mean something else.
    run: u64,
}

#[derive(Default)]
struct TopicTable {
    version: u64,
    topics: BTreeMap<TopicName, StoredTopic>,
}

impl TopicTable {
    /// Returns the number of topics about one thing.
    fn things(&self) -> usize {
        self.topics.keys().filter(|name| name.is_thing()).count()
    }
}

struct StoredTopic {
    readers: usize,
    unread_since: Option<Instant>,
    is_computed: bool,
    /// Whether nobody has read the topic since it was computed, so that it may have changed.
    is_old: bool,
    rows: HashMap<Arc<str>, StoredRow, foldhash::fast::RandomState>,
    gone: HashMap<Arc<str>, u64, foldhash::fast::RandomState>,
    /// The keys of all rows and of all removed ones, by the version of the change.
    changes: BTreeMap<u64, Arc<str>>,
    /// Versions of removed keys, oldest first; some may be there again.
    gone_order: VecDeque<u64>,
    /// Pages that were sent this version last, or an older one, have missed what is not remembered.
    forgotten: u64,
    order: Vec<Arc<str>>,
    order_version: u64,
    /// Number of updates so far.
    updates: u64,
}

struct StoredRow {
    version: u64,
    json: Arc<str>,
    /// Number of the update that had this row last.
    seen: u64,
}

/// The part of a topic that one page has read.
struct ReadTopic {
    name: TopicName,
    /// Version that the page was sent last; `None` if it has nothing yet.
    sent: Option<u64>,
    /// Version of the order that the page was sent last; 0 if it may have none.
    order: u64,
}

/// A reader of topics: one stream of one page.
pub(crate) struct RowReader {
    store: Arc<TopicStore>,
    topics: Vec<ReadTopic>,
    newest: watch::Receiver<u64>,
    /// Index of the topic that is looked at first, so that a busy one keeps no other waiting.
    next: usize,
}

impl TopicStore {
    /// Creates a store without topics. `run` differs from that of any other process.
    pub(crate) fn new(run: u64) -> TopicStore {
        let (topics, wanted, newest) = (Mutex::default(), Notify::new(), watch::Sender::new(0));
        TopicStore { topics, wanted, newest, run }
    }

    fn table(&self) -> MutexGuard<'_, TopicTable> {
        self.topics.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Returns the topics that have readers, and drops those that had none for long.
    pub(crate) fn read_topics(&self) -> Vec<TopicName> {
        let mut table = self.table();
        table.topics.retain(|_, topic| {
            topic.unread_since.is_none_or(|since| since.elapsed() < KEPT_UNREAD)
        });
        let read = table.topics.iter().filter(|(_, topic)| topic.readers > 0);
        read.map(|(name, _)| name.clone()).collect()
    }

    /// Returns the topics that have readers, but no rows yet or only those of before.
    pub(crate) fn fresh_topics(&self) -> Vec<TopicName> {
        let table = self.table();
        let fresh =
            table.topics.iter().filter(|(_, topic)| topic.readers > 0 && !topic.is_current());
        fresh.map(|(name, _)| name.clone()).collect()
    }

    /// Whether a topic has rows, also if they are none.
    pub(crate) fn is_computed(&self, name: &TopicName) -> bool {
        self.table().topics.get(name).is_some_and(|topic| topic.is_computed)
    }

    /// Whether the rows of a topic are those of the last computation, and were read since.
    pub(crate) fn is_current(&self, name: &TopicName) -> bool {
        self.table().topics.get(name).is_some_and(StoredTopic::is_current)
    }

    /// Takes the rows of a topic. Returns the number of bytes that have changed.
    pub(crate) fn update(&self, name: &TopicName, rows: &RowSet) -> usize {
        let mut table = self.table();
        let mut version = table.version;
        let Some(topic) = table.topics.get_mut(name) else { return 0 };
        let changed = topic.update(rows, &mut version);
        let is_news = version != table.version;
        table.version = version;
        drop(table);
        if is_news || changed.is_first {
            self.newest.send_replace(version);
        }
        changed.bytes
    }

    /// Subscribes to topics. `last_event` is the identifier of the last event that the page has
    /// received, in an earlier stream.
    ///
    /// # Errors
    ///
    /// Returns a sentence for a person if there are too many topics.
    pub(crate) fn subscribe(
        self: &Arc<TopicStore>,
        names: Vec<TopicName>,
        last_event: Option<&str>,
    ) -> Result<RowReader, String> {
        let sent = last_event.and_then(|id| self.sent_until(id, names.len()));
        let mut table = self.table();
        let has_no_place = |table: &TopicTable| {
            let fresh = |it: &&TopicName| it.is_thing() && !table.topics.contains_key(*it);
            let fresh = names.iter().filter(fresh).count();
            fresh > 0 && table.things() + fresh > THINGS_MAX
        };
        if has_no_place(&table) {
            table.topics.retain(|_, topic| topic.readers > 0);
        }
        if has_no_place(&table) {
            return Err("the pages that are open show too many different things; close some".into());
        }
        for name in &names {
            if !table.topics.contains_key(name) {
                // A version of its own: what was sent of an earlier topic of this name is older.
                table.version += 1;
            }
            let version = table.version;
            let topic =
                table.topics.entry(name.clone()).or_insert_with(|| StoredTopic::new(version));
            topic.readers += 1;
            topic.unread_since = None;
        }
        drop(table);
        let sent = sent.unwrap_or_else(|| vec![None; names.len()]);
        let topics =
            names.into_iter().zip(sent).map(|(name, sent)| ReadTopic { name, sent, order: 0 });
        let newest = self.newest.subscribe();
        let reader =
            RowReader { store: Arc::clone(self), topics: topics.collect(), newest, next: 0 };
        self.wanted.notify_one();
        Ok(reader)
    }

    /// Reads the identifier of an event: the run, and the version of each topic of its stream.
    fn sent_until(&self, id: &str, count: usize) -> Option<Vec<Option<u64>>> {
        let (run, versions) = id.split_once('-')?;
        if u64::from_str_radix(run, 16).ok()? != self.run {
            return None;
        }
        let read = |text: &str| match text {
            "" => Some(None),
            text => text.parse().ok().map(Some),
        };
        let versions: Vec<Option<u64>> = versions.split('.').map(read).collect::<Option<_>>()?;
        (versions.len() == count).then_some(versions)
    }
}

/// How a topic has changed by an update.
struct TopicChange {
    bytes: usize,
    is_first: bool,
}

impl StoredTopic {
    fn new(version: u64) -> StoredTopic {
        StoredTopic {
            readers: 0,
            unread_since: None,
            is_computed: false,
            is_old: false,
            rows: HashMap::default(),
            gone: HashMap::default(),
            changes: BTreeMap::new(),
            gone_order: VecDeque::new(),
            forgotten: version,
            order: Vec::new(),
            order_version: 0,
            updates: 0,
        }
    }

    /// Whether the rows may be sent: a page shows what it gets as what is true now.
    fn is_current(&self) -> bool {
        self.is_computed && !self.is_old
    }

    fn update(&mut self, rows: &RowSet, version: &mut u64) -> TopicChange {
        self.updates += 1;
        let mut change = TopicChange { bytes: 0, is_first: !self.is_current() };
        self.is_computed = true;
        self.is_old = false;
        let mut seen = 0;
        for (key, json) in rows.rows() {
            match self.rows.get_mut(key) {
                Some(row) if row.seen == self.updates => continue,
                Some(row) => {
                    row.seen = self.updates;
                    seen += 1;
                    if *row.json == *json {
                        continue;
                    }
                }
                None => seen += 1,
            }
            *version += 1;
            change.bytes += key.len() + json.len();
            self.put(key, json, *version);
        }
        if !rows.is_change && seen < self.rows.len() {
            let first_kept = rows.adds_from.as_deref();
            self.remove_unseen(first_kept, version, &mut change.bytes);
        }
        if rows.is_ordered {
            self.reorder(rows, version, &mut change.bytes);
        }
        change
    }

    fn put(&mut self, key: &str, json: &str, version: u64) {
        let (known, former) = match self.rows.remove_entry(key) {
            Some((key, row)) => (Some(key), Some(row.version)),
            None => match self.gone.remove_entry(key) {
                Some((key, gone_at)) => (Some(key), Some(gone_at)),
                None => (None, None),
            },
        };
        if let Some(former) = former {
            self.changes.remove(&former);
        }
        let key = known.unwrap_or_else(|| Arc::from(key));
        self.changes.insert(version, Arc::clone(&key));
        self.rows.insert(key, StoredRow { version, json: Arc::from(json), seen: self.updates });
    }

    /// Removes the rows that the newest update does not have; with `first_kept`, only those with
    /// smaller keys.
    fn remove_unseen(&mut self, first_kept: Option<&str>, version: &mut u64, bytes: &mut usize) {
        let is_over = |key: &str| first_kept.is_none_or(|first| key < first);
        let unseen = self.rows.iter();
        let unseen = unseen.filter(|(key, row)| row.seen != self.updates && is_over(key));
        let unseen: Vec<_> = unseen.map(|(key, row)| (Arc::clone(key), row.version)).collect();
        for (key, former) in unseen {
            *version += 1;
            *bytes += key.len();
            self.rows.remove(&key);
            self.changes.remove(&former);
            self.changes.insert(*version, Arc::clone(&key));
            self.gone_order.push_back(*version);
            self.gone.insert(key, *version);
        }
        while self.gone_order.len() > GONE_MAX
            && let Some(oldest) = self.gone_order.pop_front()
        {
            self.forgotten = self.forgotten.max(oldest);
            let is_gone = |key: &Arc<str>| self.gone.get(key) == Some(&oldest);
            if self.changes.get(&oldest).is_some_and(is_gone)
                && let Some(key) = self.changes.remove(&oldest)
            {
                self.gone.remove(&key);
            }
        }
    }

    fn reorder(&mut self, rows: &RowSet, version: &mut u64, bytes: &mut usize) {
        let keys = || rows.rows().map(|(key, _)| key);
        if keys().eq(self.order.iter().map(|key| &**key)) {
            return;
        }
        let known = |key| self.rows.get_key_value(key).map(|(key, _)| Arc::clone(key));
        self.order = keys().filter_map(known).collect();
        *version += 1;
        *bytes += self.order.iter().map(|key| key.len()).sum::<usize>();
        self.order_version = *version;
    }

    /// Returns the version of the newest change.
    fn head(&self) -> u64 {
        let newest = self.changes.last_key_value().map_or(0, |(version, _)| *version);
        newest.max(self.order_version).max(self.forgotten)
    }

    /// Writes the rows that the page lacks as the data of an event, as many as fit, and notes in
    /// `read` what was written. Returns whether there is anything to send.
    fn write(&self, read: &mut ReadTopic, now: u64, data: &mut String) -> bool {
        let head = self.head();
        let from = read.sent.filter(|sent| *sent >= self.forgotten);
        if !self.is_current() || from.is_some_and(|from| from >= head) {
            return false;
        }
        let is_full = from.is_none();
        if is_full {
            read.order = 0;
        }
        let _ = write!(data, "{{\"full\":{is_full},\"rows\":{{");
        let (start, mut until) = (data.len(), head);
        let (mut gone, mut is_first): (Vec<&str>, bool) = (Vec::new(), true);
        let changes = self.changes.range(from.map_or(0, |from| from + 1)..);
        for (version, key) in changes {
            match self.rows.get(key) {
                Some(row) => {
                    data.push_str(if is_first { "" } else { "," });
                    push_json(data, key);
                    data.push(':');
                    data.push_str(&row.json);
                    is_first = false;
                }
                // A page that has nothing yet has nothing to remove.
                None if is_full => (),
                None => gone.push(key),
            }
            if data.len() - start + 32 * gone.len() > EVENT_BYTES_MAX {
                until = *version;
                break;
            }
        }
        data.push_str("},\"gone\":");
        push_list(data, gone.into_iter());
        data.push_str(",\"order\":");
        if until == head && self.order_version > read.order {
            read.order = self.order_version;
            push_list(data, self.order.iter().map(|key| &**key));
        } else {
            data.push_str("null");
        }
        let _ = write!(data, ",\"now\":{now}}}");
        read.sent = Some(until);
        true
    }
}

fn push_json(data: &mut String, text: &str) {
    data.push_str(&serde_json::Value::from(text).to_string());
}

fn push_list<'t>(data: &mut String, texts: impl Iterator<Item = &'t str>) {
    data.push('[');
    for (index, text) in texts.enumerate() {
        data.push_str(if index == 0 { "" } else { "," });
        push_json(data, text);
    }
    data.push(']');
}

impl RowReader {
    /// Returns the next event; `None` if the page has everything.
    pub(crate) fn event(&mut self, now: u64) -> Option<String> {
        let count = self.topics.len();
        let store = Arc::clone(&self.store);
        let table = store.table();
        for turn in 0..count {
            let index = (self.next + turn) % count;
            let read = &mut self.topics[index];
            let Some(topic) = table.topics.get(&read.name) else { continue };
            let mut data = String::new();
            if !topic.write(read, now, &mut data) {
                continue;
            }
            self.next = (index + 1) % count;
            let name = &self.topics[index].name;
            return Some(format!("event: {name}\nid: {}\ndata: {data}\n\n", self.id()));
        }
        None
    }

    /// Returns the identifier of an event at this point of the stream.
    fn id(&self) -> String {
        let sent = |read: &ReadTopic| read.sent.map(|sent| sent.to_string()).unwrap_or_default();
        let versions: Vec<_> = self.topics.iter().map(sent).collect();
        format!("{:x}-{}", self.store.run, versions.join("."))
    }

    /// Waits until there may be an event.
    pub(crate) async fn changed(&mut self) {
        // The store lives as long as this reader, so its sender does.
        let _ = self.newest.changed().await;
    }
}

impl Drop for RowReader {
    fn drop(&mut self) {
        let mut table = self.store.table();
        for read in &self.topics {
            if let Some(topic) = table.topics.get_mut(&read.name) {
                topic.readers = topic.readers.saturating_sub(1);
                if topic.readers == 0 {
                    topic.unread_since = Some(Instant::now());
                    topic.is_old = true;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests;
