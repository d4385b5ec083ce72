//! Means of confinement that this kernel offers, the choice of means for each plugin, and the
//! restrictions that cannot be enforced with the chosen means.
//!
//! The means are tried out, and not derived from a kernel version: a process of the daemon's own
//! program confines itself step by step, and reports which steps succeeded
//! ([`ConfinementMeans::try_out`]).

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::calls::{self, CallFilterOptions};
use super::files::{self, AccessibleFiles};
use super::room::{self, RoomContents};
use super::{PLAIN_DEVICES, SYSTEM, ZERO};
use crate::rights::Permissions;

/// Means of confinement that the kernel offers to the daemon.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub struct ConfinementMeans {
    /// Version of Landlock that the kernel has; 0 if it has none.
    pub landlock: i32,
    /// Reason why the kernel offers no namespaces for a namespace room; `None` if it offers them.
    pub no_namespaces: Option<String>,
    /// Reason why system calls cannot be forbidden (seccomp); `None` if they can be.
    pub no_calls: Option<String>,
    /// Reason why the daemon cannot answer system calls (seccomp user notification); `None` if it
    /// can.
    pub no_questions: Option<String>,
    /// Whether plugins run as root; the kernel does not limit the number of processes of root.
    pub is_root: bool,
}

/// Means of confinement that are used for one plugin, and the properties of the plugin that
/// determine this choice.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct ConfinementPlan {
    /// Whether the plugin runs in a namespace room of its own.
    pub(crate) has_room: bool,
    /// Version of Landlock, which hides files and other processes from the plugin; 0 if there is
    /// none.
    pub(crate) landlock: i32,
    /// Whether system calls that the plugin does not need are forbidden.
    pub(crate) forbids_calls: bool,
    /// Whether system calls that connect a socket or send a signal wait for the daemon's answer.
    pub(crate) is_mediated: bool,
    /// Whether system calls that start a process wait for the daemon's answer, so that it can count
    /// processes.
    pub(crate) counts_processes: bool,
    /// Whether a control group counts the resources that all processes of the plugin take together.
    pub(crate) is_counted: bool,
    /// Whether the plugin may use the Internet.
    pub(crate) network: bool,
    /// Whether the plugin may read files and folders other than its own, which may contain sockets.
    pub(crate) reads_more: bool,
    /// Whether the daemon runs as root.
    pub(crate) is_root: bool,
}

impl ConfinementMeans {
    /// Confines this process as plugins are confined, step by step, and returns the means that
    /// succeeded. Must be called only in a process that ends afterwards. `folder` is any folder
    /// that exists.
    pub(crate) fn try_out(folder: &Path) -> ConfinementMeans {
        let why = |error: &dyn std::error::Error| error.to_string();
        let target = calls::target();
        let unknown = || format!("filters are not known for {}", std::env::consts::ARCH);
        let asked = target.ok_or_else(unknown).and_then(|target| {
            let program = calls::mediated(false, 0, target).map_err(|error| why(&error))?;
            seccomp_notify::listen(&program).map_err(|error| error.to_string())
        });
        let furniture = RoomContents {
            shown: SYSTEM.iter().map(PathBuf::from).collect(),
            devices: PLAIN_DEVICES.iter().chain(&[ZERO]).map(PathBuf::from).collect(),
            sockets: Vec::new(),
            home: folder.to_owned(),
            network: false,
        };
        let entered = room::enter(&furniture);
        let landlock = files::restrict(&AccessibleFiles::default()).unwrap_or(0);
        let choice = CallFilterOptions {
            network: false,
            has_own_mounts: true,
            truncates_own_only: true,
            counts_memory: false,
        };
        let forbidden = target
            .ok_or_else(unknown)
            .and_then(|target| calls::forbid(choice, target).map_err(|error| why(&error)));
        ConfinementMeans {
            landlock,
            no_namespaces: entered.err().map(|error| why(&error)),
            no_calls: forbidden.err(),
            no_questions: asked.err(),
            is_root: rustix::process::geteuid().is_root(),
        }
    }

    /// Returns a value without any means of confinement, with `why` as the reason for each.
    pub(crate) fn none(why: &str) -> ConfinementMeans {
        let why = || Some(why.to_owned());
        ConfinementMeans {
            landlock: 0,
            no_namespaces: why(),
            no_calls: why(),
            no_questions: why(),
            is_root: rustix::process::geteuid().is_root(),
        }
    }

    /// Returns the means that are used for a plugin with these permissions. `is_counted` is `true`
    /// if the plugin has a control group.
    pub(crate) fn plan(&self, permissions: &Permissions, is_counted: bool) -> ConfinementPlan {
        let mut plan = ConfinementPlan {
            has_room: self.no_namespaces.is_none(),
            landlock: self.landlock,
            forbids_calls: self.no_calls.is_none(),
            is_mediated: false,
            counts_processes: false,
            is_counted,
            network: permissions.network,
            reads_more: !permissions.read.is_empty(),
            is_root: self.is_root,
        };
        let can_ask = plan.forbids_calls && self.no_questions.is_none();
        let is_open = !plan.hides_sockets() || !plan.hides_processes() || !plan.hides_names();
        plan.counts_processes = can_ask && !plan.bounds_processes();
        plan.is_mediated = can_ask && (is_open || plan.counts_processes);
        plan
    }
}

impl ConfinementPlan {
    /// Whether the plugin cannot connect to other programs' sockets with a path. In a namespace
    /// room, a process can connect to any socket in a visible folder, even if the folder is
    /// read-only.
    fn hides_sockets(&self) -> bool {
        (self.has_room && !self.reads_more) || self.landlock >= files::SOCKETS || self.is_mediated
    }

    /// Whether the plugin cannot connect to other programs' sockets that have only a name (abstract
    /// sockets).
    fn hides_names(&self) -> bool {
        let has_own_network = self.has_room && !self.network;
        has_own_network || self.landlock >= files::SCOPES || self.is_mediated
    }

    /// Whether processes of others are protected from signals of the plugin.
    fn hides_processes(&self) -> bool {
        self.landlock >= files::SCOPES || self.is_mediated
    }

    /// Whether the number of processes of the plugin is limited, by the kernel or by the daemon's
    /// answers.
    fn bounds_processes(&self) -> bool {
        self.is_counted || (self.has_room && !self.is_root) || self.counts_processes
    }

    /// Whether the files of others are protected from changes by the plugin.
    fn keeps_files(&self) -> bool {
        self.has_room || (self.forbids_calls && self.landlock > 0)
    }

    pub(super) fn choice(&self) -> CallFilterOptions {
        CallFilterOptions {
            network: self.network,
            has_own_mounts: self.has_room,
            truncates_own_only: self.has_room || self.landlock >= files::TRUNCATES,
            counts_memory: self.is_counted,
        }
    }

    /// Returns the restrictions that cannot be enforced for the plugin, each as a sentence for a
    /// person.
    pub(crate) fn lacks(&self) -> Vec<String> {
        let mut lacks = Vec::new();
        let mut say = |is_lacking: bool, what: &str| {
            if is_lacking {
                lacks.push(what.to_owned());
            }
        };
        let hides_files = self.has_room || self.landlock > 0;
        say(!hides_files, "it can read, change and remove all files of this user");
        say(
            hides_files && !self.keeps_files(),
            "it can change modes, times and lengths of files that it can reach",
        );
        let sockets = match self.has_room {
            true => "it can connect to Unix sockets in the folders that `read` names",
            false => "it can connect to Unix sockets of this user, those of daemons included",
        };
        say(!self.hides_sockets(), sockets);
        say(!self.hides_names(), "it can connect to abstract Unix sockets");
        say(!self.hides_processes(), "it can signal other processes of this user");
        say(
            !self.bounds_processes(),
            "the number of its processes is checked four times a second only",
        );
        say(
            !self.forbids_calls,
            "it can make any system call: act on other processes, hold memory that is not counted, \
             open any socket",
        );
        lacks
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn means(landlock: i32, namespaces: bool, questions: bool) -> ConfinementMeans {
        let not = |has: bool| (!has).then(|| "for the test".to_owned());
        ConfinementMeans {
            landlock,
            no_namespaces: not(namespaces),
            no_calls: None,
            no_questions: not(questions),
            is_root: false,
        }
    }

    fn asking(network: bool, read: &[&str]) -> Permissions {
        let read = read.iter().map(PathBuf::from).collect();
        Permissions { network, read, ..Permissions::default() }
    }

    #[test]
    fn every_restriction_is_enforced_on_debian_kernels() {
        for landlock in [2, 6, 7, 9] {
            for namespaces in [true, false] {
                for network in [true, false] {
                    for (is_root, read) in [(true, &[][..]), (false, &[]), (false, &["/srv/a"])] {
                        let means =
                            ConfinementMeans { is_root, ..means(landlock, namespaces, true) };
                        let lacks = means.plan(&asking(network, read), false).lacks();
                        assert!(lacks.is_empty(), "{means:?} {network} {read:?}: {lacks:?}");
                    }
                }
            }
        }
        // Without Landlock, a room is enough.
        assert!(means(0, true, true).plan(&asking(false, &[]), false).lacks().is_empty());
    }

    #[test]
    fn calls_are_mediated_only_if_the_kernel_has_no_other_means() {
        assert!(!means(6, true, true).plan(&asking(false, &[]), false).is_mediated);
        assert!(!means(9, false, true).plan(&asking(true, &[]), true).is_mediated);
        assert!(means(2, true, true).plan(&asking(false, &[]), false).is_mediated, "signals");
        assert!(means(7, false, true).plan(&asking(false, &[]), true).is_mediated, "sockets");
        let reads = asking(false, &["/srv/a"]);
        assert!(means(7, true, true).plan(&reads, true).is_mediated, "sockets in a shown folder");
        assert!(!means(9, true, true).plan(&reads, true).is_mediated);
        assert!(means(9, false, true).plan(&asking(false, &[]), false).counts_processes);
    }

    #[test]
    fn restrictions_that_cannot_be_enforced_are_listed() {
        let without = means(2, false, false).plan(&asking(false, &[]), false).lacks().join("; ");
        for expected in ["Unix sockets of this user", "abstract", "signal", "four times a second"] {
            assert!(without.contains(expected), "{without}");
        }
        let shown = means(7, true, false).plan(&asking(false, &["/srv/a"]), true).lacks();
        assert_eq!(shown, ["it can connect to Unix sockets in the folders that `read` names"]);
        let nothing =
            ConfinementMeans::none("no kernel at all").plan(&asking(false, &[]), false).lacks();
        assert_eq!(nothing.len(), 6, "{nothing:?}");
        let files =
            |means: ConfinementMeans| means.plan(&asking(false, &[]), false).lacks()[0].clone();
        let all = "it can read, change and remove all files of this user";
        assert_eq!(files(ConfinementMeans::none("no kernel at all")), all);
        assert_eq!(files(means(0, false, true)), all);
        let unfiltered =
            ConfinementMeans { no_calls: Some("for the test".to_owned()), ..means(7, false, true) };
        assert!(files(unfiltered).contains("modes, times and lengths"));
    }
}
