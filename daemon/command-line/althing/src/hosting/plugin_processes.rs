//! The plugins of this daemon that run as processes: the folders that they need, and how a process
//! of this program becomes such a plugin.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt as _;
use std::path::PathBuf;
use std::process::ExitCode;

use plugin_host::{
    Confinement, FolderOwner, HostSettings, LAUNCH, Launcher, PROBE, PackageStore,
    PackageStoreError, WantedAgent, probe,
};
use terminal::{exit, output};

use super::folders::service_owner;
use super::{DaemonNode, plugins_folder};
use crate::config::{AgentEntry, Ecosystem};

/// Path of the running program; it is correct even if the file from which the program was started
/// has been replaced.
pub(crate) const ITSELF: &str = "/proc/self/exe";

/// The arguments of [`DaemonNode::host_processes`].
pub(crate) struct PluginProcesses<'p> {
    pub(crate) ecosystem: &'p Ecosystem,
    /// Entries of the agents that the daemon hosts.
    pub(crate) agents: &'p [AgentEntry],
    /// The folder with the sockets of this machine's daemons.
    pub(crate) runtime: PathBuf,
    /// The folder in which the daemon stores its state.
    pub(crate) state: PathBuf,
    /// The socket of the simulated building; `None` if there is none.
    pub(crate) building: Option<PathBuf>,
}

impl DaemonNode {
    /// Starts to host the plugins of this machine that run as processes, and continues in tasks.
    ///
    /// # Errors
    ///
    /// Returns an error message for the user if one of the daemon's folders cannot be created.
    pub(crate) fn host_processes(&self, processes: PluginProcesses<'_>) -> Result<(), String> {
        let PluginProcesses { ecosystem, agents, runtime, state, building } = processes;
        let Some(spawner) = self.spawner() else { return Ok(()) };
        let Some(admissions) = spawner.host.resources.get() else { return Ok(()) };
        let folder = plugins_folder(ecosystem.plugins.folder.as_deref());
        let shelf = PackageStore::new(folder);
        // The folder is created at start, so that packages can be installed into it.
        match shelf.make() {
            Err(error @ PackageStoreError::Writable { .. }) => {
                tracing::error!("failed to {error}; no plugin runs until this is mended");
            }
            Err(error) => tracing::info!("no folder for plugins: failed to {error}"),
            Ok(()) => (),
        }
        let private = [Some(runtime.clone()), Some(state.clone()), Some(shelf.folder.clone())];
        let keys = ecosystem.security.as_ref().map(|security| security.folder.clone());
        let mut wanted: BTreeMap<String, Vec<WantedAgent>> = BTreeMap::new();
        for entry in agents {
            let Some(package) = entry.package.clone() else { continue };
            let (name, plugin) = (entry.name.clone(), entry.plugin.clone());
            let (driver, config) = (entry.driver.clone(), (*entry.config).clone());
            wanted.entry(package).or_default().push(WantedAgent { name, plugin, driver, config });
        }
        let daemon = self.router().daemon();
        let setting = HostSettings {
            packages: shelf,
            spawner,
            agents: wanted,
            named: ecosystem.agents.iter().map(|entry| entry.name.clone()).collect(),
            admissions,
            launcher: Launcher(PathBuf::from(ITSELF)),
            sockets: runtime.join(format!("{daemon}.plugins")),
            state: state.join("plugins"),
            building,
            requires_confinement: ecosystem.plugins.requires_confinement,
            private: private.into_iter().chain([keys]).flatten().collect(),
        };
        plugin_host::host(setting).map_err(|error| format!("host plugins: {error}"))
    }
}

/// Returns the packages in `folder` for a command. What a command of root makes in the folder of the
/// packaged daemon belongs to that daemon's user.
pub(crate) fn packages_in(folder: PathBuf) -> PackageStore {
    let owner = service_owner(&folder).map(|(user, group)| FolderOwner { user, group });
    PackageStore::new(folder).owned_by(owner)
}

/// Turns this process into a plugin if it was started as `become-plugin CONFINEMENT PROGRAM
/// ARGUMENTS`. If it was started as `become-plugin probe FOLDER`, tests instead which parts of the
/// confinement work on this machine. Only daemons use these arguments, never users. Returns `None`
/// if the process has other arguments. Returns an exit code after the test, or if the plugin's
/// program cannot be run.
pub(crate) fn become_plugin() -> Option<ExitCode> {
    let mut arguments = std::env::args_os().skip(1);
    if arguments.next().as_deref() != Some(LAUNCH.as_ref()) {
        return None;
    }
    let confinement = arguments.next().map(OsString::into_vec).unwrap_or_default();
    if confinement == PROBE.as_bytes() {
        let folder = PathBuf::from(arguments.next().unwrap_or_default());
        return Some(output::print(probe(&folder), exit::DONE));
    }
    let problem = match serde_json::from_slice::<Confinement>(&confinement) {
        Ok(confinement) => {
            let program = PathBuf::from(arguments.next().unwrap_or_default());
            let arguments: Vec<_> =
                arguments.map(|argument| argument.to_string_lossy().into_owned()).collect();
            confinement.become_program(&program, &arguments)
        }
        Err(error) => format!("failed to read the plugin's confinement: {error}"),
    };
    output::print_note(&problem);
    Some(exit::with(exit::UNAVAILABLE))
}
