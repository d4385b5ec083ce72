//! What a Plan Requester that stands down tells who acts now (design, “No single point of failure”).
//!
//! The Journals may not have it: it was asked for on an island without any, or ended an instant ago.
//! So it is told directly, until it is heard; of each goal the later version counts, as ever.

use std::time::Duration;

use acl::content::{Keeping, Outcome, Record, Report, Request, value};
use acl::{Message, Performative, Protocol};
use agent::keeping::Keeps as _;
use agent::{Answer, Context, Engagement, Opening};

use crate::PlanRequester;
use crate::resuming::conversation_of;

/// How long before it is told again where nobody has heard it, and how often: who acts may have left
/// in the same moment, and a partition lasts minutes.
const AGAIN: Duration = Duration::from_secs(1);
const TIMES_MAX: u32 = 600;

impl PlanRequester {
    /// Tells who acts now what this one knew, until it is heard.
    pub(crate) fn hand_over(&mut self, records: Vec<Record>, times: u32, ctx: &mut Context<Self>) {
        if records.is_empty() {
            return;
        }
        if self.keeper.is_leading() {
            // Its turn has come again.
            return self.take_over(records, ctx);
        }
        let acts = ctx.find(ctx.id()).map(|resident| resident.incarnation);
        if acts.is_none_or(|life| life == ctx.incarnation()) {
            // Who it is that acts is not known here yet.
            return tell_again(records, times, ctx);
        }
        let opening = Opening {
            to: Some(ctx.id().clone()),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: ctx.new_conversation(),
            content: value(&Request::Keep(Keeping { records: records.clone() })),
        };
        let mut records = Some(records);
        let patience = ctx.settings().answer_deadline;
        ctx.open(opening, patience, move |_: &mut Self, answer, ctx| {
            let Some(records) = records.take() else { return };
            match answer {
                Answer::Message(message) if message.performative == Performative::Confirm => (),
                _ => tell_again(records, times, ctx),
            }
        });
    }

    /// Another life of this agent has stood down, and says what it knew.
    pub(crate) fn handed(
        &mut self,
        message: &Message,
        records: Vec<Record>,
        ctx: &mut Context<Self>,
    ) {
        if message.incarnation == ctx.incarnation() {
            // While it was on its way, the name came back to who sent it. It is told again.
            return;
        }
        let engagement = Engagement::of(message);
        self.take_over(records, ctx);
        let report = Report::new(Outcome::Done, "taken over");
        ctx.answer(&engagement, Performative::Confirm, &report);
    }

    fn take_over(&mut self, records: Vec<Record>, ctx: &mut Context<Self>) {
        let life = ctx.incarnation();
        self.keeper.learn(life, &records);
        let handed: Vec<_> = records
            .iter()
            .filter_map(|record| Some((conversation_of(&record.key)?, record.version)))
            .collect();
        self.recalled(records, ctx);
        for (id, version) in handed {
            // It goes on here; and it is not known whether any Journal has it.
            if self.goals.get(&id).is_some_and(|goal| goal.version == version) {
                self.accept(&id, ctx);
            }
        }
    }
}

/// Says it once more, a moment later, unless that was done too often.
fn tell_again(records: Vec<Record>, times: u32, ctx: &mut Context<PlanRequester>) {
    if times >= TIMES_MAX {
        return tracing::warn!(goals = records.len(), "nobody takes over what it knew");
    }
    ctx.after(AGAIN, move |requester: &mut PlanRequester, ctx| {
        requester.hand_over(records, times + 1, ctx);
    });
}
