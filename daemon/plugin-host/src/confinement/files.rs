//! What a plugin's process may do with files, and whom it may reach (Landlock).

use std::path::PathBuf;

use landlock::{
    ABI, Access as _, AccessFs, AccessNet, CompatLevel, Compatible as _, LandlockStatus,
    PathBeneath, PathFd, RulesetAttr as _, RulesetCreatedAttr as _, RulesetError, Scope,
};

/// The kernel interface that was read when this was written. What a kernel does not have is left out.
const KNOWN: ABI = ABI::V9;

/// Since this one, no file is emptied that may not be written.
pub(super) const TRUNCATES: i32 = 3;
/// Since this one, signals and abstract sockets stay among a plugin's own processes.
pub(super) const SCOPES: i32 = 6;
/// Since this one, sockets are reached by their path only where that is allowed.
pub(super) const SOCKETS: i32 = 9;

/// Files, by what may be done with them.
#[derive(Debug, Default)]
pub(super) struct Files<'f> {
    /// To be read and executed.
    pub(super) read: Vec<&'f PathBuf>,
    /// To be read, written, made and removed.
    pub(super) write: Vec<&'f PathBuf>,
    /// Sockets to connect to.
    pub(super) sockets: Vec<&'f PathBuf>,
    /// Whether TCP may be used.
    pub(super) network: bool,
}

/// Restricts this process for good; the version of Landlock that the kernel has, 0 for none.
pub(super) fn restrict(files: &Files<'_>) -> Result<i32, RulesetError> {
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
        // What is not there cannot be reached anyway.
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
