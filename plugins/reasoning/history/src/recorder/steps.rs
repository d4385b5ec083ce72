//! Events about steps of plans, stops and questions, and about requests that are declined.

use std::sync::Arc;

use acl::content::{
    ChangeState, HistoryKind, HistoryRoot, Outcome, Reason, Refusal, Report, Request, Stop,
    StopEffect,
};
use acl::{Message, Protocol};
use serde_json::Value;

use super::EventRecorder;
use super::awards::BidTrace;
use super::draft::{EventCause, EventDraft, EventLink};
use super::goals::asker_of;

/// What the recorder remembers of an exchange.
#[derive(Debug)]
pub(crate) struct ExchangeTrace {
    pub(super) topic: ExchangeTopic,
    /// The goal, the action or the question.
    pub(super) subject: Arc<str>,
    /// The event of its first message.
    pub(super) event: EventLink,
    /// The bids of a call for proposals.
    pub(super) bids: Vec<BidTrace>,
    /// Change of the state that takes effect when it is confirmed.
    pub(super) change: Option<Box<ChangeState>>,
}

/// What an exchange is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ExchangeTopic {
    Goal,
    Call,
    Plan,
    Step,
    Stop,
    Question,
    Change,
}

// === impl ExchangeTrace ===

impl ExchangeTrace {
    /// Creates the trace of an exchange that an event opened.
    fn new(topic: ExchangeTopic, subject: &str, event: EventLink) -> ExchangeTrace {
        ExchangeTrace { topic, subject: subject.into(), event, bids: Vec::new(), change: None }
    }

    /// Returns the newest bid of an agent.
    pub(super) fn bid_of(&self, bidder: &str) -> Option<&BidTrace> {
        self.bids.iter().rev().find(|bid| *bid.bidder == *bidder)
    }
}

impl EventRecorder {
    /// Records a request.
    pub(super) fn hear_request(&mut self, message: &Message, at_ms: u64) {
        // The contents of some requests are long, and are not read.
        match message.content.get("act").and_then(Value::as_str) {
            Some("achieve") => return self.hear_goal(message, at_ms),
            Some("execute") => return self.hear_execute(message, at_ms),
            Some("plan" | "store-records" | "answer-question" | "read-history") | None => return,
            Some(_) => (),
        }
        match message.content_as::<Request>() {
            Ok(Request::Act(act)) => self.hear_act(message, &act.action, at_ms),
            Ok(Request::ChangeState(change)) => self.hear_change(message, change, at_ms),
            Ok(Request::Observe(observed)) => self.record_observation(message, &observed, at_ms),
            Ok(Request::Stop(stop)) => {
                let event = self.take_stop(&stop, at_ms);
                self.open_exchange(message, ExchangeTopic::Stop, &stop.id, event);
            }
            Ok(Request::ReleaseStops(release)) => {
                let ids = release.ids.join(" ");
                if !self.stops.contains(&format!("release {ids}")) {
                    let what = format!("releases {} stops: {ids}", release.ids.len());
                    let event = self.record_request(message, &what, at_ms);
                    self.stops.insert(&format!("release {ids}"), event);
                }
            }
            Ok(Request::SetMode(set)) => {
                let what = format!("changes the planning mode to {}", set.mode);
                let event = self.record_request(message, &what, at_ms);
                self.open_exchange(message, ExchangeTopic::Change, "the planning mode", event);
            }
            Ok(Request::ChangeMetric(change)) => {
                let metric = change.metric.unwrap_or_else(|| "that of the map".to_owned());
                let what = format!("changes the metric of plans to {metric}");
                let event = self.record_request(message, &what, at_ms);
                self.open_exchange(message, ExchangeTopic::Change, "the metric", event);
            }
            Ok(Request::ChangeActions(change)) => {
                let names = |actions: &[acl::content::ActionOf]| {
                    actions.iter().map(|it| it.action.clone()).collect::<Vec<_>>().join(", ")
                };
                let what = format!(
                    "withholds actions [{}] and gives back [{}]",
                    names(&change.withhold),
                    names(&change.give_back)
                );
                let event = self.record_request(message, &what, at_ms);
                self.open_exchange(message, ExchangeTopic::Change, "the actions", event);
            }
            Ok(Request::CancelPlan(_)) => (),
            Ok(_) | Err(_) => (),
        }
    }

    fn hear_change(&mut self, message: &Message, change: ChangeState, at_ms: u64) {
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        if let Some(owner) = &change.owner {
            // The effect of a step.
            let step =
                self.agents.get(owner.as_str()).and_then(|trace| trace.step_of(conversation));
            let cause = match step {
                Some(step) => step.into(),
                None => EventCause::Event(self.goal(conversation, at_ms).last),
            };
            return self.record_change(sender, &change, conversation, cause, at_ms);
        }
        let mut what = Vec::new();
        if !change.believe.is_empty() {
            what.push(format!("states `{}`", change.believe.trim()));
        }
        if !change.retract.is_empty() {
            what.push(format!("retracts `{}`", change.retract.trim()));
        }
        let event = self.record_request(message, &what.join(" and "), at_ms);
        self.open_exchange(message, ExchangeTopic::Change, "the state", event);
        if let Some(exchange) = self.exchange_of_mut(message) {
            exchange.change = Some(Box::new(change));
        }
    }

    fn hear_act(&mut self, message: &Message, action: &str, at_ms: u64) {
        let actor = message.receiver.first().map_or("", |agent| agent.as_str());
        let conversation = message.conversation_id.as_str();
        let sender = message.sender.as_str();
        if !self.goals.contains(conversation) && asker_of(conversation) == sender {
            self.hear_single_action(conversation, sender, action, at_ms);
        }
        let cause = self.goal(conversation, at_ms).cause_of_step(action);
        let text = format!("`{actor}` is asked for `{action}`");
        let draft = EventDraft::new(HistoryKind::Step, action, actor, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        self.goal(conversation, at_ms).last = event;
        self.agent(actor).begin_step(action, conversation, event);
        self.open_exchange(message, ExchangeTopic::Step, action, event);
    }

    /// Records a confirmation.
    pub(super) fn hear_confirm(&mut self, message: &Message, at_ms: u64) {
        let Ok(report) = message.content_as::<Report>() else { return };
        match message.protocol {
            Some(Protocol::Goal) => self.hear_goal_report(message, &report, at_ms),
            Some(Protocol::Execution) => self.hear_plan_report(message, &report, at_ms),
            Some(Protocol::Action) => self.hear_step_report(message, &report, at_ms),
            Some(Protocol::StateChange) => self.hear_change_report(message, &report, at_ms),
            _ => (),
        }
    }

    fn hear_step_report(&mut self, message: &Message, report: &Report, at_ms: u64) {
        let sender = message.sender.as_str();
        let Some(exchange) = self.exchange_of(message) else { return };
        let (action, begun) = (Arc::clone(&exchange.subject), exchange.event);
        let conversation = message.conversation_id.as_str();
        let mut event = begun;
        if report.outcome.is_final() {
            let text = match report.outcome {
                Outcome::Done => format!("`{action}` is done: {}", report.detail),
                Outcome::Cancelled => format!("`{action}` is cancelled: {}", report.detail),
                _ => format!("`{action}` fails: {}", report.detail),
            };
            let worked = report.outcome == Outcome::Done;
            let draft = EventDraft::new(HistoryKind::Step, &action, sender, text, begun);
            event = self.record(draft.of(conversation).worked(worked), at_ms);
            self.agent(sender).end_step(&action, event, at_ms);
            let trace = self.goal(conversation, at_ms);
            trace.last = event;
            // The others of a joint action are cancelled after the failure of one.
            let is_consequence =
                report.outcome == Outcome::Cancelled && trace.failed_step.is_some();
            match worked {
                true => trace.last_step = Some(event),
                false if is_consequence => (),
                false => trace.failed_step = Some(event),
            }
        }
        self.record_added(sender, &report.observations, conversation, event.into(), at_ms);
    }

    fn hear_change_report(&mut self, message: &Message, report: &Report, at_ms: u64) {
        let Some(exchange) = self.exchange_of_mut(message) else { return };
        let event = exchange.event;
        match exchange.topic {
            ExchangeTopic::Change => {
                let change = exchange.change.take();
                let conversation = message.conversation_id.as_str();
                let sender = message.receiver.first().map_or("", |agent| agent.as_str());
                if let (Some(change), Outcome::Done) = (change, report.outcome) {
                    self.record_change(sender, &change, conversation, event.into(), at_ms);
                }
            }
            ExchangeTopic::Stop => {
                let sender = message.sender.as_str();
                let text = match report.stop_effect {
                    Some(StopEffect::Ended) => format!("`{sender}` has ended what it did"),
                    Some(StopEffect::Doubtful) => {
                        format!("`{sender}` has not confirmed that it stands still")
                    }
                    _ => return,
                };
                let draft = EventDraft::new(HistoryKind::Stop, sender, sender, text, event);
                self.record(draft, at_ms);
            }
            _ => (),
        }
    }

    /// Records a stop, unless it is known, and returns its event.
    pub(super) fn take_stop(&mut self, stop: &Stop, at_ms: u64) -> EventLink {
        if let Some(known) = self.stops.get(&stop.id) {
            return *known;
        }
        let by = stop.by.as_str();
        let (scope, why) = (stop.scope.join(" "), stop.why.as_str());
        let what = if stop.is_of_everything() { "everything" } else { &scope };
        let text = match why {
            "" => format!("`{by}` stops {what}"),
            why => format!("`{by}` stops {what}: {why}"),
        };
        let cause = self.own_initiative(by);
        let event = self.record(EventDraft::new(HistoryKind::Stop, what, by, text, cause), at_ms);
        self.stops.insert(&stop.id, event);
        self.last_stop = Some(event);
        event
    }

    /// Returns the stop because of which a request was declined; `None` if it was another reason.
    fn stop_behind(&self, declined: Option<Reason>) -> Option<EventLink> {
        self.last_stop.filter(|_| declined == Some(Reason::Stopped))
    }

    /// Records that a request is declined.
    pub(super) fn hear_refusal(&mut self, message: &Message, at_ms: u64) {
        let refusal = message.content_as::<Refusal>().ok();
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        let Some(exchange) = self.exchange_of(message) else { return };
        let (topic, subject, event) =
            (exchange.topic, Arc::clone(&exchange.subject), exchange.event);
        let reason = refusal.as_ref().map(|refusal| refusal.reason);
        // The request is sent again, to the replica that leads.
        if reason == Some(Reason::StandingBy) {
            return;
        }
        // A stop goes to all agents; one that moves nothing has nothing to stop.
        if topic == ExchangeTopic::Stop
            && matches!(reason, Some(Reason::Incapable | Reason::UnexpectedPerformative) | None)
        {
            return;
        }
        let detail = refusal.map_or_else(String::new, |refusal| format!(": {}", refusal.detail));
        let cause = self.stop_behind(reason).unwrap_or(event);
        let text = format!("`{sender}` declines `{subject}`{detail}");
        let draft = EventDraft::new(HistoryKind::Refusal, &subject, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        match topic {
            ExchangeTopic::Step => {
                self.agent(sender).end_step(&subject, event, at_ms);
                let trace = self.goal(conversation, at_ms);
                (trace.last, trace.failed_step) = (event, Some(event));
            }
            ExchangeTopic::Goal | ExchangeTopic::Plan => {
                self.goal(conversation, at_ms).last = event;
            }
            _ => (),
        }
    }

    /// Records that a commitment is no longer wanted.
    pub(super) fn hear_cancel(&mut self, message: &Message, at_ms: u64) {
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        let exchange = self.exchange_of(message);
        let known = exchange
            .map(|exchange| (exchange.topic, Arc::clone(&exchange.subject), exchange.event));
        match (message.protocol, known) {
            // Anybody can name a goal that never was.
            (Some(Protocol::Goal), _) if !self.goals.contains(conversation) => (),
            (Some(Protocol::Goal), _) => {
                let goal = self.goal(conversation, at_ms).goal.clone();
                let cause = self.own_initiative(sender);
                let text = format!("`{sender}` cancels `{goal}`");
                let draft = EventDraft::new(HistoryKind::Goal, &goal, sender, text, cause);
                let event = self.record(draft.of(conversation), at_ms);
                let trace = self.goal(conversation, at_ms);
                (trace.last, trace.newest_goal_event) = (event, event);
            }
            (Some(Protocol::Action), Some((ExchangeTopic::Step, action, begun))) => {
                let told = self.goal(conversation, at_ms).newest_goal_event;
                let cause = if told.number > begun.number { told } else { begun };
                let actor = message.receiver.first().map_or("", |agent| agent.as_str());
                let text = format!("`{sender}` cancels `{action}`");
                let draft = EventDraft::new(HistoryKind::Step, &action, actor, text, cause);
                self.record(draft.of(conversation), at_ms);
            }
            (Some(Protocol::Query), Some((ExchangeTopic::Question, question, asked))) => {
                let text = format!("`{sender}` withdraws the question `{question}`");
                let draft = EventDraft::new(HistoryKind::Question, &question, sender, text, asked);
                self.record(draft.of(conversation), at_ms);
            }
            _ => (),
        }
    }

    /// Records a question to people.
    pub(super) fn hear_question(&mut self, message: &Message, at_ms: u64) {
        let Ok(question) = message.content_as::<acl::content::Question>() else { return };
        let (sender, conversation) = (message.sender.as_str(), message.conversation_id.as_str());
        let trace = self.agents.get(sender);
        let cause = trace.and_then(|trace| trace.running_step().or(trace.last_fact));
        let cause = cause.map_or(EventCause::Root(HistoryRoot::Sensor), EventCause::Event);
        let asked = message.receiver.first().map_or("people", |agent| agent.as_str());
        let text = format!("`{sender}` asks {asked}: {}", question.text);
        let draft = EventDraft::new(HistoryKind::Question, &question.text, sender, text, cause);
        let event = self.record(draft.of(conversation), at_ms);
        self.open_exchange(message, ExchangeTopic::Question, &question.text, event);
    }

    /// Records that a person has answered. What was answered is not recorded.
    pub(super) fn hear_answer(&mut self, message: &Message, at_ms: u64) {
        if message.protocol != Some(Protocol::Query) {
            return;
        }
        let Some(exchange) = self.exchange_of(message) else { return };
        let (question, asked) = (Arc::clone(&exchange.subject), exchange.event);
        let sender = message.sender.as_str();
        let text = format!("`{sender}` answers `{question}`");
        let draft = EventDraft::new(HistoryKind::Question, &question, sender, text, asked);
        self.record(draft.of(message.conversation_id.as_str()).worked(true), at_ms);
    }

    /// Remembers the exchange that a message opens.
    pub(super) fn open_exchange(
        &mut self,
        message: &Message,
        topic: ExchangeTopic,
        subject: &str,
        event: EventLink,
    ) {
        if let Some(token) = message.exchange() {
            self.exchanges.insert(token.as_str(), ExchangeTrace::new(topic, subject, event));
        }
    }

    pub(super) fn exchange_of(&self, message: &Message) -> Option<&ExchangeTrace> {
        self.exchanges.get(message.in_reply_to.as_ref()?.as_str())
    }

    pub(super) fn exchange_of_mut(&mut self, message: &Message) -> Option<&mut ExchangeTrace> {
        self.exchanges.get_mut(message.exchange()?.as_str())
    }
}
