//! Reports of a daemon about itself, which other daemons query: the state of its plugins, the
//! digests of its files, the agents that it has discovered, and the daemon itself.

use std::collections::BTreeMap;
use std::sync::{Mutex, MutexGuard, OnceLock, PoisonError};
use std::time::Duration;

use acl::content::{ABSENT_MAX, AbsentAgent, DaemonReport, Discovered, DiscoveryReport};
use acl::{AgentId, DaemonId, Millis};
use bytes::Bytes;
use tokio::time::Instant;

/// The unit in which a daemon reports how long its certificate is valid.
const DAY: Duration = Duration::from_secs(24 * 3_600);

/// Sources of the reports of a daemon about itself: its plugins, its files, the agents that it has
/// discovered, its certificate.
pub(crate) struct DaemonReports {
    /// Function that returns the state of the plugins that run as processes. Set only if the daemon
    /// hosts such plugins.
    plugins: OnceLock<Box<dyn Fn() -> String + Send + Sync>>,
    /// Function that returns the digests of the ecosystem's domain and map, as this daemon has read
    /// them.
    files: OnceLock<Box<dyn Fn() -> String + Send + Sync>>,
    /// Function that returns for how long the daemon's certificate is still valid. Set only in a
    /// secured ecosystem.
    certificate: OnceLock<Box<dyn Fn() -> Duration + Send + Sync>>,
    /// Time at which the daemon began.
    began: Instant,
    /// Discovered agents, which the ecosystem file does not name, by their discoverer: a gateway, a
    /// board, or the plugin folder.
    discovered: Mutex<BTreeMap<String, Vec<Discovered>>>,
    /// The agents that the ecosystem file names, sorted by name.
    expected: Mutex<Vec<AbsentAgent>>,
}

impl Default for DaemonReports {
    /// Creates the reports of a daemon that begins now.
    fn default() -> DaemonReports {
        DaemonReports {
            plugins: OnceLock::new(),
            files: OnceLock::new(),
            certificate: OnceLock::new(),
            began: Instant::now(),
            discovered: Mutex::default(),
            expected: Mutex::default(),
        }
    }
}

impl DaemonReports {
    /// Sets the source of the state of plugins. Only the first call has an effect.
    pub(crate) fn set_plugins(&self, state: Box<dyn Fn() -> String + Send + Sync>) {
        // If a daemon has two plugin hosts, the first one answers.
        let _ = self.plugins.set(state);
    }

    /// Sets the source of the digests of files. Only the first call has an effect.
    pub(crate) fn set_files(&self, digests: Box<dyn Fn() -> String + Send + Sync>) {
        // The files are read once, at start.
        let _ = self.files.set(digests);
    }

    /// Sets the source of how long the daemon's certificate is valid. Only the first call has an
    /// effect.
    pub(crate) fn set_certificate(&self, left: Box<dyn Fn() -> Duration + Send + Sync>) {
        // A daemon has one certificate in an ecosystem.
        let _ = self.certificate.set(left);
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

    /// Replaces the list of agents that the ecosystem file names.
    pub(crate) fn set_expected(&self, mut agents: Vec<AbsentAgent>) {
        agents.sort();
        *self.expected.lock().unwrap_or_else(PoisonError::into_inner) = agents;
    }

    /// Returns the agents that the ecosystem file names and that are not present.
    pub(crate) fn absent(&self, is_present: impl Fn(&AgentId) -> bool) -> Vec<AbsentAgent> {
        let expected = self.expected.lock().unwrap_or_else(PoisonError::into_inner);
        let absent = expected.iter().filter(|expected| !is_present(&expected.agent));
        absent.take(ABSENT_MAX).cloned().collect()
    }

    /// Returns the state of the plugins that run as processes; `None` if the daemon hosts no such
    /// plugin.
    pub(crate) fn plugins(&self) -> Option<Bytes> {
        self.plugins.get().map(|state| state().into())
    }

    /// Returns the digests of the domain and of the map; `None` until both files have been read.
    pub(crate) fn files(&self) -> Option<Bytes> {
        self.files.get().map(|digests| digests().into())
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

    /// Returns how long the daemon has been running.
    pub(crate) fn uptime(&self) -> Duration {
        self.began.elapsed()
    }

    /// Returns how long the daemon's certificate is still valid; `None` if it has no certificate.
    pub(crate) fn certificate_left(&self) -> Option<Duration> {
        self.certificate.get().map(|left| left())
    }

    /// Returns the report of `daemon` about itself. The daemon hosts `agents` agents; of the agents
    /// with replicas, it `leads` some and `stands_by` for others. It misses the agents `absent`.
    pub(crate) fn daemon(
        &self,
        daemon: DaemonId,
        agents: usize,
        leads: Vec<AgentId>,
        stands_by: Vec<AgentId>,
        absent: Vec<AbsentAgent>,
    ) -> DaemonReport {
        let process = machine::process_figures();
        let days = |left: Duration| left.as_secs() / DAY.as_secs();
        DaemonReport {
            daemon,
            version: env!("CARGO_PKG_VERSION").to_owned(),
            uptime: Millis(self.uptime()),
            agents: u64::try_from(agents).unwrap_or(u64::MAX),
            leads,
            stands_by,
            absent,
            certificate_days_left: self.certificate_left().map(days),
            memory_bytes: process.memory_resident,
            open_files: process.open_files,
            open_files_max: process.open_files_max,
        }
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
        reports.set_files(Box::new(|| "digests".to_owned()));
        assert_eq!(reports.plugins(), Some(Bytes::from_static(b"first")));
        assert_eq!(reports.files(), Some(Bytes::from_static(b"digests")));
    }

    #[tokio::test(start_paused = true)]
    async fn a_daemon_reports_its_age_and_its_certificate() {
        let reports = DaemonReports::default();
        let report = || {
            let (daemon, leads) = (DaemonId::new("d").expect("a name"), Vec::new());
            reports.daemon(daemon, 3, leads, Vec::new(), Vec::new())
        };
        let fresh = report();
        assert_eq!((fresh.uptime, fresh.certificate_days_left, fresh.agents), (0.into(), None, 3));
        tokio::time::advance(Duration::from_secs(7)).await;
        reports.set_certificate(Box::new(|| DAY * 3 - Duration::from_secs(1)));
        let later = report();
        assert_eq!((later.uptime, later.certificate_days_left), (7_000.into(), Some(2)));
        let text = serde_json::to_string(&later).expect("JSON");
        assert_eq!(serde_json::from_str::<DaemonReport>(&text).expect("a report"), later);
    }

    #[test]
    fn agents_of_the_file_that_are_not_seen_are_absent() {
        let reports = DaemonReports::default();
        let expected = |name: String| AbsentAgent {
            agent: AgentId::new(&name).expect("a name"),
            daemons: Vec::new(),
        };
        assert!(reports.absent(|_| false).is_empty());
        reports
            .set_expected((0..300).map(|number| expected(format!("lamp-{number:03}"))).collect());
        let absent = reports.absent(|agent| agent.as_str() < "lamp-250");
        assert_eq!(absent.len(), 50);
        assert_eq!(absent.first(), Some(&expected("lamp-250".to_owned())));
        assert_eq!(reports.absent(|_| false).len(), ABSENT_MAX);
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
