//! Desired state of a plugin, and of the agents that it must bring.

use std::sync::Arc;

use acl::AgentId;
use serde_json::Value;

use crate::package::{Package, Stamp};
use crate::status::PluginState;

/// Desired state of a plugin.
#[derive(Clone, Debug)]
pub(crate) enum DesiredState {
    /// The plugin has to run.
    Run(Arc<DesiredPlugin>),
    /// The plugin must not run. The fields are the state to show for the plugin, the reason if
    /// there is one, and the package if it can be read.
    Stopped(PluginState, Option<String>, Option<Arc<Package>>),
    /// The plugin's package was removed: the status of the plugin is deleted, and the supervision
    /// ends, unless the package has come back meanwhile.
    Removed,
}

/// A package that has to run, and the agents that it must bring.
#[derive(Debug)]
pub(crate) struct DesiredPlugin {
    pub(crate) package: Arc<Package>,
    /// Stamp of the files of the package.
    pub(crate) stamp: Stamp,
    pub(crate) agents: Vec<WantedAgent>,
}

/// An agent that a plugin must bring.
#[derive(Clone, Debug, PartialEq)]
pub struct WantedAgent {
    /// Name of the agent.
    pub name: AgentId,
    /// Name of the plugin, within its package.
    pub plugin: String,
    /// Driver that the agent uses; `None` if neither the ecosystem file nor the manifest names one.
    pub driver: Option<String>,
    /// The `config` of the agent, from the ecosystem file or the manifest.
    pub config: Value,
}
