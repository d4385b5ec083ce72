//! The Domain Maintainer: action models and facts of many agents → one domain and problem.
//!
//! Start reading at [`Maintainer`]. Agents come and go, say what they can do and what they know;
//! at every moment there is one composite domain, one state with provenance, and a [`Snapshot`]
//! of both to plan in. The central maintainer and what actuators share are the same machine
//! with another [`Scope`]; what an actuator knows beside what is public, it sees [for
//! itself](Maintainer::snapshot_for).
//!
//! - `maintainer` is told things and answers with a [`Change`], or with why it [`Declined`].
//! - `compose` makes one domain of many models; `manifest` takes a model apart for it, `described`
//!   is what is kept of one.
//! - `belief` keeps who claims which fact; `roster` keeps who is here; `remembered` keeps what those
//!   who left could do.
//! - [`Follower`] keeps a copy of the state from announced changes.
//!
//! Leaves to others: messages and tokens (`agent`), parsing and checking (`pddl`), planning
//! (`planner`), deciding when a lost agent is removed (the plugin).
//!
//! **Invariant:** nothing here reads a clock or does I/O; a [`Moment`] enters with each call, and
//! the same calls give the same answers everywhere.
//! **Invariant:** no agent can make the composite unreadable for a planner: whatever does not fit
//! is left out and named in a [`Conflict`].

mod maintainer;

mod inputs;

mod change;
mod conflict;
mod declined;
mod snapshot;
mod untold;

mod follower;

mod compose;

mod canonical;
mod composite;
mod described;
mod manifest;
mod names;
mod vocabulary;

mod belief;
mod fact;
mod remembered;
mod roster;

mod digest;
pub mod limits;
mod moment;

pub use belief::Source;
pub use change::{Change, text_of};
pub use conflict::{Conflict, Kind, Subject};
pub use declined::Declined;
pub use digest::{model_digest, problem_digest, text_digest};
pub use fact::Owner;
pub use follower::{Follower, Lag};
pub use inputs::{
    Announcement, Beat, Effects, Known, Repeated, Requests, RequestsSince, SILENCE_HALF_PERIODS,
};
pub use maintainer::{Admission, AgentView, ClaimedBy, Maintainer, Provenance, Scope, Sight};
pub use moment::Moment;
pub use snapshot::Snapshot;
