//! Joint plans of agents with secrets (factored MA-PDDL tasks): what is `:private` to an agent is
//! never named to others.
//!
//! 1. Each agent announces a [`Projection`] of its task. Public symbols keep their names. Private
//!    objects, functions and actions get opaque names. Of its private predicates the agent keeps only
//!    some, under opaque names: at first those that connect its public actions, because one of them
//!    makes true what another one requires. The others are dropped from preconditions and effects.
//!    (It is coarser than the dependency-preserving projection of Maliah, Shani and Stern, and
//!    becomes finer on demand.)
//! 2. A requester merges the projections, and plans over them: [`SkeletonTask`]. The projections drop
//!    requirements and never add any. So a task without a skeleton has no joint plan.
//! 3. Each agent fills its own part with its private steps: [`Partner::fill`]. If it cannot, it keeps
//!    more of its private predicates ([`Partner::sharpen`]), and the requester plans again. If an
//!    agent keeps all of them, its projection is exact up to names. So there is a last round.
//!
//! What others learn: how many private objects there are, and the structure of what is kept, without
//! any name.
//!
//! In a running ecosystem, agents announce the projection as their action model, and the Domain
//! Maintainer composes it like any other: [`ConfidentialModel`].
//!
//! Start reading at [`plan_in_one_process`], which does all of this without messages. Other crates
//! exchange projections and parts between processes. **Invariant:** this crate has no async function,
//! and uses no clock, file or log.

mod confidential_model;
mod fill;
mod local;
mod opaque_names;
mod partner;
mod private_symbols;
mod projection;
mod requester;
mod terms;

pub use confidential_model::{ConfidentialModel, KnownWorld};
pub use fill::{FillRefusal, FilledPart};
pub use local::{LocalPlan, plan_in_one_process};
pub use partner::Partner;
pub use projection::Projection;
pub use requester::{SkeletonError, SkeletonOutcome, SkeletonPlan, SkeletonTask};
