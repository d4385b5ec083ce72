//! What a plugin sees: the Base Agent, its Communication Agent, its mailbox and its life.
//!
//! - [`Agent`] is the paper's Base Agent: what it reacts to is its [`Callbacks`].
//! - [`Context`] is what a callback can do: open an exchange, answer, wait, work aside.
//! - The Communication Agent behind it decodes, drops duplicates, sends receipts, retries
//!   commitments, follows the protocols, and holds messages for agents that are not here yet.
//! - [`Switchboard`] is the daemon's own end of the substrate: mailboxes, the [`Directory`], and
//!   the broadcasts a newcomer has missed.
//! - [`Rights`] say who may do what in a secured ecosystem; the switchboard sees to it.
//! - [`upkeep`] keeps a Domain Maintainer up to date; the [`Commons`] keep what the actuators of
//!   one daemon hear.
//! - [`keeping`] has the Journals keep what must outlive an agent, and reads it back.
//! - [`bringing`] lets what an agent finds come as agents beside it, if people
//!   ([`Admissions`]) let them.
//! - [`Landing`] is where agents live that come while the daemon runs; [`Observer`] watches those of
//!   another wire.
//! - [`Machine`] is what an agent takes of the machine it runs on: threads, the wall clock.
//! - [`PluginEntry`] is what a plugin crate offers to a daemon.
//!
//! An agent sees no substrate and no other agent's code.

mod admission;
mod base_agent;
pub mod bringing;
mod callbacks;
mod commons;
mod communication_agent;
mod context;
mod directory;
mod fetching;
mod gathering;
mod guard;
mod hearsay;
pub mod keeping;
mod knowledge;
mod landing;
mod last_word;
mod machine;
mod mailbox;
mod observing;
mod outbox;
mod plugin;
mod receipts;
mod rejections;
mod rights;
mod settings;
mod standing;
mod switchboard;
mod turns;
pub mod upkeep;

pub use acl::content::Mode;
pub use admission::{Admission, Admissions, Admit, Applicant};
pub use base_agent::{Agent, Berth, Launch, LaunchError};
pub use bringing::{Bringing, Brings};
pub use callbacks::Callbacks;
pub use commons::Commons;
pub use communication_agent::{Answer, Engagement, Opening, Undelivered};
pub use context::{Brought, Context, Exchanges, TimerId, Work};
pub use directory::Directory;
pub use knowledge::knowledge;
pub use landing::Landing;
pub use machine::{Lost, Machine, Simulated};
pub use observing::{Observer, Sight, Sighted};
pub use plugin::{
    Blueprint, BuildError, Host, Named, PluginEntry, Rehearsal, Resources, StateFolder,
};
pub use rights::{AgentRights, Allowed, Askers, Rights};
pub use settings::Settings;
pub use substrate::{Ask, Presence, Resident, Resource};
pub use switchboard::{Counters, Switchboard};
pub use turns::computation_bytes_max;
