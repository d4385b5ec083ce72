//! The rows and details that a view returns. All are plain data; names and texts in them come from
//! agents unchanged, so whatever draws them must make control characters visible.

mod agent_rows;
mod conversation_rows;
mod daemon_rows;
mod fact_rows;
mod floor_rows;
mod goal_rows;
mod overview_rows;

pub use agent_rows::{
    ActionRow, AgentDetail, AgentPresence, AgentRow, CurrentStep, QuestionRow, ReplicaRow,
};
pub use conversation_rows::{
    ActivityEntry, ActivityLevel, ConversationDetail, ConversationRow, MessageRow,
};
pub use daemon_rows::{DaemonRow, MailboxSums};
pub use fact_rows::{ClaimRow, FactRow, FactTruth, Freshness};
pub use floor_rows::{FloorPlan, FloorRobot, FloorRoom, FloorWay};
pub use goal_rows::{
    BidRow, BidState, CallDetail, DueRow, GoalDetail, GoalHistoryRow, GoalRow, GoalStage,
    PlanDetail, ProposalRow, StepRow, StepState,
};
pub use overview_rows::{
    Concern, ConcernKind, HealthLevel, Overview, StopRow, ViewCounts, ViewSubject,
};
