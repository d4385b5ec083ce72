//! What a plugin's process may do: entered by the process itself before it becomes the program, so
//! that no `fork` of a process with many threads has anything to do but `exec`.
//!
//! - Of the file system it sees what the system is made of, its own package, and what its manifest
//!   names (Landlock). Where the kernel has it, it opens no TCP connection, and neither signals nor
//!   meets others beyond its own.
//! - It may not make calls that no plugin needs (seccomp): trace, mount, load, leave its process
//!   group; nor, without `network`, sockets of the Internet.
//! - Memory, open files, and no core dumps (`setrlimit`). What all its processes hold together, and
//!   how much they compute, its host looks at (`usage`).
//! - It is killed with the thread that has started it.

use std::collections::BTreeMap;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

use landlock::{
    ABI, Access as _, AccessFs, AccessNet, CompatLevel, Compatible as _, PathBeneath, PathFd,
    RulesetAttr as _, RulesetCreatedAttr as _, RulesetStatus, Scope,
};
use rustix::process::{Resource, Rlimit, Signal, setrlimit};
use seccompiler::{
    SeccompAction, SeccompCmpArgLen, SeccompCmpOp, SeccompCondition, SeccompFilter, SeccompRule,
};
use serde::{Deserialize, Serialize};

/// The kernel interface that was read when this was written. What a kernel does not have is left
/// out, and said.
const LANDLOCK: ABI = ABI::V6;

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
const PLAIN_DEVICES: &[&str] =
    &["/dev/null", "/dev/zero", "/dev/full", "/dev/random", "/dev/urandom"];

/// Calls that no plugin needs.
const FORBIDDEN: &[libc::c_long] = &[
    libc::SYS_acct,
    libc::SYS_add_key,
    libc::SYS_bpf,
    libc::SYS_chroot,
    libc::SYS_clock_adjtime,
    libc::SYS_clock_settime,
    libc::SYS_delete_module,
    libc::SYS_finit_module,
    libc::SYS_init_module,
    libc::SYS_kexec_load,
    libc::SYS_keyctl,
    libc::SYS_mount,
    libc::SYS_open_by_handle_at,
    libc::SYS_perf_event_open,
    libc::SYS_pivot_root,
    libc::SYS_process_vm_readv,
    libc::SYS_process_vm_writev,
    libc::SYS_ptrace,
    libc::SYS_quotactl,
    libc::SYS_reboot,
    libc::SYS_request_key,
    libc::SYS_setns,
    libc::SYS_settimeofday,
    libc::SYS_swapoff,
    libc::SYS_swapon,
    libc::SYS_umount2,
    libc::SYS_unshare,
    // Whoever leaves the group is not ended with it.
    libc::SYS_setpgid,
    libc::SYS_setsid,
];

/// What one process may do.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Confinement {
    /// Who started it; with whom it ends.
    pub parent: u32,
    /// Bytes each of its processes may hold.
    pub memory: u64,
    /// Files it may have open.
    pub files: u64,
    /// Whether it may use the Internet's sockets.
    pub network: bool,
    /// What it may read and execute beside the system.
    pub read: Vec<PathBuf>,
    /// What it may also write: devices, and a folder of its own.
    pub write: Vec<PathBuf>,
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
    /// The file system could not be hidden.
    #[error("hide the file system from it: {0}")]
    Landlock(#[from] landlock::RulesetError),
    /// Calls could not be forbidden.
    #[error("forbid it calls: {0}")]
    Seccomp(String),
}

impl Confinement {
    /// Confines this process and makes it the program; returns only if that fails. What the kernel
    /// cannot keep from it is said on standard error.
    pub fn become_program(&self, program: &Path, arguments: &[String]) -> String {
        match self.enter() {
            Ok(missing) => {
                for missing in missing {
                    eprintln!("althing: not confined: {missing}");
                }
            }
            Err(error) => return format!("failed to {error}"),
        }
        let error = Command::new(program).args(arguments).exec();
        format!("failed to run `{}`: {error}", program.display())
    }

    /// Confines this process for good; what the kernel has no means for comes back.
    fn enter(&self) -> Result<Vec<String>, ConfinementError> {
        self.end_with_parent()?;
        let io = |what, result: rustix::io::Result<()>| {
            result.map_err(|errno| ConfinementError::Limit { what, source: errno.into() })
        };
        let at_most = |count| Rlimit { current: Some(count), maximum: Some(count) };
        io("memory", setrlimit(Resource::Data, at_most(self.memory)))?;
        io("open files", setrlimit(Resource::Nofile, at_most(self.files)))?;
        io("core dumps", setrlimit(Resource::Core, at_most(0)))?;
        let mut missing = Vec::new();
        missing.extend(self.hide_files()?);
        missing.extend(self.forbid_calls()?);
        Ok(missing)
    }

    fn end_with_parent(&self) -> Result<(), ConfinementError> {
        let failed = |errno: rustix::io::Errno| ConfinementError::Limit {
            what: "its life",
            source: errno.into(),
        };
        rustix::process::set_parent_process_death_signal(Some(Signal::KILL)).map_err(failed)?;
        let parent = rustix::process::getppid().map(|pid| pid.as_raw_nonzero().get());
        // It may have ended before it could be asked to take this one along.
        match parent.and_then(|pid| u32::try_from(pid).ok()) {
            Some(parent) if parent == self.parent => Ok(()),
            _ => Err(ConfinementError::Orphaned),
        }
    }

    fn hide_files(&self) -> Result<Option<String>, ConfinementError> {
        let reading = AccessFs::from_read(LANDLOCK);
        let all = AccessFs::from_all(LANDLOCK);
        let ruleset = landlock::Ruleset::default().set_compatibility(CompatLevel::BestEffort);
        let mut ruleset = ruleset.handle_access(all)?.scope(Scope::from_all(LANDLOCK))?;
        if !self.network {
            ruleset = ruleset.handle_access(AccessNet::from_all(LANDLOCK))?;
        }
        let mut created = ruleset.create()?;
        let own = SYSTEM.iter().map(PathBuf::from).chain(self.read.iter().cloned());
        let devices = PLAIN_DEVICES.iter().map(PathBuf::from).chain(self.write.iter().cloned());
        let rules = own.map(|path| (path, reading)).chain(devices.map(|path| (path, all)));
        for (path, access) in rules {
            // What is not there cannot be reached anyway.
            let Ok(opened) = PathFd::new(&path) else { continue };
            let access =
                if path.is_dir() { access } else { access & AccessFs::from_file(LANDLOCK) };
            created = created.add_rule(PathBeneath::new(opened, access))?;
        }
        let status = created.restrict_self()?;
        Ok(match status.ruleset {
            RulesetStatus::FullyEnforced | RulesetStatus::PartiallyEnforced => None,
            RulesetStatus::NotEnforced => Some(
                "this kernel has no Landlock; it sees all files that this user sees".to_owned(),
            ),
        })
    }

    fn forbid_calls(&self) -> Result<Option<String>, ConfinementError> {
        let Ok(target) = std::env::consts::ARCH.try_into() else {
            return Ok(Some(
                "seccomp is not known for this machine; it may make any call".to_owned(),
            ));
        };
        let seccomp =
            |error: seccompiler::BackendError| ConfinementError::Seccomp(error.to_string());
        let mut rules: BTreeMap<i64, Vec<SeccompRule>> =
            FORBIDDEN.iter().map(|call| (number(*call), Vec::new())).collect();
        if !self.network {
            let of = |family: libc::c_int| {
                let family = u64::from(family.unsigned_abs());
                let is_it =
                    SeccompCondition::new(0, SeccompCmpArgLen::Dword, SeccompCmpOp::Eq, family);
                SeccompRule::new(vec![is_it?])
            };
            let families = [libc::AF_INET, libc::AF_INET6, libc::AF_PACKET, libc::AF_VSOCK];
            let of_all: Result<Vec<_>, _> = families.into_iter().map(of).collect();
            rules.insert(number(libc::SYS_socket), of_all.map_err(seccomp)?);
        }
        let (allow, forbid) =
            (SeccompAction::Allow, SeccompAction::Errno(libc::EPERM.unsigned_abs()));
        let filter = SeccompFilter::new(rules, allow, forbid, target).map_err(seccomp)?;
        let program: seccompiler::BpfProgram = filter.try_into().map_err(seccomp)?;
        seccompiler::apply_filter(&program)
            .map_err(|error| ConfinementError::Seccomp(error.to_string()))?;
        Ok(None)
    }
}

/// The number of a system call, as filters want it.
#[allow(clippy::useless_conversion, reason = "a C long has 32 bits on some boards")]
fn number(call: libc::c_long) -> i64 {
    i64::from(call)
}
