//! Ensures that one plan per goal runs at a time, whichever replica of the Plan Requester requests
//! it (docs/design.md, “Fail-over”).
//!
//! A Plan Requester that takes a goal over requests the plan that its predecessor was running.
//! There are three cases:
//!
//! - The plan runs here: it continues, and the new requester also receives the plan's reports.
//! - The plan has ended here: its outcome is sent again.
//! - The plan is unknown here, because the executor that ran it is gone: this executor starts the
//!   plan, and leaves out the steps that are known to be done. The other steps are requested under
//!   the same tokens, so that their actuators do nothing twice.
//!
//! For a moment two daemons may disagree about the leader, and a request of the former leader may
//! arrive after a request of the new leader. Therefore all requesters of a plan receive its
//! reports.

use std::collections::VecDeque;

use acl::content::{CancelAction, CancelPlan, Execute, Outcome, Reason, Refusal, Report, value};
use acl::{ConversationId, Performative, ReplyToken};
use agent::{Context, Participation, Resident};
use plan_execution::{ExecutionEvent, ExecutionPhase};

use crate::{PlanExecutor, RunningPlan, StepExchange};

/// Maximum number of outcomes that are kept for replicas of the Plan Requester that take over; of
/// more, the oldest is dropped. The number exceeds the number of plans that can run at the same
/// time.
const ENDED_MAX: usize = 128;

/// Identifier of a plan for a goal. The later one of two plans has the greater identifier.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct PlanId {
    pub(crate) conversation: ConversationId,
    /// Term of the leading Plan Requester that made the plan.
    pub(crate) term: u64,
    /// Number of the plan within the leader's term.
    pub(crate) round: u32,
}

/// Maximum number of requesters that receive the reports of one plan. If there are more, one that
/// is no longer present is dropped, or else the oldest. The number suffices for one requester on
/// each daemon that hosts a Plan Requester, and for requests that are repeated after the leader of
/// the Plan Executors has changed.
const SUBSCRIBERS_MAX: usize = 8;

/// Exchanges in which a plan was requested; the latest one is the last.
#[derive(Clone, Debug)]
pub(crate) struct Subscribers(Vec<Participation>);

/// Outcomes of the plans that ended last; the latest one is the last.
#[derive(Debug, Default)]
pub(crate) struct FinishedPlans(VecDeque<(PlanId, Report)>);

// === impl PlanId ===

impl PlanId {
    pub(crate) fn of(conversation: &ConversationId, execute: &Execute) -> PlanId {
        let Execute { term, round, .. } = *execute;
        PlanId { conversation: conversation.clone(), term, round }
    }

    fn to_cancel(conversation: &ConversationId, CancelPlan { term, round }: CancelPlan) -> PlanId {
        PlanId { conversation: conversation.clone(), term, round }
    }
}

// === impl Subscribers ===

impl Subscribers {
    pub(crate) fn new(first: Participation) -> Subscribers {
        Subscribers(vec![first])
    }

    /// Adds a requester of a plan. A requester that requests the plan twice receives each report
    /// twice: its requests may arrive in any order, so that the exchange in which it still waits is
    /// unknown. If the list of requesters is full, drops a requester that is not the leader.
    fn add(&mut self, asker: &Participation, ctx: &Context<PlanExecutor>) {
        if self.has(Some(&asker.exchange)) {
            return;
        }
        if self.0.len() >= SUBSCRIBERS_MAX {
            let acts = |asker: &Participation| {
                ctx.find(&asker.initiator).map(|resident| resident.incarnation) == asker.incarnation
            };
            self.0.remove(self.0.iter().position(|asker| !acts(asker)).unwrap_or(0));
        }
        self.0.push(asker.clone());
    }

    pub(crate) fn has(&self, exchange: Option<&ReplyToken>) -> bool {
        self.0.iter().any(|asker| Some(&asker.exchange) == exchange)
    }

    pub(crate) fn send_to_all(&self, report: &Report, ctx: &mut Context<PlanExecutor>) {
        self.0.iter().for_each(|asker| ctx.answer(asker, Performative::Confirm, report));
    }
}

// === impl FinishedPlans ===

impl FinishedPlans {
    pub(crate) fn store_outcome(&mut self, plan: PlanId, report: Report) {
        if self.0.len() >= ENDED_MAX {
            self.0.pop_front();
        }
        self.0.push_back((plan, report));
    }

    fn outcome_of(&self, plan: &PlanId) -> Option<&Report> {
        self.0.iter().find(|(other, _)| other == plan).map(|(_, report)| report)
    }
}

// === impl PlanExecutor ===

impl PlanExecutor {
    /// Answers a request for a plan that this Plan Executor runs or has ended. Refuses the request
    /// if a newer plan, or a plan of another term, runs for the same goal. Gives up an older plan
    /// of the same goal and the same term. Returns `true` if the request was answered or refused.
    pub(crate) fn answer_if_known(
        &mut self,
        participation: &Participation,
        plan: &PlanId,
        ctx: &mut Context<Self>,
    ) -> bool {
        if let Some(report) = self.finished_plans.outcome_of(plan) {
            ctx.answer(participation, Performative::Confirm, report);
            return true;
        }
        let is_of_goal = |other: &&PlanId| other.conversation == plan.conversation;
        let runs = self.running_plans.iter().map(|(token, running)| (token, &running.plan));
        let runs: Vec<(ReplyToken, PlanId)> = runs
            .filter(|(_, other)| is_of_goal(other))
            .map(|(token, other)| (token.clone(), other.clone()))
            .collect();
        for (token, other) in runs {
            match other.cmp(plan) {
                std::cmp::Ordering::Equal => {
                    self.add_subscriber(&token, participation, ctx);
                    return true;
                }
                _ if other.term != plan.term && self.is_active(&token) => {
                    self.refuse_with_running(&token, participation, ctx);
                    return true;
                }
                std::cmp::Ordering::Greater => {
                    let detail = "a newer plan for this goal is being executed";
                    ctx.refuse(participation, Reason::StaleToken, detail);
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

    /// Cancels a plan that is no longer needed. If the plan does not run here, stores it as ended,
    /// because a request for the plan may arrive later.
    pub(crate) fn called_off(
        &mut self,
        participation: &Participation,
        plan: CancelPlan,
        ctx: &mut Context<Self>,
    ) {
        let plan = PlanId::to_cancel(&participation.conversation, plan);
        let report = Report::new(Outcome::Cancelled, "called off");
        if !self.answer_if_known(participation, &plan, ctx) {
            ctx.answer(participation, Performative::Confirm, &report);
            return self.finished_plans.store_outcome(plan, report);
        }
        let it = self.running_plans.iter().find(|(_, running)| running.plan == plan);
        if let Some(token) = it.map(|(token, _)| token.clone()) {
            self.give_up(&token, report, ctx);
        }
    }

    fn is_active(&self, token: &ReplyToken) -> bool {
        let running = self.running_plans.get(token);
        running.is_some_and(|running| running.state.phase() != ExecutionPhase::GivingUp)
    }

    /// Refuses a request for a new plan for a goal, and sends the running plan with the refusal.
    /// The running plan is unknown to the requester: it was made just before the requester took
    /// over, or on the other side of a partition.
    fn refuse_with_running(
        &mut self,
        token: &ReplyToken,
        participation: &Participation,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get(token) else { return };
        let mut plan = running.original_request.clone();
        let done = running.state.done().into_iter();
        plan.done = done.filter_map(|(step, _)| u32::try_from(step).ok()).collect();
        let detail = "another plan for this goal is under way";
        let refusal = Refusal { under_way: Some(plan), ..Refusal::new(Reason::StaleToken, detail) };
        ctx.answer(participation, Performative::Refuse, &refusal);
    }

    /// Adds a requester to a running plan and reports to this requester all steps that are done.
    fn add_subscriber(
        &mut self,
        token: &ReplyToken,
        participation: &Participation,
        ctx: &mut Context<Self>,
    ) {
        let Some(running) = self.running_plans.get_mut(token) else { return };
        running.subscribers.add(participation, ctx);
        for (step, action) in running.state.done() {
            let report = Report::new(Outcome::Progress, format!("`{action}` is done"));
            let step = u32::try_from(step).ok();
            let report = Report { action: Some(action), step, ..report };
            ctx.answer(participation, Performative::Confirm, &report);
        }
    }

    /// Repeats the requests to an actuator that was restarted during a step, under the same tokens.
    /// The new incarnation answers whether the step had begun; the former incarnation cannot answer
    /// any more.
    pub(crate) fn repeat_requests(&mut self, resident: &Resident, ctx: &mut Context<Self>) {
        let is_active = |running: &RunningPlan| running.state.phase() != ExecutionPhase::GivingUp;
        let mut repeated = Vec::new();
        for (token, running) in self.running_plans.iter_mut().filter(|(_, it)| is_active(it)) {
            for (part, acting) in &mut running.step_exchanges {
                let incarnation = Some(resident.incarnation);
                if acting.agent == resident.agent
                    && acting.agent_incarnation.is_some()
                    && acting.agent_incarnation != incarnation
                {
                    acting.agent_incarnation = incarnation;
                    ctx.reopen_with_leader(&acting.exchange);
                    repeated.push((token.clone(), *part));
                }
            }
        }
        for (token, part) in repeated {
            self.handle(&token, ExecutionEvent::StepRepeated(part), ctx);
        }
    }

    /// Stops following all running plans, because another Plan Executor leads and continues these
    /// plans under the same tokens. A step that the new leader does not continue, because it has
    /// another plan for the goal, is cancelled by the actuator of the step.
    pub(crate) fn abandon_all(&mut self, ctx: &mut Context<Self>) {
        let cancelling = value(&CancelAction { unless_followed: true });
        for (_, running) in std::mem::take(&mut self.running_plans) {
            for StepExchange { exchange, agent, .. } in running.step_exchanges.values() {
                ctx.send_turn(exchange, agent, Performative::Cancel, cancelling.clone());
                ctx.close(exchange);
            }
            let timers = [running.check_timer, running.verification_timer];
            timers.into_iter().flatten().for_each(|timer| ctx.cancel_timer(timer));
        }
    }
}
