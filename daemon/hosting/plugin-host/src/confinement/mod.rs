//! Confinement of a plugin's process. The process confines itself before it becomes the plugin's
//! program, because after a `fork` in a daemon with many threads no call but `exec` is safe.
//!
//! - `room`: Linux namespaces for this process alone, if the kernel allows them; they hold only the
//!   files and networks that the process may see.
//! - `files`: access only to files of the system, the plugin's package, its data folder, and the
//!   files that its manifest names; no signals and sockets to other processes (Landlock).
//! - `calls`: only the system calls that programs need, with no effect beyond the process
//!   (seccomp). Calls that the kernel cannot decide are answered by the daemon (`mediator`).
//! - Limits of memory, open files, file sizes, processes and priority, no core dumps (`setrlimit`),
//!   and no capabilities. The resources of all processes of the plugin together are counted by a
//!   control group (`cgroup`), or measured by the host (`usage`).
//! - The process is killed when the thread that started it ends.
//!
//! `means` finds out the restrictions that this kernel supports, and those that cannot be enforced.

mod calls;
mod files;
mod means;
mod room;

use std::os::fd::AsFd as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use rustix::process::{Resource, Rlimit, Signal, getrlimit, setrlimit};
use rustix::thread::{CapabilitySet, CapabilitySets};
use serde::{Deserialize, Serialize};

use files::AccessibleFiles;
pub use means::ConfinementMeans;
pub(crate) use means::ConfinementPlan;
use room::RoomContents;

/// Files and folders of the system that every plugin may read. The list contains only those files
/// of `/etc` that programs need, and none with keys.
const SYSTEM: &[&str] = &[
    "/usr",
    "/bin",
    "/sbin",
    "/lib",
    "/lib32",
    "/lib64",
    "/nix/store",
    "/etc/alternatives",
    "/etc/group",
    "/etc/hosts",
    "/etc/ld.so.cache",
    "/etc/ld.so.conf",
    "/etc/ld.so.conf.d",
    "/etc/ld.so.preload",
    "/etc/localtime",
    "/etc/mime.types",
    "/etc/nsswitch.conf",
    "/etc/passwd",
    "/etc/resolv.conf",
    "/etc/ssl/certs",
    "/proc/cpuinfo",
    "/proc/meminfo",
    "/proc/self",
    "/proc/stat",
    "/proc/sys",
    "/sys",
];

/// Devices that every plugin may use, because they hold no data of others.
const PLAIN_DEVICES: &[&str] = &["/dev/null", "/dev/full", "/dev/random", "/dev/urandom"];

/// Device that plugins may only read. With write access, a process could map the device as shared
/// memory that is not counted for any process.
const ZERO: &str = "/dev/zero";

/// Confinement of one process of a plugin, with everything that the process needs to enter it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Confinement {
    /// Process id of the daemon that started the process. The process ends when that daemon ends.
    pub(crate) parent: u32,
    /// Means of confinement that are used for the process.
    pub(crate) plan: ConfinementPlan,
    pub(crate) limits: ProcessLimits,
    /// Files and folders that the process may read and execute, in addition to those of the system.
    pub(crate) read: Vec<PathBuf>,
    /// Devices that the process may read and write.
    pub(crate) devices: Vec<PathBuf>,
    /// Sockets that the process may connect to.
    pub(crate) sockets: Vec<PathBuf>,
    /// Data folder of the plugin, in which the process may write.
    pub(crate) home: PathBuf,
    /// Folder of the control group that the process joins; `None` if the plugin has no control
    /// group.
    pub(crate) cgroup: Option<PathBuf>,
}

/// Resource limits of each process of a plugin.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ProcessLimits {
    /// Limit of the memory of the process, in bytes.
    pub(crate) memory: u64,
    /// Limit of the number of open files of the process.
    pub(crate) files: u64,
    /// Limit of the size of a file that the process writes, in bytes.
    pub(crate) file_size: u64,
    /// Limit of the number of threads of all processes of the plugin together. The limit is
    /// enforced only if the kernel counts threads per namespace.
    pub(crate) tasks: u64,
}

/// Report of a process about its own confinement, sent over the standard input of the process
/// before the process becomes the plugin's program.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ConfinementReport {
    /// Version of Landlock that restricts the process; 0 if none does.
    pub(crate) landlock: i32,
}

/// Reason why a process cannot become a plugin. The text of the error completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfinementError {
    /// The daemon that started the process has ended.
    #[error("begin: the daemon has ended meanwhile")]
    Orphaned,
    /// A resource limit of the process could not be set.
    #[error("limit {what}: {source}")]
    Limit {
        /// Name of the resource.
        what: &'static str,
        /// Error of the system.
        #[source]
        source: std::io::Error,
    },
    /// The process could not enter a namespace room.
    #[error(transparent)]
    Room(#[from] room::RoomError),
    /// The files of others could not be hidden from the process (Landlock).
    #[error("hide the file system from it: {0}")]
    Landlock(#[from] landlock::RulesetError),
    /// The kernel supports less of Landlock than when the daemon started.
    #[error(
        "hide the file system from it: the kernel has version {is} of Landlock, and had {was} when the daemon started"
    )]
    Weaker {
        /// Version of Landlock that restricts the process.
        is: i32,
        /// Version of Landlock that the kernel had when the daemon started.
        was: i32,
    },
    /// The filters of system calls could not be installed.
    #[error(transparent)]
    Calls(#[from] calls::CallsError),
    /// The report about the confinement could not be sent to the daemon.
    #[error("tell the daemon that it is confined: {0}")]
    Told(#[source] std::io::Error),
}

impl Confinement {
    /// Confines this process and replaces it with `program`. Returns only if that fails, with a
    /// message for a person.
    pub fn become_program(&self, program: &Path, arguments: &[String]) -> String {
        if let Err(error) = self.enter() {
            return format!("failed to {error}");
        }
        let error = Command::new(program).args(arguments).exec();
        format!("failed to run `{}`: {error}", program.display())
    }

    /// Confines this process; the confinement cannot be undone.
    fn enter(&self) -> Result<(), ConfinementError> {
        let folder = std::env::current_dir().unwrap_or_else(|_| PathBuf::from("/"));
        self.end_with_parent()?;
        if let Some(group) = &self.cgroup {
            let joined = std::fs::write(group.join("cgroup.procs"), "0");
            joined.map_err(|source| limit("its resources by a control group", source))?;
        }
        let devices: Vec<PathBuf> =
            PLAIN_DEVICES.iter().map(PathBuf::from).chain(self.devices.iter().cloned()).collect();
        let system: Vec<PathBuf> = SYSTEM.iter().map(PathBuf::from).collect();
        if self.plan.has_room {
            // With Landlock, all of `/proc` is mounted, because Landlock limits access to the
            // process's own part. Without Landlock, only the listed files of `/proc` are mounted.
            let is_shown = |path: &&PathBuf| self.plan.landlock == 0 || !path.starts_with("/proc");
            let proc = (self.plan.landlock > 0).then(|| PathBuf::from("/proc"));
            let shown = system.iter().filter(is_shown).chain(&proc).chain(&self.read);
            // Only Landlock can restrict a device to reading. Without Landlock, `/dev/zero` is left
            // out.
            let zero = (self.plan.landlock > 0).then(|| PathBuf::from(ZERO));
            let furniture = RoomContents {
                shown: shown.cloned().collect(),
                devices: devices.iter().cloned().chain(zero).collect(),
                sockets: self.sockets.clone(),
                home: self.home.clone(),
                network: self.plan.network,
            };
            room::enter(&furniture)?;
            // The current folder has the same path in the room. If the room does not contain it,
            // the root becomes the current folder.
            let _ = std::env::set_current_dir(&folder);
        }
        self.limit()?;
        drop_capabilities().map_err(|source| limit("its capabilities", source))?;
        let landlock = files::restrict(&AccessibleFiles {
            read: system.iter().chain([&PathBuf::from(ZERO)]).chain(&self.read).collect(),
            write: devices.iter().chain([&self.home]).collect(),
            sockets: self.sockets.iter().collect(),
            network: self.plan.network,
        })?;
        if landlock < self.plan.landlock {
            return Err(ConfinementError::Weaker { is: landlock, was: self.plan.landlock });
        }
        self.forbid_calls(&ConfinementReport { landlock })
    }

    fn end_with_parent(&self) -> Result<(), ConfinementError> {
        let failed =
            |errno: rustix::io::Errno| limit("its lifetime to that of the daemon", errno.into());
        rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(failed)?;
        let parent = rustix::process::getppid().map(|pid| pid.as_raw_nonzero().get());
        // The parent may have ended before the signal was set.
        match parent.and_then(|pid| u32::try_from(pid).ok()) {
            Some(parent) if parent == self.parent => Ok(()),
            _ => Err(ConfinementError::Orphaned),
        }
    }

    fn limit(&self) -> Result<(), ConfinementError> {
        let ProcessLimits { memory, files, file_size, tasks } = self.limits;
        let at_most = |count| Rlimit { current: Some(count), maximum: Some(count) };
        let set = |what, resource, count| {
            setrlimit(resource, at_most(count)).map_err(|errno| limit(what, errno.into()))
        };
        set("memory", Resource::Data, memory)?;
        set("open files", Resource::Nofile, files)?;
        set("the size of files", Resource::Fsize, file_size)?;
        set("core dumps", Resource::Core, core_limit())?;
        set("message queues", Resource::Msgqueue, 0)?;
        set("real-time priority", Resource::Rtprio, 0)?;
        set("priority", Resource::Nice, 0)?;
        // Outside of a user namespace, the kernel would count all processes of this user.
        if self.plan.has_room {
            set("processes", Resource::Nproc, tasks)?;
        }
        Ok(())
    }

    /// Does the last step of the confinement: installs the filters of system calls, and sends the
    /// report to the daemon, together with the listener for the calls that the daemon answers.
    fn forbid_calls(&self, entered: &ConfinementReport) -> Result<(), ConfinementError> {
        let target = calls::target().filter(|_| self.plan.forbids_calls);
        if let Some(target) = target {
            calls::forbid(self.plan.choice(), target)?;
        }
        let listener = match target.filter(|_| self.plan.is_mediated) {
            Some(target) => {
                let own = std::process::id();
                let program = calls::mediated(self.plan.counts_processes, own, target)?;
                Some(seccomp_notify::listen(&program).map_err(ConfinementError::Told)?)
            }
            None => None,
        };
        let told = serde_json::to_vec(entered).unwrap_or_default();
        let sent = seccomp_notify::send(std::io::stdin().as_fd(), &told, listener.as_ref());
        sent.map_err(ConfinementError::Told)
    }
}

/// Returns the limit to set for the length of a core dump, in bytes. At 0 the kernel writes no
/// file, but still passes the dump to a program that collects dumps (a `core_pattern` that begins
/// with `|`). At 1 the kernel does neither. A hard limit of 0 is kept, because raising it requires
/// a capability.
fn core_limit() -> u64 {
    getrlimit(Resource::Core).maximum.map_or(1, |most| most.min(1))
}

/// Drops all capabilities of this process, also those that a program would regain because root
/// starts it.
fn drop_capabilities() -> std::io::Result<()> {
    let none = CapabilitySet::empty();
    // Only a process with the capability to set capabilities can reduce its bounding set; any other
    // process has no capabilities to lose.
    for capability in CapabilitySet::all().iter() {
        let _ = rustix::thread::remove_capability_from_bounding_set(capability);
    }
    let _ = rustix::thread::clear_ambient_capability_set();
    let sets = CapabilitySets { effective: none, permitted: none, inheritable: none };
    // A service manager may have forbidden the call and left no capabilities to drop; then the
    // failure does not matter.
    if rustix::thread::capabilities(None) != Ok(sets) {
        rustix::thread::set_capabilities(None, sets)?;
    }
    rustix::thread::set_no_new_privs(true)?;
    Ok(())
}

fn limit(what: &'static str, source: std::io::Error) -> ConfinementError {
    ConfinementError::Limit { what, source }
}

/// Tries out the means that the kernel offers to confine plugins, in a process that was started for
/// this purpose alone. Returns [`ConfinementMeans`] in JSON, for the daemon to read.
pub fn probe(folder: &Path) -> String {
    serde_json::to_string(&ConfinementMeans::try_out(folder)).unwrap_or_default()
}
