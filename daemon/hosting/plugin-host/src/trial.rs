//! Trial of a package: starts the program of the package once, as a daemon would, to check that it
//! works (`althing plugin check`).
//!
//! The program is confined as usual, and its agents are admitted as usual. The endpoint exists for
//! this trial only, and the ecosystem has no other agents.

use std::collections::BTreeMap;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{Host, HostServices, MessageRouter, Spawner};
use substrate::memory::Network;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::advice::advice;
use crate::desired_state::WantedAgent;
use crate::endpoint::{Endpoint, EndpointParameters};
use crate::launching::{MachineConfinement, ProcessStart, StartedProcess, described, hello};
use crate::log::PluginLog;
use crate::package::Package;
use crate::process::{Launcher, PluginProcess, ending};
use crate::program::ResolvedProgram;

/// Time for which a program without agents must keep running so that the trial succeeds.
const LIVES_FOR: Duration = Duration::from_secs(2);

/// Parameters of the trial of a package.
pub struct Trial {
    /// Package that is tried; the path of its folder is absolute.
    pub package: Package,
    /// Path of this daemon's own program, which is started to become the program of the plugin.
    pub launcher: Launcher,
    /// Domain, map and settings for the trial.
    pub host: Host,
    /// Whether the program is started only if all of its confinement can be enforced.
    pub requires_confinement: bool,
}

/// Result of a successful trial of a package.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialSuccess {
    /// File of the program that was executed.
    pub program: PathBuf,
    /// Time from the start of the program until all agents of the package were present.
    pub took: Duration,
    /// Agents of the package that were present.
    pub agents: Vec<AgentId>,
    /// Restrictions that could not be enforced on this machine, each as a sentence.
    pub not_enforced: Vec<String>,
}

/// Result of a failed trial of a package.
#[derive(Clone, Debug, PartialEq)]
pub struct TrialFailure {
    /// Reason why the trial failed, for a person.
    pub why: String,
    /// Advice on how a person can correct the failure; `None` if there is none.
    pub advice: Option<String>,
}

/// Temporary folder, which is removed with its contents on drop.
struct TemporaryFolder(PathBuf);

/// Environment of the trial of a package.
struct TrialEnvironment {
    package: Arc<Package>,
    program: ResolvedProgram,
    wanted: Vec<WantedAgent>,
    spawner: Spawner,
    /// Network of an ecosystem without other daemons, used only for the trial; closed on drop.
    _network: Network,
    folder: TemporaryFolder,
    log: PluginLog,
    requires_confinement: bool,
}

impl Trial {
    /// Starts the program of the package, waits until the package's agents are present, and ends
    /// the program.
    ///
    /// # Errors
    ///
    /// Returns the reason if the program does not start, ends by itself, or is not ready in time.
    pub async fn run(self) -> Result<TrialSuccess, TrialFailure> {
        let without = |why: String| TrialFailure { why, advice: None };
        let Trial { package, launcher, host, requires_confinement } = self;
        let program = package.program().await.map_err(without)?;
        let folder =
            TemporaryFolder::new().map_err(|error| without(format!("failed to begin: {error}")))?;
        let log = PluginLog::new(&package.manifest.name, folder.0.join("log"));
        let wanted = package.manifest.agents.iter().map(|own| WantedAgent {
            name: own.name.clone(),
            plugin: package.manifest.name.clone(),
            driver: own.driver.clone(),
            config: own.config.clone(),
        });
        let wanted = wanted.collect();
        let network = Network::new();
        let (package, spawner) = (Arc::new(package), spawner(host, &network));
        let stage = TrialEnvironment {
            package,
            program,
            wanted,
            spawner,
            _network: network,
            folder,
            log,
            requires_confinement,
        };
        let outcome = stage.play(&launcher).await;
        stage.spawner.stopping.cancel();
        outcome.map_err(|why| {
            let advice = advice(&why, &stage.program.file, &stage.package.folder);
            TrialFailure { why, advice }
        })
    }
}

impl TrialEnvironment {
    async fn play(&self, launcher: &Launcher) -> Result<TrialSuccess, String> {
        let TrialEnvironment { package, program, spawner, log, .. } = self;
        let (mut told, mut models) = (Vec::new(), BTreeMap::new());
        for agent in &self.wanted {
            let (hello, model) = described(package, agent)?;
            told.push(hello);
            models.insert(agent.name.clone(), model.map(Arc::new));
        }
        let purpose = EndpointParameters {
            ecosystem: spawner.router.ecosystem(),
            daemon: spawner.router.daemon(),
            settings: &spawner.host.settings,
            socket: &self.folder.0.join("socket"),
            package,
            agents: models,
            spawner,
        };
        let opened = Endpoint::open(purpose).await;
        let endpoint = opened.map_err(|error| format!("failed to {error}"))?;
        let data = self.folder.0.join("home");
        let ward = MachineConfinement::find(launcher, &self.folder.0, &[]).await;
        let not_enforced = ward.plan(&package.manifest.permissions).lacks();
        if let Some(why) = not_confined(self.requires_confinement, &not_enforced) {
            return Err(why);
        }
        let sockets = vec![endpoint.socket.clone()];
        let start = ProcessStart {
            launcher,
            machine_confinement: &ward,
            package,
            program,
            sockets,
            data: &data,
            log,
        };
        let StartedProcess { mut process, counted: _counted } = start.begin().await?;
        let began = Instant::now();
        let hello = hello(package, spawner, &endpoint, &told, None);
        let outcome = match process.say(&hello).await {
            Ok(()) => self.ready(&mut process, &endpoint).await,
            // The exit status explains the failure better than the error of writing.
            Err(_) => Err(self.with_last_words(ending(process.ended().await))),
        };
        let took = began.elapsed();
        process.stop().await;
        endpoint.close().await;
        let agents = outcome?;
        Ok(TrialSuccess { program: program.file.clone(), took, agents, not_enforced })
    }

    /// Waits until all agents that the package must bring are present, and returns them.
    async fn ready(
        &self,
        process: &mut PluginProcess,
        endpoint: &Endpoint,
    ) -> Result<Vec<AgentId>, String> {
        let manifest = &self.package.manifest;
        let mut accepted = endpoint.accepted.subscribe();
        let waits_for_agents = !self.wanted.is_empty() || !manifest.brings.is_empty();
        let within = if waits_for_agents { manifest.ready_within } else { LIVES_FOR };
        let deadline = Instant::now() + within;
        loop {
            let here = accepted.borrow_and_update().clone();
            if let Some((agent, why)) =
                here.iter().find_map(|(a, is)| Some((a, is.as_ref().err()?)))
            {
                return Err(format!("`{agent}` is rejected: {why}"));
            }
            let is_here = |wanted: &&WantedAgent| here.contains_key(&wanted.name);
            let missing = self.wanted.iter().find(|wanted| !is_here(wanted));
            if missing.is_none() && !here.is_empty() {
                return Ok(here.into_keys().collect());
            }
            tokio::select! {
                biased;
                status = process.ended() => return Err(self.with_last_words(ending(status))),
                Ok(()) = accepted.changed() => (),
                () = tokio::time::sleep_until(deadline) => return match missing {
                    Some(agent) => Err(self.with_last_words(format!(
                        "`{}` did not join within {within:?}",
                        agent.name
                    ))),
                    None if waits_for_agents => Err(self.with_last_words(format!(
                        "none of its agents joined within {within:?}"
                    ))),
                    None => Ok(Vec::new()),
                },
            }
        }
    }

    fn with_last_words(&self, why: String) -> String {
        match self.log.last_line() {
            Some(words) => format!("{why}: {words}"),
            None => why,
        }
    }
}

/// Returns the reason why a plugin that must be fully confined does not run; `None` if the plugin
/// may run. `lacks` are the restrictions that cannot be enforced.
pub(crate) fn not_confined(is_required: bool, lacks: &[String]) -> Option<String> {
    (is_required && !lacks.is_empty()).then(|| {
        format!("`confinement = \"require\"` is set, and on this machine {}", lacks.join("; "))
    })
}

/// Returns the daemon of an ecosystem without other daemons, which the agents of the trial join.
fn spawner(host: Host, network: &Network) -> Spawner {
    let ecosystem = EcosystemId::new("trial").expect("invariant: it is a name");
    let daemon = DaemonId::new("trial").expect("invariant: it is a name");
    let machine = HostServices::new(None);
    let router = MessageRouter::on(machine, ecosystem, daemon.clone(), host.settings.clone());
    let inbound = Arc::<MessageRouter>::clone(&router);
    router.connect(network.open(daemon, inbound));
    Spawner {
        router,
        host: Arc::new(host),
        stopping: CancellationToken::new(),
        tasks: TaskTracker::new(),
        records_via: false,
    }
}

impl TemporaryFolder {
    /// Creates a new temporary folder that only this user can enter.
    fn new() -> io::Result<TemporaryFolder> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let name = format!("althing-{}-{:x}", std::process::id(), now.as_nanos());
        let folder = std::env::temp_dir().join(name);
        DirBuilder::new().mode(0o700).create(&folder)?;
        Ok(TemporaryFolder(folder.canonicalize()?))
    }
}

impl Drop for TemporaryFolder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(Path::new(&self.0));
    }
}
