//! What a plugin's process may do: entered by the process itself before it becomes the program, so that
//! no `fork` of a process with many threads has anything to do but `exec`.
//!
//! - `room`: where the kernel lets, namespaces of its own, in which there is only what it may see.
//! - `files`: of the file system it sees what the system is made of, its own package, and what its
//!   manifest names; it neither signals nor meets others beyond its own (Landlock).
//! - `calls`: it may make the calls that programs need, and of these none that reaches beyond it
//!   (seccomp). What the kernel cannot decide, the daemon is asked (`mediator`).
//! - Memory, open files, file sizes, processes, priority, no core dumps (`setrlimit`), and no capabilities. What
//!   all its processes take together a control group counts (`cgroup`), or its host looks at (`usage`).
//! - It is killed with the thread that has started it.
//!
//! `means` is which of these this kernel has, and what is left open.

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

use files::Files;
pub use means::Means;
pub(crate) use means::Plan;
use room::Furniture;

/// What the system is made of. Of `/etc` only what programs ask for, and no keys.
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

/// Devices that hold nothing of anybody's.
const PLAIN_DEVICES: &[&str] = &["/dev/null", "/dev/full", "/dev/random", "/dev/urandom"];

/// A device that is read only: who maps it to be written and shared holds memory that is counted of no
/// process.
const ZERO: &str = "/dev/zero";

/// What one process may do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Confinement {
    /// Who started it; with whom it ends.
    pub(crate) parent: u32,
    /// With what it is confined.
    pub(crate) plan: Plan,
    pub(crate) limits: Limits,
    /// What it may read and execute beside the system.
    pub(crate) read: Vec<PathBuf>,
    /// Devices that it may write to.
    pub(crate) devices: Vec<PathBuf>,
    /// Sockets that it may connect to.
    pub(crate) sockets: Vec<PathBuf>,
    /// A folder of its own.
    pub(crate) home: PathBuf,
    /// The control group that it joins, if it has one.
    pub(crate) cgroup: Option<PathBuf>,
}

/// What each of its processes may take.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Limits {
    /// Bytes of memory.
    pub(crate) memory: u64,
    /// Open files.
    pub(crate) files: u64,
    /// Bytes of one file.
    pub(crate) file_size: u64,
    /// Threads of all its processes together, where the kernel counts them for itself.
    pub(crate) tasks: u64,
}

/// What a process says of its confinement before it becomes the program, over its standard input.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Entered {
    /// The version of Landlock that holds for it.
    pub(crate) landlock: i32,
}

/// Why a process cannot become a plugin. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum ConfinementError {
    /// Whoever started it has ended.
    #[error("begin: the daemon has ended meanwhile")]
    Orphaned,
    /// A limit could not be set.
    #[error("limit {what}: {source}")]
    Limit {
        /// Of what.
        what: &'static str,
        /// Why.
        #[source]
        source: std::io::Error,
    },
    /// It has no room of its own.
    #[error(transparent)]
    Room(#[from] room::RoomError),
    /// The file system could not be hidden.
    #[error("hide the file system from it: {0}")]
    Landlock(#[from] landlock::RulesetError),
    /// The kernel has less than it had when the daemon started.
    #[error(
        "hide the file system from it: the kernel has version {is} of Landlock, and had {was} when the daemon started"
    )]
    Weaker {
        /// The version in force.
        is: i32,
        /// The version that was planned with.
        was: i32,
    },
    /// Calls could not be forbidden.
    #[error(transparent)]
    Calls(#[from] calls::CallsError),
    /// The daemon could not be told.
    #[error("tell the daemon that it is confined: {0}")]
    Told(#[source] std::io::Error),
}

impl Confinement {
    /// Confines this process and makes it the program; returns only if that fails.
    pub fn become_program(&self, program: &Path, arguments: &[String]) -> String {
        if let Err(error) = self.enter() {
            return format!("failed to {error}");
        }
        let error = Command::new(program).args(arguments).exec();
        format!("failed to run `{}`: {error}", program.display())
    }

    /// Confines this process for good.
    fn enter(&self) -> Result<(), ConfinementError> {
        let folder = std::env::current_dir().unwrap_or_else(|_| PathBuf::from("/"));
        self.end_with_parent()?;
        if let Some(group) = &self.cgroup {
            let joined = std::fs::write(group.join("cgroup.procs"), "0");
            joined.map_err(|source| limit("what it takes", source))?;
        }
        let devices: Vec<PathBuf> =
            PLAIN_DEVICES.iter().map(PathBuf::from).chain(self.devices.iter().cloned()).collect();
        let system: Vec<PathBuf> = SYSTEM.iter().map(PathBuf::from).collect();
        if self.plan.has_room {
            // Landlock lets it see of /proc what is its own; without, no more is in the room.
            let is_shown = |path: &&PathBuf| self.plan.landlock == 0 || !path.starts_with("/proc");
            let proc = (self.plan.landlock > 0).then(|| PathBuf::from("/proc"));
            let shown = system.iter().filter(is_shown).chain(&proc).chain(&self.read);
            // Landlock alone lets a device be opened to be read only.
            let zero = (self.plan.landlock > 0).then(|| PathBuf::from(ZERO));
            let furniture = Furniture {
                shown: shown.cloned().collect(),
                devices: devices.iter().cloned().chain(zero).collect(),
                sockets: self.sockets.clone(),
                home: self.home.clone(),
                network: self.plan.network,
            };
            room::enter(&furniture)?;
            // It is in the room, where it was outside.
            let _ = std::env::set_current_dir(&folder);
        }
        self.limit()?;
        drop_capabilities().map_err(|source| limit("its capabilities", source))?;
        let landlock = files::restrict(&Files {
            read: system.iter().chain([&PathBuf::from(ZERO)]).chain(&self.read).collect(),
            write: devices.iter().chain([&self.home]).collect(),
            sockets: self.sockets.iter().collect(),
            network: self.plan.network,
        })?;
        if landlock < self.plan.landlock {
            return Err(ConfinementError::Weaker { is: landlock, was: self.plan.landlock });
        }
        self.forbid_calls(&Entered { landlock })
    }

    fn end_with_parent(&self) -> Result<(), ConfinementError> {
        let failed =
            |errno: rustix::io::Errno| limit("its life to that of the daemon", errno.into());
        rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(failed)?;
        let parent = rustix::process::getppid().map(|pid| pid.as_raw_nonzero().get());
        // It may have ended before it could be asked to take this one along.
        match parent.and_then(|pid| u32::try_from(pid).ok()) {
            Some(parent) if parent == self.parent => Ok(()),
            _ => Err(ConfinementError::Orphaned),
        }
    }

    fn limit(&self) -> Result<(), ConfinementError> {
        let Limits { memory, files, file_size, tasks } = self.limits;
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
        // Outside of a namespace of users, all processes of this user would count.
        if self.plan.has_room {
            set("processes", Resource::Nproc, tasks)?;
        }
        Ok(())
    }

    /// The last step: what was made of this process is told to the daemon, with the calls that it is to
    /// be asked about.
    fn forbid_calls(&self, entered: &Entered) -> Result<(), ConfinementError> {
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

/// The longest core dump, in bytes. At 0 the kernel writes no file, but still hands the dump to a program
/// that collects dumps (a `core_pattern` that begins with `|`); at 1 it does neither. A hard limit of 0 is
/// kept, because raising it takes a capability.
fn core_limit() -> u64 {
    getrlimit(Resource::Core).maximum.map_or(1, |most| most.min(1))
}

/// Gives up all capabilities, also those that a program of root would have again.
fn drop_capabilities() -> std::io::Result<()> {
    let none = CapabilitySet::empty();
    // Only who may set its capabilities can bound them; who may not has none to lose.
    for capability in CapabilitySet::all().iter() {
        let _ = rustix::thread::remove_capability_from_bounding_set(capability);
    }
    let _ = rustix::thread::clear_ambient_capability_set();
    let sets = CapabilitySets { effective: none, permitted: none, inheritable: none };
    // A service manager may have forbidden the call, and left nothing to give up.
    if rustix::thread::capabilities(None) != Ok(sets) {
        rustix::thread::set_capabilities(None, sets)?;
    }
    rustix::thread::set_no_new_privs(true)?;
    Ok(())
}

fn limit(what: &'static str, source: std::io::Error) -> ConfinementError {
    ConfinementError::Limit { what, source }
}

/// What a process of the daemon's own program says of the kernel's means, for the daemon to read.
pub fn probe(folder: &Path) -> String {
    serde_json::to_string(&Means::try_out(folder)).unwrap_or_default()
}
