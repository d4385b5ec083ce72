//! Turns messages into spans: one trace per conversation, in bounded memory. No clock, no
//! connection.

use std::collections::{BTreeMap, VecDeque};

use acl::content::{CallForProposals, Request};
use acl::{ConversationId, Message, MessageId, Performative, Protocol, ReplyToken};

use crate::conversation_trace::{ConversationTrace, TraceProgress};
use crate::recent::RecentKeys;
use crate::span::{TraceSpan, UnixNanos};

/// Maximum number of conversations under way. Beyond it, the oldest is ended.
const CONVERSATIONS_MAX: usize = 1_024;

/// Number of ended conversations that are remembered: a late message must not begin them anew.
const ENDED_MAX: usize = 4_096;

/// Number of messages that are remembered: a message is sent again until its receipt arrives.
const MESSAGES_MAX: usize = 16_384;

/// The traces of all conversations of an ecosystem.
#[derive(Debug)]
pub(crate) struct Tracer {
    ecosystem: String,
    traces: BTreeMap<ConversationId, ConversationTrace>,
    /// The conversations, the oldest first. Ended ones are removed later.
    order: VecDeque<ConversationId>,
    ended: RecentKeys<ConversationId>,
    heard: RecentKeys<MessageId>,
}

impl Tracer {
    pub(crate) fn new(ecosystem: &str) -> Tracer {
        Tracer {
            ecosystem: ecosystem.to_owned(),
            traces: BTreeMap::new(),
            order: VecDeque::new(),
            ended: RecentKeys::new(ENDED_MAX),
            heard: RecentKeys::new(MESSAGES_MAX),
        }
    }

    /// Takes a message that was heard at `now`. Returns the spans that have ended with it.
    pub(crate) fn hear(&mut self, message: &Message, now: UnixNanos) -> Vec<TraceSpan> {
        // Most messages are heartbeats, which belong to no exchange.
        let (opened, continued) = (&message.reply_with, &message.in_reply_to);
        if opened.is_none() && continued.is_none() || !self.heard.insert(message.id.clone()) {
            return Vec::new();
        }
        match (opened, continued) {
            (Some(token), None) => self.opened(message, token, now),
            (_, Some(token)) => self.continued(message, token, now),
            (None, None) => Vec::new(),
        }
    }

    /// Ends all conversations; their ends are not known.
    pub(crate) fn abandon(&mut self, now: UnixNanos) -> Vec<TraceSpan> {
        let traces = std::mem::take(&mut self.traces);
        self.order.clear();
        traces.into_values().flat_map(|mut trace| trace.abandon(now)).collect()
    }

    fn opened(&mut self, message: &Message, token: &ReplyToken, now: UnixNanos) -> Vec<TraceSpan> {
        let (Some(protocol), id) = (message.protocol, &message.conversation_id) else {
            return Vec::new();
        };
        if self.ended.contains(id) {
            return Vec::new();
        }
        let mut spans = Vec::new();
        match (protocol, message.performative) {
            (Protocol::ContractNet, Performative::Cfp) => {
                let Ok(call) = message.content_as::<CallForProposals>() else { return spans };
                let trace = self.trace(id, now, &mut spans);
                trace.call(token, call.conjuncts.len(), now);
            }
            (Protocol::Query, Performative::QueryRef) => {
                // A question of a conversation that is not traced is nobody's goal.
                if let Some(trace) = self.traces.get_mut(id) {
                    trace.question(message, token, now);
                }
            }
            (_, Performative::Request) => {
                let Ok(request) = message.content_as::<Request>() else { return spans };
                if let (Protocol::Goal, Some(achieve)) = (protocol, request.goal()) {
                    self.trace(id, now, &mut spans).goal(message, token, achieve, now);
                    return spans;
                }
                match (protocol, request) {
                    (Protocol::Planning, Request::Plan(_)) => {
                        self.trace(id, now, &mut spans).plan(message, token, now);
                    }
                    (Protocol::Execution, Request::Execute(execute)) => {
                        let trace = self.trace(id, now, &mut spans);
                        let ended = trace.execution(message, token, &execute, now);
                        spans.extend(ended);
                    }
                    (Protocol::Action, Request::Act(act)) => {
                        self.trace(id, now, &mut spans).action(message, token, &act, now);
                    }
                    _ => (),
                }
            }
            _ => (),
        }
        spans
    }

    fn continued(
        &mut self,
        message: &Message,
        token: &ReplyToken,
        now: UnixNanos,
    ) -> Vec<TraceSpan> {
        let id = &message.conversation_id;
        let Some(trace) = self.traces.get_mut(id) else { return Vec::new() };
        let TraceProgress { spans, is_over } = trace.continued(message, token, now);
        if is_over {
            self.ended.insert(id.clone());
        }
        if is_over || trace.is_idle() {
            self.traces.remove(id);
            self.forget_ended();
        }
        spans
    }

    /// Returns the trace of a conversation, and begins it if it is new. If there are too many, the
    /// oldest is ended, and its spans are added to `spans`.
    fn trace(
        &mut self,
        id: &ConversationId,
        now: UnixNanos,
        spans: &mut Vec<TraceSpan>,
    ) -> &mut ConversationTrace {
        if !self.traces.contains_key(id) {
            while self.traces.len() >= CONVERSATIONS_MAX {
                let Some(oldest) = self.order.pop_front() else { break };
                let evicted = self.traces.remove(&oldest);
                spans.extend(evicted.into_iter().flat_map(|mut trace| trace.abandon(now)));
            }
            self.order.push_back(id.clone());
        }
        let new = || ConversationTrace::new(&self.ecosystem, id.as_str());
        self.traces.entry(id.clone()).or_insert_with(new)
    }

    /// Removes ended conversations from the order, once they are the greater part of it.
    fn forget_ended(&mut self) {
        if self.order.len() > 2 * self.traces.len() + 64 {
            let traces = &self.traces;
            let mut kept = std::collections::BTreeSet::new();
            self.order.retain(|id| traces.contains_key(id) && kept.insert(id.clone()));
        }
    }
}
