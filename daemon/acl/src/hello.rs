//! What a daemon tells a plugin in a process of its own, as the first line of its standard input.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::content::{Methods, Mode};
use crate::message::Deadline;
use crate::name::{AgentId, DaemonId, EcosystemId};

/// All that a plugin needs to join: one line of JSON. The end of its standard input, which stays open
/// while the daemon wants it, is its daemon's last word.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Hello {
    /// Of the protocol; [`crate::SCHEMA_VERSION`].
    pub protocol: u32,
    /// The ecosystem: root of all keys.
    pub ecosystem: EcosystemId,
    /// What the plugin is called as a host of agents.
    pub daemon: DaemonId,
    /// Where it joins, as a Zenoh client.
    pub endpoint: String,
    /// Who speaks to it there, and hears its answers.
    pub host: HostName,
    /// The agents that it is asked to bring.
    pub agents: Vec<HelloAgent>,
    /// The shared ontology, in PDDL.
    pub domain: String,
    /// What is on the map, in PDDL.
    pub map: String,
    /// Which flow the ecosystem uses.
    pub mode: Mode,
    /// How often an agent says that it works.
    pub heartbeat_period: Deadline,
    /// The simulated building's socket, for simulated drivers.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub building: Option<String>,
}

/// The one agent that a plugin hears from.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct HostName {
    /// Its daemon.
    pub daemon: DaemonId,
    /// Its name.
    pub agent: AgentId,
}

/// An agent to bring.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HelloAgent {
    /// Its name.
    pub name: AgentId,
    /// Which of the plugins of its package it is.
    pub plugin: String,
    /// Through what it acts, where the file says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub driver: Option<String>,
    /// What the file says of it.
    #[serde(default)]
    pub config: Value,
    /// The action model that its package has for it, in PDDL; one that says its own may leave it.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub model: String,
    /// The methods that its package has for its actions.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub methods: Methods,
}
