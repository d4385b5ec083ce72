//! The daemons: whether each answers, and what it says about itself.

use std::collections::{BTreeMap, VecDeque};

use acl::DaemonId;
use acl::content::{DaemonReport, Mailboxes};

use crate::moment::Moment;
use crate::rows::MailboxSums;
use crate::text::cut;
use crate::usual_times::median;

/// Number of round trips of one daemon that are kept.
const ROUND_TRIPS_KEPT: usize = 15;

/// Maximum number of agents in a list of one daemon.
const AGENTS_MAX: usize = 1_000;

/// Maximum number of kinds of rejected messages that are kept.
const KINDS_MAX: usize = 64;

#[derive(Clone, Debug, Default)]
pub(crate) struct DaemonRecord {
    /// Whether the daemon has answered the last query; `None` if it has never answered one.
    pub(crate) is_reached: Option<bool>,
    /// Whether the ecosystem file names the daemon.
    pub(crate) is_expected: bool,
    pub(crate) seen_at: Option<Moment>,
    round_trips: VecDeque<u64>,
    pub(crate) status: Option<(Moment, DaemonReport)>,
    pub(crate) mailboxes: Option<MailboxSums>,
    /// How much the counters of problems have grown since the first report.
    pub(crate) grown: MailboxSums,
    first: Option<MailboxSums>,
}

impl DaemonRecord {
    /// Whether the record is known to be one of a daemon. Other processes host agents, too, and do
    /// not report about themselves.
    pub(crate) fn is_daemon(&self) -> bool {
        self.is_expected || self.is_reached.is_some()
    }

    pub(crate) fn round_trip(&self) -> Option<u64> {
        self.round_trips.back().copied()
    }

    pub(crate) fn usual_round_trip(&self) -> Option<u64> {
        median(self.round_trips.iter().copied())
    }
}

#[derive(Clone, Debug)]
pub(crate) struct DaemonStore {
    daemons: BTreeMap<DaemonId, DaemonRecord>,
    daemons_max: usize,
    text_bytes: usize,
}

impl DaemonStore {
    pub(crate) fn new(daemons_max: usize, text_bytes: usize) -> DaemonStore {
        DaemonStore { daemons: BTreeMap::new(), daemons_max, text_bytes }
    }

    pub(crate) fn get(&self, daemon: &DaemonId) -> Option<&DaemonRecord> {
        self.daemons.get(daemon)
    }

    /// Iterates over the daemons. Until one has answered, all hosts of agents are taken as daemons.
    pub(crate) fn iter(&self) -> impl Iterator<Item = (&DaemonId, &DaemonRecord)> {
        let is_any_known = self.daemons.values().any(DaemonRecord::is_daemon);
        self.daemons.iter().filter(move |(_, record)| record.is_daemon() || !is_any_known)
    }

    /// Returns the record of a daemon. Guests are processes of commands, and no daemons.
    fn seen(&mut self, at: Moment, daemon: &DaemonId) -> Option<&mut DaemonRecord> {
        if daemon.is_guest() {
            return None;
        }
        if !self.daemons.contains_key(daemon) && self.daemons.len() >= self.daemons_max {
            let oldest = self.daemons.iter().min_by_key(|(_, record)| record.seen_at);
            let oldest = oldest.map(|(daemon, _)| daemon.clone())?;
            self.daemons.remove(&oldest);
        }
        let record = self.daemons.entry(daemon.clone()).or_default();
        record.seen_at = Some(at);
        Some(record)
    }

    /// Notes that a daemon hosts an agent.
    pub(crate) fn hosts(&mut self, at: Moment, daemon: &DaemonId) {
        self.seen(at, daemon);
    }

    pub(crate) fn round_trip(&mut self, at: Moment, daemon: &DaemonId, micros: u64) {
        let Some(record) = self.seen(at, daemon) else { return };
        record.is_reached = Some(true);
        record.round_trips.push_back(micros);
        if record.round_trips.len() > ROUND_TRIPS_KEPT {
            record.round_trips.pop_front();
        }
    }

    /// Takes the names of the daemons in the ecosystem file.
    pub(crate) fn expected<'d>(&mut self, daemons: impl Iterator<Item = &'d DaemonId>) {
        self.daemons.values_mut().for_each(|record| record.is_expected = false);
        for daemon in daemons {
            if self.daemons.contains_key(daemon) || self.daemons.len() < self.daemons_max {
                self.daemons.entry(daemon.clone()).or_default().is_expected = true;
            }
        }
    }

    /// Notes that a daemon has not answered a query. A process that has never answered one may be
    /// no daemon.
    pub(crate) fn no_answer(&mut self, daemon: &DaemonId) {
        let known = self.daemons.get_mut(daemon).filter(|record| record.is_daemon());
        if let Some(record) = known {
            record.is_reached = Some(false);
        }
    }

    /// Returns whether a daemon restarted since its last report.
    pub(crate) fn status(&mut self, at: Moment, mut status: DaemonReport) -> bool {
        let text_bytes = self.text_bytes;
        let Some(record) = self.seen(at, &status.daemon.clone()) else { return false };
        status.version = cut(&status.version, text_bytes);
        status.leads.truncate(AGENTS_MAX);
        status.stands_by.truncate(AGENTS_MAX);
        record.is_reached = Some(true);
        let is_restart =
            record.status.as_ref().is_some_and(|(_, former)| former.uptime > status.uptime);
        record.status = Some((at, status));
        is_restart
    }

    pub(crate) fn mailboxes(&mut self, at: Moment, mailboxes: &Mailboxes) {
        let totals = totals(mailboxes, self.text_bytes);
        let Some(record) = self.seen(at, &mailboxes.daemon) else { return };
        let first = record.first.get_or_insert_with(|| totals.clone());
        if totals.received < first.received {
            // The daemon was restarted, and counts from zero.
            *first = totals.clone();
        }
        record.grown = growth(first, &totals);
        record.mailboxes = Some(totals);
    }
}

fn totals(mailboxes: &Mailboxes, text_bytes: usize) -> MailboxSums {
    let mut totals = MailboxSums {
        unknown_receiver: mailboxes.unknown_receiver,
        unreadable: mailboxes.unreadable,
        not_sent: mailboxes.not_sent,
        not_persisted: mailboxes.not_persisted,
        ..MailboxSums::default()
    };
    let rejected = mailboxes.rejected.iter().take(KINDS_MAX);
    totals.rejected = rejected.map(|(kind, count)| (cut(kind, text_bytes), *count)).collect();
    for mailbox in &mailboxes.mailboxes {
        totals.waiting = totals.waiting.saturating_add(mailbox.waiting);
        totals.waiting_max = totals.waiting_max.max(mailbox.waiting_max);
        totals.received = totals.received.saturating_add(mailbox.received);
        totals.overflowed = totals.overflowed.saturating_add(mailbox.overflowed);
    }
    totals
}

fn growth(first: &MailboxSums, now: &MailboxSums) -> MailboxSums {
    let rejected = now.rejected.iter().map(|(kind, count)| {
        let before = first.rejected.get(kind).copied().unwrap_or(0);
        (kind.clone(), count.saturating_sub(before))
    });
    MailboxSums {
        waiting: 0,
        waiting_max: 0,
        received: now.received.saturating_sub(first.received),
        overflowed: now.overflowed.saturating_sub(first.overflowed),
        unknown_receiver: now.unknown_receiver.saturating_sub(first.unknown_receiver),
        unreadable: now.unreadable.saturating_sub(first.unreadable),
        not_sent: now.not_sent.saturating_sub(first.not_sent),
        not_persisted: now.not_persisted.saturating_sub(first.not_persisted),
        rejected: rejected.filter(|(_, count)| *count > 0).collect(),
    }
}
