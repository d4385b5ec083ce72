//! Events about goals: requests, calls for proposals, bids, plans and outcomes.

use acl::content::{
    Bid, CallForProposals, Choice, GoalStatus, HistoryKind, HistoryRoot, Keep, Outcome,
    PlanProposal, Report,
};
use acl::{Message, Performative, Protocol};
use serde_json::Value;

use super::EventRecorder;
use super::awards::{AwardTrace, BidTrace, award_of};
use super::draft::{EventCause, EventDraft, EventLink};
use super::steps::ExchangeTopic;
use crate::event::shortened;

/// Beginnings of reports that say why there is another plan, or none.
const BREAKING: [&str; 4] = ["planning anew", "since the last plan", "no plan now", "waiting"];

/// Maximum number of bidders of one call whose events are known by name.
const BIDS_MAX: usize = 64;

/// What the recorder remembers of the conversation of a goal.
#[derive(Debug)]
pub(crate) struct GoalTrace {
    /// The goal, as text.
    pub(super) goal: String,
    /// The newest event of the goal.
    pub(super) last: EventLink,
    /// The newest event of the kind `goal`.
    pub(super) newest_goal_event: EventLink,
    /// What caused the next plan: the request, or what broke the plan before.
    pub(super) trigger: EventLink,
    /// The proposal of the Planning Agent for the next plan.
    chosen: Option<EventLink>,
    /// The accepted bids of the next plan.
    awards: Vec<AwardTrace>,
    /// The accepted bids of the plan that is carried out.
    plan_awards: Vec<AwardTrace>,
    /// The plan that is carried out.
    pub(super) plan: Option<EventLink>,
    /// The newest step that was done.
    pub(super) last_step: Option<EventLink>,
    /// The newest step of the plan that has failed or was refused.
    pub(super) failed_step: Option<EventLink>,
    /// The newest report, which several agents may get.
    last_report: String,
}

// === impl GoalTrace ===

impl GoalTrace {
    pub(super) fn new(goal: String, event: EventLink) -> GoalTrace {
        GoalTrace {
            goal,
            last: event,
            newest_goal_event: event,
            trigger: event,
            chosen: None,
            awards: Vec::new(),
            plan_awards: Vec::new(),
            plan: None,
            last_step: None,
            failed_step: None,
            last_report: String::new(),
        }
    }

    /// Returns the cause of the next plan: what was chosen, the call if several bids were accepted,
    /// or else what caused the call.
    fn cause_of_plan(&self) -> EventLink {
        match (self.chosen, self.awards.as_slice()) {
            (Some(chosen), _) => chosen,
            (None, []) => self.trigger,
            (None, [award]) => award.event,
            (None, [first, rest @ ..]) => match rest.iter().all(|it| it.call == first.call) {
                true => first.call,
                false => self.trigger,
            },
        }
    }

    /// Returns the cause of a step: the accepted bid that it comes from, if the plan has several,
    /// or else the plan.
    pub(super) fn cause_of_step(&self, action: &str) -> EventLink {
        let several = Some(self.plan_awards.as_slice()).filter(|awards| awards.len() > 1);
        let award = several.and_then(|awards| award_of(awards, action));
        award.map(|award| award.event).or(self.plan).unwrap_or(self.last)
    }
}

impl EventRecorder {
    /// Learns of a goal that was asked for before the history began.
    pub fn goal_known(&mut self, status: &GoalStatus, at_ms: u64) {
        let conversation = status.conversation.as_str();
        if let Some(known) = self.goals.get_mut(conversation) {
            // The goal was heard of by its conversation only.
            if known.goal == *conversation {
                known.goal.clone_from(&status.goal);
            }
            return;
        }
        let text = format!("`{}` is wanted, {}", status.goal, self.beginning());
        let asker = asker_of(conversation);
        let cause = EventCause::Root(HistoryRoot::Person);
        let draft = EventDraft::new(HistoryKind::Goal, &status.goal, asker, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        self.goals.insert(conversation, GoalTrace::new(status.goal.clone(), event));
    }

    /// Returns what is known of a conversation. The event of a goal that the history has not heard
    /// of is recorded now.
    pub(super) fn goal(&mut self, conversation: &str, at_ms: u64) -> &mut GoalTrace {
        if !self.goals.contains(conversation) {
            let asker = asker_of(conversation);
            let text = match self.outage {
                Some(_) => format!("`{asker}` began this while the history did not run"),
                None => format!("`{asker}` began this before the history heard of it"),
            };
            let cause = self.own_initiative(asker);
            let draft = EventDraft::new(HistoryKind::Goal, conversation, asker, text, cause);
            let event = self.record(draft.of(conversation), at_ms);
            self.goals.insert(conversation, GoalTrace::new(conversation.to_owned(), event));
        }
        self.goals.get_mut(conversation).expect("invariant: it was inserted if it was missing")
    }

    /// Records that an agent asks for a goal.
    pub(super) fn hear_goal(&mut self, message: &Message, at_ms: u64) {
        let Ok(request) = message.content_as::<acl::content::Request>() else { return };
        let Some(achieve) = request.goal() else { return };
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        let kept = match achieve.keep {
            Keep::Maintain => ", to be kept",
            Keep::Achieve => "",
        };
        let goal = &achieve.goal;
        let text = match self.goals.contains(conversation) {
            true => format!("`{sender}` asks again for `{goal}`{kept}"),
            false => format!("`{sender}` asks for `{goal}`{kept}"),
        };
        let cause = match self.goals.get(conversation) {
            Some(known) => known.last.into(),
            None => self.own_initiative(sender),
        };
        let draft = EventDraft::new(HistoryKind::Goal, goal, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        match self.goals.get_mut(conversation) {
            Some(known) => {
                (known.last, known.newest_goal_event) = (event, event);
                known.goal.clone_from(goal);
            }
            None => self.goals.insert(conversation, GoalTrace::new(goal.clone(), event)),
        }
        self.open_exchange(message, ExchangeTopic::Goal, goal, event);
    }

    /// Records a report about a goal.
    pub(super) fn hear_goal_report(&mut self, message: &Message, report: &Report, at_ms: u64) {
        let conversation = message.conversation_id.as_str();
        let told = format!("{} {}", report.outcome, report.detail);
        let trace = self.goal(conversation, at_ms);
        // The plan is recorded when its execution is requested.
        if report.plan.is_some() || trace.last_report == told {
            return;
        }
        trace.last_report = told;
        let (goal, last, plan) = (trace.goal.clone(), trace.last, trace.plan);
        let last_step = trace.last_step;
        let breaks = BREAKING.iter().any(|begin| report.detail.starts_with(begin));
        let cause = match report.outcome {
            Outcome::Holds | Outcome::Done => last_step.or(plan).unwrap_or(last).into(),
            Outcome::Progress if !breaks => last.into(),
            Outcome::Progress | Outcome::Failed => {
                self.breaking_event(&report.detail, conversation, at_ms)
            }
            Outcome::Cancelled => last.into(),
        };
        let text = match report.outcome {
            Outcome::Done => format!("`{goal}` is reached: {}", report.detail),
            Outcome::Failed => format!("`{goal}` is given up: {}", report.detail),
            Outcome::Cancelled => format!("`{goal}` is cancelled: {}", report.detail),
            Outcome::Progress | Outcome::Holds => format!("`{goal}`: {}", report.detail),
        };
        let worked = matches!(report.outcome, Outcome::Holds | Outcome::Done);
        let sender = message.sender.as_str();
        let draft = EventDraft::new(HistoryKind::Goal, &goal, sender, text, cause).worked(worked);
        let event = self.record(draft.of(conversation), at_ms);
        let trace = self.goal(conversation, at_ms);
        (trace.last, trace.newest_goal_event) = (event, event);
        if breaks || report.outcome != Outcome::Progress {
            trace.trigger = event;
            (trace.chosen, trace.failed_step) = (None, None);
            trace.awards.clear();
        }
    }

    /// Records a call for proposals.
    pub(super) fn hear_call(&mut self, message: &Message, at_ms: u64) {
        let Ok(call) = message.content_as::<CallForProposals>() else { return };
        let conversation = message.conversation_id.as_str();
        let conjuncts = call.conjuncts.join(" ");
        let trace = self.goal(conversation, at_ms);
        let cause = trace.trigger;
        if trace.goal == *conversation {
            trace.goal = match call.conjuncts.len() {
                1 => conjuncts.clone(),
                _ => format!("(and {conjuncts})"),
            };
        }
        let sender = message.sender.as_str();
        let text = format!("`{sender}` calls for proposals for `{}`", shortened(&conjuncts));
        let draft = EventDraft::new(HistoryKind::Bid, &conjuncts, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        self.open_exchange(message, ExchangeTopic::Call, &conjuncts, event);
    }

    /// Records a bid. The acceptance of an action says nothing new.
    pub(super) fn hear_bid(&mut self, message: &Message, at_ms: u64) {
        if message.protocol != Some(Protocol::ContractNet) {
            return;
        }
        let Ok(bid) = message.content_as::<Bid>() else { return };
        let Some(exchange) = self.exchange_of(message) else { return };
        let cause = exchange.event;
        let proposals =
            bid.proposals.iter().take(8).map(|proposal| {
                format!("`{}` at cost {}", proposal.covers.join(" "), proposal.cost)
            });
        let offered = proposals.collect::<Vec<_>>().join(", ");
        let covered: Vec<_> =
            bid.proposals.iter().flat_map(|proposal| proposal.covers.iter().cloned()).collect();
        let covered = covered.join(" ");
        let sender = message.sender.as_str();
        let text = format!("`{sender}` proposes {offered}");
        let draft = EventDraft::new(HistoryKind::Bid, &covered, sender, text, cause);
        let event = self.record(draft.of(message.conversation_id.as_str()), at_ms);
        if let Some(exchange) = self.exchange_of_mut(message)
            && exchange.bids.len() < BIDS_MAX
        {
            exchange.bids.push(BidTrace::new(sender, &bid, event));
        }
    }

    /// Records that proposals are accepted or rejected.
    pub(super) fn hear_choice(&mut self, message: &Message, at_ms: u64) {
        if message.protocol != Some(Protocol::ContractNet) {
            return;
        }
        let Ok(choice) = message.content_as::<Choice>() else { return };
        let Some(exchange) = self.exchange_of(message) else { return };
        let bidder = message.receiver.first().map_or("", |agent| agent.as_str());
        let (call, bid) = (exchange.event, exchange.bid_of(bidder));
        let cause = bid.map_or(call, |bid| bid.event);
        let conjuncts = match choice.covers.is_empty() {
            true => exchange.subject.to_string(),
            false => choice.covers.join(" "),
        };
        let conversation = message.conversation_id.as_str();
        let is_accepted = message.performative == Performative::AcceptProposal;
        let verb = if is_accepted { "is chosen" } else { "is not chosen" };
        let who = match message.receiver.len() {
            0 | 1 => format!("`{bidder}`"),
            count => format!("`{bidder}` and {} more", count - 1),
        };
        let text = format!("{who} {verb} for `{}`: {}", shortened(&conjuncts), choice.detail);
        let draft = EventDraft::new(HistoryKind::Bid, &conjuncts, bidder, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        if is_accepted {
            let bid = self.exchange_of(message).and_then(|exchange| exchange.bid_of(bidder));
            let award = AwardTrace::new(bidder, &conjuncts, bid, call, event);
            let awards = &mut self.goal(conversation, at_ms).awards;
            if awards.len() < BIDS_MAX {
                awards.push(award);
            }
        }
    }

    /// Records the plan that the Planning Agent proposes, or the reason why it has none.
    pub(super) fn hear_proposal(&mut self, message: &Message, at_ms: u64) {
        let Ok(proposal) = message.content_as::<PlanProposal>() else { return };
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        let trace = self.goal(conversation, at_ms);
        let (goal, cause) = (trace.goal.clone(), trace.trigger);
        let text = match (&proposal.plan, proposal.cost, &proposal.detail) {
            (Some(_), Some(cost), _) => format!("`{sender}` proposes a plan at cost {cost}"),
            (Some(_), None, _) => format!("`{sender}` proposes a plan"),
            (None, _, Some(why)) => format!("`{sender}` has no plan: {why}"),
            (None, _, None) => format!("`{sender}` has no plan: {}", proposal.status),
        };
        let draft = EventDraft::new(HistoryKind::Plan, &goal, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        let trace = self.goal(conversation, at_ms);
        (trace.chosen, trace.last) = (Some(event), event);
    }

    /// Records that a plan is to be carried out.
    pub(super) fn hear_execute(&mut self, message: &Message, at_ms: u64) {
        let content = &message.content;
        let plan = content.get("plan").and_then(Value::as_str).unwrap_or_default();
        let round = content.get("round").and_then(Value::as_u64).unwrap_or_default();
        let steps: Vec<_> = super::pddl_text::lists(plan).collect();
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        if !self.goals.contains(conversation) && asker_of(conversation) == sender {
            self.hear_single_action(conversation, sender, &steps.join(" "), at_ms);
        }
        let trace = self.goal(conversation, at_ms);
        let (goal, cause) = (trace.goal.clone(), trace.cause_of_plan());
        let count = match steps.len() {
            1 => "1 step".to_owned(),
            count => format!("{count} steps"),
        };
        let text = format!("plan {round}, of {count}: {}", steps.join(" "));
        let draft = EventDraft::new(HistoryKind::Plan, &goal, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        let trace = self.goal(conversation, at_ms);
        (trace.plan, trace.last) = (Some(event), event);
        (trace.last_step, trace.failed_step) = (None, None);
        trace.plan_awards = std::mem::take(&mut trace.awards);
        self.open_exchange(message, ExchangeTopic::Plan, &goal, event);
    }

    /// Records that an agent asks for an action, and not for a goal.
    pub(super) fn hear_single_action(
        &mut self,
        conversation: &str,
        sender: &str,
        action: &str,
        at_ms: u64,
    ) {
        let cause = self.own_initiative(sender);
        let text = format!("`{sender}` asks for `{action}`");
        let draft = EventDraft::new(HistoryKind::Goal, action, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        self.goals.insert(conversation, GoalTrace::new(action.to_owned(), event));
    }

    /// Records the end of a plan.
    pub(super) fn hear_plan_report(&mut self, message: &Message, report: &Report, at_ms: u64) {
        if !report.outcome.is_final() {
            return;
        }
        let conversation = message.conversation_id.as_str();
        let trace = self.goal(conversation, at_ms);
        let (goal, plan, last) = (trace.goal.clone(), trace.plan, trace.last);
        let told = format!("plan {} {}", report.outcome, report.detail);
        if trace.last_report == told {
            return;
        }
        trace.last_report = told;
        let cause = match report.outcome {
            Outcome::Done => trace.last_step.or(plan).unwrap_or(last).into(),
            Outcome::Failed => self.breaking_event(&report.detail, conversation, at_ms),
            _ => last.into(),
        };
        let text = format!("the plan is {}: {}", report.outcome, report.detail);
        let sender = message.sender.as_str();
        let draft = EventDraft::new(HistoryKind::Plan, &goal, sender, text, cause);
        let worked = report.outcome == Outcome::Done;
        let event = self.record(draft.of(conversation).worked(worked), at_ms);
        let trace = self.goal(conversation, at_ms);
        trace.last = event;
        if report.outcome == Outcome::Failed {
            trace.failed_step = Some(event);
        }
    }
}

/// Returns the name of the agent that began a conversation, which begins its identifier.
pub(super) fn asker_of(conversation: &str) -> &str {
    let mut parts = conversation.rsplitn(3, '.');
    let (_, _, name) = (parts.next(), parts.next(), parts.next());
    name.unwrap_or(conversation)
}
