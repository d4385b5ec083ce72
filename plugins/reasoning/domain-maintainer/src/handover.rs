//! Hand-over after a partition: a Domain Maintainer that becomes a standby sends to the leader the
//! requested changes that it recorded while both led, each in its own partition (docs/design.md,
//! “Fail-over”).
//!
//! No agent repeats requested changes by itself; therefore the hand-over is retried until it is
//! confirmed. If both sides have changed the same fact, the change of the remaining leader applies.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{
    Outcome, Reason, Record, Refusal, Report, Request, RequestedSince, StoreRecords, value,
};
use acl::{DaemonId, Message, Millis, Performative, Protocol};
use agent::domain_sync;
use agent::{Context, ExchangeEvent, ExchangeOpening, Participation};
use capability::{RequestedChangesSince, Timestamp};

use crate::{AnnouncementScope, DomainMaintainer, REQUESTED};

/// Interval between attempts to hand changes over, and the maximum number of repetitions. The new
/// leader may have left at the same moment, and a partition may last for minutes.
const RETRY_INTERVAL: Duration = Duration::from_secs(1);
const RETRIES_MAX: u32 = 600;

/// Time for which all replicas must be present before the leader drops the changes that it recorded
/// for a hand-over.
const REUNITED_AFTER: Duration = Duration::from_secs(10);

/// Other replicas of this agent, and the time since which they are present.
#[derive(Debug, Default)]
pub(crate) struct KnownReplicas {
    /// Daemons on which other replicas were present. A daemon in this set that is not present has
    /// left and not returned.
    seen_on: BTreeSet<DaemonId>,
    /// Time since which the replicas on all these daemons are present; `None` if one is missing.
    complete_since: Option<Timestamp>,
}

impl DomainMaintainer {
    /// Checks whether another leader may be active in another partition; if so, begins to record
    /// changes. Must be called before each change, so that every change is recorded.
    pub(crate) fn check_replicas(&mut self, ctx: &Context<Self>) {
        let (directory, own) = (ctx.directory(), ctx.daemon());
        let daemons = directory.all(ctx.id()).iter().map(|resident| &resident.daemon);
        let here: BTreeSet<_> = daemons.filter(|daemon| *daemon != own).cloned().collect();
        let now = self.domain_sync.timestamp();
        let KnownReplicas { seen_on: met, complete_since: together } = &mut self.known_replicas;
        if !met.is_subset(&here) {
            *together = None;
            self.domain_sync.maintainer.begin_partition_log();
        } else if !here.is_empty() {
            *met = here;
            let since = *together.get_or_insert(now);
            // Before the Journals are read, the log tells what is younger than their record.
            let is_over = self.has_base && now.since(since) >= REUNITED_AFTER;
            if self.is_leading && is_over {
                self.domain_sync.maintainer.drop_partition_log();
            }
        }
    }

    /// Stands down as leader: sends the changes that were recorded for a hand-over to the new
    /// leader.
    pub(crate) fn stand_down(&mut self, ctx: &mut Context<Self>) {
        let changed = self.domain_sync.maintainer.stand_down(self.domain_sync.timestamp());
        if changed != RequestedSince::default() {
            self.hand_over(changed, 0, ctx);
        }
    }

    fn hand_over(&mut self, changed: RequestedSince, times: u32, ctx: &mut Context<Self>) {
        if self.is_leading {
            // This replica leads again.
            self.reconcile(&changed, ctx);
            return;
        }
        let acts = ctx.find(ctx.id()).map(|resident| resident.incarnation);
        if acts.is_none_or(|incarnation| incarnation == ctx.incarnation()) {
            // The new leader has not been discovered here yet.
            return retry_handover(changed, times, ctx);
        }
        let record = self.journal_client.write(REQUESTED.to_owned(), value(&changed));
        let opening = ExchangeOpening {
            to: Some(ctx.id().clone()),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: ctx.new_conversation(),
            content: value(&Request::StoreRecords(StoreRecords { records: vec![record] })),
        };
        let mut changed = Some(changed);
        let patience = ctx.settings().answer_deadline;
        ctx.open(opening, patience, move |_: &mut Self, answer, ctx| {
            let Some(changed) = changed.take() else { return };
            match answer {
                ExchangeEvent::Message(message)
                    if message.performative == Performative::Confirm => {}
                _ => retry_handover(changed, times, ctx),
            }
        });
    }

    /// Takes over the changes of another incarnation of this agent that has become a standby.
    pub(crate) fn receive_handover(
        &mut self,
        message: &Message,
        handed: &StoreRecords,
        ctx: &mut Context<Self>,
    ) {
        if message.sender != *ctx.id() || message.incarnation == ctx.incarnation() {
            // If the sender leads again, the message has returned to its own sender, which tries
            // again.
            let detail = "a Domain Maintainer takes changes over only from its own standby";
            let refusal = Refusal::new(Reason::Incapable, detail);
            return ctx.answer(&Participation::of(message), Performative::Refuse, &refusal);
        }
        let participation = Participation::of(message);
        for Record { body, .. } in handed.records.iter().filter(|record| record.key == REQUESTED) {
            match serde_json::from_value(body.clone()) {
                Ok(changed) => self.reconcile(&changed, ctx),
                Err(error) => return ctx.not_understood(message, error.to_string()),
            }
        }
        let report = Report::new(Outcome::Done, "taken over");
        ctx.answer(&participation, Performative::Confirm, &report);
    }

    fn reconcile(&mut self, changed: &RequestedSince, ctx: &mut Context<Self>) {
        let now = self.domain_sync.timestamp();
        let read = RequestedChangesSince::read(changed, now).map_err(|mistakes| {
            mistakes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
        });
        let taken = read.and_then(|read| {
            let taken = self.domain_sync.maintainer.merge_partition_log(&read, now);
            taken.map_err(|declined| declined.to_string())
        });
        match taken {
            Ok(change) => {
                tracing::info!("takes over the requests of another leader, after a partition");
                self.announcement_scope = AnnouncementScope::Full;
                domain_sync::report_change(self, &change, ctx);
                self.announce_requests(ctx);
            }
            Err(why) => tracing::warn!(why, "the requests of another leader cannot be taken over"),
        }
    }
}

/// Retries the hand-over after [`RETRY_INTERVAL`], unless it was retried [`RETRIES_MAX`] times
/// already.
fn retry_handover(changed: RequestedSince, times: u32, ctx: &mut Context<DomainMaintainer>) {
    if times >= RETRIES_MAX {
        return tracing::warn!("no leader takes over what was requested here");
    }
    ctx.after(RETRY_INTERVAL, move |maintainer: &mut DomainMaintainer, ctx| {
        maintainer.hand_over(with_time_passed(changed, RETRY_INTERVAL), times + 1, ctx);
    });
}

/// Returns the requested changes `changed` with the remaining times of their facts reduced by `by`;
/// expired facts are dropped.
fn with_time_passed(mut changed: RequestedSince, by: Duration) -> RequestedSince {
    changed.facts.retain_mut(|fact| match &mut fact.known_for {
        None => true,
        Some(Millis(left)) => {
            *left = left.saturating_sub(by);
            !left.is_zero()
        }
    });
    changed
}
