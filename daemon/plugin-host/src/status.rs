//! Status of the plugins of a daemon, for users: `althing plugin list`.

use acl::{AgentId, DaemonId};
use serde::{Deserialize, Serialize};

use crate::confinement::ConfinementMeans;
use crate::package::Package;

/// All plugins of one daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PluginList {
    /// Name of the daemon.
    pub daemon: DaemonId,
    /// Its plugin folder.
    pub folder: String,
    /// Extent to which plugins can be confined there.
    #[serde(default)]
    pub confinement: ConfinementStatus,
    /// Status of each plugin, sorted by name.
    pub plugins: Vec<PluginStatus>,
}

/// Extent to which plugins can be confined on a daemon's machine.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ConfinementStatus {
    /// Restrictions that cannot be enforced for a plugin without `network`, each as a sentence; empty if
    /// all can.
    pub not_enforced: Vec<String>,
    /// Description of how the resources of plugins are limited.
    pub limits: String,
    /// Whether a plugin runs only if all of its confinement can be enforced.
    pub is_required: bool,
    /// Means of confinement that the kernel offers; `None` until they are known.
    pub means: Option<ConfinementMeans>,
}

/// Status of one plugin.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct PluginStatus {
    /// Name of the plugin.
    pub name: String,
    /// Its version; empty if its manifest cannot be read.
    pub version: String,
    /// Its description, one line.
    pub about: String,
    /// Its state.
    pub state: PluginState,
    /// Reason for the state, if there is one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// Rights that it uses beyond the minimum, as written after `--allow`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub allowed: Vec<String>,
    /// Restrictions that cannot be enforced for it here, each as a sentence.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_enforced: Vec<String>,
    /// Advice on what a person can do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
    /// Process id; `None` if it does not run.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pid: Option<i32>,
    /// Bytes of memory that its processes hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<u64>,
    /// Its agents that are in the ecosystem.
    pub agents: Vec<AgentId>,
    /// Number of restarts.
    pub restarts: u32,
    /// Messages that were dropped because there were too many.
    pub dropped: u64,
    /// Path of the file with its output.
    pub log: String,
}

impl PluginStatus {
    /// Takes version and description from its package; clears them if the package cannot be read.
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
    /// Its package has mistakes.
    Invalid,
    /// A person has disabled it.
    Disabled,
    /// The package asks for rights that were not allowed.
    NotAllowed,
    /// The plugin may run only fully confined, which is not possible here.
    NotConfined,
    /// None of its agents is wanted.
    #[default]
    Unused,
    /// Its process has been started, and its agents are not all present yet.
    Starting,
    /// Its agents have joined.
    Running,
    /// The process has ended, and will be restarted.
    Waiting,
    /// The process has ended too often: a person has to intervene.
    GivenUp,
}

impl PluginState {
    /// Returns the name of the state, for a person.
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
