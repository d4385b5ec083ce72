//! Entry point of a plugin crate for a daemon, and the data from which an agent is built.

use std::sync::Arc;

use acl::AgentId;
use serde::de::DeserializeOwned;
use serde_json::Value;

use crate::host::Host;
use crate::launch::LaunchableAgent;

/// Description of one plugin, as an entry of the daemon's table of plugins.
#[derive(Clone, Copy, Debug)]
pub struct PluginEntry {
    /// Name by which an ecosystem file refers to the plugin.
    pub name: &'static str,
    /// Description of the plugin in one line.
    pub about: &'static str,
    /// Names of the drivers that the plugin offers; the first is the default. Empty if the plugin
    /// uses no device.
    pub drivers: &'static [&'static str],
    /// Whether several daemons may host an agent of this plugin. If so, one replica is the leader
    /// and the others are standbys. `false` for a plugin that drives a device, because there is
    /// only one device.
    pub has_replicas: bool,
    /// Function that builds an agent of this plugin. The function opens no device and no
    /// connection; the agent opens them when it is activated.
    pub build: fn(Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError>,
}

/// Data from which an agent is built: its entry in the ecosystem file, and its host.
#[derive(Clone, Debug)]
pub struct Blueprint {
    /// Name of the agent.
    pub id: AgentId,
    /// Name of the driver: one of those that the plugin offers.
    pub driver: String,
    /// The `config` table of the agent's entry, as JSON.
    pub config: Arc<Value>,
    /// Data and resources of the daemon that hosts the agent.
    pub host: Arc<Host>,
}

/// Reason why an agent could not be built. The message completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum BuildError {
    /// The `config` of the agent's entry does not have the expected shape.
    #[error("read the config of `{agent}`: {source}")]
    Config {
        /// Name of the agent that could not be built.
        agent: AgentId,
        /// Error that the parser returned.
        #[source]
        source: serde_json::Error,
    },
    /// The agent's entry names a driver that the plugin does not have.
    #[error("find driver `{driver}` for `{agent}`; there is {}", known.join(", "))]
    UnknownDriver {
        /// Name of the agent that could not be built.
        agent: AgentId,
        /// Name of the driver that the entry asks for.
        driver: String,
        /// Names of the drivers that the plugin has.
        known: Vec<String>,
    },
    /// The safeguards of the agent, which stand outside its entry, name an action that it does not
    /// have.
    #[error("safeguard `{agent}`: {problem}")]
    Safeguards {
        /// Name of the agent that could not be built.
        agent: AgentId,
        /// The name that is no action, and those that are.
        problem: String,
    },
    /// The agent's entry has another mistake.
    #[error("build `{agent}`: {problem}")]
    Other {
        /// Name of the agent that could not be built.
        agent: AgentId,
        /// Description of the problem, and of what a correct entry would contain.
        problem: String,
    },
}

impl Blueprint {
    /// Parses the `config` of the agent's entry.
    ///
    /// # Errors
    ///
    /// Returns an error if `config` does not have the expected shape.
    pub fn config_as<T: DeserializeOwned>(&self) -> Result<T, BuildError> {
        let config = if self.config.is_null() {
            Value::Object(Default::default())
        } else {
            Value::clone(&self.config)
        };
        serde_json::from_value(config)
            .map_err(|source| BuildError::Config { agent: self.id.clone(), source })
    }

    /// Creates an error about a mistake in the agent's entry; `problem` describes the mistake.
    pub fn problem(&self, problem: impl Into<String>) -> BuildError {
        BuildError::Other { agent: self.id.clone(), problem: problem.into() }
    }
}
