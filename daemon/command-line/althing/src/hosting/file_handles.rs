//! Checks whether the operating system lets this process open as many files as a daemon needs.
//! Connections count as files, and a daemon that has reached the limit can accept no connection and
//! write no file.

use nix::sys::resource::{Resource, getrlimit, rlim_t};

/// Number of open files that the daemon of a building needs: about forty for itself, two for each
/// connection with another daemon or a command, and several for each plugin that runs as a process.
const NEEDED: rlim_t = 512;

/// Logs a warning if the limit on open files is too low for a daemon.
pub(crate) fn warn_of_few_file_handles() {
    if let Ok((limit, most)) = getrlimit(Resource::RLIMIT_NOFILE)
        && let Some(warning) = warning(limit, most)
    {
        tracing::warn!("{warning}");
    }
}

/// Returns the warning about the limit `limit`, which this user may raise up to `most`. Returns
/// `None` if the limit is high enough.
fn warning(limit: rlim_t, most: rlim_t) -> Option<String> {
    if limit >= NEEDED {
        return None;
    }
    let cure = if most >= NEEDED {
        format!(
            "raise it with `ulimit -n {NEEDED}`, or `LimitNOFILE={NEEDED}` in the service's unit"
        )
    } else {
        format!(
            "only the administrator can raise it beyond {most}: `LimitNOFILE={NEEDED}` in the \
             service's unit, or `nofile` in /etc/security/limits.conf"
        )
    };
    Some(format!(
        "this process may have only {limit} files open at a time, connections among them, and a \
         daemon needs up to {NEEDED}: beyond the limit it can accept no command and no other daemon; \
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
