//! How the plugins of a daemon are, for people: `althing plugin list`.

use acl::{AgentId, DaemonId};
use serde::{Deserialize, Serialize};

use crate::confinement::Means;
use crate::package::Package;

/// All plugins of one daemon.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Plugins {
    /// The daemon.
    pub daemon: DaemonId,
    /// Where its packages are.
    pub folder: String,
    /// How far they can be confined there.
    #[serde(default)]
    pub confinement: Confined,
    /// Each, by name.
    pub plugins: Vec<Status>,
}

/// How far plugins can be confined where a daemon runs.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Confined {
    /// What cannot be kept from a plugin without `network`, each in a sentence; empty if nothing is left.
    pub not_enforced: Vec<String>,
    /// How what plugins take is limited.
    pub limits: String,
    /// Whether plugins run only where they are confined whole.
    pub is_required: bool,
    /// What the kernel has for it.
    pub means: Option<Means>,
}

/// One plugin.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct Status {
    /// Its name.
    pub name: String,
    /// Its version; empty where its manifest cannot be read.
    pub version: String,
    /// What it is, in a line.
    pub about: String,
    /// Where it stands.
    pub state: State,
    /// Why, where that is not plain.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reason: Option<String>,
    /// What it was allowed beyond the least, as it is written after `--allow`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub allowed: Vec<String>,
    /// What of its confinement cannot be enforced here, each in a sentence.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub not_enforced: Vec<String>,
    /// What a person can do about it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub advice: Option<String>,
    /// Its process.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pid: Option<i32>,
    /// Bytes of memory its processes hold.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub memory: Option<u64>,
    /// The agents of it that are in the ecosystem.
    pub agents: Vec<AgentId>,
    /// How often it was started again.
    pub restarts: u32,
    /// Messages that were too many, and dropped.
    pub dropped: u64,
    /// The file of what it prints.
    pub log: String,
}

impl Status {
    /// Takes what its package says of itself; nothing, where it cannot be read.
    pub(crate) fn describes(&mut self, package: Option<&Package>) {
        let manifest = package.map(|package| &package.manifest);
        self.version = manifest.map(|manifest| manifest.version.clone()).unwrap_or_default();
        self.about = manifest.map(|manifest| manifest.about.clone()).unwrap_or_default();
    }
}

/// Where a plugin stands.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum State {
    /// Its package is not whole.
    Invalid,
    /// A person has taken it out of use.
    Disabled,
    /// It asks for what nobody has allowed.
    NotAllowed,
    /// It could not be confined whole, and has to be.
    NotConfined,
    /// Nobody wants an agent of it.
    #[default]
    Unused,
    /// Its process is beginning.
    Starting,
    /// Its agents are here.
    Running,
    /// It has ended, and will be started again.
    Waiting,
    /// It has ended too often: a person has to look.
    GivenUp,
}

impl State {
    /// The name, for a person.
    pub fn as_str(self) -> &'static str {
        match self {
            State::Invalid => "invalid",
            State::Disabled => "disabled",
            State::NotAllowed => "not allowed",
            State::NotConfined => "not confined",
            State::Unused => "unused",
            State::Starting => "starting",
            State::Running => "running",
            State::Waiting => "waiting",
            State::GivenUp => "given up",
        }
    }
}
