//! Reports of a daemon about itself, which other daemons query: the state of its plugins, the
//! digests of its files, and the agents that it has discovered.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};

use acl::DaemonId;
use acl::content::{Discovered, DiscoveryReport};
use bytes::Bytes;

/// Sources of the reports of a daemon about itself: its plugins, its files, and the agents that it
/// has discovered.
#[derive(Default)]
pub(crate) struct DaemonReports {
    /// Function that returns the state of the plugins that run as processes. Set only if the daemon
    /// hosts such plugins.
    plugins: OnceLock<Box<dyn Fn() -> String + Send + Sync>>,
    /// Digests of the ecosystem's domain and map, as this daemon has read them.
    files: OnceLock<String>,
    /// Discovered agents, which the ecosystem file does not name, by their discoverer: a gateway, a
    /// board, or the plugin folder.
    discovered: Mutex<BTreeMap<String, Vec<Discovered>>>,
}

impl DaemonReports {
    /// Sets the source of the state of plugins. Only the first call has an effect.
    pub(crate) fn set_plugins(&self, state: Box<dyn Fn() -> String + Send + Sync>) {
        // If a daemon has two plugin hosts, the first one answers.
        let _ = self.plugins.set(state);
    }

    /// Sets the digests of files. Only the first call has an effect.
    pub(crate) fn set_files(&self, digests: String) {
        // The files are read once, at start.
        let _ = self.files.set(digests);
    }

    /// Replaces the list of agents that the discoverer `by` has found. A discoverer is a gateway, a
    /// board, or the plugin folder.
    pub(crate) fn set_discovered(&self, by: &str, agents: Vec<Discovered>) {
        let mut discovered = self.all_discovered();
        match agents.is_empty() {
            true => drop(discovered.remove(by)),
            false => drop(discovered.insert(by.to_owned(), agents)),
        }
    }

    /// Returns the state of the plugins that run as processes; `None` if the daemon hosts no such
    /// plugin.
    pub(crate) fn plugins(&self) -> Option<Bytes> {
        self.plugins.get().map(|state| state().into())
    }

    /// Returns the digests of the domain and of the map; `None` until both files have been read.
    pub(crate) fn files(&self) -> Option<Bytes> {
        self.files.get().cloned().map(Bytes::from)
    }

    /// Returns the report of the daemon `of` about its discovered agents; `None` if it has
    /// discovered none.
    pub(crate) fn discovered(&self, of: &DaemonId) -> Option<Bytes> {
        let discovered: Vec<_> = self.all_discovered().values().flatten().cloned().collect();
        if discovered.is_empty() {
            return None;
        }
        let appeared = DiscoveryReport { daemon: of.clone(), discovered };
        serde_json::to_vec(&appeared).ok().map(Bytes::from)
    }

    fn all_discovered(&self) -> MutexGuard<'_, BTreeMap<String, Vec<Discovered>>> {
        self.discovered.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use acl::AgentId;

    use super::*;

    #[test]
    fn a_report_without_a_source_is_not_given() {
        let reports = DaemonReports::default();
        assert_eq!((reports.plugins(), reports.files()), (None, None));
        reports.set_plugins(Box::new(|| "first".to_owned()));
        reports.set_plugins(Box::new(|| "second".to_owned()));
        reports.set_files("digests".to_owned());
        assert_eq!(reports.plugins(), Some(Bytes::from_static(b"first")));
        assert_eq!(reports.files(), Some(Bytes::from_static(b"digests")));
    }

    #[test]
    fn each_finder_has_one_list_of_discovered_agents() {
        let (reports, daemon) = (DaemonReports::default(), DaemonId::new("d").expect("a name"));
        let found = |name: &str, by: &str| Discovered {
            agent: AgentId::new(name).expect("a name"),
            by: by.to_owned(),
            joined: true,
            problem: None,
            toml: String::new(),
        };
        let names = || {
            let report = reports.discovered(&daemon)?;
            let DiscoveryReport { discovered, .. } =
                serde_json::from_slice(&report).expect("a report");
            Some(discovered.iter().map(|one| one.agent.to_string()).collect::<Vec<_>>())
        };
        assert_eq!(names(), None);
        reports.set_discovered("zigbee", vec![found("a", "zigbee"), found("b", "zigbee")]);
        reports.set_discovered("plugins", vec![found("c", "plugins")]);
        reports.set_discovered("zigbee", vec![found("b", "zigbee")]);
        assert_eq!(names(), Some(vec!["c".to_owned(), "b".to_owned()]));
        reports.set_discovered("zigbee", Vec::new());
        reports.set_discovered("plugins", Vec::new());
        assert_eq!(names(), None);
    }
}
