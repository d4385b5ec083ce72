//! The trace of one conversation: the work that is under way, and the spans that come of it.
//!
//! - `goal`, the root, lasts until the goal is reached, holds for the first time, or fails. Each
//!   later time that a kept goal is restored is a span `restore goal`.
//! - Below it are `plan` (the Planning Agent searches), `call for proposals` with a `bid` for each
//!   bidder, `execute plan` with an `action` for each step, and `question` to people.
//! - An execution that replaces an earlier one links to it.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::{Achieve, Act, Execute, Keep, Outcome, Report};
use acl::{Message, Performative, ReplyToken};

use crate::call_answers::CallAnswers;
use crate::outcomes::{AGENT, CONVERSATION, conclude, is_final, planned, refused};
use crate::span::{
    Attribute, AttributeValue, SpanId, SpanLink, SpanStatus, TraceId, TraceSpan, UnixNanos,
};

/// Maximum number of spans of a conversation that are under way; more are not traced.
const OPEN_MAX: usize = 1_024;

/// Key of a span of which a trace has one.
const ONLY: &str = "";

/// What an exchange is about.
#[derive(Clone, Debug, PartialEq, Eq)]
enum WorkKind {
    Plan,
    Call(CallAnswers),
    Execution,
    Action,
    Question,
}

/// Work under way.
#[derive(Debug)]
struct OpenWork {
    kind: WorkKind,
    span: TraceSpan,
}

/// The trace of one conversation.
#[derive(Debug)]
pub(crate) struct ConversationTrace {
    trace: TraceId,
    conversation: String,
    /// The work under way, by the exchange that it is the subject of.
    open: BTreeMap<ReplyToken, OpenWork>,
    /// Exchanges in which the goal was requested: several, if its requester was restarted.
    requests: BTreeSet<ReplyToken>,
    /// The goal, or the restoring of it.
    goal: Option<TraceSpan>,
    /// Whether the root of the trace has been begun.
    has_root: bool,
    /// Number of times that the goal was restored.
    restored: u64,
    /// Executions by term and round.
    executions: BTreeSet<(u64, u32)>,
    last_execution: Option<SpanId>,
}

/// Result of a message about a conversation.
#[derive(Debug, Default)]
pub(crate) struct TraceProgress {
    /// Spans that have ended.
    pub(crate) spans: Vec<TraceSpan>,
    /// Whether the conversation is over.
    pub(crate) is_over: bool,
}

impl ConversationTrace {
    pub(crate) fn new(ecosystem: &str, conversation: &str) -> ConversationTrace {
        ConversationTrace {
            trace: TraceId::of(ecosystem, conversation),
            conversation: conversation.to_owned(),
            open: BTreeMap::new(),
            requests: BTreeSet::new(),
            goal: None,
            has_root: false,
            restored: 0,
            executions: BTreeSet::new(),
            last_execution: None,
        }
    }

    /// Whether nothing is known that a later message could need.
    pub(crate) fn is_idle(&self) -> bool {
        self.open.is_empty() && !self.has_root
    }

    /// Ends everything that is under way; its end is not known.
    pub(crate) fn abandon(&mut self, now: UnixNanos) -> Vec<TraceSpan> {
        let mut spans: Vec<_> = std::mem::take(&mut self.open).into_values().map(settled).collect();
        spans.extend(self.goal.take());
        for span in &mut spans {
            span.end = span.end.max(now);
            span.set("althing.unfinished", AttributeValue::Flag(true));
        }
        spans
    }

    // === the beginning of work ===

    /// Notes that a goal is requested.
    pub(crate) fn goal(
        &mut self,
        message: &Message,
        token: &ReplyToken,
        achieve: &Achieve,
        now: UnixNanos,
    ) {
        self.requests.insert(token.clone());
        if self.has_root {
            return;
        }
        self.has_root = true;
        let mut span = self.span("goal", ONLY, None, now);
        span.set("althing.goal", achieve.goal.as_str());
        span.set("althing.goal.kept", AttributeValue::Flag(achieve.keep == Keep::Maintain));
        span.set("althing.goal.priority", AttributeValue::Integer(achieve.priority.into()));
        span.set("althing.requester", message.sender.as_str());
        // The request may be heard after the messages that it led to: those of different daemons
        // overtake each other.
        for work in self.open.values_mut().filter(|work| work.span.parent.is_none()) {
            work.span.parent = Some(span.id);
            span.start = span.start.min(work.span.start);
        }
        self.goal = Some(span);
    }

    /// Notes that the Planning Agent is asked for a plan.
    pub(crate) fn plan(&mut self, message: &Message, token: &ReplyToken, now: UnixNanos) {
        let mut span = self.child("plan", token.as_str(), now);
        span.attributes.extend(receiver(message));
        self.begin(token, WorkKind::Plan, span);
    }

    /// Notes a call for proposals. Earlier calls of the same attempt are part of the same planning.
    pub(crate) fn call(&mut self, token: &ReplyToken, conjuncts: usize, now: UnixNanos) {
        let mut span = self.child("call for proposals", token.as_str(), now);
        span.set("althing.conjuncts", conjuncts as u64);
        let answers = CallAnswers::new(now);
        self.begin(token, WorkKind::Call(answers), span);
    }

    /// Notes that the Plan Executor is asked to execute a plan. The calls for proposals are over.
    pub(crate) fn execution(
        &mut self,
        message: &Message,
        token: &ReplyToken,
        execute: &Execute,
        now: UnixNanos,
    ) -> Vec<TraceSpan> {
        let ended = self.end_calls();
        let Execute { term, round, plan, .. } = execute;
        let mut span = self.child("execute plan", &execution_key(*term, *round), now);
        span.set("althing.plan.term", *term);
        span.set("althing.plan.round", u64::from(*round));
        span.set(
            "althing.plan.steps",
            plan.lines().filter(|line| line.starts_with('(')).count() as u64,
        );
        span.attributes.extend(receiver(message));
        if let Some(before) =
            self.last_execution.replace(span.id).filter(|before| *before != span.id)
        {
            span.links.push(SpanLink { trace: self.trace, span: before, relation: "replaces" });
        }
        self.executions.insert((*term, *round));
        self.begin(token, WorkKind::Execution, span);
        ended
    }

    /// Notes that an actuator is asked to act.
    pub(crate) fn action(
        &mut self,
        message: &Message,
        token: &ReplyToken,
        act: &Act,
        now: UnixNanos,
    ) {
        let asked = &act.token;
        let key = format!("{}/{}", execution_key(asked.term, asked.round), asked.step);
        // A new Plan Executor asks again for what the former one has asked for.
        let key = format!("{key}/{token}");
        let name = act.action.trim_start_matches('(').split([' ', ')']).next().unwrap_or_default();
        let mut span = self.child(&format!("action {name}"), &key, now);
        if self.executions.contains(&(asked.term, asked.round)) {
            let execution = execution_key(asked.term, asked.round);
            span.parent = Some(SpanId::of(self.trace, "execute plan", &execution));
        }
        span.set("althing.action", act.action.as_str());
        span.set("althing.plan.step", u64::from(asked.step));
        span.attributes.extend(receiver(message));
        self.begin(token, WorkKind::Action, span);
    }

    /// Notes a question to people. Neither the question nor the answer is traced: they may be
    /// secret.
    pub(crate) fn question(&mut self, message: &Message, token: &ReplyToken, now: UnixNanos) {
        let mut span = self.child("question", token.as_str(), now);
        span.set(AGENT, message.sender.as_str());
        self.begin(token, WorkKind::Question, span);
    }

    fn begin(&mut self, token: &ReplyToken, kind: WorkKind, span: TraceSpan) {
        if self.open.len() < OPEN_MAX {
            self.open.insert(token.clone(), OpenWork { kind, span });
        }
    }

    fn span(&self, name: &str, key: &str, parent: Option<SpanId>, now: UnixNanos) -> TraceSpan {
        TraceSpan {
            trace: self.trace,
            id: SpanId::of(self.trace, name, key),
            parent,
            name: name.to_owned(),
            start: now,
            end: now,
            attributes: vec![(CONVERSATION, self.conversation.as_str().into())],
            links: Vec::new(),
            status: SpanStatus::Unset,
        }
    }

    /// Returns a span below that of the goal. If the goal has held already, it is being restored.
    fn child(&mut self, name: &str, key: &str, now: UnixNanos) -> TraceSpan {
        if self.has_root && self.goal.is_none() {
            self.restored += 1;
            let root = SpanId::of(self.trace, "goal", ONLY);
            let mut span = self.span("restore goal", &self.restored.to_string(), Some(root), now);
            span.set("althing.goal.restored", self.restored);
            self.goal = Some(span);
        }
        let parent = self.goal.as_ref().map(|goal| goal.id);
        self.span(name, key, parent, now)
    }

    // === the progress and the end of work ===

    /// Notes a later message of an exchange.
    pub(crate) fn continued(
        &mut self,
        message: &Message,
        token: &ReplyToken,
        now: UnixNanos,
    ) -> TraceProgress {
        if self.requests.contains(token) {
            return self.goal_answered(message, now);
        }
        let Some(work) = self.open.get_mut(token) else { return TraceProgress::default() };
        let spans = match (&mut work.kind, message.performative) {
            (WorkKind::Call(answers), performative) => {
                answers.heard(&work.span, message, token, performative, now)
            }
            (WorkKind::Plan, Performative::Propose) => {
                planned(&mut work.span, message);
                self.end(token, now)
            }
            (WorkKind::Question, Performative::Inform) => {
                work.span.set("althing.answered_by", message.sender.as_str());
                work.span.status = SpanStatus::Done;
                self.end(token, now)
            }
            (WorkKind::Question, Performative::Cancel) => self.end(token, now),
            (WorkKind::Question, _) => Vec::new(),
            (_, Performative::Confirm) => match message.content_as::<Report>() {
                Ok(report) if is_final(report.outcome) => {
                    conclude(&mut work.span, &report);
                    self.end(token, now)
                }
                _ => Vec::new(),
            },
            (_, Performative::Refuse | Performative::NotUnderstood) => {
                refused(&mut work.span, message);
                self.end(token, now)
            }
            _ => Vec::new(),
        };
        TraceProgress { spans, is_over: false }
    }

    fn goal_answered(&mut self, message: &Message, now: UnixNanos) -> TraceProgress {
        let mut goal = self.goal.take();
        match message.performative {
            Performative::Confirm => {
                let report = message.content_as::<Report>();
                let Ok(report) = report.as_ref() else {
                    self.goal = goal;
                    return TraceProgress::default();
                };
                if report.outcome == Outcome::Progress {
                    self.goal = goal;
                    return TraceProgress::default();
                }
                if let Some(goal) = &mut goal {
                    conclude(goal, report);
                }
            }
            Performative::Refuse | Performative::NotUnderstood => {
                if let Some(goal) = &mut goal {
                    refused(goal, message);
                }
            }
            _ => {
                self.goal = goal;
                return TraceProgress::default();
            }
        }
        let holds = message.content_as::<Report>().is_ok_and(|it| it.outcome == Outcome::Holds);
        let is_over = !holds;
        if let Some(goal) = &mut goal {
            goal.end = now;
        }
        let mut spans = self.end_calls();
        if is_over {
            spans.extend(self.abandon(now));
        }
        spans.extend(goal);
        TraceProgress { spans, is_over }
    }

    fn end(&mut self, token: &ReplyToken, now: UnixNanos) -> Vec<TraceSpan> {
        let ended = self.open.remove(token).map(|mut work| {
            work.span.end = now;
            settled(work)
        });
        ended.into_iter().collect()
    }

    /// Ends the calls for proposals, at the time of their last answers.
    fn end_calls(&mut self) -> Vec<TraceSpan> {
        let is_call = |work: &OpenWork| matches!(work.kind, WorkKind::Call(_));
        let tokens: Vec<_> = self
            .open
            .iter()
            .filter(|(_, work)| is_call(work))
            .map(|(token, _)| token.clone())
            .collect();
        tokens.iter().filter_map(|token| self.open.remove(token)).map(settled).collect()
    }
}

/// Returns the span of work that has ended. Its time is set, apart from that of a call.
fn settled(work: OpenWork) -> TraceSpan {
    let OpenWork { kind, mut span } = work;
    if let WorkKind::Call(answers) = kind {
        answers.conclude(&mut span);
    }
    span
}

fn receiver(message: &Message) -> Option<Attribute> {
    message.receiver.first().map(|agent| (AGENT, agent.as_str().into()))
}

fn execution_key(term: u64, round: u32) -> String {
    format!("{term}/{round}")
}
