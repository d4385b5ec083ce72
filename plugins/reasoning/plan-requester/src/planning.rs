//! The centralised planning flow: the Planning Agent computes the plan (the paper, “Flow of Control
//! in Centralized Plan Execution”).

use std::sync::Arc;
use std::time::Duration;

use acl::content::{
    Choice, Outcome, PlanProposal, PlanRequest, PlanStatus, Refusal, Report, Request, value,
};
use acl::{AgentId, ConversationId, Performative, Protocol};
use agent::{Context, ExchangeEvent, ExchangeOpening};
use goal_lifecycle::{Attempt, GoalEvent, PlanDecision};
use pddl::Condition;
use planner::Cancel;
use planner::explain::Explanation;

use crate::PlanRequester;
use crate::explanations::{self, GoalContext};
use crate::goal::Work;
use crate::planning_snapshot::PlanningSnapshot;

impl PlanRequester {
    /// Requests the Planning Agent to make a plan for a goal.
    pub(crate) fn ask_planner(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        known: &PlanningSnapshot,
        ctx: &mut Context<Self>,
    ) {
        let Some(wanted) = self.combined_goal(id, known) else { return };
        let Some(goal) = self.goals.get_mut(id) else { return };
        let request = PlanRequest {
            domain: known.domain_text.clone(),
            problem: known.problem_of(&wanted).to_string(),
            epoch: known.epoch,
            remaining_steps: known.nameable(&goal.failed_steps).map(|rest| rest.to_string()),
        };
        let opening = ExchangeOpening {
            to: Some(self.config.planning_agent.clone()),
            performative: Performative::Request,
            protocol: Protocol::Planning,
            conversation: id.clone(),
            content: value(&Request::Plan(request)),
        };
        let patience = ctx.settings().planning_deadline;
        let asked = id.clone();
        let token = ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            requester.planner_answered(&asked, attempt, answer, ctx);
        });
        goal.work = Work::Planning(token);
    }

    /// Reports to the user which facts and agents of a goal have changed since the last round of
    /// planning.
    pub(crate) fn report_changes(
        &mut self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        open: &[Condition],
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        let now = GoalContext::of(known, &known.sure(&goal.condition));
        let news =
            goal.last_context.as_ref().and_then(|seen| seen.describe_changes(&now, known, open));
        goal.last_context = Some(now);
        if let Some(news) = news {
            self.send_report(id, Report::new(Outcome::Progress, news), ctx);
        }
    }

    fn planner_answered(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get(id).filter(|goal| goal.is_current(attempt)) else {
            return;
        };
        let (Work::Planning(token), Some(round)) = (&goal.work, &goal.round) else { return };
        let (token, known) = (token.clone(), Arc::clone(&round.known));
        let (sender, proposal) = match read(answer) {
            Ok(read) => read,
            Err(MissingProposal { why, wait, is_passing }) => {
                let event = match is_passing {
                    true => GoalEvent::PlannerBusy(attempt, why, wait),
                    false => GoalEvent::PlannerFailed(attempt, why, wait),
                };
                return self.handle(id, event, ctx);
            }
        };
        let judged = self.judge(id, &known, &proposal).map(|(plan, cost)| {
            let decision = self.decide(id, &known, &plan);
            (plan, cost, decision)
        });
        let (performative, detail) = match &judged {
            Ok((_, _, PlanDecision::Run)) => {
                (Performative::AcceptProposal, "it is valid".to_owned())
            }
            Ok(_) => (Performative::RejectProposal, "other goals come first".to_owned()),
            Err(detail) => (Performative::RejectProposal, detail.clone()),
        };
        let choice = value(&Choice::new(Vec::new(), detail));
        ctx.send_turn(&token, &sender, performative, choice);
        ctx.close(&token);
        match judged {
            Ok((plan, cost, decision)) => self.plan_found(id, attempt, (plan, cost), decision, ctx),
            Err(why) if proposal.status == PlanStatus::Unsolvable => {
                let open = self.open_conjuncts(id);
                let explained = move |known: &PlanningSnapshot, cancel: &Cancel| {
                    let interfere = |explanation: &Explanation| format!("{why}; {explanation}");
                    explain(known, &open, cancel, interfere).unwrap_or(why)
                };
                self.plan_missing(id, attempt, explained, ctx);
            }
            Err(why) => self.plan_missing(id, attempt, |_, _| why, ctx),
        }
    }

    /// Returns the plan in the Planning Agent's proposal and its cost.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the proposal has no plan that is valid here.
    fn judge(
        &self,
        id: &ConversationId,
        known: &PlanningSnapshot,
        proposal: &PlanProposal,
    ) -> Result<(pddl::Plan, f64), String> {
        let Some(text) = &proposal.plan else {
            let detail = proposal.detail.clone().unwrap_or_default();
            return Err(format!("the planner: {}; {detail}", proposal.status));
        };
        let wanted = self.combined_goal(id, known).ok_or("the goal has ended")?;
        let plan = pddl::parse_plan(text).into_result().map_err(crate::first)?;
        let cost = known
            .validate(&plan, &wanted)
            .map_err(|fault| format!("the proposed plan is not valid: {fault}"))?;
        Ok((plan, cost))
    }
}

/// Why the Planning Agent has made no proposal.
struct MissingProposal {
    /// The reason, as text for a person.
    why: String,
    /// Delay before the next attempt.
    wait: Duration,
    /// Whether the agent is only absent or busy, so that a later attempt may succeed.
    is_passing: bool,
}

/// Returns the Planning Agent's proposal and its sender.
///
/// # Errors
///
/// Returns an error if the answer contains no proposal.
fn read(answer: ExchangeEvent) -> Result<(AgentId, PlanProposal), MissingProposal> {
    let message = match answer {
        ExchangeEvent::Message(message) => message,
        ExchangeEvent::TimedOut => {
            let why = "the Planning Agent did not answer in time".to_owned();
            return Err(MissingProposal { why, wait: Duration::ZERO, is_passing: false });
        }
        ExchangeEvent::Undelivered(why) => {
            let why = format!("the Planning Agent could not be reached: {why}");
            return Err(MissingProposal { why, wait: crate::ASK_AGAIN, is_passing: true });
        }
    };
    let proposal = message.content_as::<PlanProposal>().map_err(|_| {
        let refusal = message.content_as::<Refusal>();
        let is_passing = refusal.as_ref().is_ok_and(|refusal| crate::is_passing(refusal.reason));
        let why = refusal.map(|refusal| refusal.detail);
        let why = why.unwrap_or_else(|_| "its reason cannot be read".to_owned());
        let why = format!("the Planning Agent declined: {why}");
        MissingProposal { why, wait: crate::BUSY, is_passing }
    })?;
    Ok((message.sender, proposal))
}

/// Returns, as text for a person, which conjuncts cannot be reached and what is missing for them,
/// if the known facts or the delete relaxation (planning as if no action undid another) show this.
/// Otherwise returns the text of `otherwise`. Returns `None` if the domain cannot be analysed.
pub(crate) fn explain(
    known: &PlanningSnapshot,
    open: &[Condition],
    cancel: &Cancel,
    otherwise: impl FnOnce(&Explanation) -> String,
) -> Option<String> {
    let reasons: Vec<_> = open.iter().map(|part| known.plain_reason(part)).collect();
    let plain: Vec<String> = reasons.iter().flatten().cloned().collect();
    let others = open.iter().zip(&reasons).filter(|(_, reason)| reason.is_none());
    let others: Vec<Condition> = others.map(|(part, _)| part.clone()).collect();
    let explanation = known.explain(&others, cancel)?;
    let obstacles = explanations::obstacles(&explanation, known);
    match (plain.is_empty(), obstacles) {
        (true, Some(obstacles)) => Some(obstacles),
        // Perhaps only the avoided action is missing. The text of `otherwise`, which names
        // interference as the reason, would mislead in that case.
        (true, None) if !known.avoided.is_empty() => {
            Some(format!("there is no other way{}", explanations::describe_avoided(&known.avoided)))
        }
        (true, None) => Some(otherwise(&explanation)),
        (false, obstacles) => Some(explanations::listed_all(plain.into_iter().chain(obstacles))),
    }
}
