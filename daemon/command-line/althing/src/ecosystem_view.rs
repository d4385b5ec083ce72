//! Access to a running ecosystem: queries to its daemons, and the names under which guests take
//! part. Commands, the prompt and the web page of a daemon use it.

use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{Directory, MessageRouter, Resident, Resource, ResourceQuery, RoleNames};
use bytes::Bytes;

use crate::config::Ecosystem;
use crate::hosting::{self, GuestKeys};

/// How long the answers of daemons to a query are awaited.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// How long a command waits until it sees agents of the ecosystem, once the link is up.
const SEEN_WITHIN: Duration = Duration::from_secs(5);

/// Maximum number of characters of the host name in a guest's name; the rest is cut off, because
/// lists of agents are 80 columns wide.
const HOST_CHARS_MAX: usize = 12;

/// Access to a running ecosystem, through a command's link or inside one of its daemons.
#[derive(Clone)]
pub(crate) struct EcosystemView {
    pub(crate) router: Arc<MessageRouter>,
    pub(crate) name: EcosystemId,
    /// The ecosystem as its file defines it; `None` if this process has not read the file.
    pub(crate) ecosystem: Option<Arc<Ecosystem>>,
    /// The endpoints of the ecosystem's daemons.
    pub(crate) endpoints: Vec<String>,
    /// The key that guests use if the ecosystem is secured; `None` if it is not secured.
    pub(crate) keys: Option<GuestKeys>,
}

/// Returns a unique name for a guest, from its role, the host name and the process id.
pub(crate) fn guest_name(role: &str) -> String {
    format!("{role}-{}-{}", short_host_name(), std::process::id())
}

/// Returns the first characters of the host name. Processes on hosts with equal first characters
/// rarely have equal ids.
pub(crate) fn short_host_name() -> String {
    let host = hosting::host_name();
    let host = host.as_ref().map_or("here", DaemonId::host);
    host.chars().take(HOST_CHARS_MAX).collect()
}

impl EcosystemView {
    /// Returns the names of the reasoning agents: those of the ecosystem file, or the default names
    /// if this process has not read the file.
    pub(crate) fn roles(&self) -> &RoleNames {
        &self.router.settings().roles
    }

    /// Returns the name of the shared ontology, or `unknown` if this process has not read the
    /// ecosystem file.
    pub(crate) fn ontology(&self) -> &str {
        self.ecosystem.as_ref().map_or("unknown", |ecosystem| ecosystem.domain.name.as_str())
    }

    /// Queries a resource from all daemons, and returns their answers.
    pub(crate) async fn ask(&self, resource: Resource, agent: Option<AgentId>) -> Vec<Bytes> {
        let ask = ResourceQuery { daemon: None, resource, agent };
        self.router.ask(ask, ANSWERED_WITHIN).await
    }

    /// Returns the daemon that hosts an agent. Returns `None` if no daemon that answers hosts it.
    pub(crate) async fn holder(&self, agent: &AgentId) -> Option<DaemonId> {
        self.directory(None).await;
        let answers = self.ask(Resource::Directory, None).await;
        let read = |answer: &Bytes| serde_json::from_slice::<Vec<Resident>>(answer).ok();
        let mut residents = answers.iter().filter_map(read).flatten();
        let found = residents.find(|resident| resident.agent == *agent);
        found.map(|resident| resident.daemon)
    }

    /// Waits up to [`SEEN_WITHIN`] until the agent `wanted` is seen or, if `wanted` is `None`,
    /// until any agent is seen. Returns the agents that are seen at the end of the wait.
    pub(crate) async fn directory(&self, wanted: Option<&AgentId>) -> Arc<Directory> {
        let (mut directory, mut changes) = self.router.presence_changes();
        let deadline = tokio::time::Instant::now() + SEEN_WITHIN;
        let is_seen = |directory: &Directory| match wanted {
            Some(agent) => directory.find(agent).is_some(),
            None => directory.iter().next().is_some(),
        };
        while !is_seen(&directory) {
            if tokio::time::timeout_at(deadline, changes.recv()).await.is_err() {
                break;
            }
            directory = self.router.directory();
        }
        directory
    }
}
