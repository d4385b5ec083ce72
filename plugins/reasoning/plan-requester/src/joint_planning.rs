//! Joint planning: where no set of proposals reaches a goal, the Plan Requester plans with the
//! actions of all agents, and asks each agent that acts in the plan to agree to its own part.
//!
//! - The agents that may act are those that were present when joint planning began, each in the same
//!   incarnation. An agent that leaves, declines its part or does not answer is left out, and the
//!   plan is made anew without it, at most [`PLANS_MAX`] times.
//! - An agreement is an exchange of the contract net: a `cfp` with the part, `agree` or `refuse`, and
//!   then `accept-proposal` or `reject-proposal`. It holds the agent for the goal, for a lease.
//! - A requester holds no agent while it waits for another: if one agent has other work, all agreements
//!   are rejected, and the goal is planned for again after a while. So several requesters that want the
//!   same agents never wait for each other.
//! - If an agent declines because it knows other facts than the requester, and there is no plan without
//!   it, the goal is planned for again until the heartbeat lease is over: a heartbeat may have been
//!   lost.
//! - Nothing is executed before all agents have agreed.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::content::{Bid, CallForProposals, Choice, Outcome, Reason, Refusal, Report, value};
use acl::fnv::Fnv64;
use acl::{AgentId, ConversationId, Message, Performative};
use agent::{Context, RetryBackoff, TimerId};
use goal_lifecycle::{Attempt, GoalEvent, PlanDecision};
use pddl::{Condition, Plan};
use planner::explain::Explanation;
use planner::{Budget, Cancel, Options};

use crate::PlanRequester;
use crate::explanations;
use crate::goal::Work;
use crate::joint_plans::{self, JointPlan};
use crate::joint_state::{BiddingGap, JointPhase, JointPlanState, JointSearch, PendingAgreements};
use crate::planning::explain;
use crate::planning_snapshot::PlanningSnapshot;

/// Maximum number of joint plans of one attempt. Each further one leaves out an agent that has left
/// or has declined its part. After the last one the goal is explained, and planned for again when
/// the world changes.
const PLANS_MAX: u32 = 4;

impl PlanRequester {
    /// Begins joint planning for a goal for which the proposals do not suffice.
    pub(crate) fn plan_jointly(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        (known, wanted): (Arc<PlanningSnapshot>, Condition),
        gap: BiddingGap,
        ctx: &mut Context<Self>,
    ) {
        let here = |agent: &AgentId| Some((agent.clone(), ctx.find(agent)?.incarnation));
        let members: BTreeMap<_, _> = known.offers.keys().filter_map(here).collect();
        let absent = known.offers.keys().filter(|agent| !members.contains_key(*agent));
        let absent: BTreeSet<AgentId> = absent.cloned().collect();
        let state = JointPlanState {
            attempt,
            known: without(known, &absent),
            wanted,
            members,
            gap,
            declined: Vec::new(),
            differing: None,
            plans: 0,
            phase: JointPhase::Idle,
        };
        self.search_jointly(id, state, ctx);
    }

    /// Searches a joint plan in the background.
    fn search_jointly(
        &mut self,
        id: &ConversationId,
        mut state: JointPlanState,
        ctx: &mut Context<Self>,
    ) {
        let Some(goal) = self.goals.get_mut(id) else { return };
        state.plans += 1;
        let cancel = Cancel::new();
        let (flag, deadline) = (cancel.clone(), cancel.clone());
        // The planner reads no clock; therefore a timer ends the search.
        ctx.after(ctx.settings().planning_deadline, move |_: &mut Self, _| deadline.set());
        let (known, wanted) = (Arc::clone(&state.known), state.wanted.clone());
        let (searched, number) = (id.clone(), state.plans);
        let work = ctx.compute(
            move || search(&known, &wanted, &flag),
            move |requester: &mut Self, found, ctx| {
                requester.joint_plan_searched(&searched, number, found, ctx);
            },
        );
        state.phase = JointPhase::Searching(JointSearch { cancel, _work: work });
        goal.work = Work::Joint(Box::new(state));
    }

    fn planning_jointly(&mut self, id: &ConversationId) -> Option<&mut JointPlanState> {
        match &mut self.goals.get_mut(id)?.work {
            Work::Joint(state) => Some(state),
            _ => None,
        }
    }

    /// Removes and returns the state of joint planning for a goal; `None` if there is none.
    fn take_joint_plan(&mut self, id: &ConversationId) -> Option<JointPlanState> {
        let work = &mut self.goals.get_mut(id)?.work;
        match std::mem::take(work) {
            Work::Joint(state) => Some(*state),
            other => {
                *work = other;
                None
            }
        }
    }

    /// Ends joint planning for a goal, and rejects the agreements to its plan.
    pub(crate) fn give_up_joint_plan(
        &mut self,
        id: &ConversationId,
        why: &str,
        ctx: &mut Context<Self>,
    ) {
        let Some(state) = self.take_joint_plan(id) else { return };
        if let JointPhase::Agreeing(pending) = state.phase {
            pending.reject(why, ctx);
        }
    }

    fn joint_plan_searched(
        &mut self,
        id: &ConversationId,
        number: u32,
        found: Result<JointPlan, String>,
        ctx: &mut Context<Self>,
    ) {
        let Some(state) = self.planning_jointly(id) else { return };
        if state.plans != number || !matches!(state.phase, JointPhase::Searching(_)) {
            return;
        }
        let Some(state) = self.take_joint_plan(id) else { return };
        let joint = match found {
            Ok(joint) => joint,
            Err(why) => {
                tracing::info!(conversation = %id, %why, "no joint plan");
                return self.joint_plan_missing(id, state, ctx);
            }
        };
        let is_gone = |agent: &&AgentId| {
            let now = ctx.find(agent).map(|resident| resident.incarnation);
            now.is_none() || state.members.get(*agent) != now.as_ref()
        };
        if let Some(gone) = joint.parts.keys().find(is_gone).cloned() {
            let why = format!("`{gone}` has left");
            return self.plan_without(id, state, (gone, why), ctx);
        }
        let decision = self.decide(id, &state.known, &joint.plan);
        if matches!(decision, PlanDecision::Run) {
            return self.ask_for_agreements(id, state, joint, ctx);
        }
        // Other goals come first; a plan that does not run needs no agreement.
        self.plan_found(id, state.attempt, (joint.plan, joint.cost), decision, ctx);
    }

    /// Makes a joint plan anew without an agent, for a reason that is text for a person.
    fn plan_without(
        &mut self,
        id: &ConversationId,
        mut state: JointPlanState,
        (agent, why): (AgentId, String),
        ctx: &mut Context<Self>,
    ) {
        tracing::info!(conversation = %id, %agent, %why, "a joint plan is made without that agent");
        state.declined.push(why);
        state.members.remove(&agent);
        state.known = without(state.known, &BTreeSet::from([agent]));
        if state.plans < PLANS_MAX {
            return self.search_jointly(id, state, ctx);
        }
        self.joint_plan_missing(id, state, ctx);
    }

    // === agreements ===

    /// Asks each agent that acts in a joint plan to agree to its part.
    fn ask_for_agreements(
        &mut self,
        id: &ConversationId,
        mut state: JointPlanState,
        joint: JointPlan,
        ctx: &mut Context<Self>,
    ) {
        let conjuncts: Vec<_> = self.open_conjuncts(id).iter().map(ToString::to_string).collect();
        let mut awaited = BTreeMap::new();
        for (agent, part) in &joint.parts {
            let (conjuncts, part) = (conjuncts.clone(), Some(part.clone()));
            let content = CallForProposals { conjuncts, together: true, part };
            let to = Some(agent.clone());
            let token = self.open_call_with(id, to, content, Self::part_answered, ctx);
            awaited.insert(agent.clone(), token);
        }
        let (asked, deadline) = (id.clone(), ctx.settings().proposals_deadline);
        let timer = ctx.after(deadline, move |requester: &mut Self, ctx| {
            requester.agreements_overdue(&asked, ctx);
        });
        let reminder = self.agreement_reminder(id, ctx.settings().retry_backoff(), ctx);
        let agreed = BTreeMap::new();
        let pending = PendingAgreements { joint, awaited, agreed, timer, reminder };
        state.phase = JointPhase::Agreeing(pending);
        if let Some(goal) = self.goals.get_mut(id) {
            goal.work = Work::Joint(Box::new(state));
        }
    }

    fn agreeing(&mut self, id: &ConversationId) -> Option<&mut PendingAgreements> {
        match &mut self.planning_jointly(id)?.phase {
            JointPhase::Agreeing(pending) => Some(pending),
            JointPhase::Searching(_) | JointPhase::Idle => None,
        }
    }

    /// Starts the timer that asks again the agents that have not answered, after the waits of
    /// `backoff`.
    fn agreement_reminder(
        &mut self,
        id: &ConversationId,
        mut backoff: RetryBackoff,
        ctx: &mut Context<Self>,
    ) -> TimerId {
        let asked = id.clone();
        ctx.after(backoff.next_wait(), move |requester: &mut Self, ctx| {
            let Some(pending) = requester.agreeing(&asked) else { return };
            for (agent, token) in &pending.awaited {
                ctx.resend_cfp(token, agent);
            }
            let next = requester.agreement_reminder(&asked, backoff, ctx);
            if let Some(pending) = requester.agreeing(&asked) {
                pending.reminder = next;
            }
        })
    }

    /// Handles the answer of an agent that was asked to agree to its part.
    fn part_answered(&mut self, id: &ConversationId, message: Message, ctx: &mut Context<Self>) {
        let agent = message.sender.clone();
        let awaited = self.agreeing(id).and_then(|pending| pending.awaited.get(&agent));
        if awaited.is_none() || awaited != message.exchange() {
            return reject_late(&message, ctx);
        }
        let Some(state) = self.planning_jointly(id) else { return };
        let is_same = state.members.get(&agent) == Some(&message.incarnation);
        let JointPhase::Agreeing(pending) = &mut state.phase else { return };
        let mut differs = false;
        let answer = match message.performative {
            Performative::Agree => match message.content_as::<Bid>() {
                Ok(bid) if bid.agreed.as_ref() == Some(&pending.joint.digest) && is_same => Ok(()),
                Ok(_) => Err("it takes no part in joint plans".to_owned()),
                Err(error) => Err(format!("its answer cannot be read: {error}")),
            },
            _ => {
                let refusal = message.content_as::<Refusal>();
                let said = refusal.as_ref().ok().and_then(|refusal| match refusal.reason {
                    Reason::Busy | Reason::MailboxFull => Some((refusal, "has other work")),
                    Reason::ModelChanged => Some((refusal, "has announced a more precise model")),
                    _ => None,
                });
                if let Some((refusal, said)) = said {
                    let why = format!("`{agent}` {said}: {}", refusal.detail);
                    return self.postpone_joint_plan(id, &agent, why, ctx);
                }
                differs = refusal.as_ref().is_ok_and(|it| it.reason == Reason::Conflict);
                Err(refusal.map_or_else(|_| "without a reason".to_owned(), |it| it.detail))
            }
        };
        if let Err(why) = answer {
            let why = format!("`{agent}` declines its part: {why}");
            if differs {
                state.differing.get_or_insert_with(|| why.clone());
            }
            return self.part_declined(id, (agent, why), ctx);
        }
        pending.agreed.extend(pending.awaited.remove_entry(&agent));
        if pending.awaited.is_empty() {
            self.all_agreed(id, ctx);
        }
    }

    /// Gives the present joint plan up because of an agent, and makes another one without it.
    fn part_declined(
        &mut self,
        id: &ConversationId,
        declined: (AgentId, String),
        ctx: &mut Context<Self>,
    ) {
        let Some(mut state) = self.take_joint_plan(id) else { return };
        if let JointPhase::Agreeing(pending) = std::mem::take(&mut state.phase) {
            pending.reject("another agent does not take part", ctx);
        }
        self.plan_without(id, state, declined, ctx);
    }

    /// Gives the present joint plan up because one of its agents has other work, or another model than
    /// the plan was made with, and plans for the goal again after a while. Nothing has failed, so the
    /// agent is not left out.
    fn postpone_joint_plan(
        &mut self,
        id: &ConversationId,
        agent: &AgentId,
        why: String,
        ctx: &mut Context<Self>,
    ) {
        let Some(state) = self.take_joint_plan(id) else { return };
        let attempt = state.attempt;
        if let JointPhase::Agreeing(mut pending) = state.phase {
            // This agent has answered; its exchange is over.
            pending.awaited.remove(agent);
            pending.reject("another agent of the plan cannot take part now", ctx);
        }
        self.handle(id, GoalEvent::MembersBusy(attempt, why, waiting_share(id, attempt)), ctx);
    }

    fn agreements_overdue(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let silent = self.agreeing(id).and_then(|pending| pending.awaited.keys().next().cloned());
        if let Some(silent) = silent {
            let why = format!("`{silent}` did not answer for its part");
            self.part_declined(id, (silent, why), ctx);
        }
    }

    /// Handles the departure of an agent during joint planning for a goal.
    pub(crate) fn member_left(
        &mut self,
        id: &ConversationId,
        agent: &AgentId,
        ctx: &mut Context<Self>,
    ) {
        // While the plan is searched, the agents that act in it are unknown; they are looked at then.
        let Some(pending) = self.agreeing(id) else { return };
        if pending.joint.parts.contains_key(agent) {
            let why = format!("`{agent}` has left");
            self.part_declined(id, (agent.clone(), why), ctx);
        }
    }

    /// Accepts all agreements to a joint plan, and has the plan executed.
    fn all_agreed(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let conjuncts: Vec<_> = self.open_conjuncts(id).iter().map(ToString::to_string).collect();
        let Some(JointPlanState { attempt, known, gap, declined, phase, .. }) =
            self.take_joint_plan(id)
        else {
            return;
        };
        let JointPhase::Agreeing(pending) = phase else { return };
        let decision = self.decide(id, &known, &pending.joint.plan);
        let is_run = matches!(decision, PlanDecision::Run);
        let why = gap.describe(&declined);
        let joint = match is_run {
            true => pending.accept(conjuncts, ctx),
            false => pending.reject("other goals come first", ctx),
        };
        if is_run {
            self.send_report(id, Report::new(Outcome::Progress, joint.describe(&why)), ctx);
        }
        self.plan_found(id, attempt, (joint.plan, joint.cost), decision, ctx);
    }

    // === no plan ===

    fn joint_plan_missing(
        &mut self,
        id: &ConversationId,
        state: JointPlanState,
        ctx: &mut Context<Self>,
    ) {
        let open = self.open_conjuncts(id);
        let (now, lease) = (ctx.now(), ctx.settings().heartbeat_lease);
        let Some(goal) = self.goals.get_mut(id) else { return };
        if let Some(why) = &state.differing {
            // A heartbeat may have been lost on the way to one of the two.
            let since = *goal.views_differ_since.get_or_insert(now);
            if now.saturating_duration_since(since) < lease {
                let (attempt, why) = (state.attempt, why.clone());
                let share = waiting_share(id, attempt);
                return self.handle(id, GoalEvent::MembersBusy(attempt, why, share), ctx);
            }
        }
        goal.views_differ_since = None;
        let goal = goal.condition.clone();
        let JointPlanState { attempt, gap, declined, .. } = state;
        let explained = move |known: &PlanningSnapshot, cancel: &Cancel| {
            let why = why_none(known, &goal, open, (&gap, &declined), cancel);
            format!("{why}{}", joint_plans::members(known))
        };
        self.plan_missing(id, attempt, explained, ctx);
    }
}

/// Rejects an agreement that comes too late, so that it does not hold its agent.
fn reject_late(message: &Message, ctx: &mut Context<PlanRequester>) {
    let Some(token) = message.exchange().filter(|_| message.performative == Performative::Agree)
    else {
        return;
    };
    let detail = "the joint plan was given up meanwhile".to_owned();
    let choice = value(&Choice::new(Vec::new(), detail));
    ctx.send_turn(token, &message.sender, Performative::RejectProposal, choice);
    ctx.close(token);
}

/// Returns by which share a goal waits longer than others before it is planned for again, in 256ths.
/// Goals that want the same agents at the same moment have different shares, and other ones in each
/// attempt; otherwise they would meet again and again.
fn waiting_share(id: &ConversationId, attempt: Attempt) -> u8 {
    let hash = Fnv64::default().with(id.as_str().as_bytes()).with(&attempt.0.to_le_bytes()).value();
    // The upper bits of this hash depend on all bytes of the input.
    u8::try_from(hash >> 56).unwrap_or(u8::MAX)
}

/// Returns the snapshot without the actions of some agents.
fn without(known: Arc<PlanningSnapshot>, agents: &BTreeSet<AgentId>) -> Arc<PlanningSnapshot> {
    match agents.is_empty() {
        true => known,
        false => Arc::new(PlanningSnapshot::clone(&known).without_offers_of(agents)),
    }
}

/// Plans for `wanted` with the actions of all agents in `known`.
///
/// # Errors
///
/// Returns the reason, as text for a person, if there is no valid plan.
fn search(
    known: &PlanningSnapshot,
    wanted: &Condition,
    cancel: &Cancel,
) -> Result<JointPlan, String> {
    let memory_max_bytes = agent::computation_bytes_max();
    let budget = Budget { memory_max_bytes, ..Budget::default() };
    let options = Options { budget, ..Options::default() };
    let outcome = planner::plan(&known.domain, &known.problem_of(wanted), &options, cancel)
        .map_err(|error| error.to_string())?;
    let plan = outcome.plan.ok_or_else(|| outcome.stop_reason.to_string())?;
    JointPlan::of(known, Plan { cost: None, ..plan }, wanted)
}

/// Returns the reason why there is neither a valid set of proposals nor a joint plan.
fn why_none(
    known: &PlanningSnapshot,
    goal: &Condition,
    mut open: Vec<Condition>,
    (gap, declined): (&BiddingGap, &[String]),
    cancel: &Cancel,
) -> String {
    if !gap.missing.is_empty() {
        open.retain(|conjunct| gap.missing.contains(&conjunct.to_string()));
    }
    let names: Vec<_> = open.iter().map(|conjunct| format!("`{conjunct}`")).collect();
    let names = names.join(" and ");
    let held = explanations::describe_avoided(&known.avoided);
    let otherwise = || format!("no agent proposes a plan of its own for {names}{held}");
    let together = |_: &Explanation| {
        let all = known.parts(goal);
        let reason = joint_plans::reason(known, &all, (&names, declined), cancel);
        match gap.problems.first().filter(|_| gap.missing.is_empty()) {
            Some(first) => format!("the proposals do not work together: {first}; {reason}"),
            None => format!("{reason}{held}"),
        }
    };
    explain(known, &open, cancel, together).unwrap_or_else(otherwise)
}
