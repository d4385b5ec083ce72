//! Messages: what each changes in the view, and the sentences about it.

use acl::content::{
    Achieve, Act, Bid, CallForProposals, ChangeActions, ChangeState, Choice, EpochChange, Execute,
    GoalPhase, Heartbeat, Keep, Mode, ModelAnnouncement, Outcome, Question, Reason, Refusal,
    Report, Request, Stop,
};
use acl::{Message, Performative, Protocol, ReplyToken};
use serde::Deserialize as _;
use serde::de::DeserializeOwned;
use serde_json::Value;

use super::{LiveView, TROUBLES_MAX, Trouble};
use crate::activity_log::Sentence;
use crate::agent_store::AgentChange;
use crate::fact_store::GroundFact;
use crate::moment::Moment;
use crate::redaction::holds_answer;
use crate::rows::StepState;
use crate::text::{number, plural, short};

/// Maximum length of the identifier of a message, a conversation or an exchange, in bytes.
const IDENTIFIER_BYTES_MAX: usize = 256;

/// Maximum number of parts of a list in a sentence.
const LISTED_MAX: usize = 3;

impl LiveView {
    pub(super) fn take_message(&mut self, at: Moment, message: &Message) {
        self.counts.messages = self.counts.messages.saturating_add(1);
        if !has_short_names(message) {
            self.counts.unreadable = self.counts.unreadable.saturating_add(1);
            self.unreadable_at = Some(at);
            return;
        }
        if message.protocol.is_none() && message.performative == Performative::Inform {
            return self.take_announcement(at, message);
        }
        if !self.duplicates.insert(&message.sender, &message.id) {
            return;
        }
        self.agents.spoke(at, &message.sender);
        let violation = self.transcript.receive(message).err().map(|error| error.to_string());
        if let Some(violation) = &violation {
            self.counts.out_of_turn += 1;
            let text = format!("{} breaks its protocol: {violation}", message.sender);
            keep_trouble(&mut self.out_of_turn, at, message, &text);
            let sentence = Sentence::problem(text).about(&message.sender);
            self.tell(at, sentence.in_conversation(&message.conversation_id));
        }
        // A message out of turn is shown like others: the one before it may not have been observed.
        self.conversations.add(at, message, violation);
        if holds_answer(message) {
            return self.take_answer(at, message);
        }
        match message.protocol {
            Some(Protocol::Goal) => self.take_goal(at, message),
            Some(Protocol::Planning) => self.take_planning(at, message),
            Some(Protocol::ContractNet) => self.take_contract_net(at, message),
            Some(Protocol::Execution) => self.take_execution(at, message),
            Some(Protocol::Action) => self.take_action(at, message),
            Some(Protocol::StateChange) => self.take_state_change(at, message),
            Some(Protocol::Query) => self.take_query(at, message),
            None => self.take_decline(at, message),
        }
    }

    fn tell_in(&mut self, at: Moment, message: &Message, sentence: Sentence) {
        let sentence = sentence.in_conversation(&message.conversation_id);
        let sentence = match sentence.agent {
            Some(_) => sentence,
            None => sentence.about(&message.sender),
        };
        self.tell(at, sentence);
    }

    /// Returns the goal of a message's conversation for a sentence.
    fn goal_of(&self, message: &Message) -> String {
        match self.goals.goal_text(&message.conversation_id) {
            "" => "a goal".to_owned(),
            goal => goal.to_owned(),
        }
    }

    // === announcements to all ===

    fn take_announcement(&mut self, at: Moment, message: &Message) {
        match message.content.get("of").and_then(Value::as_str) {
            Some("heartbeat") => {
                if let Ok(beat) = Heartbeat::deserialize(&message.content) {
                    let (sender, incarnation) = (&message.sender, message.incarnation);
                    let is_news = self.stops.is_held_by(sender)
                        || self.agents.is_news(at, sender, incarnation, &beat);
                    self.take_heartbeat(at, message, &beat);
                    self.events -= u64::from(!is_news);
                }
            }
            Some("model") => {
                if let Ok(announced) = ModelAnnouncement::deserialize(&message.content) {
                    self.take_model(at, message, &announced);
                }
            }
            Some("epoch") => {
                if let Ok(change) = EpochChange::deserialize(&message.content) {
                    self.take_change(at, message, &change);
                }
            }
            _ => (),
        }
    }

    fn take_heartbeat(&mut self, at: Moment, message: &Message, beat: &Heartbeat) {
        let sender = &message.sender;
        if !self.agents.heartbeat(at, sender, message.incarnation, beat) {
            return;
        }
        self.facts.heartbeat(at, sender.as_str(), beat);
        if self.stops.repeated(at, sender, &beat.stops)
            && !self.is_inventory(at)
            && let Some(stop) = beat.stops.last()
        {
            self.tell_stop(at, stop);
        }
    }

    fn tell_stop(&mut self, at: Moment, stop: &Stop) {
        let what = match stop.scope.as_slice() {
            [] => "everything".to_owned(),
            names => names.iter().take(LISTED_MAX).cloned().collect::<Vec<_>>().join(", "),
        };
        let why = if stop.why.is_empty() { String::new() } else { format!(": {}", stop.why) };
        let sentence = Sentence::problem(format!("{} stops {what}{why}", stop.by));
        self.tell(at, sentence.about(&stop.by));
    }

    fn take_model(&mut self, at: Moment, message: &Message, announced: &ModelAnnouncement) {
        let sender = &message.sender;
        self.agents.spoke(at, sender);
        let (model, change) = self.agents.model(sender, announced);
        if let Some(model) = model {
            self.moves.learn(&model.actions, str::to_owned);
            self.facts.learn(at, GroundFact::of_all(&model.init));
        }
        if change == AgentChange::Offers && !self.is_inventory(at) {
            let offered = self.agents.get(sender).map(|record| record.offered());
            let offered = offered.unwrap_or_default();
            let sentence = match offered.as_slice() {
                [] => Sentence::notable(format!("{sender} offers nothing now")),
                offered => Sentence::routine(format!("{sender} offers {}", offered.join(", "))),
            };
            self.tell(at, sentence.about(sender));
        }
        self.take_heartbeat(at, message, &announced.heartbeat);
    }

    fn take_change(&mut self, at: Moment, message: &Message, change: &EpochChange) {
        if !self.duplicates.insert(&message.sender, &message.id) {
            return;
        }
        self.agents.spoke(at, &message.sender);
        self.facts.change(at, change);
        for agent in &change.left {
            if self.agents.capability(at, agent, false) == AgentChange::Went {
                self.tell_departure(at, agent);
            }
        }
        for agent in &change.joined {
            if self.agents.capability(at, agent, true) == AgentChange::Came {
                self.tell_arrival(at, agent);
            }
        }
    }

    // === goals and planning ===

    fn take_goal(&mut self, at: Moment, message: &Message) {
        let (id, sender) = (&message.conversation_id, &message.sender);
        match message.performative {
            Performative::Request => {
                let Some(request) = read::<Request>(message) else { return };
                let Some(achieve) = request.goal() else { return };
                if self.goals.achieve(at, id, sender, achieve) {
                    let Achieve { goal, keep, .. } = achieve;
                    let kept = if *keep == Keep::Maintain { ", and to keep it" } else { "" };
                    let text = format!("{sender} asks for {goal}{kept}");
                    self.tell_in(at, message, Sentence::notable(text));
                }
            }
            Performative::Confirm => {
                let Some(report) = read::<Report>(message) else { return };
                // A goal that holds is reported again after a new start of its Plan Requester, and
                // is no news; nor is one that was asked for before the view began.
                let is_repeated = report.outcome == Outcome::Holds
                    && (self.goals.holds(id) || self.is_inventory(at) && !self.goals.was_asked(id));
                self.goals.goal_report(at, id, &report);
                if is_repeated {
                    return;
                }
                if let Some(sentence) = goal_sentence(&self.goal_of(message), &report) {
                    self.tell_in(at, message, sentence);
                }
            }
            Performative::Refuse | Performative::NotUnderstood => {
                let why = self.refusal(at, message);
                let goal = self.goal_of(message);
                self.goals.goal_refused(at, id, &why);
                self.tell_in(at, message, Sentence::problem(format!("{goal} is refused: {why}")));
            }
            Performative::Cancel => {
                let text = format!("{sender} cancels {}", self.goal_of(message));
                self.tell_in(at, message, Sentence::notable(text));
            }
            _ => (),
        }
    }

    fn take_planning(&mut self, at: Moment, message: &Message) {
        match message.performative {
            Performative::Request => {
                self.goals.planning(at, &message.conversation_id, GoalPhase::Planning);
            }
            Performative::Refuse | Performative::NotUnderstood => {
                self.take_decline(at, message);
            }
            _ => (),
        }
    }

    fn take_contract_net(&mut self, at: Moment, message: &Message) {
        let Some(token) = message.exchange() else { return };
        let (id, sender) = (&message.conversation_id, &message.sender);
        match message.performative {
            Performative::Cfp => {
                let Some(call) = read::<CallForProposals>(message) else { return };
                self.goals.call(at, id, token, &call, message.receiver.first());
                let wanted = listed(&call.conjuncts);
                let text = format!("{sender} calls for proposals for {wanted}");
                self.tell_in(at, message, Sentence::routine(text));
            }
            Performative::Agree => {
                let Some(bid) = read::<Bid>(message) else { return };
                self.goals.bid(at, token, sender, Ok(&bid));
                let each = bid.proposals.iter().map(|proposal| {
                    format!("{} at cost {}", listed(&proposal.covers), number(proposal.cost))
                });
                let text = format!("{sender} bids for {}", listed(&each.collect::<Vec<_>>()));
                self.tell_in(at, message, Sentence::routine(text));
            }
            Performative::Refuse | Performative::NotUnderstood => {
                let why = match read::<Refusal>(message) {
                    // Most agents have nothing to propose.
                    Some(refusal) if refusal.reason == Reason::Incapable => refusal.detail,
                    _ => self.refusal(at, message),
                };
                self.goals.bid(at, token, sender, Err(&why));
            }
            Performative::AcceptProposal | Performative::RejectProposal => {
                let is_accepted = message.performative == Performative::AcceptProposal;
                let choice = read::<Choice>(message);
                let told = (choice.as_ref(), is_accepted);
                self.goals.choice(at, token, &message.receiver, told);
                let covers = choice.map(|choice| choice.covers).unwrap_or_default();
                if let Some(winner) = message.receiver.first().filter(|_| is_accepted) {
                    let text = format!("{winner} is chosen for {}", listed(&covers));
                    self.tell_in(at, message, Sentence::routine(text).about(winner));
                }
            }
            _ => (),
        }
    }

    // === execution ===

    fn take_execution(&mut self, at: Moment, message: &Message) {
        let token = message.exchange();
        match message.performative {
            Performative::Request => {
                let Some(Request::Execute(execute)) = read(message) else { return };
                self.take_plan(at, message, &execute);
            }
            Performative::Confirm => {
                let (Some(report), Some(token)) = (read::<Report>(message), token) else { return };
                self.goals.execution_report(at, token, &report);
                if report.outcome == Outcome::Failed {
                    let text = format!("the plan has failed: {}", report.detail);
                    self.tell_in(at, message, Sentence::problem(text));
                }
            }
            Performative::Refuse | Performative::NotUnderstood => {
                let why = self.refusal(at, message);
                if let Some(token) = token {
                    self.goals.execution_refused(at, token, &why);
                }
                let text = format!("{} does not execute the plan: {why}", message.sender);
                self.tell_in(at, message, Sentence::problem(text));
            }
            _ => (),
        }
    }

    fn take_plan(&mut self, at: Moment, message: &Message, execute: &Execute) {
        let exchange = (message.exchange(), &message.sender);
        self.goals.execute(at, &message.conversation_id, exchange, execute);
        for (agent, offers) in &execute.offers {
            self.agents.offers(at, agent, offers.keys());
        }
        self.learn_from(at, execute);
    }

    fn take_action(&mut self, at: Moment, message: &Message) {
        let Some(token) = message.exchange() else { return };
        let sender = &message.sender;
        match message.performative {
            Performative::Request => {
                let Some(Request::Act(act)) = read(message) else { return };
                self.take_act(at, message, &act);
            }
            Performative::Confirm => {
                let Some(report) = read::<Report>(message) else { return };
                let state = match report.outcome {
                    Outcome::Progress | Outcome::Holds => StepState::Running,
                    Outcome::Done => StepState::Done,
                    Outcome::Failed => StepState::Failed,
                    Outcome::Cancelled => StepState::Cancelled,
                };
                let detail = report.detail.as_str();
                let step = self.goals.step_report(at, (token, sender), state, detail);
                let did = step.map(|step| self.moves.sentence(&step));
                let did = did.unwrap_or_else(|| sender.to_string());
                let sentence = match report.outcome {
                    Outcome::Failed => Sentence::problem(format!("{did}: failed: {detail}")),
                    Outcome::Cancelled => Sentence::notable(format!("{did}: given up: {detail}")),
                    _ => Sentence::routine(format!("{sender}: {detail}")),
                };
                self.tell_in(at, message, sentence);
            }
            Performative::Refuse | Performative::NotUnderstood => {
                let why = self.refusal(at, message);
                let refused = StepState::Refused;
                let step = self.goals.step_report(at, (token, sender), refused, &why);
                let what = step.map_or_else(|| "to act".to_owned(), |step| step.to_pddl());
                let text = format!("{sender} refuses {what}: {why}");
                self.tell_in(at, message, Sentence::problem(text));
            }
            _ => (),
        }
    }

    fn take_act(&mut self, at: Moment, message: &Message, act: &Act) {
        let Some(agent) = message.receiver.first() else { return };
        let step = self.goals.act(at, act, (agent, message.exchange()));
        let sentence = Sentence::routine(self.moves.sentence(&step)).about(agent);
        self.tell_in(at, message, sentence);
    }

    // === people ===

    fn take_state_change(&mut self, at: Moment, message: &Message) {
        match message.performative {
            Performative::Request => {
                let Some(request) = read::<Request>(message) else { return };
                self.take_change_request(at, message, request);
            }
            // A stop that a device has not confirmed, for example.
            Performative::Confirm => {
                let report = read::<Report>(message);
                if let Some(report) = report.filter(|report| report.outcome == Outcome::Failed) {
                    let text = format!("{}: {}", message.sender, report.detail);
                    self.tell_in(at, message, Sentence::problem(text));
                }
            }
            Performative::Refuse | Performative::NotUnderstood => {
                let is_stop =
                    message.exchange().and_then(|token| self.stop_exchanges.remove(token));
                if is_stop.is_none() {
                    self.take_decline(at, message);
                }
            }
            _ => (),
        }
    }

    fn take_change_request(&mut self, at: Moment, message: &Message, request: Request) {
        let sender = &message.sender;
        let text = match request {
            // The effects of an action, which the action's own sentences tell.
            Request::ChangeState(ChangeState { owner: Some(_), .. }) => return,
            Request::ChangeState(ChangeState { believe, retract, .. }) => {
                match (believe.as_str(), retract.as_str()) {
                    (believe, "") => format!("{sender} sets {believe}"),
                    ("", retract) => format!("{sender} retracts {retract}"),
                    (believe, retract) => format!("{sender} sets {believe}, retracts {retract}"),
                }
            }
            Request::SetMode(change) => {
                let mode = match change.mode {
                    Mode::Centralized => "centralized",
                    Mode::Decentralized => "decentralized",
                };
                format!("{sender} makes planning {mode}")
            }
            Request::ChangeMetric(change) => match change.metric {
                Some(metric) => format!("{sender} sets {metric}"),
                None => format!("{sender} restores the metric of the map"),
            },
            Request::ChangeActions(ChangeActions { withhold, give_back }) => {
                let names = |actions: &[acl::content::ActionOf]| {
                    let each: Vec<_> = actions.iter().map(|each| each.action.clone()).collect();
                    listed(&each)
                };
                match (withhold.as_slice(), give_back.as_slice()) {
                    (withheld, []) => format!("{sender} withholds {}", names(withheld)),
                    (_, given) => format!("{sender} gives {} back", names(given)),
                }
            }
            Request::Stop(stop) => {
                self.follow_stop(message);
                if self.stops.requested(at, &stop) {
                    self.tell_stop(at, &stop);
                }
                return;
            }
            Request::ReleaseStops(release) => {
                self.follow_stop(message);
                if !self.stops.released(&release.ids) {
                    return;
                }
                format!("{sender} releases {}", plural(count(&release.ids), "stop"))
            }
            _ => return,
        };
        self.tell_in(at, message, Sentence::notable(text));
    }

    fn follow_stop(&mut self, message: &Message) {
        if let Some(token) = message.exchange() {
            self.stop_exchanges.insert(token.clone(), ());
        }
    }

    fn take_query(&mut self, at: Moment, message: &Message) {
        let Some(token) = message.exchange() else { return };
        let sender = &message.sender;
        match message.performative {
            Performative::QueryRef => {
                let Some(question) = read::<Question>(message) else { return };
                let asked = (sender, message.receiver.first());
                let within = message.reply_within;
                self.questions.asked(at, token, asked, (&question, within));
                let text = format!("{sender} asks people: {}", question.text);
                self.tell_in(at, message, Sentence::notable(text));
            }
            Performative::Cancel => self.questions.ended(token, false),
            Performative::Refuse | Performative::NotUnderstood => {
                self.questions.ended(token, true);
            }
            _ => (),
        }
    }

    /// Takes a message with the answer of a person, which may be a secret: nothing reads its content.
    fn take_answer(&mut self, at: Moment, message: &Message) {
        let is_end = message.performative == Performative::Inform;
        if let Some(token) = message.exchange().filter(|_| is_end) {
            self.questions.ended(token, false);
            let text = format!("{} has an answer of a person", message.sender);
            self.tell_in(at, message, Sentence::notable(text));
        }
    }

    // === refusals ===

    fn take_decline(&mut self, at: Moment, message: &Message) {
        let is_decline = [Performative::Refuse, Performative::NotUnderstood];
        if is_decline.contains(&message.performative) {
            let why = self.refusal(at, message);
            let text = format!("{} declines: {why}", message.sender);
            self.tell_in(at, message, Sentence::problem(text));
        }
    }

    /// Returns the reason of a refusal, and remembers the refusal if it points at a mistake rather
    /// than at the state of the world.
    fn refusal(&mut self, at: Moment, message: &Message) -> String {
        let Some(refusal) = read::<Refusal>(message) else {
            return "no reason is given".to_owned();
        };
        let is_mistake = matches!(
            refusal.reason,
            Reason::Unreadable
                | Reason::BadContent
                | Reason::UnexpectedPerformative
                | Reason::OutOfTurn
                | Reason::MailboxFull
                | Reason::Forbidden
        );
        // A person has mistyped a goal, and was told: it is no mistake of an agent.
        let is_mistyped = message.protocol == Some(Protocol::Goal)
            && matches!(refusal.reason, Reason::Unreadable | Reason::BadContent);
        let why = short(&refusal.detail, self.limits.text_bytes);
        if is_mistake && !is_mistyped {
            let text = format!("{} declines: {why}", message.sender);
            keep_trouble(&mut self.refused, at, message, &text);
        }
        why
    }
}

/// Whether the identifiers of a message are short enough to be kept. Those of agents are.
fn has_short_names(message: &Message) -> bool {
    let tokens = [&message.reply_with, &message.in_reply_to];
    let tokens = tokens.into_iter().flatten().map(ReplyToken::as_str);
    let names = [message.id.as_str(), message.conversation_id.as_str()];
    names.into_iter().chain(tokens).all(|name| name.len() <= IDENTIFIER_BYTES_MAX)
}

fn keep_trouble(
    troubles: &mut std::collections::VecDeque<Trouble>,
    at: Moment,
    message: &Message,
    text: &str,
) {
    let conversation = message.conversation_id.clone();
    troubles.push_back(Trouble { at, text: text.to_owned(), conversation });
    if troubles.len() > TROUBLES_MAX {
        troubles.pop_front();
    }
}

/// Returns the content of a message; `None` if it is malformed.
fn read<T: DeserializeOwned>(message: &Message) -> Option<T> {
    message.content_as().ok()
}

/// Returns the sentence about a report of the Plan Requester; `None` if other messages tell it.
fn goal_sentence(goal: &str, report: &Report) -> Option<Sentence> {
    let detail = report.detail.as_str();
    Some(match report.outcome {
        Outcome::Holds => Sentence::notable(format!("{goal} holds, and is watched")),
        Outcome::Done => Sentence::notable(format!("{goal} is reached")),
        Outcome::Failed => Sentence::problem(format!("{goal} has failed: {detail}")),
        Outcome::Cancelled => Sentence::notable(format!("{goal} is cancelled: {detail}")),
        // The agent of the step, or the choice of each bidder, has told this.
        Outcome::Progress if report.action.is_some() || detail.starts_with("chosen:") => {
            return None;
        }
        Outcome::Progress if detail.starts_with("no plan") => {
            Sentence::problem(format!("{goal}: {detail}"))
        }
        Outcome::Progress => Sentence::routine(format!("{goal}: {detail}")),
    })
}

/// Returns some texts as a list: the first ones, and the number of the others.
fn listed(texts: &[String]) -> String {
    let mut shown = texts.iter().take(LISTED_MAX).cloned().collect::<Vec<_>>().join(", ");
    if let Some(more) = texts.len().checked_sub(LISTED_MAX).filter(|more| *more > 0) {
        shown = format!("{shown} and {more} more");
    }
    shown
}

fn count<T>(list: &[T]) -> u64 {
    u64::try_from(list.len()).unwrap_or(u64::MAX)
}
