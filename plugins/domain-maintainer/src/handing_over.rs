//! What a Domain Maintainer that stands down tells who acts now (design, “No single point of failure”):
//! what requests changed while both acted, each in its piece of a partition.
//!
//! Nobody says it again by itself, so it is told until it is heard. Of what was changed in both, the word
//! that was given to who goes on stands.

use std::collections::BTreeSet;
use std::time::Duration;

use acl::content::{
    Keeping, Outcome, Reason, Record, Refusal, Report, Request, RequestedSince, value,
};
use acl::{DaemonId, Deadline, Message, Performative, Protocol};
use agent::upkeep;
use agent::{Answer, Context, Engagement, Opening};
use capability::{Moment, RequestsSince};

use crate::{DomainMaintainer, REQUESTED, Tells};

/// How long before it is told again where nobody has heard it, and how often: who acts may have left
/// in the same moment, and a partition lasts minutes.
const AGAIN: Duration = Duration::from_secs(1);
const TIMES_MAX: u32 = 600;

/// How long all that can act have to see each other before nobody has anything to hand over.
const SETTLED: Duration = Duration::from_secs(10);

/// The others that can act in its stead.
#[derive(Debug, Default)]
pub(crate) struct Namesakes {
    /// Where one was seen, that has not come back if it is not here.
    met: BTreeSet<DaemonId>,
    /// Since when all of them are here.
    together: Option<Moment>,
}

impl DomainMaintainer {
    /// Sees whether another may act elsewhere: from before the first change that it may not hear of,
    /// changes are noted. To be called before anything is changed.
    pub(crate) fn look_around(&mut self, ctx: &Context<Self>) {
        let (directory, own) = (ctx.directory(), ctx.switchboard().daemon());
        let daemons = directory.all(ctx.id()).iter().map(|resident| &resident.daemon);
        let here: BTreeSet<_> = daemons.filter(|daemon| *daemon != own).cloned().collect();
        let now = self.upkeep.moment();
        let Namesakes { met, together } = &mut self.namesakes;
        if !met.is_subset(&here) {
            *together = None;
            self.upkeep.maintainer.part();
        } else if !here.is_empty() {
            *met = here;
            let since = *together.get_or_insert(now);
            if self.is_leading && now.since(since) >= SETTLED {
                self.upkeep.maintainer.reunite();
            }
        }
    }

    /// Another acts. What was changed here is told to it.
    pub(crate) fn stand_down(&mut self, ctx: &mut Context<Self>) {
        let changed = self.upkeep.maintainer.stand_down(self.upkeep.moment());
        if changed != RequestedSince::default() {
            self.hand_over(changed, 0, ctx);
        }
    }

    fn hand_over(&mut self, changed: RequestedSince, times: u32, ctx: &mut Context<Self>) {
        if self.is_leading {
            // Its turn has come again.
            self.reconcile(&changed, ctx);
            return;
        }
        let acts = ctx.find(ctx.id()).map(|resident| resident.incarnation);
        if acts.is_none_or(|life| life == ctx.incarnation()) {
            // Who it is that acts is not known here yet.
            return tell_again(changed, times, ctx);
        }
        let record = self.keeper.write(REQUESTED.to_owned(), value(&changed));
        let opening = Opening {
            to: Some(ctx.id().clone()),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: ctx.new_conversation(),
            content: value(&Request::Keep(Keeping { records: vec![record] })),
        };
        let mut changed = Some(changed);
        let patience = ctx.settings().answer_deadline;
        ctx.open(opening, patience, move |_: &mut Self, answer, ctx| {
            let Some(changed) = changed.take() else { return };
            match answer {
                Answer::Message(message) if message.performative == Performative::Confirm => (),
                _ => tell_again(changed, times, ctx),
            }
        });
    }

    /// Another life of this agent has stood down, and says what was changed there.
    pub(crate) fn handed(&mut self, message: &Message, handed: &Keeping, ctx: &mut Context<Self>) {
        if message.sender != *ctx.id() || message.incarnation == ctx.incarnation() {
            // While it was on its way, the name came back to who sent it. It is told again.
            let detail = "only who stands by for it hands something over to a Domain Maintainer";
            let refusal = Refusal::new(Reason::Incapable, detail);
            return ctx.answer(&Engagement::of(message), Performative::Refuse, &refusal);
        }
        let engagement = Engagement::of(message);
        for Record { body, .. } in handed.records.iter().filter(|record| record.key == REQUESTED) {
            match serde_json::from_value(body.clone()) {
                Ok(changed) => self.reconcile(&changed, ctx),
                Err(error) => return ctx.not_understood(message, error.to_string()),
            }
        }
        let report = Report::new(Outcome::Done, "taken over");
        ctx.answer(&engagement, Performative::Confirm, &report);
    }

    fn reconcile(&mut self, changed: &RequestedSince, ctx: &mut Context<Self>) {
        let now = self.upkeep.moment();
        let read = RequestsSince::read(changed, now).map_err(|mistakes| {
            mistakes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; ")
        });
        let taken = read.and_then(|read| {
            let taken = self.upkeep.maintainer.reconcile(&read, now);
            taken.map_err(|declined| declined.to_string())
        });
        match taken {
            Ok(change) => {
                tracing::info!("takes over what was requested of another that acted apart");
                self.tells = Tells::All;
                upkeep::conclude(self, &change, ctx);
                self.announce_requests(ctx);
            }
            Err(why) => tracing::warn!(why, "what was requested of another cannot be taken over"),
        }
    }
}

/// Says it once more, a moment later, unless that was done too often.
fn tell_again(changed: RequestedSince, times: u32, ctx: &mut Context<DomainMaintainer>) {
    if times >= TIMES_MAX {
        return tracing::warn!("nobody takes over what was requested here");
    }
    ctx.after(AGAIN, move |maintainer: &mut DomainMaintainer, ctx| {
        maintainer.hand_over(later(changed, AGAIN), times + 1, ctx);
    });
}

/// What of it is still known after a while.
fn later(mut changed: RequestedSince, by: Duration) -> RequestedSince {
    changed.facts.retain_mut(|fact| match &mut fact.known_for {
        None => true,
        Some(Deadline(left)) => {
            *left = left.saturating_sub(by);
            !left.is_zero()
        }
    });
    changed
}
