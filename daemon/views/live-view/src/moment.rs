//! Points in time, and the limits of a view.

use serde::Serialize;

/// A point in time: milliseconds since the Unix epoch, by the clock of the process that observes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(transparent)]
pub struct Moment(pub u64);

impl Moment {
    /// Returns the milliseconds from `earlier` to this moment; 0 if `earlier` is later, because
    /// clocks are set back now and then.
    pub fn since(self, earlier: Moment) -> u64 {
        self.0.saturating_sub(earlier.0)
    }

    /// Returns the moment that is `milliseconds` later.
    pub fn plus(self, milliseconds: u64) -> Moment {
        Moment(self.0.saturating_add(milliseconds))
    }

    /// Returns the moment that is `milliseconds` earlier.
    pub fn minus(self, milliseconds: u64) -> Moment {
        Moment(self.0.saturating_sub(milliseconds))
    }
}

/// Limits of what a view keeps, so that its memory is bounded however long it observes. If a limit
/// is reached, the oldest element goes first.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewLimits {
    /// Agents, with those that have left.
    pub agents: usize,
    /// Daemons, with those that are not reached any more.
    pub daemons: usize,
    /// Goals; those that have ended go first.
    pub goals: usize,
    /// Plans per goal.
    pub plans_per_goal: usize,
    /// Steps per plan; the remaining ones are counted only.
    pub steps_per_plan: usize,
    /// Calls for proposals per goal.
    pub calls_per_goal: usize,
    /// Bids per call for proposals.
    pub bids_per_call: usize,
    /// Bytes of all goals together, roughly, with their plans and calls.
    pub goals_bytes: usize,
    /// Entries in the history of a goal.
    pub history_per_goal: usize,
    /// Facts.
    pub facts: usize,
    /// Bytes of all facts together, roughly, with the claims about them.
    pub facts_bytes: usize,
    /// Open questions.
    pub questions: usize,
    /// Entries of the activity.
    pub activity: usize,
    /// Conversations.
    pub conversations: usize,
    /// Messages per conversation.
    pub messages_per_conversation: usize,
    /// Messages of all conversations together.
    pub messages: usize,
    /// Rooms of the floor plan.
    pub rooms: usize,
    /// Actions whose usual time is measured.
    pub measured_actions: usize,
    /// Bytes of one text, such as a sentence, a fact or a goal; the rest is cut off.
    pub text_bytes: usize,
    /// Bytes of one action model; a longer one is not shown.
    pub model_bytes: usize,
    /// Bytes of all action models together; beyond them, further ones are not shown.
    pub models_bytes: usize,
}

impl Default for ViewLimits {
    fn default() -> ViewLimits {
        ViewLimits {
            agents: 10_000,
            daemons: 1_000,
            goals: 500,
            plans_per_goal: 8,
            steps_per_plan: 500,
            calls_per_goal: 8,
            bids_per_call: 200,
            goals_bytes: 64 << 20,
            history_per_goal: 64,
            facts: 50_000,
            facts_bytes: 64 << 20,
            questions: 200,
            activity: 2_000,
            conversations: 1_000,
            messages_per_conversation: 500,
            messages: 20_000,
            rooms: 200,
            measured_actions: 10_000,
            text_bytes: 2_000,
            model_bytes: 64 << 10,
            models_bytes: 16 << 20,
        }
    }
}
