//! Hand-over from a leader that becomes a standby to the new leader (docs/design.md, “Fail-over”).
//!
//! The Journals may lack two kinds of goals: goals that were requested in a partition without a
//! Journal, and goals that ended a moment ago. Therefore the former leader sends its records to the
//! new leader directly, until the new leader confirms them. Of two records of a goal the later
//! version applies, as for records from the Journals.

use std::time::Duration;

use acl::content::{Outcome, Record, Report, Request, StoreRecords, value};
use acl::{Message, Performative, Protocol};
use agent::{Context, ExchangeEvent, ExchangeOpening, Participation};

use crate::PlanRequester;
use crate::failover::conversation_of;

/// Interval between attempts to hand the records over, and the maximum number of repetitions. The
/// new leader may have left at the same moment, and a partition may last for minutes.
const AGAIN: Duration = Duration::from_secs(1);
const TIMES_MAX: u32 = 600;

impl PlanRequester {
    /// Sends the records of this replica to the new leader, until the new leader confirms them.
    /// `times` is the number of earlier attempts.
    pub(crate) fn hand_over(&mut self, records: Vec<Record>, times: u32, ctx: &mut Context<Self>) {
        if records.is_empty() {
            return;
        }
        if self.journal_client.is_leading() {
            // This replica is the leader again.
            return self.adopt_records(records, ctx);
        }
        let acts = ctx.find(ctx.id()).map(|resident| resident.incarnation);
        if acts.is_none_or(|incarnation| incarnation == ctx.incarnation()) {
            // The new leader has not been discovered here yet.
            return retry_handover(records, times, ctx);
        }
        let opening = ExchangeOpening {
            to: Some(ctx.id().clone()),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: ctx.new_conversation(),
            content: value(&Request::StoreRecords(StoreRecords { records: records.clone() })),
        };
        let mut records = Some(records);
        let patience = ctx.settings().answer_deadline;
        ctx.open(opening, patience, move |_: &mut Self, answer, ctx| {
            let Some(records) = records.take() else { return };
            match answer {
                ExchangeEvent::Message(message)
                    if message.performative == Performative::Confirm => {}
                _ => retry_handover(records, times, ctx),
            }
        });
    }

    /// Takes over the records of another incarnation of this agent that has become a standby.
    pub(crate) fn receive_handover(
        &mut self,
        message: &Message,
        records: Vec<Record>,
        ctx: &mut Context<Self>,
    ) {
        if message.incarnation == ctx.incarnation() {
            // The message has returned to its own sender, which has become the leader meanwhile.
            // The sender tries again.
            return;
        }
        let participation = Participation::of(message);
        self.adopt_records(records, ctx);
        let report = Report::new(Outcome::Done, "taken over");
        ctx.answer(&participation, Performative::Confirm, &report);
    }

    fn adopt_records(&mut self, records: Vec<Record>, ctx: &mut Context<Self>) {
        let incarnation = ctx.incarnation();
        self.journal_client.advance_term_past(incarnation, &records);
        let handed: Vec<_> = records
            .iter()
            .filter_map(|record| Some((conversation_of(&record.key)?, record.version)))
            .collect();
        self.merge_records(records, false, ctx);
        self.replicate_all_due(ctx);
        for (id, version) in handed {
            // The goal continues here, and it is unknown whether any Journal has this record.
            if self.goals.get(&id).is_some_and(|goal| goal.version == version) {
                self.replicate_new_goal(&id, ctx);
            }
        }
    }
}

/// Retries the hand-over after [`AGAIN`], unless it was retried [`TIMES_MAX`] times already.
fn retry_handover(records: Vec<Record>, times: u32, ctx: &mut Context<PlanRequester>) {
    if times >= TIMES_MAX {
        return tracing::warn!(goals = records.len(), "no leader takes these goals over");
    }
    ctx.after(AGAIN, move |requester: &mut PlanRequester, ctx| {
        requester.hand_over(records, times + 1, ctx);
    });
}
