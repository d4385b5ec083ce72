//! Starts a package's program once, as a daemon would, to see whether it works: `althing plugin check`.
//!
//! The program is confined as it will be, joins an endpoint of its own, and is let in as a daemon lets it
//! in; but the ecosystem it joins has no one else in it.

use std::collections::BTreeMap;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use acl::{AgentId, DaemonId, EcosystemId};
use agent::{Host, Landing, Machine, Switchboard};
use substrate::memory::Network;
use tokio::time::Instant;
use tokio_util::sync::CancellationToken;
use tokio_util::task::TaskTracker;

use crate::advice::advice;
use crate::endpoint::{Endpoint, Purpose};
use crate::launching::{Start, Started, Ward, described, hello};
use crate::log::Log;
use crate::package::Package;
use crate::process::{Launcher, Process, ending};
use crate::program::Program;
use crate::supervision::WantedAgent;

/// How long a program without agents of its own has to live.
const LIVES_FOR: Duration = Duration::from_secs(2);

/// What is tried.
pub struct Trial {
    /// The package; its folder is absolute.
    pub package: Package,
    /// This daemon's own program.
    pub launcher: Launcher,
    /// The words and the map that it is told.
    pub host: Host,
    /// Whether it runs only where nothing of its confinement is missing.
    pub requires_confinement: bool,
}

/// A trial that went well.
#[derive(Clone, Debug, PartialEq)]
pub struct Worked {
    /// What was really executed.
    pub program: PathBuf,
    /// How long it took until all its agents were here.
    pub took: Duration,
    /// Its agents.
    pub agents: Vec<AgentId>,
    /// What could not be kept from it here, each in a sentence.
    pub not_enforced: Vec<String>,
}

/// A trial that did not.
#[derive(Clone, Debug, PartialEq)]
pub struct Failed {
    /// Why, for a person.
    pub why: String,
    /// What can be done about it.
    pub advice: Option<String>,
}

/// A folder that is removed with all that is in it.
struct Folder(PathBuf);

/// What a trial stands on.
struct Stage {
    package: Arc<Package>,
    program: Program,
    wanted: Vec<WantedAgent>,
    landing: Landing,
    /// The wire of an ecosystem that has nobody else in it; closed when it is dropped.
    _network: Network,
    folder: Folder,
    log: Log,
    requires_confinement: bool,
}

impl Trial {
    /// Starts the program, waits until its agents are here, and ends it.
    ///
    /// # Errors
    ///
    /// If it does not start, ends by itself, or is not ready in time.
    pub async fn run(self) -> Result<Worked, Failed> {
        let without = |why: String| Failed { why, advice: None };
        let Trial { package, launcher, host, requires_confinement } = self;
        let program = package.program().await.map_err(without)?;
        let folder = Folder::new().map_err(|error| without(format!("failed to begin: {error}")))?;
        let log = Log::new(&package.manifest.name, folder.0.join("log"));
        let wanted = package.manifest.agents.iter().map(|own| WantedAgent {
            name: own.name.clone(),
            plugin: package.manifest.name.clone(),
            driver: own.driver.clone(),
            config: own.config.clone(),
        });
        let wanted = wanted.collect();
        let network = Network::new();
        let (package, landing) = (Arc::new(package), landing(host, &network));
        let stage = Stage {
            package,
            program,
            wanted,
            landing,
            _network: network,
            folder,
            log,
            requires_confinement,
        };
        let outcome = stage.play(&launcher).await;
        stage.landing.stopping.cancel();
        outcome.map_err(|why| {
            let advice = advice(&why, &stage.program.file, &stage.package.folder);
            Failed { why, advice }
        })
    }
}

impl Stage {
    async fn play(&self, launcher: &Launcher) -> Result<Worked, String> {
        let Stage { package, program, landing, log, .. } = self;
        let (mut told, mut models) = (Vec::new(), BTreeMap::new());
        for agent in &self.wanted {
            let (hello, model) = described(package, agent)?;
            told.push(hello);
            models.insert(agent.name.clone(), model.map(Arc::new));
        }
        let purpose = Purpose {
            ecosystem: landing.switchboard.ecosystem(),
            daemon: landing.switchboard.daemon(),
            settings: &landing.host.settings,
            socket: &self.folder.0.join("socket"),
            package,
            agents: models,
            landing,
        };
        let opened = Endpoint::open(purpose).await;
        let endpoint = opened.map_err(|error| format!("failed to {error}"))?;
        let data = self.folder.0.join("home");
        let ward = Ward::find(launcher, &self.folder.0, &[]).await;
        let not_enforced = ward.plan(&package.manifest.permissions).lacks();
        if let Some(why) = not_confined(self.requires_confinement, &not_enforced) {
            return Err(why);
        }
        let sockets = vec![endpoint.socket.clone()];
        let start = Start { launcher, ward: &ward, package, program, sockets, data: &data, log };
        let Started { mut process, counted: _counted } = start.begin().await?;
        let began = Instant::now();
        let hello = hello(package, landing, &endpoint, &told, None);
        let outcome = match process.say(&hello).await {
            Ok(()) => self.ready(&mut process, &endpoint).await,
            // How it ended says more than that it does not listen.
            Err(_) => Err(self.with_last_words(ending(process.ended().await))),
        };
        let took = began.elapsed();
        process.stop().await;
        endpoint.close().await;
        let agents = outcome?;
        Ok(Worked { program: program.file.clone(), took, agents, not_enforced })
    }

    /// Waits until all that it is to bring is here.
    async fn ready(
        &self,
        process: &mut Process,
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
                return Err(format!("`{agent}` is not let in: {why}"));
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
                        "`{}` was not here within {within:?}",
                        agent.name
                    ))),
                    None if waits_for_agents => Err(self.with_last_words(format!(
                        "none of its agents was here within {within:?}"
                    ))),
                    None => Ok(Vec::new()),
                },
            }
        }
    }

    fn with_last_words(&self, why: String) -> String {
        match self.log.last_words() {
            Some(words) => format!("{why}: {words}"),
            None => why,
        }
    }
}

/// Why a plugin does not run that may only run fully confined, if it may and is not.
pub(crate) fn not_confined(is_required: bool, lacks: &[String]) -> Option<String> {
    (is_required && !lacks.is_empty())
        .then(|| format!("`confinement = \"require\"`, and here {}", lacks.join("; ")))
}

/// A daemon of an ecosystem that has no other.
fn landing(host: Host, network: &Network) -> Landing {
    let ecosystem = EcosystemId::new("trial").expect("invariant: it is a name");
    let daemon = DaemonId::new("trial").expect("invariant: it is a name");
    let machine = Machine::new(None);
    let switchboard = Switchboard::on(machine, ecosystem, daemon.clone(), host.settings.clone());
    let inbound = Arc::<Switchboard>::clone(&switchboard);
    switchboard.connect(network.open(daemon, inbound));
    Landing {
        switchboard,
        host: Arc::new(host),
        stopping: CancellationToken::new(),
        tasks: TaskTracker::new(),
        tells_way: false,
    }
}

impl Folder {
    /// Makes one that only this user can enter, and that was not there before.
    fn new() -> io::Result<Folder> {
        let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
        let name = format!("althing-{}-{:x}", std::process::id(), now.as_nanos());
        let folder = std::env::temp_dir().join(name);
        DirBuilder::new().mode(0o700).create(&folder)?;
        Ok(Folder(folder.canonicalize()?))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(Path::new(&self.0));
    }
}
