//! One goal, one plan at a time, whoever asks for it (design, “No single point of failure”).
//!
//! A Plan Requester that takes a goal over asks for the plan that was under way when its
//! predecessor died. If it runs here, it goes on and is reported to who asked last; if it has
//! ended, how it ended is said again; if nobody here knows of it, the executor that had it is gone:
//! it is begun at the steps that are known to be done. The others are asked for under the same
//! tokens, so that their actuators do nothing twice.
//!
//! Who acts may be seen differently here and there, for a moment; and what was asked before its asker
//! stood down may come after what the next has asked. So all who have asked for a plan hear of it.

use std::collections::VecDeque;

use acl::content::{CallOff, Cancelling, Execute, Outcome, Reason, Refusal, Report, value};
use acl::{ConversationId, Performative, ReplyToken};
use agent::{Context, Engagement, Resident};

use crate::{Acting, PlanExecutor};

/// Outcomes kept for those who take over: of more plans than can run side by side.
const ENDED_MAX: usize = 128;

/// One plan for one goal. Of two, the greater was made later.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlanId {
    pub(crate) conversation: ConversationId,
    /// In whose term it was made.
    pub(crate) term: u64,
    /// Which plan of that term.
    pub(crate) round: u32,
}

/// How often one plan may have been asked for, for each to be told of it: by each of the daemons that
/// host a Plan Requester, and by one of them again where executors came and went.
const ASKERS_MAX: usize = 8;

/// Who has asked for a plan; who asked last comes last.
#[derive(Clone, Debug)]
pub(crate) struct Askers(Vec<Engagement>);

/// How the last plans ended.
#[derive(Debug, Default)]
pub(crate) struct Ended(VecDeque<(PlanId, Report)>);

// === impl PlanId ===

impl PlanId {
    pub(crate) fn of(conversation: &ConversationId, execute: &Execute) -> PlanId {
        let Execute { term, round, .. } = *execute;
        PlanId { conversation: conversation.clone(), term, round }
    }

    fn to_call_off(conversation: &ConversationId, CallOff { term, round }: CallOff) -> PlanId {
        PlanId { conversation: conversation.clone(), term, round }
    }
}

// === impl Askers ===

impl Askers {
    pub(crate) fn new(first: Engagement) -> Askers {
        Askers(vec![first])
    }

    /// What one has asked twice it hears twice: which of them it still listens to is not known here,
    /// and they may come in any order. Who acts is not forgotten for others.
    fn add(&mut self, asker: &Engagement, ctx: &Context<PlanExecutor>) {
        if self.has(Some(&asker.exchange)) {
            return;
        }
        if self.0.len() >= ASKERS_MAX {
            let acts = |asker: &Engagement| {
                ctx.find(&asker.initiator).map(|resident| resident.incarnation) == asker.life
            };
            self.0.remove(self.0.iter().position(|asker| !acts(asker)).unwrap_or(0));
        }
        self.0.push(asker.clone());
    }

    pub(crate) fn has(&self, exchange: Option<&ReplyToken>) -> bool {
        self.0.iter().any(|asker| Some(&asker.exchange) == exchange)
    }

    pub(crate) fn tell(&self, report: &Report, ctx: &mut Context<PlanExecutor>) {
        self.0.iter().for_each(|asker| ctx.answer(asker, Performative::Confirm, report));
    }
}

// === impl Ended ===

impl Ended {
    pub(crate) fn keep(&mut self, plan: PlanId, report: Report) {
        if self.0.len() >= ENDED_MAX {
            self.0.pop_front();
        }
        self.0.push_back((plan, report));
    }

    fn of(&self, plan: &PlanId) -> Option<&Report> {
        self.0.iter().find(|(other, _)| other == plan).map(|(_, report)| report)
    }
}

// === impl PlanExecutor ===

impl PlanExecutor {
    /// Whether a plan is known here already, and so is dealt with. An older one for the same goal
    /// is given up; but what another Plan Requester has begun goes on.
    pub(crate) fn is_known(
        &mut self,
        engagement: &Engagement,
        plan: &PlanId,
        ctx: &mut Context<Self>,
    ) -> bool {
        if let Some(report) = self.ended.of(plan) {
            ctx.answer(engagement, Performative::Confirm, report);
            return true;
        }
        let is_of_goal = |other: &&PlanId| other.conversation == plan.conversation;
        let runs = self.running.iter().map(|(token, running)| (token, &running.plan));
        let runs: Vec<(ReplyToken, PlanId)> = runs
            .filter(|(_, other)| is_of_goal(other))
            .map(|(token, other)| (token.clone(), other.clone()))
            .collect();
        for (token, other) in runs {
            match other.cmp(plan) {
                std::cmp::Ordering::Equal => {
                    self.attach(&token, engagement, ctx);
                    return true;
                }
                _ if other.term != plan.term && self.goes_on(&token) => {
                    self.show(&token, engagement, ctx);
                    return true;
                }
                std::cmp::Ordering::Greater => {
                    let detail = "a newer plan for this goal is being executed";
                    ctx.refuse(engagement, Reason::StaleToken, detail);
                    return true;
                }
                std::cmp::Ordering::Less => {
                    let report = Report::new(Outcome::Cancelled, "a newer plan takes its place");
                    self.give_up(&token, report, ctx);
                }
            }
        }
        false
    }

    /// Nobody needs a plan any more. Where it does not run, it is kept in mind: who has made it may have
    /// asked for it, and what asks may come later than this.
    pub(crate) fn called_off(
        &mut self,
        engagement: &Engagement,
        plan: CallOff,
        ctx: &mut Context<Self>,
    ) {
        let plan = PlanId::to_call_off(&engagement.conversation, plan);
        let report = Report::new(Outcome::Cancelled, "called off");
        if !self.is_known(engagement, &plan, ctx) {
            ctx.answer(engagement, Performative::Confirm, &report);
            return self.ended.keep(plan, report);
        }
        let it = self.running.iter().find(|(_, running)| running.plan == plan);
        if let Some(token) = it.map(|(token, _)| token.clone()) {
            self.give_up(&token, report, ctx);
        }
    }

    fn goes_on(&self, token: &ReplyToken) -> bool {
        self.running.get(token).is_some_and(|running| running.ending.is_none())
    }

    /// Shows a running plan to who has made another because it knew nothing of this one: it was made
    /// in the instant before it took over, or beyond a partition.
    fn show(&mut self, token: &ReplyToken, engagement: &Engagement, ctx: &mut Context<Self>) {
        let Some(running) = self.running.get(token) else { return };
        let mut plan = running.asked.clone();
        let done = running.execution.done().into_iter();
        plan.done = done.filter_map(|(step, _)| u32::try_from(step).ok()).collect();
        let detail = "another plan for this goal is under way";
        let refusal = Refusal { under_way: Some(plan), ..Refusal::new(Reason::StaleToken, detail) };
        ctx.answer(engagement, Performative::Refuse, &refusal);
    }

    /// Reports a running plan to who asks for it too, from its beginning.
    fn attach(&mut self, token: &ReplyToken, engagement: &Engagement, ctx: &mut Context<Self>) {
        let Some(running) = self.running.get_mut(token) else { return };
        running.askers.add(engagement, ctx);
        for (step, action) in running.execution.done() {
            let report = Report::new(Outcome::Progress, format!("`{action}` is done"));
            let step = u32::try_from(step).ok();
            let report = Report { action: Some(action), step, ..report };
            ctx.answer(engagement, Performative::Confirm, &report);
        }
    }

    /// An actuator has begun a new life in the middle of a step: it is asked under the same token, and
    /// says whether the step was begun. Of its former life nothing will be heard.
    pub(crate) fn ask_next_life(&mut self, resident: &Resident, ctx: &mut Context<Self>) {
        for running in self.running.values_mut().filter(|running| running.ending.is_none()) {
            for acting in running.acting.values_mut() {
                let life = Some(resident.incarnation);
                if acting.agent == resident.agent && acting.life.is_some() && acting.life != life {
                    acting.life = life;
                    ctx.open_again(&acting.exchange);
                }
            }
        }
    }

    /// Another executor acts: what runs is its to go on with, under the same tokens. What it does
    /// not go on with, because it has another plan for that goal, is given up.
    pub(crate) fn let_go(&mut self, ctx: &mut Context<Self>) {
        let cancelling = value(&Cancelling { unless_followed: true });
        for (_, running) in std::mem::take(&mut self.running) {
            for Acting { exchange, agent, .. } in running.acting.values() {
                ctx.go_on(exchange, agent, Performative::Cancel, cancelling.clone());
                ctx.close(exchange);
            }
            let timers = [running.check, running.grace, running.hearing];
            timers.into_iter().flatten().for_each(|timer| ctx.forget(timer));
        }
    }
}
