//! The Domain Maintainer: composes the action models and facts of many agents into one domain and
//! one problem.
//!
//! Start reading at [`Maintainer`]. Agents join and leave, announce their action models and report
//! facts. At every moment there is one composite domain and one state, with the claims about each
//! fact. A [`DomainSnapshot`] of both is the input of a planner.
//!
//! The central maintainer and the maintainer that the actuators of a daemon share are the same
//! state machine with different [`MaintainerScope`]s. The private knowledge of an actuator is added
//! [in its own snapshot](Maintainer::snapshot_for).
//!
//! - `maintainer` takes inputs. For each it returns the [`DomainChange`] that it makes, or the
//!   reason why it was [`Declined`].
//! - `compose` makes one domain of many models. `model_summary` divides a model into its parts for
//!   `compose`; `parsed_model` is the result that a maintainer keeps.
//! - `belief` keeps all claims about facts; `known_agents` keeps the present agents;
//!   `former_actions` keeps the actions of agents that have left.
//! - [`Follower`] keeps a copy of the state from announced changes.
//!
//! Other crates have the following tasks: messages and liveliness tokens (`agent`), parsing and
//! checking (`pddl`), planning (`planner`), and the decision when a lost agent is removed (the
//! plugin).
//!
//! **Invariant:** this crate reads no clock and does no I/O. A [`Timestamp`] is passed to each
//! call, and the same calls give the same results everywhere.
//!
//! **Invariant:** no agent can make the composite domain unreadable for a planner. A part of a
//! model that does not fit is left out and named in a [`Conflict`].

mod maintainer;

mod inputs;

mod change;
mod conflict;
mod declined;
mod pending_changes;
mod snapshot;

mod follower;

mod compose;

mod canonical;
mod composite;
mod model_summary;
mod names;
mod parsed_model;
mod vocabulary;

mod belief;
mod fact;
mod former_actions;
mod known_agents;

mod digest;
pub mod limits;
mod timestamp;

pub use change::{DomainChange, text_of};
pub use conflict::{Conflict, ModelPart, ModelPartKind};
pub use declined::Declined;
pub use digest::{model_digest, problem_digest, text_digest};
pub use fact::{ClaimSource, Owner};
pub use follower::{FollowError, Follower};
pub use inputs::{
    Announcement, Effects, KnownFact, ParsedHeartbeat, RepeatedHeartbeat, RequestedChanges,
    RequestedChangesSince, SilenceLimit,
};
pub use maintainer::{
    AdmitResult, AgentView, CompositionCache, Maintainer, MaintainerScope, OwnerClaim, Provenance,
};
pub use snapshot::DomainSnapshot;
pub use timestamp::Timestamp;
