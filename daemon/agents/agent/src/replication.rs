//! Replicated records: an agent writes records to the ecosystem's Journals, and reads them when it
//! becomes the leader (docs/design.md, “Fail-over”).
//!
//! Each leader writes under a term of its own, which is greater than any term that it has read
//! (fencing). So its versions of records are newer than those of earlier leaders, even if the
//! clocks of the machines differ. Journals that join or return are read again, because after a
//! partition they hold the decisions made on their side.

mod journal_queue;

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{Record, Version};
use acl::{AgentId, Incarnation};
use serde_json::Value;
use substrate::{Presence, Resource};
use tokio::task::JoinSet;
use tokio::time::Instant;

use crate::base_agent::Agent;
use crate::context::{Context, TimerId, WorkHandle};
use crate::host::Host;
use crate::replication::journal_queue::JournalQueues;

/// How long to wait for the other Journals once one has answered. The other Journals hold the same
/// records, except for those written last.
const OTHERS_AWAITED: Duration = Duration::from_millis(100);

/// Wait before a Journal that gave no answer is read again: a machine that has just started is
/// still opening the file of its Journal. After `READS_OFTEN` attempts the wait is `READ_LATER`,
/// for as long as the Journal is present: a slow memory card may take minutes to repair a file.
const READ_AGAIN: Duration = Duration::from_millis(50);
const READS_OFTEN: u32 = 40;
const READ_LATER: Duration = Duration::from_secs(2);

/// Client of the Journals for one agent: the version of the agent's last write, and the records
/// that are being delivered.
pub struct JournalClient<A: Agent> {
    journals: Vec<AgentId>,
    version: Version,
    is_leading: bool,
    /// Journals that are present and have not been read in their present incarnation.
    unread: BTreeSet<AgentId>,
    /// Whether any Journal has been read since this agent became the leader.
    has_read: bool,
    reads: u32,
    reading: Option<WorkHandle>,
    /// Timer that is due when Journals that gave no answer are read again.
    again: Option<TimerId>,
    deliveries: JournalQueues<A>,
}

/// Agent that replicates its records to the Journals.
pub trait ReplicatesRecords: Agent {
    /// Returns the agent's client of the Journals.
    fn journal_client(&mut self) -> &mut JournalClient<Self>;

    /// Called with the newest version of each record that the Journals hold, ordered by key; this
    /// agent or earlier leaders have written them. Called when the agent becomes the leader, and
    /// whenever a Journal joins.
    fn records_restored(&mut self, records: Vec<Record>, ctx: &mut Context<Self>);
}

/// Outcome of replicating some records to the Journals.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ReplicationOutcome {
    /// Journals that have the records on disk.
    pub stored_by: Vec<AgentId>,
    /// Journals that could not keep the records, each with the reason.
    pub failed_by: BTreeMap<AgentId, String>,
}

impl<A: Agent> JournalClient<A> {
    /// Creates a client of the host's Journals that has read no record yet.
    pub fn new(host: &Host) -> JournalClient<A> {
        JournalClient {
            journals: host.journals.clone(),
            version: Version::default(),
            is_leading: false,
            unread: BTreeSet::new(),
            has_read: false,
            reads: 0,
            reading: None,
            again: None,
            deliveries: JournalQueues::new(),
        }
    }

    /// Whether every Journal that is present and works has stored all records that were sent to it.
    pub fn has_delivered(&self) -> bool {
        self.deliveries.is_empty()
    }

    /// Returns the Journals of the ecosystem.
    pub fn journals(&self) -> &[AgentId] {
        &self.journals
    }

    /// Whether this agent is the leader; only the leader writes records.
    pub fn is_leading(&self) -> bool {
        self.is_leading
    }

    /// Ensures that versions that this agent writes later are newer than `records`, which other
    /// agents have written.
    pub fn advance_term_past(&mut self, incarnation: Incarnation, records: &[Record]) {
        self.begin_term(incarnation, records);
    }

    /// Returns the term under which this agent writes; it is greater than any term that the agent
    /// has read.
    pub fn term(&self) -> u64 {
        self.version.term
    }

    /// Creates a new version of the record `key`, with the content `body`. The caller passes it to
    /// [`replicate`] or [`replicate_detached`].
    pub fn write(&mut self, key: String, body: Value) -> Record {
        self.version.count += 1;
        Record { key, version: self.version, body }
    }

    fn begin_term(&mut self, incarnation: Incarnation, records: &[Record]) {
        let read = records.iter().map(|record| record.version.term).max();
        // An agent that reads its own records begins no new term.
        if read > Some(self.version.term) || self.version.term == 0 {
            let later = read.map_or(0, |term| term.saturating_add(stride_of(incarnation)));
            self.version = Version { term: later.max(incarnation.0), count: 0 };
        }
    }
}

/// Returns the distance between a new term and the greatest term that was read. The distance
/// differs between incarnations, so that two agents begin different terms even if they have read
/// the same records while cut off from each other.
fn stride_of(Incarnation(incarnation): Incarnation) -> u64 {
    /// 2⁶⁴ divided by the golden ratio. Multiplication by this number spreads incarnations that lie
    /// close together (Knuth, The Art of Computer Programming, 6.4).
    const SPREAD: u64 = 0x9e37_79b9_7f4a_7c15;
    // 32 bits, which is about an hour in microseconds: terms do not run far ahead of the clock, and
    // there is room for more terms than there are seconds in a century.
    (incarnation.wrapping_mul(SPREAD) >> 32).max(1)
}

/// Replicates records to the Journals that are present. Calls `then` as soon as enough machines
/// have the records, all Journals have answered, or the time for an answer has passed. The records
/// are sent to each Journal again until it has stored them.
pub fn replicate<A: ReplicatesRecords>(
    agent: &mut A,
    records: &[Record],
    ctx: &mut Context<A>,
    then: impl FnOnce(&mut A, ReplicationOutcome, &mut Context<A>) + Send + 'static,
) {
    journal_queue::deliver(agent, records, Some(Box::new(then)), ctx);
}

/// Replicates records without reporting the outcome. The records are sent to the Journals that are
/// present until each has these versions or newer ones.
pub fn replicate_detached<A: ReplicatesRecords>(
    agent: &mut A,
    records: &[Record],
    ctx: &mut Context<A>,
) {
    journal_queue::deliver(agent, records, None, ctx);
}

/// Updates the agent's [`JournalClient`] after the agent has become the leader or a standby. Call
/// this function from [`Agent::leadership_changed`].
pub fn handle_leadership<A: ReplicatesRecords>(
    agent: &mut A,
    is_leading: bool,
    ctx: &mut Context<A>,
) {
    let incarnation = ctx.incarnation();
    let journal_client = agent.journal_client();
    journal_client.is_leading = is_leading;
    (journal_client.unread, journal_client.reading, journal_client.reads) =
        (BTreeSet::new(), None, 0);
    journal_client.has_read = false;
    if is_leading {
        journal_client.begin_term(incarnation, &[]);
        read_all(agent, ctx);
    }
}

/// Updates the agent's [`JournalClient`] after another agent has joined or left. Call this function
/// for every change of presence.
pub fn handle_presence<A: ReplicatesRecords>(
    agent: &mut A,
    presence: &Presence,
    ctx: &mut Context<A>,
) {
    let who = &presence.resident().agent;
    let journal_client = agent.journal_client();
    if !journal_client.is_leading || !journal_client.journals.contains(who) {
        return;
    }
    match presence {
        Presence::Joined(_) => {
            // All Journals are read, because this one may lack the ends of goals that the others
            // have recorded.
            read_all(agent, ctx);
        }
        Presence::Left(_) => {
            journal_client.unread.remove(who);
        }
    }
}

/// Reads the records of all Journals that are present.
fn read_all<A: ReplicatesRecords>(agent: &mut A, ctx: &mut Context<A>) {
    let journal_client = agent.journal_client();
    let here = journal_client.journals.iter().filter(|journal| ctx.find(journal).is_some());
    (journal_client.unread, journal_client.reads) = (here.cloned().collect(), 0);
    read(agent, ctx);
}

/// Reads the records of those Journals that have not been read, unless a read is under way.
fn read<A: ReplicatesRecords>(agent: &mut A, ctx: &mut Context<A>) {
    let journal_client = agent.journal_client();
    if journal_client.reading.is_some() || journal_client.unread.is_empty() {
        return;
    }
    journal_client.reads = journal_client.reads.saturating_add(1);
    let (reads, deadline) = (journal_client.reads, ctx.settings().answer_deadline);
    // A new leader needs the records to go on; later reads are not urgent.
    let patience = if journal_client.has_read { deadline } else { OTHERS_AWAITED };
    let mut asked = JoinSet::new();
    for journal in journal_client.unread.clone() {
        if ctx.find(&journal).is_none() {
            continue;
        }
        let answers = ctx.ask(Resource::Journal, &journal);
        asked.spawn(async move { (journal, answers.await) });
    }
    let reading = ctx.run(answers(asked, patience), move |agent: &mut A, answers, ctx| {
        agent.journal_client().reading = None;
        let records = take_in(agent, answers, ctx.incarnation());
        let is_all_read = agent.journal_client().unread.is_empty();
        if let Some(records) = records {
            agent.records_restored(records, ctx);
        }
        if !is_all_read {
            let wait = if reads < READS_OFTEN { READ_AGAIN } else { READ_LATER };
            let again = ctx.after(wait, |agent: &mut A, ctx| read(agent, ctx));
            let former = agent.journal_client().again.replace(again);
            former.into_iter().for_each(|former| ctx.cancel_timer(former));
        }
    });
    agent.journal_client().reading = Some(reading);
}

/// Collects the answers of Journals: the name of each Journal, and its records. Once one Journal
/// has answered, waits for the others at most `patience`.
async fn answers(
    mut asked: JoinSet<(AgentId, Vec<bytes::Bytes>)>,
    patience: Duration,
) -> Vec<(AgentId, Vec<Record>)> {
    let mut read = Vec::new();
    let mut until: Option<Instant> = None;
    loop {
        let next = async {
            match until {
                Some(until) => {
                    tokio::time::timeout_at(until, asked.join_next()).await.ok().flatten()
                }
                None => asked.join_next().await,
            }
        };
        let Some(answered) = next.await else { return read };
        let Ok((journal, answers)) = answered else { continue };
        for answer in answers {
            match serde_json::from_slice(&answer) {
                Ok(records) => {
                    read.push((journal.clone(), records));
                    until.get_or_insert_with(|| Instant::now() + patience);
                }
                Err(error) => tracing::warn!(%journal, %error, "an answer cannot be read"),
            }
        }
    }
}

/// Returns the newest version of each record that was read; `None` if no Journal has answered.
fn take_in<A: ReplicatesRecords>(
    agent: &mut A,
    answers: Vec<(AgentId, Vec<Record>)>,
    incarnation: Incarnation,
) -> Option<Vec<Record>> {
    if answers.is_empty() {
        return None;
    }
    let journal_client = agent.journal_client();
    journal_client.has_read = true;
    let mut newest: BTreeMap<String, Record> = BTreeMap::new();
    for (journal, records) in answers {
        journal_client.unread.remove(&journal);
        journal_client.begin_term(incarnation, &records);
        for record in records {
            let is_newer =
                newest.get(&record.key).is_none_or(|known| known.version < record.version);
            if is_newer {
                newest.insert(record.key.clone(), record);
            }
        }
    }
    Some(newest.into_values().collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Writer;

    impl Agent for Writer {
        fn callbacks(&self) -> crate::Callbacks<Self> {
            crate::Callbacks::new()
        }
    }

    fn journal_client() -> JournalClient<Writer> {
        JournalClient {
            journals: Vec::new(),
            version: Version::default(),
            is_leading: true,
            unread: BTreeSet::new(),
            has_read: false,
            reads: 0,
            reading: None,
            again: None,
            deliveries: JournalQueues::new(),
        }
    }

    #[test]
    fn a_term_is_greater_than_any_read_whatever_the_clock_says() {
        let mut journal_client = journal_client();
        journal_client.begin_term(Incarnation(7), &[]);
        assert_eq!(journal_client.term(), 7);
        let mine = journal_client.write("goal/a".to_owned(), Value::Null);
        journal_client.begin_term(Incarnation(7), std::slice::from_ref(&mine));
        assert_eq!(journal_client.term(), 7, "its own records begin no term");
        let theirs = Record { version: Version { term: 99, count: 3 }, ..mine };
        journal_client.begin_term(Incarnation(7), std::slice::from_ref(&theirs));
        assert!(journal_client.term() > 99);
        assert!(journal_client.write("goal/a".to_owned(), Value::Null).version > theirs.version);
    }

    /// If two leaders had equal terms, a plan or a command of one could be mistaken for that of the
    /// other.
    #[test]
    fn leaders_that_read_the_same_records_begin_different_terms() {
        let version = Version { term: 1_700_000_034_043_986, count: 3 };
        let read = Record { key: "goal/a".to_owned(), version, body: Value::Null };
        let terms = [1_700_000_034_042_988, 1_700_000_034_042_989, 1_700_000_034_039_001];
        let terms = terms.map(|incarnation| {
            let mut journal_client = journal_client();
            journal_client.begin_term(Incarnation(incarnation), std::slice::from_ref(&read));
            journal_client.term()
        });
        assert!(terms.iter().all(|term| *term > version.term));
        assert_eq!(BTreeSet::from(terms).len(), 3, "{terms:?}");
    }
}
