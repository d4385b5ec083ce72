//! Starts the process of a package: determines the confinement, the environment, and the first line
//! of input of the process. Used by the supervision in a daemon and by the trial of `althing plugin
//! check`.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::DirBuilder;
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _};
use std::path::{Path, PathBuf};

use acl::{DaemonId, Hello, HelloAgent, Millis, SCHEMA_VERSION};
use agent::Spawner;
use pddl::ActionModel;

use crate::cgroup::{CgroupTree, PluginCgroup};
use crate::confinement::{Confinement, ConfinementMeans, ConfinementPlan, ProcessLimits};
use crate::desired_state::WantedAgent;
use crate::endpoint::Endpoint;
use crate::log::PluginLog;
use crate::package::Package;
use crate::process::{Launcher, PluginProcess, ProcessLaunch};
use crate::program::{self, ResolvedProgram};
use crate::rights::{Permissions, device_objection, read_objection};

/// Bytes that are added to the memory limit of a plugin to get the limit that the kernel enforces
/// for each process. The kernel's limit also counts libraries and unused stacks of threads.
const ADDRESSES: u64 = 1 << 30;

/// Folders with programs of the system. They are added to the `PATH` of a plugin even if the
/// daemon's `PATH` does not contain them.
const SYSTEM_PATH: [&str; 3] = ["/usr/local/bin", "/usr/bin", "/bin"];

/// Number of threads that are added to the thread limit of a plugin for each process that the
/// plugin may have.
const THREADS_PER_PROCESS: u64 = 4;
/// Base of the thread limit of a plugin. A process with an interpreter and Zenoh has a dozen
/// threads.
const THREADS: u64 = 64;

/// Means of confinement on this machine.
#[derive(Clone, Debug)]
pub(crate) struct MachineConfinement {
    pub(crate) means: ConfinementMeans,
    /// The part of the tree of control groups that was delegated to this daemon, or the reason why
    /// no part was delegated.
    pub(crate) tree: Result<CgroupTree, String>,
    /// Folders that no plugin may read.
    pub(crate) private: Vec<PathBuf>,
}

/// Parameters of a plugin's process that is to be started.
pub(crate) struct ProcessStart<'s> {
    pub(crate) launcher: &'s Launcher,
    pub(crate) machine_confinement: &'s MachineConfinement,
    pub(crate) package: &'s Package,
    pub(crate) program: &'s ResolvedProgram,
    /// Sockets that the process may connect to.
    pub(crate) sockets: Vec<PathBuf>,
    /// Data folder of the plugin; created if it does not exist.
    pub(crate) data: &'s Path,
    pub(crate) log: &'s PluginLog,
}

/// Running process of a plugin, together with the plugin's control group if there is one.
pub(crate) struct StartedProcess {
    pub(crate) process: PluginProcess,
    pub(crate) counted: Option<PluginCgroup>,
}

impl MachineConfinement {
    /// Determines the means of confinement of this machine. `folder` is any folder that exists.
    pub(crate) async fn find(
        launcher: &Launcher,
        folder: &Path,
        private: &[PathBuf],
    ) -> MachineConfinement {
        // The groups come first: otherwise the process that tries out the other means would be in
        // the daemon's group, and the group could not be divided.
        let tree = CgroupTree::find();
        MachineConfinement { means: launcher.means(folder).await, tree, private: private.to_vec() }
    }

    /// Returns the placeholder that is used until the means of confinement are determined. The
    /// placeholder offers no means.
    pub(crate) fn unknown() -> MachineConfinement {
        let why = "this machine has not been checked yet";
        MachineConfinement {
            means: ConfinementMeans::none(why),
            tree: Err(why.to_owned()),
            private: Vec::new(),
        }
    }

    /// Describes for a person how the resources of plugins are limited on this machine.
    pub(crate) fn limits(&self) -> String {
        match &self.tree {
            Ok(_) => "limited by the kernel (a control group for each plugin)".to_owned(),
            Err(why) => format!(
                "measured four times a second, without what is in connections that they have not \
                 accepted, because {why}"
            ),
        }
    }

    /// Checks the paths in a plugin's permissions, after resolving symbolic links.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, about the first path that no plugin may use.
    fn check_paths(&self, permissions: &Permissions) -> Result<(), String> {
        for device in &permissions.devices {
            let Ok(real) = device.canonicalize() else { continue };
            let kind = std::fs::metadata(&real).map(|metadata| metadata.file_type());
            let is_device = kind.is_ok_and(|kind| kind.is_char_device() || kind.is_dir());
            let not_one = || (!is_device).then(|| "it is no character device".to_owned());
            if let Some(why) = device_objection(&real).or_else(not_one) {
                let (shown, real) = (device.display(), real.display());
                return Err(format!("no plugin may use the device {shown} ({real}): {why}"));
            }
        }
        for path in &permissions.read {
            let Ok(real) = path.canonicalize() else { continue };
            let reaches =
                |private: &PathBuf| private.starts_with(&real) || real.starts_with(private);
            let is_private = self.private.iter().any(reaches);
            let private = || is_private.then(|| "Althing keeps its own files there".to_owned());
            let kind = std::fs::metadata(&real).map(|metadata| metadata.file_type());
            let is_socket = kind.is_ok_and(|kind| kind.is_socket());
            let socket = || {
                let why =
                    "it is a socket: a plugin may connect only to the socket of its own daemon";
                is_socket.then(|| why.to_owned())
            };
            if let Some(why) = read_objection(&real).or_else(private).or_else(socket) {
                let (shown, real) = (path.display(), real.display());
                return Err(format!("no plugin may read {shown} ({real}): {why}"));
            }
        }
        Ok(())
    }

    /// Returns the means of confinement that are used for a plugin with these permissions.
    pub(crate) fn plan(&self, permissions: &Permissions) -> ConfinementPlan {
        self.means.plan(permissions, self.tree.is_ok())
    }
}

/// Returns the limit of threads for all processes of a plugin together; `processes` is the limit of
/// processes.
pub(crate) fn threads_max(processes: u32) -> u64 {
    THREADS + THREADS_PER_PROCESS * u64::from(processes)
}

impl ProcessStart<'_> {
    /// Starts the process of the plugin, in its confinement.
    ///
    /// # Errors
    ///
    /// Returns the reason, for a person, if the process cannot be started.
    pub(crate) async fn begin(self) -> Result<StartedProcess, String> {
        let ProcessStart {
            launcher,
            machine_confinement: ward,
            package,
            program,
            sockets,
            data,
            log,
        } = self;
        let permissions = &package.manifest.permissions;
        ward.check_paths(permissions)?;
        make_home(data)?;
        if let Some(remark) = &program.remark {
            log.remark(remark);
        }
        let tasks = threads_max(permissions.processes);
        let counted = match &ward.tree {
            Ok(tree) => Some(tree.group(&package.manifest.name, permissions.memory, tasks)),
            Err(_) => None,
        };
        let counted = counted.transpose();
        let counted =
            counted.map_err(|error| format!("failed to make a control group: {error}"))?;
        let mut read = BTreeSet::from([package.folder.clone()]);
        read.extend(permissions.read.iter().chain(&program.readable).cloned());
        let path = path(program, &read);
        let confinement = Confinement {
            parent: std::process::id(),
            plan: ward.means.plan(permissions, counted.is_some()),
            limits: ProcessLimits {
                memory: permissions.memory.saturating_add(ADDRESSES),
                files: permissions.files,
                file_size: permissions.disk,
                tasks,
            },
            read: read.into_iter().collect(),
            devices: permissions.devices.clone(),
            sockets,
            home: data.to_owned(),
            cgroup: counted.as_ref().map(|group| group.folder().to_owned()),
        };
        let told = package.manifest.run.get(1..).unwrap_or_default();
        let arguments = [&program.leading, told].concat();
        let mut environment = program.environment.clone();
        environment.push(("PATH", path));
        let launch = ProcessLaunch {
            launcher,
            program: &program.file,
            arguments: &arguments,
            environment: &environment,
            folder: &package.folder,
            data,
            confinement: &confinement,
            processes: permissions.processes,
            log,
        };
        let begun = PluginProcess::begin(&launch).await;
        let process = begun.map_err(|error| format!("failed to start it: {error}"))?;
        Ok(StartedProcess { process, counted })
    }
}

/// Creates the data folder of a plugin, with access for this user only.
fn make_home(data: &Path) -> Result<(), String> {
    let mut folder = DirBuilder::new();
    let made = folder.recursive(true).mode(0o700).create(data);
    made.map_err(|error| format!("failed to make {}: {error}", data.display()))
}

/// Returns the `PATH` of a plugin. The folder of the plugin's interpreter comes first, so that
/// scripts find the same interpreter by its name. Next come those folders of the daemon's `PATH`
/// that the plugin can read.
fn path(program: &ResolvedProgram, read: &BTreeSet<PathBuf>) -> OsString {
    let own = program.file.parent().map(Path::to_owned);
    let is_readable = |folder: &PathBuf| {
        read.iter().any(|root| folder.starts_with(root)) || folder.starts_with("/usr")
    };
    let daemons = program::own_path().into_iter().filter(is_readable);
    let mut folders: Vec<PathBuf> = Vec::new();
    for folder in own.into_iter().chain(daemons).chain(SYSTEM_PATH.map(PathBuf::from)) {
        if !folders.contains(&folder) {
            folders.push(folder);
        }
    }
    // Joining fails if the name of a folder contains a `:`.
    std::env::join_paths(folders).unwrap_or_else(|_| SYSTEM_PATH.join(":").into())
}

/// Returns the first line of input of the plugin's program: the agents to bring, and the endpoint
/// to connect to.
pub(crate) fn hello(
    package: &Package,
    spawner: &Spawner,
    endpoint: &Endpoint,
    agents: &[HelloAgent],
    building: Option<&Path>,
) -> String {
    let Spawner { host, router, .. } = spawner;
    let daemon = DaemonId::new(&format!("plugin-{}", package.manifest.name));
    let hello = Hello {
        protocol: SCHEMA_VERSION,
        ecosystem: router.ecosystem().clone(),
        daemon: daemon.unwrap_or_else(|_| router.daemon().clone()),
        endpoint: endpoint.locator.clone(),
        host: endpoint.host.clone(),
        agents: agents.to_vec(),
        domain: host.ontology.to_string(),
        map: host.map.to_string(),
        mode: host.mode,
        heartbeat_period: Millis(host.settings.heartbeat_period),
        building: building.map(|path| path.display().to_string()),
    };
    serde_json::to_string(&hello).unwrap_or_default()
}

/// Returns the description of an agent that is passed to the package's program, and the agent's
/// action model; the model is `None` if the package has none for this agent.
///
/// # Errors
///
/// Returns the reason, for a person, if the agent's config or model is invalid.
pub(crate) fn described(
    package: &Package,
    agent: &WantedAgent,
) -> Result<(HelloAgent, Option<ActionModel>), String> {
    let WantedAgent { name, plugin, driver, config } = agent;
    if let Some(problem) = package.manifest.problem_with(config) {
        return Err(format!("agent `{name}`: {problem}"));
    }
    let described = package.model(name, config)?;
    let (text, model) = described.unzip();
    let hello = HelloAgent {
        name: name.clone(),
        plugin: plugin.clone(),
        driver: driver.clone(),
        config: config.clone(),
        model: text.unwrap_or_default(),
        methods: package.manifest.methods.clone(),
    };
    Ok((hello, model))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_private_path_or_a_socket_cannot_be_read() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        let _socket = std::os::unix::net::UnixListener::bind(at("socket")).expect("a socket");
        std::fs::write(at("file"), "").expect("a file");
        std::fs::create_dir(at("private")).expect("a folder");
        std::os::unix::fs::symlink(at("socket"), at("link")).expect("a link");
        let private = at("private").canonicalize().expect("it is there");
        let ward = MachineConfinement { private: vec![private], ..MachineConfinement::unknown() };
        let objection = |name: &str| {
            let asked = Permissions { read: vec![at(name)], ..Permissions::default() };
            ward.check_paths(&asked).err().unwrap_or_default()
        };
        assert_eq!(objection("file"), "");
        assert!(objection("private").contains("Althing keeps its own files there"));
        for name in ["socket", "link"] {
            assert!(objection(name).contains("it is a socket"), "{name}");
        }
    }
}
