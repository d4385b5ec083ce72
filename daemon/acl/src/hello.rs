//! The first line of standard input of a plugin that is a process of its own.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::content::{Methods, Mode};
use crate::message::Deadline;
use crate::name::{AgentId, DaemonId, EcosystemId};

/// Everything that a plugin needs to join, as one line of JSON. The daemon keeps the plugin's standard
/// input open while the plugin is to run; when it is closed, the plugin must exit.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the protocol; [`crate::SCHEMA_VERSION`].
    pub protocol: u32,
    /// The ecosystem: root of all keys.
    pub ecosystem: EcosystemId,
    /// Name of the plugin as a host of agents.
    pub daemon: DaemonId,
    /// Endpoint to which the plugin connects, as a Zenoh client.
    pub endpoint: String,
    /// The agent of the daemon that the plugin communicates with at that endpoint.
    pub host: HostName,
    /// The agents that the plugin must start.
    pub agents: Vec<HelloAgent>,
    /// The shared ontology, in PDDL.
    pub domain: String,
    /// The map, in PDDL.
    pub map: String,
    /// The flow that the ecosystem uses.
    pub mode: Mode,
    /// Period in which each agent sends a heartbeat.
    pub heartbeat_period: Deadline,
    /// Socket of the simulated building, for simulated drivers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub building: Option<String>,
}

/// The agent that a plugin receives messages from. There is only one.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostName {
    /// Daemon of the agent.
    pub daemon: DaemonId,
    /// Name of the agent.
    pub agent: AgentId,
}

/// An agent that the plugin must start.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HelloAgent {
    /// Name of the agent.
    pub name: AgentId,
    /// Name of the plugin within its package.
    pub plugin: String,
    /// Driver of the agent, if the ecosystem file names one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
    /// The agent's configuration in the ecosystem file.
    #[serde(default)]
    pub config: Value,
    /// Action model from the package, in PDDL; empty if the agent defines its own.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub model: String,
    /// Methods from the package for the agent's actions.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub methods: Methods,
}
