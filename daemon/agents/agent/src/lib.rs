//! The interface between a plugin and its daemon: the Base Agent, its Communication Agent, its
//! mailbox and its life cycle.
//!
//! - [`Agent`] is the paper's Base Agent. Its [`Callbacks`] list the messages that it reacts to.
//! - [`Context`] has the operations of a callback: open an exchange, answer, set a timer, run work
//!   in the background.
//! - The Communication Agent behind a context decodes messages, drops duplicates, sends receipts,
//!   retries commitments, follows the protocols, and holds messages for agents that are not present
//!   yet.
//! - [`MessageRouter`] is the router of a daemon. It owns the membership with the [`Directory`],
//!   the hosted agents with their mailboxes, the broadcasts that a newly started agent has missed,
//!   the link to the substrate, and the feed of the shared domain. Plugins reach these parts
//!   through [`Context`] only.
//! - [`Rights`] state which agent may do what in a secured ecosystem. The router enforces them.
//! - [`domain_sync`] keeps a Domain Maintainer up to date. The [`SharedDomain`] is the domain model
//!   that the actuators of one daemon share.
//! - [`replication`] replicates records to the Journals, for data that must outlive an agent, and
//!   reads the records back.
//! - [`discovery`] starts agents for the devices that an agent discovers, if people
//!   ([`Admissions`]) admit these agents.
//! - [`Spawner`] launches agents while the daemon runs. An [`Observer`] watches the agents of
//!   another network.
//! - [`HostServices`] has the services of the host machine: threads, the wall clock, incarnation
//!   numbers.
//! - [`PluginEntry`] is the entry point of a plugin crate for a daemon.
//!
//! An agent has no access to the substrate or to the code of another agent.

mod activity_counters;
mod admission;
mod applied_heartbeats;
mod authorization;
mod base_agent;
mod broadcast_cache;
mod callbacks;
mod communication_agent;
mod compute_pool;
mod config_duration;
mod config_table;
mod context;
mod daemon_figures;
mod daemon_reports;
mod directory;
pub mod discovery;
mod domain_feed;
pub mod domain_sync;
mod domain_tracker;
mod duration_histogram;
mod event_loop;
mod exchange;
mod failure_counters;
mod heartbeat_batcher;
mod host;
mod host_services;
mod knowledge;
mod latest_announcement;
mod launch;
mod leadership;
mod local_agents;
mod mailbox;
mod membership;
mod model_fetcher;
mod observer;
mod outbox;
mod overheard;
mod plugin;
mod receipts;
mod refusal;
mod rejections;
pub mod replication;
mod retry_backoff;
mod rights;
mod role_names;
mod router;
mod settings;
mod shared_domain;
mod spawner;
mod stop_buttons;
mod stops;
mod stored_file;
mod substrate_link;

pub use acl::content::Mode;
pub use activity_counters::{
    ActivityCounters, ActivityCounts, PlanningResult, StepOutcome, TrackedGoal,
};
pub use admission::{AdmissionPolicy, AdmissionStatus, Admissions, Applicant};
pub use base_agent::Agent;
pub use callbacks::Callbacks;
pub use compute_pool::computation_bytes_max;
pub use config_duration::{config_duration, config_validity};
pub use config_table::config_table;
pub use context::{ChildHandle, Context, TimerId, WorkHandle};
pub use daemon_figures::{DaemonFigures, FailureCounts, MailboxTotals};
pub use directory::Directory;
pub use discovery::{DiscoveredAgents, DiscoversAgents};
pub use duration_histogram::DurationCounts;
pub use exchange::{DeliveryError, ExchangeEvent, ExchangeOpening, ExchangeSummary, Participation};
pub use failure_counters::FailureCounters;
pub use host::{
    BuildCheck, ConfiguredModels, ConfiguredNames, EcosystemFolder, Host, Resources, StateFolder,
};
pub use host_services::{HostServices, MachineSimulation, WorkError};
pub use knowledge::knowledge;
pub use launch::{LaunchContext, LaunchError, LaunchableAgent};
pub use observer::{AgentSnapshot, AgentWatch, Observer};
pub use overheard::{Overheard, OverheardBatch};
pub use plugin::{Blueprint, BuildError, PluginEntry};
pub use retry_backoff::RetryBackoff;
pub use rights::{AgentRights, AllowedNames, AllowedRequesters, Rights};
pub use role_names::RoleNames;
pub use router::MessageRouter;
pub use settings::{AgentSettings, ModelPrivacy, TimingRule};
pub use shared_domain::SharedDomain;
pub use spawner::Spawner;
pub use stop_buttons::{PressedWhen, StopButton, StopButtons};
pub use stops::{StopChanges, StopRegistry};
pub use stored_file::replace_file;
pub use substrate::{Presence, Resident, Resource, ResourceQuery};
