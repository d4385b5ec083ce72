//! Starts a package's process: what it is told, and within which bounds it runs. Used by the supervision
//! of a daemon and by the trial of `althing plugin check`.

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

use acl::{DaemonId, Deadline, Hello, HelloAgent, SCHEMA_VERSION};
use agent::Landing;
use pddl::ActionModel;

use crate::confinement::Confinement;
use crate::endpoint::Endpoint;
use crate::log::Log;
use crate::package::Package;
use crate::process::{Launch, Launcher, Process};
use crate::program::{self, Program};
use crate::supervision::WantedAgent;

/// Beyond what its processes may hold together, each is stopped by the kernel: libraries and the
/// stacks of threads that nothing is in count here, and do not there.
const ADDRESSES: u64 = 1 << 30;

/// Where programs of the system are, also where the daemon's `PATH` says nothing of them.
const SYSTEM_PATH: [&str; 3] = ["/usr/local/bin", "/usr/bin", "/bin"];

/// A process that is to be started.
pub(crate) struct Start<'s> {
    pub(crate) launcher: &'s Launcher,
    pub(crate) package: &'s Package,
    pub(crate) program: &'s Program,
    /// A folder of its own; made if it is not there.
    pub(crate) data: &'s Path,
    pub(crate) log: &'s Log,
}

impl Start<'_> {
    /// Starts it.
    ///
    /// # Errors
    ///
    /// If that fails; for a person.
    pub(crate) fn begin(&self) -> Result<Process, String> {
        let Start { launcher, package, program, data, log } = *self;
        let permissions = &package.manifest.permissions;
        let made = std::fs::create_dir_all(data);
        made.map_err(|error| format!("failed to make {}: {error}", data.display()))?;
        if let Some(remark) = &program.remark {
            log.remark(remark);
        }
        let mut read = BTreeSet::from([package.folder.clone()]);
        read.extend(permissions.read.iter().chain(&program.readable).cloned());
        let path = path(program, &read);
        let confinement = Confinement {
            parent: std::process::id(),
            memory: permissions.memory.saturating_add(ADDRESSES),
            files: permissions.files,
            network: permissions.network,
            read: read.into_iter().collect(),
            write: permissions.devices.iter().cloned().chain([data.to_owned()]).collect(),
        };
        let told = package.manifest.run.get(1..).unwrap_or_default();
        let arguments = [&program.leading, told].concat();
        let mut environment = program.environment.clone();
        environment.push(("PATH", path));
        let launch = Launch {
            launcher,
            program: &program.file,
            arguments: &arguments,
            environment: &environment,
            folder: &package.folder,
            data,
            confinement: &confinement,
            log,
        };
        Process::begin(&launch).map_err(|error| format!("failed to start it: {error}"))
    }
}

/// The `PATH` of a plugin: first where its interpreter is, so that what it starts by that name is the
/// same; then what of the daemon's it can read.
fn path(program: &Program, read: &BTreeSet<PathBuf>) -> OsString {
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
    // A folder with a `:` in its name cannot be on a path.
    std::env::join_paths(folders).unwrap_or_else(|_| SYSTEM_PATH.join(":").into())
}

/// What the program is told in its first line.
pub(crate) fn hello(
    package: &Package,
    landing: &Landing,
    endpoint: &Endpoint,
    agents: &[HelloAgent],
    building: Option<&Path>,
) -> String {
    let Landing { host, switchboard, .. } = landing;
    let daemon = DaemonId::new(&format!("plugin-{}", package.manifest.name));
    let hello = Hello {
        protocol: SCHEMA_VERSION,
        ecosystem: switchboard.ecosystem().clone(),
        daemon: daemon.unwrap_or_else(|_| switchboard.daemon().clone()),
        endpoint: endpoint.locator.clone(),
        host: endpoint.host.clone(),
        agents: agents.to_vec(),
        domain: host.ontology.to_string(),
        map: host.map.to_string(),
        mode: host.mode,
        heartbeat_period: Deadline(host.settings.heartbeat_period),
        building: building.map(|path| path.display().to_string()),
    };
    serde_json::to_string(&hello).unwrap_or_default()
}

/// What a package's program is told of an agent, and its model where the package has one.
///
/// # Errors
///
/// If its config or its model is wrong; for a person.
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
