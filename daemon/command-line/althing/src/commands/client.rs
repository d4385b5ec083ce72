//! The link of a command to a running ecosystem: the command is a Zenoh client of one of the
//! ecosystem's daemons.

use std::future::Future;
use std::path::PathBuf;
use std::process::ExitCode;
use std::sync::Arc;

use acl::{DaemonId, EcosystemId};
use agent::HostServices;
use terminal::{exit, output};

use crate::cli::{AskArgs, ReachArgs};
use crate::commands::daemon_sockets;
use crate::commands::join_slots::{self, JoinSlot};
use crate::config::{self, Ecosystem, Overrides};
use crate::ecosystem_view::short_host_name;
pub(crate) use crate::ecosystem_view::{EcosystemView, guest_name};
use crate::hosting::{self, DaemonNode, GuestKeys, MessageTransport};
use crate::{plugins, speech};

/// A command's link to a running ecosystem.
pub(crate) struct ClientLink {
    pub(crate) node: DaemonNode,
    pub(crate) view: EcosystemView,
}

/// The ecosystem that a command addresses: its name, its definition, the endpoints of its daemons,
/// and the key to use.
#[derive(Clone)]
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
        let (name, ecosystem) = ClientTarget::choose(reach)?;
        ClientTarget::named(name, ecosystem, reach)
    }

    /// Chooses the ecosystem as [`ClientTarget::find`] does, and returns its name and definition,
    /// whether or not a daemon of it runs here.
    pub(super) fn choose(reach: &ReachArgs) -> Result<(EcosystemId, Option<Ecosystem>), String> {
        let file = match &reach.ecosystem {
            Some(asked) => match config::resolve_ecosystem(asked) {
                Ok(file) => Some(file),
                // A name without a file is enough, because the ecosystem's daemons may run here.
                Err(problem) => match EcosystemId::new(asked) {
                    Ok(name) => return Ok((name, None)),
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
                speech::learn(&ecosystem.words);
                Ok((ecosystem.name.clone(), Some(ecosystem)))
            }
            None => Ok((only_running()?, None)),
        }
    }

    /// Finds the daemons of the ecosystem `name`: those that the user names, or those that run on
    /// this machine. The error text completes the sentence “failed to …”.
    pub(super) fn named(
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
    pub(super) fn turn(&self) -> Result<Option<JoinSlot>, String> {
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
        None => (unsecured_guest(role)?, None),
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
    words.map(|(option, value)| format!(" {option} {}", shell_word(value))).collect()
}

/// Returns a text as one word of a shell's command line.
pub(super) fn shell_word(text: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "/._-:[]".contains(c);
    match !text.is_empty() && text.chars().all(is_plain) {
        true => text.to_owned(),
        false => format!("'{}'", text.replace('\'', "'\\''")),
    }
}

/// Returns the name of a guest's session with an ecosystem that is not secured. It has the form of
/// a guest's name in a secured one, so that nobody takes a command for a daemon.
fn unsecured_guest(role: &str) -> Result<DaemonId, String> {
    let host = DaemonId::new(&short_host_name()).map_err(|error| error.to_string())?;
    let role = format!("{role}-{}", std::process::id());
    host.guest(&role).map_err(|error| error.to_string())
}

/// Returns the ecosystems of which a daemon runs on this machine.
pub(super) fn running_here() -> Vec<EcosystemId> {
    let is_running = |name: &EcosystemId| {
        let folder = hosting::runtime_folder(name);
        let sockets = folder.map(|folder| hosting::daemon_sockets(&folder)).unwrap_or_default();
        sockets.iter().any(|path| daemon_sockets::is_listening(path))
    };
    hosting::running_ecosystems().into_iter().filter(is_running).collect()
}

/// Returns the only ecosystem that runs on this machine. Returns an error if there is none, or if
/// there are several.
fn only_running() -> Result<EcosystemId, String> {
    let mut running = running_here();
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

/// Opens a link for one question, and closes it again. The error text is for a person.
pub(super) fn ask_once<T>(
    target: ClientTarget,
    ask: impl AsyncFnOnce(&EcosystemView) -> Result<T, String>,
) -> Result<T, String> {
    let turn = target.turn()?;
    let mut answer = Err("the program could not start its threads".to_owned());
    super::in_runtime(async {
        answer = match target.link().await {
            Ok(link) => {
                link.view.directory(None).await;
                drop(turn);
                let answer = ask(&link.view).await;
                link.node.drain().await;
                answer
            }
            Err(problem) => Err(format!("failed to {problem}")),
        };
        exit::with(exit::DONE)
    });
    answer
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
