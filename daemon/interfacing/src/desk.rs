//! A desk: whom agents of one ecosystem ask for goals of another.
//!
//! It takes the goals that its rule names, in mapped words, and asks the other's own Plan Requester
//! for them. How they stand comes back, in words of its own. A goal that has come from another
//! ecosystem itself goes no further: two desks must never pass one goal to each other for ever.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;
use std::sync::atomic::Ordering;

use acl::content::{Achieve, Outcome, Reason, Refusal, Report, Request};
use acl::{AgentId, EcosystemId, Message, Performative, ReplyToken};
use agent::{Agent, Callbacks, Context, Engagement, Work};
use keyboard::Wish;
use pddl::{Domain, Problem};

use super::bucket::Bucket;
use super::export;
use super::mirror::Counters;
use super::translate::Translator;
use super::voice::{Asked, News, Voice};
use super::words::Words;

/// Goals that one desk follows at a time.
const GOALS_MAX: usize = 64;

pub(super) struct Desk {
    /// Where the goals go.
    pub(super) far: EcosystemId,
    /// The predicates, in near words, that they may be made of.
    pub(super) goals: BTreeSet<String>,
    /// Near = far.
    pub(super) words: Words,
    pub(super) near: (Arc<Domain>, Arc<Problem>),
    pub(super) revocable: bool,
    pub(super) voice: Voice,
    pub(super) outward: Arc<Bucket>,
    pub(super) counters: Arc<Counters>,
    /// By who asked and its token: a token is its asker's alone.
    pub(super) open: BTreeMap<Asking, Work>,
}

/// Who has asked, and what it calls that.
pub(super) type Asking = (AgentId, ReplyToken);

impl Agent for Desk {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::Request, Self::requested)
            .on(Performative::Cancel, Self::cancelled)
    }
}

impl Desk {
    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let engagement = Engagement::of(&message);
        let achieve = match message.content_as::<Request>() {
            Ok(Request::Achieve(achieve)) => achieve,
            Ok(_) => {
                let detail = "a desk takes goals: `achieve`";
                return ctx.refuse(&engagement, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        match self.admit(&message, achieve) {
            Ok(wish) => self.pass(engagement, wish, ctx),
            Err(refusal) => ctx.answer(&engagement, Performative::Refuse, &refusal),
        }
    }

    /// The goal in the other's words, if it may pass.
    fn admit(&self, message: &Message, achieve: Achieve) -> Result<Wish, Refusal> {
        let Desk { far, goals, words, near, outward, counters, .. } = self;
        if !message.via.is_empty() {
            counters.looped.fetch_add(1, Ordering::Relaxed);
            let detail = "it comes from another ecosystem itself, and goes no further";
            return Err(Refusal::new(Reason::Conflict, detail));
        }
        let Achieve { goal, keep, priority, partition } = achieve;
        let translator = Translator::of_ontology(words, (&near.0, &near.1));
        let goal = export::goal(&goal, goals, &translator).map_err(|why| {
            counters.unexported.fetch_add(1, Ordering::Relaxed);
            Refusal::new(Reason::BadContent, why)
        })?;
        if self.open.len() >= GOALS_MAX {
            let detail = format!("{GOALS_MAX} goals have passed and are not reached yet");
            return Err(Refusal::new(Reason::Busy, detail));
        }
        if !outward.take() {
            counters.over_rate.fetch_add(1, Ordering::Relaxed);
            let rate = outward.per_second();
            let detail = format!("{rate} messages a second may pass to `{far}`; ask again later");
            return Err(Refusal::new(Reason::Busy, detail));
        }
        Ok(Wish { goal, keep, priority, partition })
    }

    fn pass(&mut self, engagement: Engagement, wish: Wish, ctx: &mut Context<Self>) {
        self.counters.passed.fetch_add(1, Ordering::Relaxed);
        let (voice, revocable) = (self.voice.clone(), self.revocable);
        let asked = async move { voice.wish(wish, revocable).await };
        let asking = asking(&engagement);
        let work = ctx.run(asked, move |desk: &mut Self, asked, ctx| {
            desk.follow(engagement, asked, ctx);
        });
        self.open.insert(asking, work);
    }

    /// Waits for the next news of a goal.
    fn follow(&mut self, engagement: Engagement, mut asked: Asked, ctx: &mut Context<Self>) {
        let asking = asking(&engagement);
        let next = async move {
            let news = asked.next().await;
            (news, asked)
        };
        let work = ctx.run(next, move |desk: &mut Self, (news, asked), ctx| {
            desk.answer(&engagement, &news, ctx);
            if news.is_final() {
                desk.open.remove(&self::asking(&engagement));
            } else {
                desk.follow(engagement, asked, ctx);
            }
        });
        self.open.insert(asking, work);
    }

    /// Passes on how a goal stands, and nothing else that is said of it over there.
    fn answer(&mut self, engagement: &Engagement, news: &News, ctx: &mut Context<Self>) {
        let far = &self.far;
        match news {
            News::Report(report) => {
                let detail = match report.outcome {
                    Outcome::Progress => format!("`{far}` is at it"),
                    Outcome::Holds | Outcome::Done => format!("`{far}` says that it holds"),
                    Outcome::Failed => format!("`{far}` cannot reach it"),
                    Outcome::Cancelled => format!("`{far}` has given it up"),
                };
                ctx.answer(engagement, Performative::Confirm, &Report::new(report.outcome, detail));
            }
            News::Refused(refusal) => {
                ctx.refuse(engagement, refusal.reason, format!("`{far}` declines"));
            }
            News::Unanswered => {
                let detail = format!("nobody in `{far}` answers");
                ctx.refuse(engagement, Reason::Unanswered, detail);
            }
        }
    }

    fn cancelled(&mut self, message: Message, ctx: &mut Context<Self>) {
        let Some(exchange) = message.exchange().cloned() else { return };
        // Dropped, it is taken back over there too.
        if self.open.remove(&(message.sender.clone(), exchange)).is_some() {
            let report = Report::new(Outcome::Cancelled, "given up as asked");
            ctx.answer(&Engagement::of(&message), Performative::Confirm, &report);
        }
    }
}

fn asking(engagement: &Engagement) -> Asking {
    (engagement.initiator.clone(), engagement.exchange.clone())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tokens are counted by whoever gives them: two may give the same.
    #[test]
    fn what_two_call_the_same_is_two_things() {
        let of = |asker: &str| {
            let text = format!(
                r#"{{"version":1,"id":"{asker}.1","performative":"request","sender":"{asker}",
                "incarnation":1,"content":{{}},"conversation_id":"c","reply_with":"r-1"}}"#
            );
            asking(&Engagement::of(&acl::decode(text.as_bytes()).expect("a message")))
        };
        assert_eq!(of("anna"), of("anna"));
        assert_ne!(of("anna"), of("bert"));
    }
}
