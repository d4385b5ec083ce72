//! The decentralised planning flow, on the side of the initiator of the contract net. The Plan
//! Requester sends a call for proposals to all actuators. The cheapest set of proposals that covers
//! the goal wins (the paper, “Flow of Control in Decentralized Plan Execution”).
//!
//! A round of calls closes when all called agents have answered or left, or at the deadline of the
//! round. If one agent is the cheapest bidder for several conjuncts, a second round calls that
//! agent for a proposal for all these conjuncts together. If no set of proposals reaches the goal, a
//! joint plan is made (`joint_planning`).

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::content::{Bid, CallForProposals, Outcome, Proposal, Reason, Refusal, Report, value};
use acl::{AgentId, ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{Context, ExchangeEvent, ExchangeOpening, RetryBackoff, TimerId};
use goal_lifecycle::{Attempt, GoalEvent, PlanDecision};
use pddl::{Condition, Plan};
use planner::Cancel;

use crate::PlanRequester;
use crate::explanations;
use crate::goal::Work;
use crate::joint_state::BiddingGap;
use crate::planning::explain;
use crate::planning_snapshot::PlanningSnapshot;
use crate::proposals::ContractNetState;
use crate::selection::{Selection, bundles, uncovered};

impl PlanRequester {
    /// Sends a call for proposals for a goal to all actuators.
    pub(crate) fn call_for_proposals(
        &mut self,
        id: &ConversationId,
        attempt: Attempt,
        known: &Arc<PlanningSnapshot>,
        open: &[Condition],
        ctx: &mut Context<Self>,
    ) {
        let conjuncts: Vec<_> = open.iter().map(ToString::to_string).collect();
        let here = ctx.directory();
        let called: Vec<_> =
            known.offers.keys().filter(|agent| here.find(agent).is_some()).cloned().collect();
        if called.is_empty() {
            let open = open.to_vec();
            let explained = move |known: &PlanningSnapshot, cancel: &Cancel| {
                let nobody = || "no agent here offers any action".to_owned();
                explain(known, &open, cancel, |_| nobody()).unwrap_or_else(nobody)
            };
            return self.plan_missing(id, attempt, explained, ctx);
        }
        let content =
            CallForProposals { conjuncts: conjuncts.clone(), ..CallForProposals::default() };
        let token = self.open_call(id, None, content, ctx);
        let timer = self.round_timer(id, ctx);
        let reminder = self.reminder(id, ctx.settings().retry_backoff(), ctx);
        let awaited = called.into_iter().map(|agent| (agent, token.clone())).collect();
        let call = ContractNetState {
            attempt,
            known: Arc::clone(known),
            conjuncts,
            awaited,
            bids: BTreeMap::new(),
            refusals: BTreeMap::new(),
            silent: BTreeSet::new(),
            ahead: BTreeSet::new(),
            made_in: Vec::new(),
            tokens: vec![token],
            timer,
            reminder,
            is_second_round: false,
        };
        if let Some(goal) = self.goals.get_mut(id) {
            goal.work = Work::Proposals(Box::new(call));
        }
    }

    fn open_call(
        &mut self,
        id: &ConversationId,
        to: Option<AgentId>,
        content: CallForProposals,
        ctx: &mut Context<Self>,
    ) -> ReplyToken {
        self.open_call_with(id, to, content, Self::bidder_answered, ctx)
    }

    /// Sends a call for proposals; `answered` is called with each answer.
    pub(crate) fn open_call_with(
        &mut self,
        id: &ConversationId,
        to: Option<AgentId>,
        content: CallForProposals,
        answered: fn(&mut Self, &ConversationId, Message, &mut Context<Self>),
        ctx: &mut Context<Self>,
    ) -> ReplyToken {
        let opening = ExchangeOpening {
            to,
            performative: Performative::Cfp,
            protocol: Protocol::ContractNet,
            conversation: id.clone(),
            content: value(&content),
        };
        // The time limit is longer than a round, because the winners are notified in this exchange
        // after the round has closed.
        let patience = ctx.settings().proposals_deadline * 3;
        let called = id.clone();
        ctx.open(opening, patience, move |requester: &mut Self, answer, ctx| {
            if let ExchangeEvent::Message(message) = answer {
                answered(requester, &called, *message, ctx);
            }
        })
    }

    fn round_timer(&mut self, id: &ConversationId, ctx: &mut Context<Self>) -> TimerId {
        let called = id.clone();
        let deadline = ctx.settings().proposals_deadline;
        ctx.after(deadline, move |requester: &mut Self, ctx| requester.close_round(&called, ctx))
    }

    /// Starts the timer that sends the call again to agents that have not answered, after the waits
    /// of `backoff`, until the round ends.
    fn reminder(
        &mut self,
        id: &ConversationId,
        mut backoff: RetryBackoff,
        ctx: &mut Context<Self>,
    ) -> TimerId {
        let called = id.clone();
        ctx.after(backoff.next_wait(), move |requester: &mut Self, ctx| {
            let Some(call) = requester.calling(&called) else { return };
            for (agent, token) in &call.awaited {
                ctx.resend_cfp(token, agent);
            }
            let next = requester.reminder(&called, backoff, ctx);
            if let Some(call) = requester.calling(&called) {
                call.reminder = next;
            }
        })
    }

    fn calling(&mut self, id: &ConversationId) -> Option<&mut ContractNetState> {
        match &mut self.goals.get_mut(id)?.work {
            Work::Proposals(call) => Some(call),
            _ => None,
        }
    }

    fn bidder_answered(&mut self, id: &ConversationId, message: Message, ctx: &mut Context<Self>) {
        let Some(call) = self.calling(id) else { return };
        let Some(token) = message.exchange().cloned() else { return };
        let bidder = message.sender.clone();
        let is_called = call.known.offers.contains_key(&bidder);
        if message.performative == Performative::Agree {
            match message.content_as::<Bid>() {
                Ok(mut bid) => {
                    if bid
                        .proposals
                        .iter()
                        .any(|proposal| call.known.uses_newer_model(&proposal.plan))
                    {
                        call.ahead.insert(bidder.clone());
                    }
                    // The bidder may use avoided actions, because it does not receive the list of
                    // avoided actions.
                    bid.proposals.retain(|proposal| call.known.admits(&proposal.plan));
                    let covers = |proposal: &Proposal| {
                        (bidder.clone(), proposal.covers.clone(), token.clone())
                    };
                    call.made_in.extend(bid.proposals.iter().map(covers));
                    // An agent that was not called is in use by another goal.
                    if is_called {
                        call.bids.entry(bidder.clone()).or_default().extend(bid.proposals);
                    }
                }
                Err(error) => ctx.not_understood(&message, error.to_string()),
            }
        } else {
            // A refusal as incapable is the ordinary case and is not reported.
            let is_news = |refusal: &Refusal| refusal.reason != Reason::Incapable;
            let refusal = message.content_as::<Refusal>().ok().filter(is_news);
            call.refusals.extend(refusal.map(|refusal| (bidder.clone(), refusal.detail)));
        }
        let Some(call) = self.calling(id) else { return };
        call.awaited.remove(&bidder);
        if call.awaited.is_empty() {
            self.close_round(id, ctx);
        }
    }

    /// Stops waiting for the bids of an agent that has left.
    pub(crate) fn bidder_left(&mut self, agent: &AgentId, ctx: &mut Context<Self>) {
        let ids: Vec<_> = self.goals.keys().cloned().collect();
        for id in ids {
            self.member_left(&id, agent, ctx);
            let Some(call) = self.calling(&id) else { continue };
            if call.awaited.remove(agent).is_some() && call.awaited.is_empty() {
                self.close_round(&id, ctx);
            }
        }
    }

    fn close_round(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(call) = self.calling(id) else { return };
        ctx.cancel_timer(call.timer);
        ctx.cancel_timer(call.reminder);
        let silent: Vec<_> = call.awaited.keys().map(ToString::to_string).collect();
        if !silent.is_empty() {
            tracing::info!(conversation = %id, silent = silent.join(", "),
                "no answer to the call for proposals");
        }
        call.silent.extend(std::mem::take(&mut call.awaited).into_keys());
        let wanted = bundles(&call.conjuncts, &call.bids);
        if !call.is_second_round && !wanted.is_empty() {
            return self.call_for_bundles(id, wanted, ctx);
        }
        self.choose(id, ctx);
    }

    fn call_for_bundles(
        &mut self,
        id: &ConversationId,
        wanted: Vec<(AgentId, Vec<String>)>,
        ctx: &mut Context<Self>,
    ) {
        let timer = self.round_timer(id, ctx);
        let reminder = self.reminder(id, ctx.settings().retry_backoff(), ctx);
        let mut awaited = BTreeMap::new();
        for (agent, conjuncts) in wanted {
            let content = CallForProposals { conjuncts, together: true, part: None };
            let token = self.open_call(id, Some(agent.clone()), content, ctx);
            awaited.insert(agent, token);
        }
        let Some(call) = self.calling(id) else { return };
        call.is_second_round = true;
        call.tokens.extend(awaited.values().cloned());
        call.awaited = awaited;
        call.timer = timer;
        call.reminder = reminder;
    }

    /// Removes and returns the call for proposals of a goal, in order to end the call; `None` if
    /// there is none.
    fn take_call(&mut self, id: &ConversationId) -> Option<ContractNetState> {
        let work = &mut self.goals.get_mut(id)?.work;
        match std::mem::take(work) {
            Work::Proposals(call) => Some(*call),
            other => {
                *work = other;
                None
            }
        }
    }

    /// Rejects all proposals for a goal, if a call for proposals is open for it.
    pub(crate) fn reject_proposals(
        &mut self,
        id: &ConversationId,
        why: &str,
        ctx: &mut Context<Self>,
    ) {
        self.take_call(id).into_iter().for_each(|call| call.reject_all(why, ctx));
        self.give_up_joint_plan(id, why, ctx);
    }

    fn choose(&mut self, id: &ConversationId, ctx: &mut Context<Self>) {
        let Some(call) = self.calling(id) else { return };
        let attempt = call.attempt;
        match call.ahead.first() {
            Some(bidder) => {
                let why =
                    format!("the action model that `{bidder}` bids with is not known here yet");
                self.handle(id, GoalEvent::BidsOutdated(attempt, why.clone()), ctx);
                if self.calling(id).is_none() {
                    return;
                }
                tracing::warn!(conversation = %id, %why, "the bid of that agent is left out");
            }
            None => {
                if let Some(goal) = self.goals.get_mut(id) {
                    goal.state.note_bids_current();
                }
            }
        }
        let Some(mut call) = self.take_call(id) else { return };
        let known = Arc::clone(&call.known);
        let Some(wanted) = self.combined_goal(id, &known) else { return };
        let missing = uncovered(&call.conjuncts, &call.bids);
        let problems = match call.cheapest_valid(&wanted) {
            Ok((selection, plan, cost)) => {
                return self.chosen(id, call, &selection, (plan, cost), ctx);
            }
            Err(problems) => problems,
        };
        let (refusals, silent) = (call.refusals.clone(), call.silent.clone());
        call.reject_all("no set of proposals covers the goal", ctx);
        let gap = BiddingGap { missing, problems, refusals, silent };
        self.plan_jointly(id, attempt, (known, wanted), gap, ctx);
    }

    /// Handles a valid set of proposals that was chosen. Executes the combined plan, unless the
    /// decision is that the goal must wait for other goals.
    fn chosen(
        &mut self,
        id: &ConversationId,
        call: ContractNetState,
        selection: &Selection,
        (plan, cost): (Plan, f64),
        ctx: &mut Context<Self>,
    ) {
        let attempt = call.attempt;
        let decision = self.decide(id, &call.known, &plan);
        if matches!(decision, PlanDecision::Run) {
            let why =
                explanations::describe_choice(selection, &call.bids, &call.refusals, &call.silent);
            call.award(Some(selection), "another set of proposals is cheaper", ctx);
            if let Some(why) = why {
                self.send_report(id, Report::new(Outcome::Progress, why), ctx);
            }
        } else {
            call.reject_all("other goals come first", ctx);
        }
        self.plan_found(id, attempt, (plan, cost), decision, ctx);
    }
}
