//! Status of the plugins of a daemon, for users. `althing plugin list` shows it.

use acl::{AgentId, DaemonId};
use serde::{Deserialize, Serialize};

use crate::confinement::ConfinementMeans;
use crate::package::Package;

/// The plugins of one daemon, with the status of each.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PluginList {
    /// Name of the daemon.
    pub daemon: DaemonId,
    /// Path of the daemon's plugin folder.
    pub folder: String,
    /// Extent to which plugins can be confined on the daemon's machine.
    #[serde(default)]
    pub confinement: ConfinementStatus,
    /// Status of each plugin, sorted by name.
    pub plugins: Vec<PluginStatus>,
}

/// Extent to which plugins can be confined on a daemon's machine.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ConfinementStatus {
    /// Restrictions that cannot be enforced for a plugin without the right `network`, each as a
    /// sentence; empty if all can be enforced.
    pub not_enforced: Vec<String>,
    /// Description of the limits on the resources of plugins and their enforcement, for a person.
    pub limits: String,
    /// Whether a plugin runs only if all of its confinement can be enforced.
    pub is_required: bool,
    /// Means of confinement that the kernel offers; `None` until they are determined.
    pub means: Option<ConfinementMeans>,
}

/// Status of one plugin.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PluginStatus {
    /// Name of the plugin.
    pub name: String,
    /// Version of the plugin; empty if the plugin's manifest cannot be read.
    pub version: String,
    /// Description of the plugin, one line.
    pub about: String,
    /// State of the plugin.
    pub state: PluginState,
    /// Reason why the plugin is in this state; `None` if the state needs no reason.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Rights that the plugin uses beyond the minimum, as written after `--allow`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub allowed: Vec<String>,
    /// Restrictions that cannot be enforced for the plugin on this machine, each as a sentence.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_enforced: Vec<String>,
    /// Advice on how a person can mend the plugin's state; `None` if there is none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
    /// Process id of the plugin; `None` if the plugin does not run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pid: Option<i32>,
    /// Bytes of memory that the plugin's processes hold; `None` if the memory is not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<u64>,
    /// Agents of the plugin that are in the ecosystem.
    pub agents: Vec<AgentId>,
    /// Number of times that the plugin was restarted.
    pub restarts: u32,
    /// Number of messages of the plugin that were dropped because there were too many.
    pub dropped: u64,
    /// Path of the file with the plugin's output.
    pub log: String,
}

impl PluginStatus {
    /// Copies the version and description from the plugin's package; clears them if the package
    /// cannot be read.
    pub(crate) fn describes(&mut self, package: Option<&Package>) {
        let manifest = package.map(|package| &package.manifest);
        self.version = manifest.map(|manifest| manifest.version.clone()).unwrap_or_default();
        self.about = manifest.map(|manifest| manifest.about.clone()).unwrap_or_default();
    }
}

/// State of a plugin.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum PluginState {
    /// The plugin's package has mistakes.
    Invalid,
    /// A person has disabled the plugin.
    Disabled,
    /// The plugin's package requests rights that were not allowed.
    NotAllowed,
    /// The plugin may run only if it is fully confined, which is not possible on this machine.
    NotConfined,
    /// The plugin does not run, because the ecosystem uses none of its agents.
    #[default]
    Unused,
    /// The plugin's process has been started, and not all of the plugin's agents are present yet.
    Starting,
    /// The plugin's process runs, and its agents have joined.
    Running,
    /// The plugin's process has ended, and will be restarted.
    Waiting,
    /// The plugin's process has ended too often; a person has to intervene.
    GivenUp,
}

impl PluginState {
    /// Returns the name of the state of a plugin, for a person.
    pub fn as_str(self) -> &'static str {
        match self {
            PluginState::Invalid => "invalid",
            PluginState::Disabled => "disabled",
            PluginState::NotAllowed => "not allowed",
            PluginState::NotConfined => "not confined",
            PluginState::Unused => "unused",
            PluginState::Starting => "starting",
            PluginState::Running => "running",
            PluginState::Waiting => "waiting",
            PluginState::GivenUp => "given up",
        }
    }
}
