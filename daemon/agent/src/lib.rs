//! The interface between a plugin and its daemon: the Base Agent, its Communication Agent, its
//! mailbox and its life cycle.
//!
//! - [`Agent`] is the paper's Base Agent; its [`Callbacks`] list the messages that it reacts to.
//! - [`Context`] has the operations of a callback: open an exchange, answer, set a timer, run work
//!   in the background.
//! - The Communication Agent behind it decodes messages, drops duplicates, sends receipts, retries
//!   commitments, follows the protocols, and holds messages for agents that are not present yet.
//! - [`Switchboard`] is the router of a daemon: mailboxes, the [`Directory`], and the broadcasts
//!   that a newly started agent has missed.
//! - [`Rights`] state which agent may do what in a secured ecosystem; the switchboard enforces them.
//! - [`upkeep`] keeps a Domain Maintainer up to date; the [`Commons`] are the domain model that the
//!   actuators of one daemon share.
//! - [`keeping`] replicates records to the Journals for data that must outlive an agent, and reads
//!   them back.
//! - [`bringing`] starts agents for the devices that an agent discovers, if people ([`Admissions`])
//!   admit them.
//! - [`Landing`] launches agents while the daemon runs; an [`Observer`] watches the agents of
//!   another network.
//! - [`Machine`] has the services of the host machine: threads, the wall clock, incarnation numbers.
//! - [`PluginEntry`] is the entry point of a plugin crate for a daemon.
//!
//! An agent has no access to the substrate or to the code of another agent.

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
