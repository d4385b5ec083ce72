//! Checks whether the operating system lets this process open as many files as a daemon needs.
//! Connections count as files, and a daemon that has reached the limit can accept no connection and
//! write no file.

use rustix::process::{Resource, getrlimit};

/// Number of open files that the daemon of a building needs: about forty for itself, two for each
/// connection with another daemon or a command, and several for each plugin that runs as a process.
pub(crate) const OPEN_FILES_NEEDED: u64 = 512;

/// Logs a warning if the limit on open files is too low for a daemon.
pub(crate) fn warn_of_few_file_handles() {
    let (limit, most) = open_files_limit();
    if let Some(warning) = warning(limit, most) {
        tracing::warn!("{warning}");
    }
}

/// Returns how many files this process may have open, and up to how many this user may raise that
/// limit; [`u64::MAX`] where there is none.
pub(crate) fn open_files_limit() -> (u64, u64) {
    let limits = getrlimit(Resource::Nofile);
    (limits.current.unwrap_or(u64::MAX), limits.maximum.unwrap_or(u64::MAX))
}

/// Returns the warning about the limit `limit`, which this user may raise up to `most`. Returns
/// `None` if the limit is high enough.
fn warning(limit: u64, most: u64) -> Option<String> {
    if limit >= OPEN_FILES_NEEDED {
        return None;
    }
    let cure = if most >= OPEN_FILES_NEEDED {
        format!(
            "raise it with `ulimit -n {OPEN_FILES_NEEDED}`, or `LimitNOFILE={OPEN_FILES_NEEDED}` in the service's unit"
        )
    } else {
        format!(
            "only the administrator can raise it beyond {most}: `LimitNOFILE={OPEN_FILES_NEEDED}` in the \
             service's unit, or `nofile` in /etc/security/limits.conf"
        )
    };
    Some(format!(
        "this process may have only {limit} files open at a time, connections among them, and a \
         daemon needs up to {OPEN_FILES_NEEDED}: beyond the limit it can accept no command and no other daemon; \
         {cure}"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_low_limit_yields_a_warning_with_its_remedy() {
        assert_eq!(warning(1_024, 1_048_576), None);
        let low = warning(64, 1_048_576).expect("it is low");
        assert!(low.contains("only 64 files") && low.contains("ulimit -n 512"), "{low}");
        let fixed = warning(64, 64).expect("it is low");
        assert!(fixed.contains("administrator") && !fixed.contains("ulimit"), "{fixed}");
    }
}
