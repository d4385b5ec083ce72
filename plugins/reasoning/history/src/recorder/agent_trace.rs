//! What the recorder remembers of one agent: its steps and its newest events.

use std::collections::VecDeque;
use std::sync::Arc;

use super::draft::EventLink;
use crate::words::words_of;

/// Maximum number of steps that are remembered.
const STEPS_MAX: usize = 8;

/// Time after the end of a step in which a change of a fact may still be its effect: the next
/// heartbeat tells it.
const EFFECT_MS: u64 = 3_000;

/// What is known of one agent.
#[derive(Debug, Default)]
pub(crate) struct AgentTrace {
    /// Whether the agent has announced actions or facts, as devices do.
    pub(crate) is_actuator: bool,
    /// Whether it is known which facts the agent declares private.
    pub(crate) is_model_known: bool,
    /// Digest of the model that the agent announced last.
    pub(crate) digest: String,
    /// Whether the agent was reported as silent, and was not heard since.
    pub(crate) is_silent: bool,
    pub(crate) last_joined: Option<EventLink>,
    /// The newest announcement of another model.
    pub(crate) last_model: Option<EventLink>,
    pub(crate) last_left: Option<(u64, EventLink)>,
    /// The newest change of a fact of the agent.
    pub(crate) last_fact: Option<EventLink>,
    steps: VecDeque<StepTrace>,
}

#[derive(Debug)]
struct StepTrace {
    action: Arc<str>,
    conversation: Arc<str>,
    event: EventLink,
    ended_ms: Option<u64>,
}

// === impl AgentTrace ===

impl AgentTrace {
    /// Returns the newest events that add to what the agent offers, or change it.
    pub(crate) fn changes(&self) -> impl Iterator<Item = EventLink> {
        [self.last_joined, self.last_model].into_iter().flatten()
    }

    /// Adds a step that the agent begins.
    pub(crate) fn begin_step(&mut self, action: &str, conversation: &str, event: EventLink) {
        if self.steps.len() >= STEPS_MAX {
            self.steps.pop_front();
        }
        let (action, conversation) = (action.into(), conversation.into());
        self.steps.push_back(StepTrace { action, conversation, event, ended_ms: None });
    }

    /// Marks the newest step with this action as ended by `event`.
    pub(crate) fn end_step(&mut self, action: &str, event: EventLink, at_ms: u64) {
        let step = self.steps.iter_mut().rev().find(|step| *step.action == *action);
        if let Some(step) = step {
            (step.event, step.ended_ms) = (event, Some(at_ms));
        }
    }

    /// Returns the event of the newest step that has not ended.
    pub(crate) fn running_step(&self) -> Option<EventLink> {
        self.steps.iter().rev().find(|step| step.ended_ms.is_none()).map(|step| step.event)
    }

    /// Returns the event of the newest step of a conversation.
    pub(crate) fn step_of(&self, conversation: &str) -> Option<EventLink> {
        let mut steps = self.steps.iter().rev();
        steps.find(|step| *step.conversation == *conversation).map(|step| step.event)
    }

    /// Returns the event of the newest step that may have changed a fact: it runs or has ended
    /// lately, and the fact names one of its objects.
    pub(crate) fn step_behind(&self, fact: &str, at_ms: u64) -> Option<EventLink> {
        let is_recent = |step: &&StepTrace| match step.ended_ms {
            None => true,
            Some(ended) => at_ms.saturating_sub(ended) <= EFFECT_MS,
        };
        let names_same = |step: &&StepTrace| {
            words_of(fact).skip(1).any(|object| {
                words_of(&step.action).skip(1).any(|named| named.eq_ignore_ascii_case(object))
            })
        };
        self.steps.iter().rev().filter(is_recent).find(names_same).map(|step| step.event)
    }
}
