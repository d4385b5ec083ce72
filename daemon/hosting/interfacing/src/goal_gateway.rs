//! The goal gateway: the agent that accepts goals in one ecosystem for the other ecosystem.
//!
//! A goal gateway accepts goals over the predicates of its rule, translates them, and requests them
//! from the Plan Requester of the other ecosystem. The goal gateway passes reports about each goal
//! back to the initiator, in texts of its own. A goal of a proxy agent is refused: otherwise two
//! goal gateways could pass one goal to each other for ever.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use acl::content::{Achieve, Outcome, Reason, Refusal, Report, Request};
use acl::{AgentId, EcosystemId, Message, Performative, ReplyToken};
use agent::{Agent, Callbacks, Context, Participation, WorkHandle};
use keyboard::GoalRequest;
use pddl::{Domain, Problem};

use super::export;
use super::proxy_device::InterfaceCounters;
use super::rate_limiter::RateLimiter;
use super::remote_client::{RemoteClient, RemoteRequest, RemoteUpdate};
use super::translate::Translator;
use super::vocabulary::InterfaceVocabulary;

/// Maximum number of goals that one goal gateway follows at a time; further goals are refused.
const GOALS_MAX: usize = 64;

pub(super) struct GoalGateway {
    /// Name of the other ecosystem, to which the goals are passed.
    pub(super) far: EcosystemId,
    /// Predicates that goals may contain, by their names on the near side, where the goals are
    /// requested.
    pub(super) goals: BTreeSet<String>,
    /// Vocabulary of the interface for goals: far name of each near symbol.
    pub(super) vocabulary: InterfaceVocabulary,
    pub(super) near: (Arc<Domain>, Arc<Problem>),
    pub(super) revocable: bool,
    pub(super) client: RemoteClient,
    pub(super) outward: Arc<RateLimiter>,
    pub(super) counters: Arc<InterfaceCounters>,
    /// Open goals, by initiator and token. The token alone is not enough, because different
    /// initiators may use the same token.
    pub(super) open: BTreeMap<RequestKey, WorkHandle>,
}

/// Key of a request: its initiator, and the token that the initiator gave the request.
pub(super) type RequestKey = (AgentId, ReplyToken);

impl Agent for GoalGateway {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
    }
}

impl GoalGateway {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let achieve = match message.content_as::<Request>() {
            Ok(Request::Achieve(achieve)) => achieve,
            Ok(_) => {
                let detail = "this agent takes goals: `achieve`";
                return ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        match self.admit(&message, achieve) {
            Ok(wish) => self.forward(participation, wish, ctx),
            Err(refusal) => ctx.answer(&participation, Performative::Refuse, &refusal),
        }
    }

    /// Translates a requested goal. Returns a refusal if the goal must not pass to the other
    /// ecosystem.
    fn admit(&self, message: &Message, achieve: Achieve) -> Result<GoalRequest, Refusal> {
        let GoalGateway { far, goals, vocabulary, near, outward, counters, .. } = self;
        if !message.via.is_empty() {
            counters.looped_goals.fetch_add(1, Ordering::Relaxed);
            let detail = "it comes from another ecosystem itself, and is not passed on";
            return Err(Refusal::new(Reason::Conflict, detail));
        }
        let Achieve { goal, keep, priority, partition } = achieve;
        let translator = Translator::of_ontology(vocabulary, (&near.0, &near.1));
        let goal = export::goal(&goal, goals, &translator).map_err(|why| {
            counters.unexported.fetch_add(1, Ordering::Relaxed);
            Refusal::new(Reason::BadContent, why)
        })?;
        if self.open.len() >= GOALS_MAX {
            let detail = format!("{GOALS_MAX} goals have passed and are not reached yet");
            return Err(Refusal::new(Reason::Busy, detail));
        }
        if !outward.try_acquire() {
            counters.over_rate.fetch_add(1, Ordering::Relaxed);
            let rate = outward.per_second();
            let detail = format!("{rate} messages a second may pass to `{far}`; ask again later");
            return Err(Refusal::new(Reason::Busy, detail));
        }
        Ok(GoalRequest { goal, keep, priority, partition })
    }

    fn forward(
        &mut self,
        participation: Participation,
        wish: GoalRequest,
        ctx: &mut Context<Self>,
    ) {
        self.counters.passed.fetch_add(1, Ordering::Relaxed);
        let (client, revocable) = (self.client.clone(), self.revocable);
        let asked = async move { client.request_goal(wish, revocable).await };
        let asking = request_key(&participation);
        let work = ctx.run(asked, move |gateway: &mut Self, asked, ctx| {
            gateway.await_update(participation, asked, ctx);
        });
        self.open.insert(asking, work);
    }

    /// Waits for the next report from the other ecosystem about a goal.
    fn await_update(
        &mut self,
        participation: Participation,
        mut asked: RemoteRequest,
        ctx: &mut Context<Self>,
    ) {
        let asking = request_key(&participation);
        let next = async move {
            let news = asked.next().await;
            (news, asked)
        };
        let work = ctx.run(next, move |gateway: &mut Self, (news, asked), ctx| {
            gateway.answer(&participation, &news, ctx);
            if news.is_final() {
                gateway.open.remove(&self::request_key(&participation));
            } else {
                gateway.await_update(participation, asked, ctx);
            }
        });
        self.open.insert(asking, work);
    }

    /// Reports the state of a goal to the initiator. The texts of the other ecosystem are not
    /// passed on.
    fn answer(
        &mut self,
        participation: &Participation,
        news: &RemoteUpdate,
        ctx: &mut Context<Self>,
    ) {
        let far = &self.far;
        match news {
            RemoteUpdate::Report(report) => {
                let detail = match report.outcome {
                    Outcome::Progress => format!("`{far}` works on it"),
                    Outcome::Holds | Outcome::Done => format!("`{far}` says that it holds"),
                    Outcome::Failed => format!("`{far}` cannot reach it"),
                    Outcome::Cancelled => format!("`{far}` has given it up"),
                };
                ctx.answer(
                    participation,
                    Performative::Confirm,
                    &Report::new(report.outcome, detail),
                );
            }
            RemoteUpdate::Refused(refusal) => {
                ctx.refuse(participation, refusal.reason, format!("`{far}` declines"));
            }
            RemoteUpdate::Unanswered => {
                let detail = format!("no agent of `{far}` answers");
                ctx.refuse(participation, Reason::Unanswered, detail);
            }
            RemoteUpdate::DeadlinePassed(within) => {
                let detail = format!("nothing was heard of it from `{far}` within {within:?}");
                ctx.refuse(participation, Reason::TimedOut, detail);
            }
        }
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Some(exchange) = message.exchange().cloned() else { return };
        // Dropping the handle also cancels the goal in the other ecosystem.
        if self.open.remove(&(message.sender.clone(), exchange)).is_some() {
            let report = Report::new(Outcome::Cancelled, "given up as asked");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        }
    }
}

fn request_key(participation: &Participation) -> RequestKey {
    (participation.initiator.clone(), participation.exchange.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Each initiator counts its own tokens, so two initiators may use the same token.
    #[test]
    fn requests_of_two_initiators_with_one_token_are_distinct() {
        let of = |asker: &str| {
            let text = format!(
                r#"{{"version":2,"id":"{asker}.1","performative":"request","sender":"{asker}",
                "incarnation":1,"content":{{}},"conversation_id":"c","reply_with":"r-1"}}"#
            );
            request_key(&Participation::of(&acl::decode(text.as_bytes()).expect("a message")))
        };
        assert_eq!(of("anna"), of("anna"));
        assert_ne!(of("anna"), of("bert"));
    }
}
