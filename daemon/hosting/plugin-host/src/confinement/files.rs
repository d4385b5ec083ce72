//! Restricts what a plugin's process can do with files, sockets and signals (Landlock).

use std::path::PathBuf;

use landlock::{
    ABI, Access as _, AccessFs, AccessNet, CompatLevel, Compatible as _, LandlockStatus,
    PathBeneath, PathFd, RulesetAttr as _, RulesetCreatedAttr as _, RulesetError, Scope,
};

/// Newest Landlock version that this code supports. Restrictions that an older kernel does not
/// support are left out.
const KNOWN: ABI = ABI::V9;

/// First Landlock version that forbids emptying (`truncate`) a file that may not be written.
pub(super) const TRUNCATES: i32 = 3;
/// First Landlock version that restricts signals and abstract sockets to the plugin's own
/// processes.
pub(super) const SCOPES: i32 = 6;
/// First Landlock version that restricts connections to sockets with a path.
pub(super) const SOCKETS: i32 = 9;

/// Files and sockets that a process may use, by the kind of use.
#[derive(Debug, Default)]
pub(super) struct AccessibleFiles<'f> {
    /// Files and folders that the process may read and execute.
    pub(super) read: Vec<&'f PathBuf>,
    /// Files and folders that the process may read, write, create and remove.
    pub(super) write: Vec<&'f PathBuf>,
    /// Sockets that the process may connect to.
    pub(super) sockets: Vec<&'f PathBuf>,
    /// Whether the process may use TCP.
    pub(super) network: bool,
}

/// Restricts this process to these files and sockets; the restriction cannot be removed. Returns
/// the version of Landlock that the kernel has, or 0 if it has none.
pub(super) fn restrict(files: &AccessibleFiles<'_>) -> Result<i32, RulesetError> {
    let all = AccessFs::from_all(KNOWN);
    let ruleset = landlock::Ruleset::default().set_compatibility(CompatLevel::BestEffort);
    let mut ruleset = ruleset.handle_access(all)?.scope(Scope::from_all(KNOWN))?;
    if !files.network {
        ruleset = ruleset.handle_access(AccessNet::from_all(KNOWN))?;
    }
    let mut created = ruleset.create()?;
    let sockets = AccessFs::ResolveUnix | AccessFs::ReadFile | AccessFs::WriteFile;
    let read = files.read.iter().map(|path| (path, AccessFs::from_read(KNOWN)));
    let write = files.write.iter().map(|path| (path, all));
    let sockets = files.sockets.iter().map(|path| (path, sockets));
    for (path, access) in read.chain(write).chain(sockets) {
        // A path that does not exist needs no rule.
        let Ok(opened) = PathFd::new(path) else { continue };
        let access = if path.is_dir() { access } else { access & AccessFs::from_file(KNOWN) };
        created = created.add_rule(PathBeneath::new(opened, access))?;
    }
    let status = created.restrict_self()?;
    Ok(match status.landlock {
        LandlockStatus::Available { effective_abi, kernel_abi } => {
            kernel_abi.unwrap_or(effective_abi as i32)
        }
        _ => 0,
    })
}
