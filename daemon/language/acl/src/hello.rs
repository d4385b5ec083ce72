//! The first line of standard input of a plugin that runs as a process.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::content::{Methods, Mode};
use crate::message::Millis;
use crate::name::{AgentId, DaemonId, EcosystemId};

/// All data that a plugin needs to join the ecosystem, sent as one line of JSON. The daemon keeps
/// the plugin's standard input open as long as the plugin should run. When the input is closed, the
/// plugin must exit.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Version of the protocol that the daemon uses: [`crate::SCHEMA_VERSION`].
    pub protocol: u32,
    /// Name of the ecosystem, which is the root of all keys.
    pub ecosystem: EcosystemId,
    /// Name under which the plugin hosts agents, like the name of a daemon.
    pub daemon: DaemonId,
    /// Zenoh endpoint that the plugin connects to, as a client.
    pub endpoint: String,
    /// The agent of the daemon that the plugin exchanges messages with.
    pub host: HostName,
    /// The agents that the plugin must start.
    pub agents: Vec<HelloAgent>,
    /// The shared ontology, in PDDL.
    pub domain: String,
    /// The map of the ecosystem, in PDDL.
    pub map: String,
    /// The planning mode of the ecosystem (centralised or decentralised).
    pub mode: Mode,
    /// Time between two heartbeats of each agent.
    pub heartbeat_period: Millis,
    /// Path of the socket of the simulated building, which simulated drivers use; `None` if there
    /// is no simulated building.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub building: Option<String>,
}

/// The agent of the daemon from which the plugin receives messages. A plugin has exactly one.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostName {
    /// Name of the daemon that hosts the agent.
    pub daemon: DaemonId,
    /// Name of the agent that the plugin receives messages from.
    pub agent: AgentId,
}

/// An agent that the plugin must start.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HelloAgent {
    /// Name of the agent to start.
    pub name: AgentId,
    /// Name of the plugin that implements the agent, as its package defines it.
    pub plugin: String,
    /// Name of the agent's driver; `None` if the ecosystem file does not specify one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
    /// Configuration of the agent from the ecosystem file.
    #[serde(default)]
    pub config: Value,
    /// Action model of the agent in its package, in PDDL; empty if the agent defines its own.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub model: String,
    /// Methods of the agent's actions in its package.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub methods: Methods,
}
