//! Delivery of records to the Journals. Each Journal gets one request at a time, with the newest
//! version of the records that wait for it. A request is repeated until the Journal has kept the
//! records.
//!
//! However many changes there are and however slow a disk is, at most one message per Journal is
//! under way, and the number of waiting records is bounded by the number of keys.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{Reason, Record, Refusal, Request, StoreRecords, value};
use acl::{AgentId, DaemonId, Performative, Protocol};

use super::{ReplicatesRecords, ReplicationOutcome};
use crate::base_agent::Agent;
use crate::context::{Context, TimerId};
use crate::exchange::{ExchangeEvent, ExchangeOpening};

/// Number of machines that must have a record before the record counts as kept: the machine of this
/// agent, and one other machine if one can be reached.
const COPIES: usize = 2;

/// Wait before a request is sent again to a Journal that did not answer or is busy.
const AGAIN: Duration = Duration::from_millis(200);

/// Wait before a request is sent again to a Journal that cannot write to its disk: a full disk has
/// to be emptied by a person.
const DISK_AGAIN: Duration = Duration::from_secs(5);

/// Maximum number of records in one request; `BYTES_AT_ONCE` is the maximum number of bytes. Such a
/// request is far shorter than the longest message, and a few requests carry the changes of
/// hundreds of goals.
const RECORDS_AT_ONCE: usize = 64;
const BYTES_AT_ONCE: usize = 128 << 10;

/// Callback that a caller of `replicate` gives. It is called with the Journals that have stored the
/// records, and the reasons why others have not.
type OutcomeCallback<A> = Box<dyn FnOnce(&mut A, ReplicationOutcome, &mut Context<A>) + Send>;

/// A call of `replicate` that waits for Journals.
struct PendingWrite<A: Agent> {
    keys: BTreeSet<String>,
    kept: ReplicationOutcome,
    /// Machines that have all records of the call.
    machines: BTreeSet<DaemonId>,
    awaited: BTreeSet<AgentId>,
    then: OutcomeCallback<A>,
    deadline: TimerId,
}

/// Queues of records for all Journals, and the calls of `replicate` that wait for an outcome.
pub(super) struct JournalQueues<A: Agent> {
    to: BTreeMap<AgentId, JournalQueue>,
    tallies: BTreeMap<u64, PendingWrite<A>>,
    numbered: u64,
}

/// Queue of records for one Journal.
#[derive(Debug, Default)]
struct JournalQueue {
    /// The newest version of each record that waits to be sent, by key.
    waiting: BTreeMap<String, Record>,
    /// Numbers of the calls of `replicate` that wait for this Journal; their records are in
    /// `waiting` or under way.
    tallies: BTreeSet<u64>,
    /// Records in the request that is under way.
    under_way: Option<Vec<Record>>,
    /// Timer of the next attempt to send records to the Journal.
    again: Option<TimerId>,
    /// Whether each record is sent in a request of its own, because the Journal refused a request
    /// with several records.
    one_by_one: bool,
    /// Reason why the Journal stores no records at present, as it was logged; `None` if the Journal
    /// works.
    trouble: Option<String>,
    /// Whether the disk of the Journal is the reason why it stores no records. No call of
    /// `replicate` then waits for this Journal.
    is_disk_in_trouble: bool,
}

/// Outcome of a request to a Journal to store records.
#[derive(Debug, PartialEq, Eq)]
enum WriteOutcome {
    Kept,
    /// The Journal does not accept these records now or later.
    Refused(String),
    /// The Journal may accept these records later: the reason for the delay, and the wait before
    /// the next attempt.
    Later(String, Duration),
    /// The Journal has left, for the given reason. When the Journal returns, all records are sent
    /// anew.
    Gone(String),
}

// === impl JournalQueues ===

impl<A: Agent> JournalQueues<A> {
    pub(super) fn new() -> JournalQueues<A> {
        JournalQueues { to: BTreeMap::new(), tallies: BTreeMap::new(), numbered: 0 }
    }

    /// Whether every Journal that is present and works has kept all records that were sent to it.
    pub(super) fn is_empty(&self) -> bool {
        let is_idle = |to: &JournalQueue| to.under_way.is_none() && to.waiting.is_empty();
        self.to.values().all(|to| to.trouble.is_some() || is_idle(to))
    }
}

impl JournalQueue {
    /// Queues records for sending, or puts records back that were not kept. If a newer version of a
    /// record waits already, that version stays.
    fn add(&mut self, records: &[Record]) {
        for record in records {
            let waiting = self.waiting.get(&record.key);
            if waiting.is_none_or(|waiting| waiting.version < record.version) {
                self.waiting.insert(record.key.clone(), record.clone());
            }
        }
    }

    /// Takes the records for the next request. Returns `None` if a request is under way or
    /// scheduled, or if no record waits.
    fn next(&mut self) -> Option<Vec<Record>> {
        if self.under_way.is_some() || self.again.is_some() || self.waiting.is_empty() {
            return None;
        }
        let most = if self.one_by_one { 1 } else { RECORDS_AT_ONCE };
        let mut bytes = 0;
        let mut records = Vec::new();
        while let Some((key, record)) = self.waiting.pop_first() {
            bytes += serde_json::to_vec(&record.body).map_or(0, |body| body.len()) + key.len();
            if records.len() == most || (bytes > BYTES_AT_ONCE && !records.is_empty()) {
                self.waiting.insert(key, record);
                break;
            }
            records.push(record);
        }
        self.under_way = Some(records.clone());
        Some(records)
    }
}

// === keeping ===

/// Sends records to the Journals that are present. Calls `then`, if given, as soon as enough
/// machines have the records, all Journals have answered, or `answer_deadline` has passed.
pub(super) fn deliver<A: ReplicatesRecords>(
    agent: &mut A,
    records: &[Record],
    then: Option<OutcomeCallback<A>>,
    ctx: &mut Context<A>,
) {
    let journals = agent.journal_client().journals.clone();
    let here: BTreeSet<_> =
        journals.into_iter().filter(|journal| ctx.find(journal).is_some()).collect();
    if here.is_empty() {
        if let Some(then) = then {
            ctx.after(Duration::ZERO, move |agent: &mut A, ctx| {
                then(agent, ReplicationOutcome::default(), ctx)
            });
        }
        return;
    }
    let number = then.map(|then| {
        let deadline = ctx.settings().answer_deadline;
        let deliveries = &mut agent.journal_client().deliveries;
        deliveries.numbered += 1;
        let number = deliveries.numbered;
        let late = move |agent: &mut A, ctx: &mut Context<A>| {
            let awaited = agent.journal_client().deliveries.tallies.get(&number);
            for journal in awaited.map(|tally| tally.awaited.clone()).unwrap_or_default() {
                let known = agent.journal_client().deliveries.to.get(&journal);
                let why = known.and_then(|delivery| delivery.trouble.clone());
                let why = why.unwrap_or_else(|| "it did not answer in time".to_owned());
                note(agent, number, &journal, Err(why), ctx);
            }
        };
        let tally = PendingWrite {
            keys: records.iter().map(|record| record.key.clone()).collect(),
            kept: ReplicationOutcome::default(),
            machines: BTreeSet::new(),
            awaited: here.clone(),
            then,
            deadline: ctx.after(deadline, late),
        };
        deliveries.tallies.insert(number, tally);
        number
    });
    for journal in here {
        let delivery = agent.journal_client().deliveries.to.entry(journal.clone()).or_default();
        delivery.add(records);
        delivery.tallies.extend(number);
        let is_hopeless = delivery.is_disk_in_trouble && delivery.again.is_some();
        match delivery.trouble.clone().filter(|_| is_hopeless) {
            Some(why) => settle(agent, &journal, &Err(why), ctx),
            None => send(agent, &journal, ctx),
        }
    }
}

/// Sends the records that wait for a Journal to that Journal, unless a request is under way.
fn send<A: ReplicatesRecords>(agent: &mut A, journal: &AgentId, ctx: &mut Context<A>) {
    let Some(delivery) = agent.journal_client().deliveries.to.get_mut(journal) else { return };
    let Some(records) = delivery.next() else { return };
    if ctx.find(journal).is_none() {
        return answered(agent, journal, WriteOutcome::Gone("it has left".to_owned()), ctx);
    }
    let opening = ExchangeOpening {
        to: Some(journal.clone()),
        performative: Performative::Request,
        protocol: Protocol::StateChange,
        conversation: ctx.new_conversation(),
        content: value(&Request::StoreRecords(StoreRecords { records })),
    };
    let (patience, from) = (ctx.settings().answer_deadline, journal.clone());
    ctx.open(opening, patience, move |agent: &mut A, answer, ctx| {
        answered(agent, &from, outcome(answer), ctx);
    });
}

fn answered<A: ReplicatesRecords>(
    agent: &mut A,
    from: &AgentId,
    outcome: WriteOutcome,
    ctx: &mut Context<A>,
) {
    let journal_client = agent.journal_client();
    // An agent that is no longer the leader does not retry: the new leader's records may have
    // smaller versions.
    let outcome = match outcome {
        WriteOutcome::Later(why, _) if !journal_client.is_leading => WriteOutcome::Gone(why),
        outcome => outcome,
    };
    let Some(delivery) = journal_client.deliveries.to.get_mut(from) else { return };
    let Some(batch) = delivery.under_way.take() else { return };
    match outcome {
        WriteOutcome::Kept => {
            if delivery.trouble.take().is_some() {
                tracing::info!(agent = %ctx.id(), journal = %from, "the Journal keeps records again");
            }
        }
        WriteOutcome::Refused(_) if batch.len() > 1 => {
            delivery.one_by_one = true;
            delivery.add(&batch);
        }
        WriteOutcome::Refused(why) => {
            let Some(record) = batch.first() else { return };
            tracing::warn!(agent = %ctx.id(), journal = %from, key = record.key, why,
                "a Journal refuses a record: it is not kept there");
            refused(agent, from, &record.key, &why, ctx);
        }
        WriteOutcome::Later(why, wait) => {
            delivery.add(&batch);
            if delivery.trouble.replace(why.clone()).is_none() {
                tracing::warn!(agent = %ctx.id(), journal = %from, why,
                    "a Journal does not keep records now: it is asked again until it does");
            }
            delivery.is_disk_in_trouble = wait == DISK_AGAIN;
            let journal = from.clone();
            delivery.again = Some(ctx.after(wait, move |agent: &mut A, ctx| {
                if let Some(delivery) = agent.journal_client().deliveries.to.get_mut(&journal) {
                    delivery.again = None;
                    send(agent, &journal, ctx);
                }
            }));
            if wait == DISK_AGAIN {
                settle(agent, from, &Err(why), ctx);
            }
            return;
        }
        WriteOutcome::Gone(why) => {
            if let Some(again) = delivery.again.take() {
                ctx.cancel_timer(again);
            }
            (delivery.waiting, delivery.trouble) = (BTreeMap::new(), None);
            return settle(agent, from, &Err(why), ctx);
        }
    }
    let delivery = agent.journal_client().deliveries.to.entry(from.clone()).or_default();
    if delivery.waiting.is_empty() {
        delivery.one_by_one = false;
        return settle(agent, from, &Ok(()), ctx);
    }
    settle_kept(agent, from, ctx);
    send(agent, from, ctx);
}

/// Handles the refusal of one record by a Journal: records the failure for the calls of `replicate`
/// that contain the record.
fn refused<A: ReplicatesRecords>(
    agent: &mut A,
    by: &AgentId,
    key: &str,
    why: &str,
    ctx: &mut Context<A>,
) {
    let deliveries = &agent.journal_client().deliveries;
    let waits = |(_, tally): &(&u64, &PendingWrite<A>)| tally.keys.contains(key);
    let waiting = deliveries.tallies.iter().filter(waits).map(|(number, _)| *number);
    for number in waiting.collect::<Vec<_>>() {
        note(agent, number, by, Err(why.to_owned()), ctx);
    }
}

/// Records for all calls of `replicate` that wait for a Journal whether the Journal has stored
/// their records. An error states the reason why it has not.
fn settle<A: ReplicatesRecords>(
    agent: &mut A,
    journal: &AgentId,
    outcome: &Result<(), String>,
    ctx: &mut Context<A>,
) {
    let delivery = agent.journal_client().deliveries.to.entry(journal.clone()).or_default();
    for number in std::mem::take(&mut delivery.tallies) {
        note(agent, number, journal, outcome.clone(), ctx);
    }
}

/// Records success for those calls of `replicate` that have all their records on a Journal, even if
/// records of other calls still wait.
fn settle_kept<A: ReplicatesRecords>(agent: &mut A, journal: &AgentId, ctx: &mut Context<A>) {
    let deliveries = &mut agent.journal_client().deliveries;
    let tallies = &deliveries.tallies;
    let Some(JournalQueue { waiting, tallies: numbers, .. }) = deliveries.to.get_mut(journal)
    else {
        return;
    };
    let is_kept = |number: &u64| {
        tallies
            .get(number)
            .is_none_or(|tally| !tally.keys.iter().any(|key| waiting.contains_key(key)))
    };
    let (kept, left) = std::mem::take(numbers).into_iter().partition(is_kept);
    *numbers = left;
    let kept: BTreeSet<u64> = kept;
    for number in kept {
        note(agent, number, journal, Ok(()), ctx);
    }
}

/// Records for one call of `replicate` whether a Journal has stored its records. Runs the callback
/// of the call if enough machines have the records, or if all Journals have answered.
fn note<A: ReplicatesRecords>(
    agent: &mut A,
    number: u64,
    journal: &AgentId,
    outcome: Result<(), String>,
    ctx: &mut Context<A>,
) {
    let tallies = &mut agent.journal_client().deliveries.tallies;
    let Some(tally) = tallies.get_mut(&number) else { return };
    if !tally.awaited.remove(journal) {
        return;
    }
    match outcome {
        Ok(()) => {
            tally.machines.extend(ctx.find(journal).map(|resident| resident.daemon));
            tally.kept.stored_by.push(journal.clone());
        }
        Err(why) => drop(tally.kept.failed_by.insert(journal.clone(), why)),
    }
    if (tally.machines.len() >= COPIES || tally.awaited.is_empty())
        && let Some(PendingWrite { then, kept, deadline, .. }) = tallies.remove(&number)
    {
        ctx.cancel_timer(deadline);
        then(agent, kept, ctx);
    }
}

/// Converts the answer of a Journal to the outcome of the request to store records.
fn outcome(answer: ExchangeEvent) -> WriteOutcome {
    match answer {
        ExchangeEvent::Message(message) if message.performative == Performative::Confirm => {
            WriteOutcome::Kept
        }
        ExchangeEvent::Message(message) => match message.content_as::<Refusal>() {
            Ok(refusal) => match refusal.reason {
                Reason::BadContent => WriteOutcome::Refused(refusal.detail),
                Reason::Busy | Reason::MailboxFull => WriteOutcome::Later(refusal.detail, AGAIN),
                _ => WriteOutcome::Later(refusal.detail, DISK_AGAIN),
            },
            Err(_) => WriteOutcome::Later("it declined".to_owned(), DISK_AGAIN),
        },
        ExchangeEvent::TimedOut => {
            WriteOutcome::Later("it did not answer in time".to_owned(), AGAIN)
        }
        ExchangeEvent::Undelivered(why) => match why {
            crate::DeliveryError::OutboxFull | crate::DeliveryError::NoReceipt => {
                WriteOutcome::Later(why.to_string(), AGAIN)
            }
            _ => WriteOutcome::Gone(why.to_string()),
        },
    }
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
    fn one_request_at_a_time_carries_the_newest_records() {
        let mut delivery = JournalQueue::default();
        delivery.add(&[record("goal/a", 1, json!("asked for"))]);
        assert_eq!(delivery.next().expect("one").len(), 1);
        for count in 2..1_000 {
            delivery
                .add(&[record("goal/a", count, json!(count)), record("plan/a", count, json!(0))]);
            assert_eq!(delivery.next(), None, "one is under way");
        }
        assert_eq!(delivery.waiting.len(), 2);
        // The request under way is not kept; the newer versions replace what it carried.
        let batch = delivery.under_way.take().expect("it is under way");
        delivery.add(&batch);
        let next = delivery.next().expect("two");
        assert_eq!(next.iter().map(|record| record.version.count).collect::<Vec<_>>(), [999, 999]);
    }

    #[test]
    fn a_request_is_bounded_and_all_records_are_sent() {
        let mut delivery = JournalQueue::default();
        let long = json!("x".repeat(BYTES_AT_ONCE));
        let of = |number| record(&format!("{number:03}"), 1, json!(number));
        let records: Vec<_> = (0..RECORDS_AT_ONCE + 5).map(of).collect();
        delivery.add(&records);
        delivery.add(&[record("001", 2, long.clone()), record("002", 2, long)]);
        let mut sizes = Vec::new();
        while let Some(records) = delivery.next() {
            sizes.push(records.len());
            delivery.under_way = None;
        }
        assert_eq!(sizes, [1, 1, 1, RECORDS_AT_ONCE, 2]);
    }
}
