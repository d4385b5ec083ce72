//! What is to be seen of a running ecosystem, made from what it says.
//!
//! - [`LiveView`] observes [`ViewEvent`]s: messages, changes of presence, answers to queries. It
//!   keeps a bounded amount ([`ViewLimits`]).
//! - Its methods return rows and details, which a terminal, a command or a page draws: goals with
//!   their plans, agents, facts, the floor plan, questions, activity, conversations, daemons, and
//!   the answer to “is all well?”.
//! - [`redact`] removes the answers of people from a message.
//!
//! **Invariants:** This crate reads no clock and has no effect: the same events give the same view.
//! Events may be malformed, repeated, out of order or lost; none of them panics. The answer of a
//! person is never kept. Texts are kept as agents wrote them: whatever draws them makes control
//! characters visible.

mod activity_log;
mod agent_store;
mod bounded;
mod conversation_store;
mod daemon_store;
mod event;
mod fact_store;
mod floor;
mod goal_store;
mod live_view;
mod moment;
mod moves;
mod question_store;
mod redaction;
mod rows;
mod stop_store;
mod summary;
mod text;
mod usual_times;

pub use event::{AgentPlace, ExpectedAgent, ViewEvent};
pub use live_view::{LiveView, ViewRevision};
pub use moment::{Moment, ViewLimits};
pub use redaction::{REDACTED, redact};
pub use rows::{
    ActionRow, ActivityEntry, ActivityLevel, AgentDetail, AgentPresence, AgentRow, BidRow,
    BidState, CallDetail, ClaimRow, Concern, ConcernKind, ConversationDetail, ConversationRow,
    CurrentStep, DaemonRow, DueRow, FactRow, FactTruth, FloorPlan, FloorRobot, FloorRoom, FloorWay,
    Freshness, GoalDetail, GoalHistoryRow, GoalRow, GoalStage, HealthLevel, MailboxSums,
    MessageRow, Overview, PlanDetail, ProposalRow, QuestionRow, ReplicaRow, StepRow, StepState,
    StopRow, ViewCounts, ViewSubject,
};
pub use summary::summarize;
