//! The status of a goal for other agents and users: its phase and its history.

use std::fmt;

use serde::{Deserialize, Serialize};

use super::{DueStatus, Keep, Outcome};
use crate::ConversationId;

/// The state of a goal, as shown to users.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct GoalStatus {
    /// Conversation of the goal, which identifies it in messages.
    pub conversation: ConversationId,
    /// Number of the goal, by which people name it: 1 for the first goal of the ecosystem. The
    /// number is the same on every machine, and a new leader keeps it. 0 if the Plan Requester is
    /// of an earlier version of Althing.
    #[serde(default)]
    pub number: u32,
    /// The goal: a PDDL condition.
    pub goal: String,
    /// Whether the goal ends when it is reached, or is kept from then on.
    pub keep: Keep,
    /// Priority of the goal: a goal with a greater number takes precedence.
    pub priority: i32,
    /// The current phase of the goal.
    pub phase: GoalPhase,
    /// Reason why the goal waits, as text for a person that completes “waiting: ”; empty if the
    /// goal does not wait.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub waits_because: String,
    /// Number of plans for the goal that were executed so far.
    pub rounds: u32,
    /// Past events of the goal, oldest first; their number is limited.
    pub history: Vec<HistoryEntry>,
    /// The times of a goal by the clock. Unless such a goal is pursued itself, it waits for its time,
    /// and is asked for in a conversation of its own. `None` for any other goal.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub due: Option<Box<DueStatus>>,
}

/// The phase of a goal. `docs/goals.md` has the transitions.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum GoalPhase {
    /// The goal waits until it may be planned for: one goal is planned for at a time.
    Queued,
    /// The goal waits for agents or facts that the plans of other goals use.
    WaitingForAgents,
    /// The goal waits for a capability, for a change of the known state, or for its time.
    WaitingForChange,
    /// The Plan Requester is fetching the domain and the state, to compare the goal with them.
    FetchingDomain,
    /// The Planning Agent has been asked for a plan.
    Planning,
    /// The actuators have been called for proposals.
    CollectingProposals,
    /// There is no plan for the goal; the reason is being computed.
    Explaining,
    /// A plan for the goal is being executed.
    Executing,
    /// The Plan Executor has received the request to cancel the plan, because another goal or a
    /// better plan takes precedence.
    Preempted,
    /// The Plan Executor has received the request to cancel the plan, because the goal was
    /// cancelled.
    Cancelling,
    /// The plan was executed; the Plan Requester is checking whether the goal holds.
    Verifying,
    /// The kept goal holds, and the known state is watched for changes.
    Holding,
    /// The goal has ended, or another replica pursues it.
    Ended,
}

// === impl GoalPhase ===

impl GoalPhase {
    /// All phases, in the order of a goal that is reached without failures.
    pub const ALL: [GoalPhase; 13] = [
        GoalPhase::Queued,
        GoalPhase::WaitingForAgents,
        GoalPhase::WaitingForChange,
        GoalPhase::FetchingDomain,
        GoalPhase::Planning,
        GoalPhase::CollectingProposals,
        GoalPhase::Explaining,
        GoalPhase::Executing,
        GoalPhase::Preempted,
        GoalPhase::Cancelling,
        GoalPhase::Verifying,
        GoalPhase::Holding,
        GoalPhase::Ended,
    ];

    /// Returns the name of the phase, as in messages.
    pub fn as_str(self) -> &'static str {
        match self {
            GoalPhase::Queued => "queued",
            GoalPhase::WaitingForAgents => "waiting-for-agents",
            GoalPhase::WaitingForChange => "waiting-for-change",
            GoalPhase::FetchingDomain => "fetching-domain",
            GoalPhase::Planning => "planning",
            GoalPhase::CollectingProposals => "collecting-proposals",
            GoalPhase::Explaining => "explaining",
            GoalPhase::Executing => "executing",
            GoalPhase::Preempted => "preempted",
            GoalPhase::Cancelling => "cancelling",
            GoalPhase::Verifying => "verifying",
            GoalPhase::Holding => "holding",
            GoalPhase::Ended => "ended",
        }
    }

    /// Whether the goal is being planned for. Only one goal is planned for at a time.
    pub fn is_planning(self) -> bool {
        use GoalPhase::{CollectingProposals, Explaining, FetchingDomain, Planning};
        matches!(self, FetchingDomain | Planning | CollectingProposals | Explaining)
    }

    /// Whether a plan of the goal uses agents.
    pub fn is_running(self) -> bool {
        use GoalPhase::{Preempted, Verifying};
        self.is_under_way() || matches!(self, Preempted | Verifying)
    }

    /// Whether a replica that takes the goal over must also take over a running plan.
    pub fn is_under_way(self) -> bool {
        matches!(self, GoalPhase::Executing | GoalPhase::Cancelling)
    }
}

impl fmt::Display for GoalPhase {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            GoalPhase::Queued => "waiting: another goal comes first",
            GoalPhase::WaitingForAgents | GoalPhase::WaitingForChange => "waiting",
            GoalPhase::FetchingDomain => "compiling domain and state",
            GoalPhase::Planning => "planning",
            GoalPhase::CollectingProposals => "calling for proposals",
            GoalPhase::Explaining => "finding out why there is no plan",
            GoalPhase::Executing => "executing",
            GoalPhase::Preempted => "giving way",
            GoalPhase::Cancelling => "cancelling",
            GoalPhase::Verifying => "checking whether it holds",
            GoalPhase::Holding => "holds",
            GoalPhase::Ended => "ended",
        })
    }
}

impl GoalStatus {
    /// Whether this is a goal by the clock, which waits for its time and is then pursued in another
    /// conversation.
    pub fn waits_for_its_time(&self) -> bool {
        self.due.as_ref().is_some_and(|due| !due.words.is_empty())
    }

    /// Returns the phase as text for a person, followed by the reason if the goal waits.
    pub fn phase_text(&self) -> String {
        match self.waits_because.as_str() {
            "" => self.phase.to_string(),
            why => format!("{}: {why}", self.phase),
        }
    }
}

/// Maximum number of entries in the history of a goal: enough to explain its present phase. A Plan
/// Requester drops the oldest entries.
pub const HISTORY_ENTRIES_MAX: usize = 64;

/// An event in the history of a goal.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HistoryEntry {
    /// Time of the event in milliseconds since 1970-01-01 UTC, by the clock of the machine that
    /// pursued the goal at that time.
    pub at_ms: u64,
    /// Outcome that was sent to the requester with this event; `None` if none was sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub outcome: Option<Outcome>,
    /// Description of the event, for a person.
    pub text: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_name_of_a_phase_is_the_one_in_messages() {
        for phase in GoalPhase::ALL {
            let written = serde_json::to_value(phase).expect("JSON");
            assert_eq!(written, phase.as_str());
        }
    }
}
