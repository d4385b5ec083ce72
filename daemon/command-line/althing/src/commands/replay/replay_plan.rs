//! Extracts from a recording the exchanges to replay: those that agents outside the ecosystem
//! opened, each with its end.

use std::collections::BTreeSet;
use std::fmt;

use acl::content::{Execute, Report, Request};
use acl::{AgentId, ConversationId, Message, Performative, Protocol};
use keyboard::{GoalRequest, MessageDraft, UserRequest};

use crate::commands::watch::record::{Recorded, Recording};
use crate::config::Ecosystem;

/// How long to wait for answers to a message that names no deadline.
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(60);

/// All exchanges of a recording that are to be replayed.
#[derive(Clone, Debug, Default)]
pub(super) struct ReplayPlan {
    pub(super) plays: Vec<ReplayedExchange>,
    /// Number of messages from outside the ecosystem that cannot be replayed: answers of people,
    /// which are not recorded, and messages that open no exchange.
    pub(super) left_out: usize,
}

/// One exchange that is to be replayed.
#[derive(Clone, Debug)]
pub(super) struct ReplayedExchange {
    pub(super) who: AgentId,
    /// Time at which the exchange was opened, in milliseconds after the first exchange was opened.
    pub(super) after_ms: u64,
    pub(super) conversation: ConversationId,
    pub(super) words: OpeningMessage,
    /// How the exchange ended in the recording.
    pub(super) end: ExchangeEnd,
    /// Indices of the exchanges that had ended before this exchange was opened. Its initiator may
    /// have waited for them.
    pub(super) after: Vec<usize>,
}

/// The message that opens an exchange of the replay.
#[derive(Clone, Debug)]
pub(super) enum OpeningMessage {
    Said(UserRequest),
    /// A cancellation: the conversation to cancel, as in the recording, and the draft to send.
    CancelEarlier(ConversationId, MessageDraft),
}

/// How an exchange ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum ExchangeEnd {
    /// The request was carried out, or the goal held.
    Done,
    Failed,
    Cancelled,
    Refused,
    /// No agent took the request.
    Unanswered,
    /// The exchange was still running when the recording ended.
    Open,
}

impl ReplayPlan {
    pub(super) fn of(recording: &Recording, ecosystem: &Ecosystem) -> ReplayPlan {
        let ours: BTreeSet<&AgentId> = ecosystem.agents.iter().map(|agent| &agent.name).collect();
        let mut plays = ReplayPlan::default();
        let mut ids = BTreeSet::new();
        let (mut first, mut ended) = (None, Vec::new());
        for Recorded { at_ms, message, .. } in &recording.messages {
            let is_outside = !ours.contains(&message.sender);
            if !is_outside || !ids.insert(&message.id) || !message.opens_exchange() {
                continue;
            }
            let mut words = words_of(message);
            if let Some(OpeningMessage::CancelEarlier(conversation, draft)) = &words
                && !plays.plays.iter().any(|play| play.conversation == *conversation)
            {
                // The goal was requested before the recording began, so it is not replayed. The
                // message to cancel it is sent unchanged.
                words = Some(OpeningMessage::Said(UserRequest::Send(draft.clone())));
            }
            let Some(words) = words else {
                plays.left_out += 1;
                continue;
            };
            let first = *first.get_or_insert(*at_ms);
            let (end, ended_ms) = end_of(message, &recording.messages);
            let had_ended = |ended: &Option<u64>| ended.is_some_and(|ended| ended <= *at_ms);
            let after = ended.iter().enumerate().filter(|(_, ended)| had_ended(ended));
            let after = after.map(|(index, _)| index).collect();
            ended.push(ended_ms);
            plays.plays.push(ReplayedExchange {
                who: message.sender.clone(),
                after_ms: at_ms - first,
                conversation: message.conversation_id.clone(),
                words,
                end,
                after,
            });
        }
        plays
    }
}

/// Returns the opening message that replays `message`; `None` if `message` cannot be replayed.
fn words_of(message: &Message) -> Option<OpeningMessage> {
    if message.performative == Performative::Cancel {
        let conversation = message.conversation_id.clone();
        let draft = MessageDraft { conversation: Some(conversation.clone()), ..draft_of(message)? };
        return Some(OpeningMessage::CancelEarlier(conversation, draft));
    }
    if message.performative != Performative::Request {
        return draft_of(message).map(|draft| OpeningMessage::Said(UserRequest::Send(draft)));
    }
    let said = match message.content_as::<Request>() {
        Ok(Request::Achieve(achieve)) => {
            let acl::content::Achieve { goal, keep, priority, partition } = achieve;
            UserRequest::RequestGoal(GoalRequest { goal, keep, priority, partition })
        }
        Ok(Request::Execute(execute)) => UserRequest::Act(action_of(&execute)?),
        Ok(Request::ChangeState(change)) => UserRequest::Set(change),
        Ok(Request::SetMode(mode)) => UserRequest::Mode(mode.mode),
        // Answers of people are not recorded: they may be secrets.
        Ok(Request::AnswerQuestion(_)) => return None,
        _ => UserRequest::Send(draft_of(message)?),
    };
    Some(OpeningMessage::Said(said))
}

fn draft_of(message: &Message) -> Option<MessageDraft> {
    Some(MessageDraft {
        to: message.receiver.first().cloned(),
        performative: message.performative,
        protocol: message.protocol.unwrap_or(Protocol::StateChange),
        conversation: None,
        content: message.content.clone(),
        patience: message.reply_within.map_or(PATIENCE, |by| by.0),
    })
}

/// Returns the action that a person requested, under the name that its agent uses; `None` unless
/// `execute` holds exactly one action.
fn action_of(execute: &Execute) -> Option<String> {
    let plan = pddl::parse_plan(&execute.plan).into_result().ok()?;
    let [step] = &plan.steps[..] else { return None };
    let agent = step.arguments.first()?.as_str();
    let (_, offers) = execute.offers.iter().find(|(name, _)| name.as_str() == agent)?;
    let (outside, _) = offers.iter().find(|(_, offer)| step.action == offer.schema.as_str())?;
    let step = pddl::PlanStep::new(outside.as_str(), step.arguments.iter().cloned());
    Some(step.to_string())
}

/// Returns how the exchange that `opening` opens ended in the recording, and when it ended.
fn end_of(opening: &Message, messages: &[Recorded]) -> (ExchangeEnd, Option<u64>) {
    let answers = messages.iter().filter(|Recorded { message, .. }| {
        message.in_reply_to == opening.reply_with && message.sender != opening.sender
    });
    let (mut end, mut ended) = (ExchangeEnd::Open, None);
    for Recorded { at_ms, message, .. } in answers {
        let said = match message.performative {
            Performative::Refuse | Performative::NotUnderstood => Some(ExchangeEnd::Refused),
            Performative::Confirm => {
                let report = message.content_as::<Report>().ok();
                report.and_then(|report| ExchangeEnd::of_outcome(report.outcome))
            }
            _ => None,
        };
        if let Some(said) = said {
            (end, ended) = (said, ended.or(Some(*at_ms)));
        }
    }
    (end, ended)
}

impl ExchangeEnd {
    /// Whether the replay ended as the recording did. An exchange without an end in the recording
    /// may end in any way.
    pub(super) fn is_as_good_as(self, now: ExchangeEnd) -> bool {
        self == ExchangeEnd::Open || self == now
    }
}

impl fmt::Display for ExchangeEnd {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            ExchangeEnd::Done => "done",
            ExchangeEnd::Failed => "failed",
            ExchangeEnd::Cancelled => "given up",
            ExchangeEnd::Refused => "refused",
            ExchangeEnd::Unanswered => "unanswered",
            ExchangeEnd::Open => "without an end",
        })
    }
}

impl fmt::Display for OpeningMessage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            OpeningMessage::Said(UserRequest::RequestGoal(wish)) => write!(f, "goal {}", wish.goal),
            OpeningMessage::Said(UserRequest::ScheduleGoal(wish, times)) => {
                write!(f, "goal {} {}", wish.goal, times.words)
            }
            OpeningMessage::Said(UserRequest::Act(action)) => write!(f, "act {action}"),
            OpeningMessage::Said(UserRequest::Set(change)) => {
                write!(f, "set {}{}", change.believe, change.retract)
            }
            OpeningMessage::Said(UserRequest::Mode(mode)) => write!(f, "mode {mode}"),
            OpeningMessage::Said(UserRequest::Send(draft)) => {
                write!(f, "{} {}", draft.performative, draft.content)
            }
            OpeningMessage::Said(UserRequest::Cancel(_) | UserRequest::Answer { .. })
            | OpeningMessage::CancelEarlier(..) => {
                write!(f, "give it up")
            }
        }
    }
}
