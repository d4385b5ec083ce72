//! The Journal: replica store for records that must outlive a process, such as goals and plans; a
//! new leader reads them (docs/design.md, “Fail-over”).
//!
//! - `request` (records) → `confirm` when these records are on this machine's disk, or `refuse`
//!   with the reason if they cannot be stored. The newest version of each key is kept, regardless
//!   of the agent that wrote it.
//! - Answers queries for all its records. When another Journal joins, fetches newer records from
//!   that Journal, so that the copies become equal after a crash or a partition.
//! - Records are not interpreted; decisions about goals belong to other agents.
//!
//! Each daemon that keeps a copy has one Journal, under a name of its own.

mod records;
mod store;

use std::collections::BTreeSet;
use std::path::PathBuf;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Outcome, Reason, Record, Refusal, Report, Request, StoreRecords};
use acl::{AgentId, Message, Performative};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, Participation, PluginEntry,
    Presence, Resource, StateFolder, WorkHandle,
};

use crate::records::{Records, SplitRecords};
pub use crate::store::{FORMAT, MemoryStore};
use crate::store::{Store, StoreError};

/// Maximum number of requests that wait for the running write; further requests are refused. Each
/// request is a change of one goal, and one write covers all waiting requests.
const QUEUED_MAX: usize = 256;

/// Interval between attempts to open the Journal's file. The disk may have been full when the
/// daemon started, or an earlier process may still have the file open.
const REOPEN_INTERVAL: Duration = Duration::from_secs(5);

/// Delay before another query to a Journal that gave no answer, because that Journal may still be
/// opening its file.
const FETCH_RETRY_DELAY: Duration = Duration::from_secs(2);

/// Delay before the records of another Journal for which there was no room are fetched again: goals
/// that end meanwhile make room.
const ROOM_RETRY_DELAY: Duration = Duration::from_secs(60);

/// The entry of the Journal in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "journal",
    about: "keeps goals, plans and outcomes for a standby that takes over",
    drivers: &[],
    has_replicas: false,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let resources = &blueprint.host.resources;
    let folder = resources.get::<StateFolder>();
    let path = folder.map(|folder| folder.0.join(format!("{}.redb", blueprint.id)));
    let others = blueprint.host.journals.iter().filter(|other| **other != blueprint.id);
    Ok(Box::new(Journal {
        others: others.cloned().collect(),
        location: StoreLocation { path, memory: resources.get::<MemoryStore>() },
        disk: DiskState::Opening(Vec::new()),
        records: Records::default(),
        queued: Vec::new(),
        work: None,
        fetching: Vec::new(),
        refetched: BTreeSet::new(),
        has_missed_writes: false,
    }))
}

/// Storage location of a Journal's records: a file, or memory.
#[derive(Clone)]
struct StoreLocation {
    path: Option<PathBuf>,
    memory: Option<Arc<MemoryStore>>,
}

struct Journal {
    others: Vec<AgentId>,
    location: StoreLocation,
    disk: DiskState,
    records: Records,
    /// Records for the next write, with the exchange that waits for the answer. The exchange is
    /// `None` for records from another Journal.
    queued: Vec<(Option<Participation>, Vec<Record>)>,
    /// The running write to the file, or the opening of the file.
    work: Option<WorkHandle>,
    fetching: Vec<(AgentId, WorkHandle)>,
    /// Journals whose records are fetched again after a delay.
    refetched: BTreeSet<AgentId>,
    /// Whether the last write failed; other Journals may then have newer records.
    has_missed_writes: bool,
}

enum DiskState {
    /// The file is being opened. Holds the requests that have arrived meanwhile.
    Opening(Vec<(Option<Participation>, Vec<Record>)>),
    Open(Arc<Store>),
    /// The file cannot be used, for the reason in this text.
    Unusable(String),
}

impl Agent for Journal {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, Self::requested)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.open(ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let who = &presence.resident().agent;
        // A fetch is not cancelled, because an answer of a Journal that has left may still arrive.
        if self.others.contains(who) && matches!(presence, Presence::Joined(_)) {
            self.fetch(who.clone(), ctx);
        }
    }

    fn answer_query(&mut self, resource: Resource, _ctx: &mut Context<Self>) -> Option<String> {
        let is_open = matches!(self.disk, DiskState::Open(_));
        (resource == Resource::Journal && is_open).then(|| self.records.to_json())?
    }

    fn drain(&mut self, _ctx: &mut Context<Self>) -> bool {
        self.work.is_none() && self.queued.is_empty()
    }
}

impl Journal {
    fn open(&mut self, ctx: &mut Context<Self>) {
        let place = self.location.clone();
        let opening = ctx.run_blocking(move || open_location(&place));
        self.work = Some(ctx.run(opening, |journal: &mut Self, opened, ctx| {
            journal.work = None;
            journal.opened(
                opened.unwrap_or_else(|error| Err(StoreError::Lost(error.to_string()))),
                ctx,
            );
        }));
    }

    fn opened(
        &mut self,
        opened: Result<(Store, Vec<Record>), StoreError>,
        ctx: &mut Context<Self>,
    ) {
        let disk = match opened {
            Ok((store, records)) => {
                tracing::info!(agent = %ctx.id(), records = records.len(), "the journal is open");
                for record in records {
                    self.records.insert_if_newer(record);
                }
                DiskState::Open(Arc::new(store))
            }
            Err(error) => {
                tracing::error!(agent = %ctx.id(), %error, "the journal keeps nothing");
                ctx.failure_counters().count_not_persisted();
                if error.is_transient() {
                    ctx.after(REOPEN_INTERVAL, |journal: &mut Self, ctx| journal.open(ctx));
                }
                DiskState::Unusable(error.to_string())
            }
        };
        let was_unusable = matches!(self.disk, DiskState::Unusable(_));
        if let DiskState::Opening(early) = std::mem::replace(&mut self.disk, disk) {
            early.into_iter().for_each(|(asker, records)| self.queue_records(asker, records, ctx));
        }
        if was_unusable && matches!(self.disk, DiskState::Open(_)) {
            // This Journal has refused the requests that arrived meanwhile.
            self.fetch_all(ctx);
        }
    }

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        match message.content_as::<Request>() {
            Ok(Request::StoreRecords(StoreRecords { records })) => {
                self.queue_records(Some(participation), records, ctx)
            }
            Ok(_) => ctx.refuse(&participation, Reason::Incapable, "a Journal takes `keep`"),
            Err(error) => ctx.not_understood(&message, error.to_string()),
        }
    }

    /// Queues records for the next write, or refuses them.
    fn queue_records(
        &mut self,
        asker: Option<Participation>,
        records: Vec<Record>,
        ctx: &mut Context<Self>,
    ) {
        match self.try_queue(asker, records, ctx) {
            Ok(()) => (),
            Err((Some(asker), refusal)) => ctx.answer(&asker, Performative::Refuse, &refusal),
            // Records of another Journal, which arrived before it was known how many have room.
            Err((None, _)) => {
                for other in self.others.clone() {
                    self.fetch_after(FETCH_RETRY_DELAY, other, ctx);
                }
            }
        }
    }

    /// Queues records for the next write.
    ///
    /// Returns the exchange that waits for the answer, and the refusal, if the records cannot be
    /// queued.
    fn try_queue(
        &mut self,
        asker: Option<Participation>,
        records: Vec<Record>,
        ctx: &mut Context<Self>,
    ) -> Result<(), (Option<Participation>, Refusal)> {
        let refusal = match &mut self.disk {
            DiskState::Opening(early) if early.len() < QUEUED_MAX => {
                early.push((asker, records));
                return Ok(());
            }
            DiskState::Open(_) if self.queued.len() < QUEUED_MAX => {
                match self.records.rejection_reason(&records) {
                    None => {
                        self.queued.push((asker, records));
                        self.write(ctx);
                        return Ok(());
                    }
                    Some(objection) => Refusal::new(Reason::BadContent, objection),
                }
            }
            DiskState::Unusable(why) => Refusal::new(Reason::Incapable, why.clone()),
            _ => Refusal::new(Reason::Busy, "the disk does not keep up; ask again later"),
        };
        Err((asker, refusal))
    }

    /// Writes all queued records in one transaction, unless a write is running.
    fn write(&mut self, ctx: &mut Context<Self>) {
        let DiskState::Open(store) = &self.disk else { return };
        if self.work.is_some() || self.queued.is_empty() {
            return;
        }
        let waiting = std::mem::take(&mut self.queued);
        let mut newer = Vec::new();
        for record in waiting.iter().flat_map(|(_, records)| records) {
            newer.extend(self.records.is_newer(record).then(|| record.clone()));
        }
        let (store, written) = (Arc::clone(store), newer.clone());
        let surplus = self.records.keys_to_evict(newer.len());
        let gone = surplus.clone();
        let writing = ctx.run_blocking(move || store.write(&written, &gone));
        self.work = Some(ctx.run(writing, move |journal: &mut Self, outcome, ctx| {
            journal.work = None;
            let outcome = outcome.unwrap_or_else(|error| Err(StoreError::Lost(error.to_string())));
            journal.written(waiting, newer, &surplus, outcome, ctx);
            journal.write(ctx);
        }));
    }

    fn written(
        &mut self,
        waiting: Vec<(Option<Participation>, Vec<Record>)>,
        newer: Vec<Record>,
        gone: &[String],
        outcome: Result<(), StoreError>,
        ctx: &mut Context<Self>,
    ) {
        if outcome.is_ok() {
            gone.iter().for_each(|key| self.records.remove_key(key));
            newer.into_iter().for_each(|record| self.records.insert_if_newer(record));
        }
        if let Err(error) = &outcome {
            tracing::error!(agent = %ctx.id(), %error, "records are not kept");
            ctx.failure_counters().count_not_persisted();
        }
        let was_behind = std::mem::replace(&mut self.has_missed_writes, outcome.is_err());
        if was_behind && outcome.is_ok() {
            self.fetch_all(ctx);
        }
        for asker in waiting.into_iter().filter_map(|(asker, _)| asker) {
            match &outcome {
                Ok(()) => {
                    let report = Report::new(Outcome::Done, "kept");
                    ctx.answer(&asker, Performative::Confirm, &report);
                }
                Err(error) => {
                    let refusal = Refusal::new(Reason::Other, error.to_string());
                    ctx.answer(&asker, Performative::Refuse, &refusal);
                }
            }
        }
    }

    fn fetch_all(&mut self, ctx: &mut Context<Self>) {
        self.others.clone().into_iter().for_each(|other| self.fetch(other, ctx));
    }

    /// Fetches all records of another Journal, and stores those that are newer than the records
    /// here.
    fn fetch(&mut self, other: AgentId, ctx: &mut Context<Self>) {
        if ctx.find(&other).is_none() {
            return;
        }
        let asked = ctx.ask(Resource::Journal, &other);
        let from = other.clone();
        let work = ctx.run(asked, move |journal: &mut Self, answers, ctx| {
            journal.fetching.retain(|(other, _)| *other != from);
            let mut again = answers.is_empty().then_some(FETCH_RETRY_DELAY);
            for answer in answers {
                match serde_json::from_slice::<Vec<Record>>(&answer) {
                    Ok(records) => again = again.max(journal.copy_records(&from, records, ctx)),
                    Err(error) => tracing::info!(%from, %error, "an answer cannot be read"),
                }
            }
            again.into_iter().for_each(|wait| journal.fetch_after(wait, from.clone(), ctx));
        });
        self.fetching.retain(|(fetching, _)| *fetching != other);
        self.fetching.push((other, work));
    }

    /// Fetches the records of another Journal after `wait`, unless that is planned already.
    fn fetch_after(&mut self, wait: Duration, other: AgentId, ctx: &mut Context<Self>) {
        if !self.refetched.insert(other.clone()) {
            return;
        }
        ctx.after(wait, move |journal: &mut Self, ctx| {
            journal.refetched.remove(&other);
            journal.fetch(other, ctx);
        });
    }

    /// Queues those records of another Journal that are newer than the records here. Returns the
    /// delay after which they must be fetched again, because some cannot be queued now; `None` if
    /// all are queued.
    fn copy_records(
        &mut self,
        from: &AgentId,
        mut records: Vec<Record>,
        ctx: &mut Context<Self>,
    ) -> Option<Duration> {
        records.retain(|record| self.records.is_newer(record));
        if records.is_empty() {
            return None;
        }
        let SplitRecords { kept, malformed, without_room } = self.records.split(records);
        for reason in malformed {
            tracing::warn!(agent = %ctx.id(), %from, reason, "a record of another Journal is not kept");
        }
        if without_room > 0 {
            tracing::warn!(agent = %ctx.id(), %from, without_room,
                "there is no room for records of another Journal: they are fetched again");
        }
        let again = (without_room > 0).then_some(ROOM_RETRY_DELAY);
        if kept.is_empty() {
            return again;
        }
        tracing::info!(agent = %ctx.id(), %from, records = kept.len(),
            "copies records of another Journal");
        match self.try_queue(None, kept, ctx) {
            Ok(()) => again,
            // The next success after `Unusable` fetches by itself.
            Err((_, Refusal { reason: Reason::Incapable, .. })) => again,
            Err(_) => Some(FETCH_RETRY_DELAY),
        }
    }
}

fn open_location(place: &StoreLocation) -> Result<(Store, Vec<Record>), StoreError> {
    match (&place.memory, &place.path) {
        (Some(shelf), _) => Ok(Store::in_memory(shelf)),
        (None, Some(path)) => Store::open(path),
        (None, None) => Err(StoreError::Nowhere),
    }
}
