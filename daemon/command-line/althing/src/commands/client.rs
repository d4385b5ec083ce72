//! The link of a command to a running ecosystem: the command is a Zenoh client of one of the
//! ecosystem's daemons.

use std::future::Future;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{Directory, HostServices, MessageRouter, Resident, Resource, ResourceQuery, RoleNames};
use bytes::Bytes;
use terminal::{exit, output};

use crate::cli::{AskArgs, ReachArgs};
use crate::commands::daemon_sockets;
use crate::commands::join_slots::{self, JoinSlot};
use crate::config::{self, Ecosystem, Overrides};
use crate::hosting::{self, DaemonNode, GuestKeys, MessageTransport};
use crate::plugins;

/// How long a command waits for the answers of daemons to a query.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// How long a command waits until it sees agents of the ecosystem, once the link is up.
const SEEN_WITHIN: Duration = Duration::from_secs(5);

/// Maximum number of characters of the host name in a guest's name; the rest is cut off, because
/// lists of agents are 80 columns wide.
const HOST_CHARS_MAX: usize = 12;

/// A command's link to a running ecosystem.
pub(crate) struct ClientLink {
    pub(crate) node: DaemonNode,
    pub(crate) view: EcosystemView,
}

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

/// The ecosystem that a command addresses: its name, its definition, the endpoints of its daemons,
/// and the key to use.
pub(crate) struct ClientTarget {
    pub(super) name: EcosystemId,
    pub(super) ecosystem: Option<Ecosystem>,
    pub(super) endpoints: Vec<String>,
    pub(super) keys: Option<GuestKeys>,
}

impl ClientTarget {
    /// Finds the ecosystem that a command addresses: the one of `--ecosystem`, or the one of the
    /// file in the current folder, or the only one that runs on this machine. The error text
    /// completes the sentence “failed to …”.
    pub(super) fn find(reach: &ReachArgs) -> Result<ClientTarget, String> {
        let file = match &reach.ecosystem {
            Some(asked) => match config::resolve_ecosystem(asked) {
                Ok(file) => Some(file),
                // A name without a file is enough, because the ecosystem's daemons may run here.
                Err(problem) => match EcosystemId::new(asked) {
                    Ok(name) => return ClientTarget::named(name, None, reach),
                    Err(_) => return Err(problem),
                },
            },
            None => config::find_ecosystem_file(),
        };
        match file {
            Some(file) => {
                let ecosystem = Ecosystem::load(&file, &Overrides::default(), &plugins::known())
                    .map_err(|error| {
                        output::show_to_person(&error.into_report());
                        format!("read {}", file.display())
                    })?;
                ClientTarget::named(ecosystem.name.clone(), Some(ecosystem), reach)
            }
            None => ClientTarget::named(only_running()?, None, reach),
        }
    }

    fn named(
        name: EcosystemId,
        ecosystem: Option<Ecosystem>,
        reach: &ReachArgs,
    ) -> Result<ClientTarget, String> {
        let mut endpoints = reach.connect.clone();
        let mut alive = Vec::new();
        if endpoints.is_empty() {
            let folder = hosting::runtime_folder(&name).map_err(|error| error.to_string())?;
            let is_alive = |path: &PathBuf| daemon_sockets::is_listening(path);
            alive.extend(hosting::daemon_sockets(&folder).into_iter().filter(is_alive));
            let endpoint = |path: &PathBuf| format!("unixsock-stream/{}", path.display());
            endpoints.extend(alive.iter().map(endpoint));
        }
        if endpoints.is_empty() {
            return Err(format!(
                "reach the ecosystem `{name}`: no daemon of it runs on this machine; start one \
                 with `althing up`, or name one elsewhere with --connect ENDPOINT"
            ));
        }
        // If the file has no security settings, no keys are searched for: the file is the same on
        // all machines.
        let settings = ecosystem.as_ref().map(|ecosystem| ecosystem.security.as_ref());
        let keys = match settings {
            Some(None) => None,
            known => {
                let (chosen, host) = (reach.key.as_deref(), hosting::host_name());
                let settings = known.flatten();
                GuestKeys::find(&name, settings, &alive, chosen, host.as_ref())?
            }
        };
        Ok(ClientTarget { name, ecosystem, endpoints, keys })
    }

    /// Returns the configuration of a Zenoh client session with this ecosystem.
    pub(super) fn config(&self) -> Result<substrate_zenoh::Config, String> {
        guest_config(&self.name, &self.endpoints, self.keys.as_ref(), "cli")
    }

    /// Waits until the command may join, because only a few commands may join at once. Returns
    /// `None` without waiting if no daemon is on this machine.
    fn turn(&self) -> Result<Option<JoinSlot>, String> {
        let is_here = |endpoint: &String| endpoint.starts_with("unixsock-stream/");
        if !self.endpoints.iter().any(is_here) {
            return Ok(None);
        }
        let folder = hosting::runtime_folder(&self.name).map_err(|error| error.to_string())?;
        join_slots::acquire_slot(&folder).map(Some)
    }

    /// Opens the link to the ecosystem.
    pub(super) async fn link(self) -> Result<ClientLink, String> {
        let config = self.config()?;
        self.link_with(config).await
    }

    /// Opens a second link of the same process, beside its first one.
    pub(super) async fn side_link(self) -> Result<ClientLink, String> {
        let config = guest_config(&self.name, &self.endpoints, self.keys.as_ref(), "side")?;
        self.link_with(config).await
    }

    async fn link_with(self, config: substrate_zenoh::Config) -> Result<ClientLink, String> {
        let daemon = config.daemon.clone();
        let ClientTarget { name, ecosystem, endpoints, keys } = self;
        let ecosystem = ecosystem.map(Arc::new);
        let settings =
            ecosystem.as_ref().map(|ecosystem| ecosystem.settings.clone()).unwrap_or_default();
        let rights = ecosystem.as_ref().filter(|_| keys.is_some());
        let rights = rights.map(|ecosystem| ecosystem.rights.clone());
        let wire = MessageTransport::Zenoh(Box::new(config));
        let node =
            DaemonNode::join(HostServices::default(), name.clone(), daemon, settings, rights, wire)
                .await
                .map_err(|error| error.to_string())?;
        let router = Arc::clone(node.router());
        Ok(ClientLink { node, view: EcosystemView { router, name, ecosystem, endpoints, keys } })
    }
}

/// Returns the configuration of a guest's Zenoh client session; `role` distinguishes the sessions
/// of one process.
pub(crate) fn guest_config(
    ecosystem: &EcosystemId,
    endpoints: &[String],
    keys: Option<&GuestKeys>,
    role: &str,
) -> Result<substrate_zenoh::Config, String> {
    let (daemon, security) = match keys {
        None => (DaemonId::new(&guest_name(role)).map_err(|error| error.to_string())?, None),
        Some(keys) => {
            let (daemon, security) = keys.security(role)?;
            (daemon, Some(security))
        }
    };
    let mut config = substrate_zenoh::Config::new(ecosystem.clone(), daemon);
    config.mode = substrate_zenoh::SessionMode::Client;
    config.connect = daemon_sockets::running_first(endpoints);
    config.security = security;
    Ok(config)
}

/// Returns the options with which the user named the ecosystem, as text to append to a suggested
/// command.
pub(crate) fn reach_words(reach: &ReachArgs) -> String {
    let ReachArgs { ecosystem, connect, key } = reach;
    let ecosystem = ecosystem.iter().map(|each| ("--ecosystem", each));
    let connect = connect.iter().map(|each| ("--connect", each));
    let key = key.iter().map(|each| ("--as", each));
    let words = ecosystem.chain(connect).chain(key);
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-:[]".contains(c);
    words
        .map(|(option, value)| match value.chars().all(is_plain) {
            true => format!(" {option} {value}"),
            false => format!(" {option} '{}'", value.replace('\'', "'\\''")),
        })
        .collect()
}

/// Returns a unique name for a guest, from its role, the host name and the process id.
pub(crate) fn guest_name(role: &str) -> String {
    let host = hosting::host_name();
    let host = host.as_ref().map_or("here", DaemonId::as_str);
    // The host name is cut. Processes on hosts with equal first letters rarely have equal ids.
    let host: String = host.chars().take(HOST_CHARS_MAX).collect();
    format!("{role}-{host}-{}", std::process::id())
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

/// Returns the only ecosystem that runs on this machine. Returns an error if there is none, or if
/// there are several.
fn only_running() -> Result<EcosystemId, String> {
    let mut running: Vec<_> = hosting::running_ecosystems()
        .into_iter()
        .filter(|name| {
            let folder = hosting::runtime_folder(name);
            let sockets = folder.map(|folder| hosting::daemon_sockets(&folder)).unwrap_or_default();
            sockets.iter().any(|path| daemon_sockets::is_listening(path))
        })
        .collect();
    match (running.pop(), running.is_empty()) {
        (Some(only), true) => Ok(only),
        (None, _) => Err("find a running ecosystem on this machine; start one with `althing up`, \
                          or say which with --ecosystem and --connect"
            .to_owned()),
        (Some(last), false) => {
            let others: Vec<_> = running.iter().map(|name| format!("`{name}`")).collect();
            Err(format!(
                "choose between the running ecosystems {} and `{last}`: say which with --ecosystem",
                others.join(", ")
            ))
        }
    }
}

/// Opens a link, runs `act` with it, and closes the link.
pub(super) fn with_link<F: Future<Output = (ClientLink, ExitCode)>>(
    reach: &ReachArgs,
    json: bool,
    act: impl FnOnce(ClientLink) -> F,
) -> ExitCode {
    let target = match ClientTarget::find(reach) {
        Ok(target) => target,
        Err(problem) => return unavailable(&problem, json),
    };
    let turn = match target.turn() {
        Ok(turn) => turn,
        Err(problem) => return unavailable(&problem, json),
    };
    super::in_runtime(async move {
        match target.link().await {
            Ok(link) => {
                link.view.directory(None).await;
                drop(turn);
                let (link, code) = act(link).await;
                link.node.drain().await;
                code
            }
            Err(problem) => unavailable(&problem, json),
        }
    })
}

/// Opens a link, prints a view of the ecosystem as JSON or for people, and closes the link.
pub(super) fn with_view(
    args: &AskArgs,
    print: impl AsyncFnOnce(&EcosystemView, bool) -> ExitCode,
) -> ExitCode {
    let json = args.print.json;
    with_link(&args.reach, json, async |link| {
        let code = print(&link.view, json).await;
        (link, code)
    })
}

/// Reports that the ecosystem or an agent could not be reached, and returns the exit code.
pub(crate) fn unavailable(problem: &str, json: bool) -> ExitCode {
    if json {
        let problem = format!("failed to {problem}");
        let value = serde_json::json!({ "status": "unavailable", "problem": problem });
        return output::print_json(&value, exit::UNAVAILABLE);
    }
    output::print_note(&format!("error: failed to {problem}"));
    exit::with(exit::UNAVAILABLE)
}
