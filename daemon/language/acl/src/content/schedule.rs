//! Goals by the clock: when a goal is asked for, until when it is pursued, and what is to be seen of
//! that.

use serde::{Deserialize, Serialize};

use super::Achieve;
use crate::ConversationId;

/// Request to the Plan Requester: pursue a goal at these times.
///
/// The request is an act of its own, because a Plan Requester that does not know it must refuse it,
/// and not pursue the goal at once.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ScheduleGoal {
    /// The goal.
    #[serde(flatten)]
    pub goal: Achieve,
    /// The times.
    pub times: GoalTimes,
}

/// The times of a goal. All of them are times of clocks on the wall in one time zone, so that they
/// keep their meaning when summer time begins or ends.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub struct GoalTimes {
    /// Name of the time zone, such as `Europe/Berlin`; `None` for that of the Plan Requester.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_zone: Option<String>,
    /// Time at which the goal is asked for, or before which it is never asked for if there is a
    /// `rule`: `2026-12-01T08:00:00`. `None` for a goal that is asked for at once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub start: Option<String>,
    /// Recurrence rule (RFC 5545, section 3.3.10); `None` for a goal that is asked for once.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub rule: Option<String>,
    /// Hours in which the goal is asked for, such as `08:00-18:00`: an occurrence of the rule at
    /// another time of the day is left out. `None` for all hours.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub hours: Option<String>,
    /// When the goal is given up after it was asked for: a duration (`2h`), the next time of the day
    /// (`18:00`), or a time (`2026-12-01T18:00:00`). `None` if it is not given up by the clock.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ends: Option<String>,
    /// When the goal should be reached after it was asked for, written as `ends` is. `None` if there
    /// is no deadline.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by: Option<String>,
    /// Time from which the goal is not asked for any more, and at which it is given up; `None` if
    /// there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until: Option<String>,
    /// The times in the words of the person that wrote them.
    pub words: String,
}

/// What is to be seen of the times of a goal: of one that waits for its time, or of one that is
/// pursued now and has a deadline or an end.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case", default)]
pub struct DueStatus {
    /// The times of a goal that waits for them, in the words of the person that wrote them; empty for
    /// a goal that is pursued now.
    pub words: String,
    /// Next time at which the goal is asked for, in milliseconds since 1970-01-01 UTC; `None` if it
    /// is not asked for again.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next_ms: Option<u64>,
    /// The same time as text for a person, in the time zone of the goal: `Thursday 08:00`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub next: Option<String>,
    /// Conversation of the goal that was asked for last and is pursued now; `None` if there is none.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub pursued: Option<ConversationId>,
    /// Time by which the goal should be reached, in milliseconds since 1970-01-01 UTC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub by_ms: Option<u64>,
    /// Time at which the goal is given up, in milliseconds since 1970-01-01 UTC.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub ends_ms: Option<u64>,
}

impl GoalTimes {
    /// Whether the goal is asked for at once. The request for such a goal belongs to the protocol
    /// `goal`, as that for a goal without times; any other is a change of the state of the Plan
    /// Requester, whose answer says only that the goal is kept.
    pub fn is_at_once(&self) -> bool {
        self.start.is_none()
    }
}
