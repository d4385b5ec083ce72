//! Hosts plugins that run as processes of their own (the paper, “Plug & Play”). A plugin is a
//! package: a folder in the plugin folder. Adding a package adds its agents to the ecosystem, and
//! removing a package removes them; the daemon is not restarted.
//!
//! - `manifest` and `package` read and check a package. `package_store` is the plugin folder, and
//!   `placing` changes files in it.
//! - `supervision` starts, restarts and stops one plugin. `restart_policy` decides when to restart
//!   the plugin's process, and `process_health` decides when to end the process.
//! - `program` finds the program that a package really runs, `launching` starts the program, and
//!   `process` is the running process. `trial` starts a package once, for `althing plugin check`.
//! - `rights` is what a plugin may use of its machine. `confinement` restricts a plugin's process.
//!   `mediator` answers the system calls that the kernel alone cannot decide. `usage` measures the
//!   resources that a plugin takes. `log` keeps the output of a plugin.
//! - `endpoint` is the socket that a plugin connects to, on a substrate that the plugin shares with
//!   its host only. On this substrate, an `agent::Observer` watches the plugin's agents, and the
//!   `plugin_client` forwards requests to them. `proxy` is the proxy agent that represents each
//!   agent of a plugin in the ecosystem. A proxy agent is an actuator; its planner and its domain
//!   run in this daemon.
//! - `status` is the state of all plugins, for users.
//!
//! A plugin uses the protocol of actuators (docs/protocol.md), but only with its host. Its messages
//! reach the ecosystem only through the proxy agents.

mod advice;
mod buffers;
mod cgroup;
mod confinement;
mod desired_state;
mod endpoint;
mod launching;
mod log;
mod manifest;
mod mediator;
mod package;
mod package_store;
mod placing;
mod plugin_client;
mod process;
mod process_health;
mod program;
mod proxy;
mod resource_sampling;
mod restart_policy;
mod rights;
mod status;
mod supervision;
mod template;
mod trial;
mod usage;
mod wording;

use std::collections::{BTreeMap, BTreeSet};
use std::fs::DirBuilder;
use std::os::unix::fs::DirBuilderExt as _;
use std::path::PathBuf;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use acl::AgentId;
use acl::content::Discovered;
use agent::{AdmissionStatus, Admissions, Spawner};
use notify::{RecursiveMode, Watcher as _};
use tokio::sync::{Notify, watch};
use tokio::time::Instant;

pub use confinement::{Confinement, ConfinementError, ConfinementMeans, probe};
pub use desired_state::WantedAgent;
pub use manifest::{ConfigKey, ConfigShape, OwnAgent, PackageManifest};
pub use package::{MANIFEST, Package, PackageFaults};
pub use package_store::{PackageStore, PackageStoreError};
pub use placing::FolderOwner;
pub use process::Launcher;
pub use rights::{Permissions, Right, listed};
pub use status::{ConfinementStatus, PluginList, PluginState, PluginStatus};
pub use trial::{Trial, TrialFailure, TrialSuccess};

use desired_state::{DesiredPlugin, DesiredState};
use launching::MachineConfinement;
use log::PluginLog;
use package::{Stamp, stamp};
use supervision::{PluginSupervisor, Statuses};

/// First argument with which this daemon's own program is started in order to become the program of
/// a plugin. The next arguments are a [`Confinement`] in JSON, the plugin's program, and the
/// arguments of that program.
pub const LAUNCH: &str = "become-plugin";

/// Argument after [`LAUNCH`] that makes the process try out the means of confinement that the
/// kernel offers. The argument after this one is the path of any folder that exists.
pub const PROBE: &str = "probe";

/// Name of this crate as a source of discovered agents. The name distinguishes the agents of
/// packages from those of other sources.
const PLUGINS: &str = "plugins";

/// Time without further changes after which the plugin folder is checked. The pause is needed
/// because a package is copied file by file.
const QUIET_TIME: Duration = Duration::from_millis(60);

/// Interval between checks of the plugin folder in the first [`CHECK_INTERVAL_LONG`] after a
/// change. The short interval is needed because the kernel reports changes in a new subfolder only
/// once that subfolder is watched; files that were written before are not reported.
const CHECK_INTERVAL_SHORT: Duration = Duration::from_millis(250);

/// Interval between checks of the plugin folder when its last change is longer ago than this
/// interval.
const CHECK_INTERVAL_LONG: Duration = Duration::from_secs(5);

/// Settings and environment for hosting plugins.
pub struct HostSettings {
    /// The plugin folder, with the packages.
    pub packages: PackageStore,
    /// The ecosystem that the proxy agents join.
    pub spawner: Spawner,
    /// Agents that the ecosystem file assigns to this daemon, by the name of the package that has
    /// to bring them.
    pub agents: BTreeMap<String, Vec<WantedAgent>>,
    /// Names of all agents in the ecosystem file, on any daemon.
    pub named: BTreeSet<AgentId>,
    /// Decisions on which agents may join although the ecosystem file does not name them.
    pub admissions: Arc<Admissions>,
    /// This daemon's own program, which is started to become the program of a plugin.
    pub launcher: Launcher,
    /// Folder for the sockets of the endpoints that plugins connect to.
    pub sockets: PathBuf,
    /// Folder with the data folder and the log of each plugin.
    pub state: PathBuf,
    /// Path of the socket of the simulated building; `None` if there is no simulated building.
    pub building: Option<PathBuf>,
    /// Whether a plugin runs only if all of its confinement can be enforced.
    pub requires_confinement: bool,
    /// Folders that no plugin may read, regardless of its rights: those with keys, sockets and the
    /// data of daemons.
    pub private: Vec<PathBuf>,
}

/// State that the supervisions of all plugins share.
pub(crate) struct HostContext {
    pub(crate) packages: PackageStore,
    pub(crate) spawner: Spawner,
    pub(crate) launcher: Launcher,
    pub(crate) sockets: PathBuf,
    pub(crate) data: PathBuf,
    pub(crate) building: Option<PathBuf>,
    requires_confinement: bool,
    private: Vec<PathBuf>,
    /// Means of confinement on this machine; set before the first plugin is started.
    machine_confinement: OnceLock<MachineConfinement>,
    /// Notified when the plugin folder is to be checked again.
    pub(crate) check_again: Notify,
}

/// Placeholder for the means of confinement until they are determined.
static UNKNOWN: LazyLock<MachineConfinement> = LazyLock::new(MachineConfinement::unknown);

impl HostContext {
    /// Returns the means of confinement on this machine; [`MachineConfinement::unknown`] until they
    /// are determined.
    pub(crate) fn machine_confinement(&self) -> &MachineConfinement {
        self.machine_confinement.get().unwrap_or(&UNKNOWN)
    }

    /// Returns the confinement that this machine can enforce, for users. Until the means of
    /// confinement are determined, only `is_required` is set.
    fn confined(&self) -> ConfinementStatus {
        let is_required = self.requires_confinement;
        let Some(ward) = self.machine_confinement.get() else {
            return ConfinementStatus { is_required, ..ConfinementStatus::default() };
        };
        ConfinementStatus {
            not_enforced: ward.plan(&Permissions::default()).lacks(),
            limits: ward.limits(),
            is_required,
            means: Some(ward.means.clone()),
        }
    }
}

/// Starts to host plugins. Hosting ends when the daemon shuts down.
///
/// # Errors
///
/// Returns an error if the folder for sockets or the folder for data cannot be created.
pub fn host(setting: HostSettings) -> std::io::Result<()> {
    let HostSettings {
        packages: package_store,
        spawner,
        agents,
        named,
        admissions,
        launcher,
        sockets,
        state,
        ..
    } = setting;
    let HostSettings { building, requires_confinement, private, .. } = setting;
    for folder in [&sockets, &state] {
        DirBuilder::new().recursive(true).mode(0o700).create(folder)?;
    }
    // A service manager may have replaced these folders by symbolic links. The paths of open files
    // and of rights are compared with them, so the real paths are needed.
    let (sockets, state) = (sockets.canonicalize()?, state.canonicalize()?);
    // A folder that does not exist yet keeps its path, because there is no link to resolve.
    let real = |folder: PathBuf| folder.canonicalize().unwrap_or(folder);
    let private = private.into_iter().map(real).collect();
    let ground = Arc::new(HostContext {
        packages: package_store,
        spawner,
        launcher,
        sockets,
        data: state,
        building,
        requires_confinement,
        private,
        machine_confinement: OnceLock::new(),
        check_again: Notify::new(),
    });
    let statuses = Statuses::default();
    // The reference is weak, because the context owns the message router, which keeps this closure.
    let (told_of, told_ground) = (Arc::clone(&statuses), Arc::downgrade(&ground));
    ground.spawner.router.tell_plugins(move || {
        told_ground.upgrade().map(|ground| status_json(&ground, &told_of)).unwrap_or_default()
    });
    let keeper = PluginReconciler {
        context: Arc::clone(&ground),
        agents,
        named,
        admissions,
        statuses,
        managed: BTreeMap::new(),
    };
    ground.spawner.tasks.spawn(keeper.run());
    Ok(())
}

fn status_json(ground: &HostContext, statuses: &Statuses) -> String {
    let plugins = PluginList {
        daemon: ground.spawner.router.daemon().clone(),
        folder: ground.packages.folder.display().to_string(),
        confinement: ground.confined(),
        plugins: statuses
            .lock()
            .unwrap_or_else(PoisonError::into_inner)
            .values()
            .cloned()
            .collect(),
    };
    serde_json::to_string(&plugins).unwrap_or_default()
}

/// Compares the packages in the plugin folder with the plugins that run, and starts or stops
/// plugins accordingly.
struct PluginReconciler {
    context: Arc<HostContext>,
    agents: BTreeMap<String, Vec<WantedAgent>>,
    named: BTreeSet<AgentId>,
    admissions: Arc<Admissions>,
    statuses: Statuses,
    managed: BTreeMap<String, ManagedPlugin>,
}

/// One plugin as it was at the last check of the plugin folder, and its desired state.
struct ManagedPlugin {
    /// The package; `None` if it was removed, and the supervision has not ended yet.
    snapshot: Option<PackageSnapshot>,
    /// Desired state, which the supervision of the plugin receives until it ends.
    desired_state: watch::Sender<DesiredState>,
}

/// Properties of a package that decide whether its plugin runs.
#[derive(PartialEq)]
struct PackageSnapshot {
    stamp: Stamp,
    is_disabled: bool,
    /// Rights that a person has allowed, or the reason why they cannot be read.
    allowed: Result<Vec<Right>, String>,
    admission: AdmissionStatus,
    /// Reason why another user could have changed the package; `None` if only this user can change
    /// it.
    writable: Option<String>,
}

impl PluginReconciler {
    async fn run(mut self) {
        self.find_means().await;
        let touched = Arc::new(FolderChanges::default());
        let _watcher = self.watch(&touched);
        let stopping = self.context.spawner.stopping.clone();
        let mut admitted = self.admissions.changes();
        let mut stirred = Instant::now();
        loop {
            self.reconcile(&touched.take());
            let is_fresh = stirred.elapsed() < CHECK_INTERVAL_LONG;
            tokio::select! {
                biased;
                () = stopping.cancelled() => return,
                () = self.context.check_again.notified() => (),
                Ok(()) = admitted.changed() => (),
                () = touched.wait_until_quiet() => stirred = Instant::now(),
                () = tokio::time::sleep(if is_fresh { CHECK_INTERVAL_SHORT } else { CHECK_INTERVAL_LONG }) => (),
            }
        }
    }

    /// Determines how plugins can be confined on this machine, and logs the result.
    async fn find_means(&self) {
        let HostContext {
            launcher,
            data,
            machine_confinement: ward,
            packages: package_store,
            private,
            ..
        } = &*self.context;
        let kept = package_store.allow_rights_in_use(|name| data.join(name).is_dir());
        for error in [package_store.put_back_missing(), kept].into_iter().filter_map(Result::err) {
            tracing::warn!("failed to {error}");
        }
        let found = MachineConfinement::find(launcher, data, private).await;
        let lacks = found.plan(&Permissions::default()).lacks();
        match lacks.is_empty() {
            true => {
                tracing::info!(limits = found.limits(), "plugins are fully confined")
            }
            false => tracing::warn!(
                limits = found.limits(),
                "plugins are not fully confined on this machine; for each plugin: {}",
                lacks.join("; ")
            ),
        }
        // `set` cannot fail, because no other task sets the value.
        let _ = ward.set(found);
    }

    /// Watches the plugin folder for changes. Returns `None` if the kernel cannot watch the folder;
    /// then the folder is only checked periodically.
    fn watch(&self, touched: &Arc<FolderChanges>) -> Option<notify::RecommendedWatcher> {
        let folder = self.context.packages.folder.clone();
        let touched = Arc::clone(touched);
        let heard = {
            let folder = folder.clone();
            move |event: notify::Result<notify::Event>| {
                if let Ok(event) = event {
                    touched.note(&folder, &event);
                }
            }
        };
        let watched = notify::recommended_watcher(heard).and_then(|mut watcher| {
            watcher.watch(&folder, RecursiveMode::Recursive)?;
            Ok(watcher)
        });
        match watched {
            Ok(watcher) => Some(watcher),
            Err(error) => {
                let folder = folder.display();
                tracing::info!(
                    %folder,
                    %error,
                    "the folder of plugins cannot be watched; it is checked periodically"
                );
                None
            }
        }
    }

    /// Checks the plugin folder and updates the desired state of each plugin. `touched` holds the
    /// plugins with a changed marker file: their supervisions are notified even if nothing else has
    /// changed.
    fn reconcile(&mut self, touched: &BTreeSet<String>) {
        let mut names: BTreeSet<_> = self.context.packages.names().into_iter().collect();
        names.extend(self.agents.keys().cloned());
        // The supervision of a package that was removed is kept until its process has ended: a
        // second one would need the same socket, log and control group.
        self.managed.retain(|_, kept| !kept.desired_state.is_closed());
        for (_, kept) in self.managed.iter_mut().filter(|(name, _)| !names.contains(*name)) {
            if kept.snapshot.take().is_some() {
                kept.desired_state.send_replace(DesiredState::Removed);
            }
        }
        let (mut discovered, mut applicants) = (Vec::new(), BTreeMap::new());
        for name in names {
            let looked = self.snapshot_of(&name);
            let package = Package::open(&self.context.packages.package_folder(&name));
            if let Some(about) = self.application(&name, package.as_ref().ok(), looked.is_disabled)
            {
                applicants.insert(name.clone(), about);
            }
            let wish = self.desired_state(&name, package, &looked, &mut discovered);
            match self.managed.get_mut(&name) {
                Some(kept)
                    if kept.snapshot.as_ref() == Some(&looked) && !touched.contains(&name) => {}
                Some(kept) => {
                    kept.snapshot = Some(looked);
                    kept.desired_state.send_replace(wish);
                }
                None => {
                    let wish = self.start_supervisor(&name, wish);
                    let snapshot = Some(looked);
                    self.managed.insert(name, ManagedPlugin { snapshot, desired_state: wish });
                }
            }
        }
        self.admissions.present(PLUGINS, applicants);
        self.context.spawner.router.discovered(PLUGINS, discovered);
    }

    fn snapshot_of(&self, name: &str) -> PackageSnapshot {
        let package_store = &self.context.packages;
        let writers =
            package_store.check_writers().and_then(|()| package_store.check_writers_of(name));
        PackageSnapshot {
            stamp: stamp(&package_store.package_folder(name)),
            is_disabled: package_store.is_disabled(name),
            allowed: package_store.allowed(name).map_err(|error| error.to_string()),
            admission: self.admissions.of(PLUGINS, name),
            writable: writers.err().map(|error| error.to_string()),
        }
    }

    /// Returns the text that asks a person to admit the agents of a package. Returns `None` if no
    /// admission is needed or the package brings no agents.
    fn application(
        &self,
        name: &str,
        package: Option<&Package>,
        is_disabled: bool,
    ) -> Option<String> {
        let manifest = &package?.manifest;
        let is_asked = self.admissions.of(PLUGINS, name) == AdmissionStatus::Asked;
        if is_disabled || !is_asked || self.agents.contains_key(name) {
            return None;
        }
        let own: Vec<_> = manifest.agents.iter().map(|own| own.name.as_str()).collect();
        if own.is_empty() && manifest.brings.is_empty() {
            return None;
        }
        let brings = if own.is_empty() { "agents of its own".to_owned() } else { own.join(", ") };
        Some(format!("a plugin, with {brings}"))
    }

    fn desired_state(
        &self,
        name: &str,
        package: Result<Package, PackageFaults>,
        looked: &PackageSnapshot,
        discovered: &mut Vec<Discovered>,
    ) -> DesiredState {
        let named = self.agents.get(name);
        let package = match package {
            Ok(package) => package,
            Err(faults) if self.context.packages.package_folder(name).exists() => {
                return DesiredState::Stopped(PluginState::Invalid, Some(faults.first()), None);
            }
            Err(_) => {
                let folder = self.context.packages.folder.display();
                let reason = format!("the ecosystem's file names it, and it is not in {folder}");
                return DesiredState::Stopped(PluginState::Invalid, Some(reason), None);
            }
        };
        let PackageSnapshot { admission, is_disabled, .. } = looked;
        let joined = named.is_none() && *admission == AdmissionStatus::Granted && !is_disabled;
        let own = || package.manifest.agents.iter().filter(|own| !self.named.contains(&own.name));
        if named.is_none() {
            discovered.extend(own().map(|own| Discovered {
                agent: own.name.clone(),
                by: format!("plugin {name}"),
                joined,
                problem: admission.reason(),
                toml: entry(name, own),
            }));
        }
        if *is_disabled {
            return DesiredState::Stopped(PluginState::Disabled, None, Some(Arc::new(package)));
        }
        let agents: Vec<_> = match named {
            Some(named) => named.clone(),
            None if joined => own()
                .map(|own| WantedAgent {
                    name: own.name.clone(),
                    plugin: name.to_owned(),
                    driver: own.driver.clone(),
                    config: own.config.clone(),
                })
                .collect(),
            None => Vec::new(),
        };
        let brings = joined && !package.manifest.brings.is_empty();
        if agents.is_empty() && !brings {
            let reason = Some(unused_reason(&package, admission));
            return DesiredState::Stopped(PluginState::Unused, reason, Some(Arc::new(package)));
        }
        match self.refusal(&package, looked) {
            Some((state, why)) => DesiredState::Stopped(state, Some(why), Some(Arc::new(package))),
            None => {
                let (package, stamp) = (Arc::new(package), looked.stamp.clone());
                DesiredState::Run(Arc::new(DesiredPlugin { package, stamp, agents }))
            }
        }
    }

    /// Returns the resulting state of the plugin, and the reason, if a package must not run
    /// although the ecosystem needs its agents; `None` if the package may run.
    fn refusal(
        &self,
        package: &Package,
        looked: &PackageSnapshot,
    ) -> Option<(PluginState, String)> {
        let HostContext { requires_confinement, .. } = &*self.context;
        let (name, permissions) = (&package.manifest.name, &package.manifest.permissions);
        if let Some(problem) = &looked.writable {
            return Some((PluginState::Invalid, format!("failed to {problem}")));
        }
        let beyond = permissions.beyond(looked.allowed.as_deref().unwrap_or_default());
        if let (false, Err(problem)) = (beyond.is_empty(), &looked.allowed) {
            return Some((PluginState::Invalid, format!("failed to {problem}")));
        }
        if !beyond.is_empty() {
            let asks = listed(&beyond);
            let why = format!(
                "it asks for {asks}, which is not allowed yet: althing plugin allow {name}"
            );
            return Some((PluginState::NotAllowed, why));
        }
        let lacks = self.context.machine_confinement().plan(permissions).lacks();
        let why = trial::not_confined(*requires_confinement, &lacks);
        why.map(|why| (PluginState::NotConfined, why))
    }

    fn start_supervisor(&self, name: &str, wish: DesiredState) -> watch::Sender<DesiredState> {
        let (wish, wishes) = watch::channel(wish);
        let path = self.context.data.join(format!("{name}.log"));
        let supervision = PluginSupervisor {
            name: name.to_owned(),
            context: Arc::clone(&self.context),
            desired_states: wishes,
            statuses: Arc::clone(&self.statuses),
            log: PluginLog::new(name, path),
            rolled_back: None,
        };
        let context = Arc::clone(&self.context);
        self.context.spawner.tasks.spawn(async move {
            supervision.run().await;
            // The package may have come back just when its supervision ended.
            context.check_again.notify_one();
        });
        wish
    }
}

/// Returns the entry for the ecosystem file that would configure the agent `own` of a package.
fn entry(package: &str, own: &OwnAgent) -> String {
    let mut text = format!("[[agent]]\nname = \"{}\"\npackage = \"{package}\"\n", own.name);
    if let Some(driver) = &own.driver {
        text += &format!("driver = \"{driver}\"\n");
    }
    if let Ok(config) = toml::to_string(&own.config)
        && !config.trim().is_empty()
    {
        text += &format!("\n[agent.config]\n{config}");
    }
    text
}

/// Plugins with a changed marker file since the last check of the plugin folder, and a notification
/// about any change in that folder.
#[derive(Default)]
struct FolderChanges {
    names: Mutex<BTreeSet<String>>,
    something: Notify,
}

impl FolderChanges {
    fn note(&self, folder: &std::path::Path, event: &notify::Event) {
        if event.kind.is_access() {
            return;
        }
        for path in &event.paths {
            let within = path.strip_prefix(folder).ok();
            let first = within.and_then(|within| within.components().next());
            let Some(name) = first.and_then(|first| first.as_os_str().to_str()) else { continue };
            // `.NAME.disabled` and `.NAME.rights` belong to the package NAME. Changes within a
            // package are detected from its files (`stamp`).
            if let Some((name, "disabled" | "rights")) =
                name.strip_prefix('.').and_then(|name| name.rsplit_once('.'))
            {
                self.lock().insert(name.to_owned());
            }
        }
        self.something.notify_one();
    }

    fn lock(&self) -> MutexGuard<'_, BTreeSet<String>> {
        self.names.lock().unwrap_or_else(PoisonError::into_inner)
    }

    fn take(&self) -> BTreeSet<String> {
        std::mem::take(&mut *self.lock())
    }

    /// Waits until the plugin folder changes, and then until there was no change for
    /// [`QUIET_TIME`].
    async fn wait_until_quiet(&self) {
        self.something.notified().await;
        while tokio::time::timeout(QUIET_TIME, self.something.notified()).await.is_ok() {}
    }
}

/// Returns the reason why no agent of a package runs, for a person.
fn unused_reason(package: &Package, admission: &AdmissionStatus) -> String {
    let has_agents = !package.manifest.agents.is_empty() || !package.manifest.brings.is_empty();
    match admission {
        AdmissionStatus::Listed if has_agents => {
            "its agents are listed and do not join: `admit = \"listed\"`".to_owned()
        }
        AdmissionStatus::Asked | AdmissionStatus::Denied if has_agents => {
            admission.reason().unwrap_or_default()
        }
        _ => "no [[agent]] of the ecosystem's file names it, and it brings none".to_owned(),
    }
}
