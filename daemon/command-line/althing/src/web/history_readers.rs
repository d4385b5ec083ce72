//! The agents of this daemon that read the history for pages. An agent that joins or leaves is an event
//! of the history itself, so an agent stays for further reads, and ends when it has not been used for
//! a while.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::AgentId;
use acl::content::HistoryQuery;
use tokio::time::Instant;

use super::DAEMON_CHARS_MAX;
use crate::asking::history_reader::{HistoryAnswer, HistoryReader};
use crate::ecosystem_view::EcosystemView;

/// How long an agent stays without a read. A person that looks at the history every few minutes
/// causes no agent to join or leave.
const IDLE_MAX: Duration = Duration::from_secs(30 * 60);

/// Maximum number of agents that stay. Several pages that read at the same moment need one each.
const IDLE_READERS_MAX: usize = 4;

/// The agents that read the history for pages and are not reading now.
#[derive(Default)]
pub(super) struct HistoryReaders {
    idle: Mutex<Vec<(AgentId, HistoryReader, Instant)>>,
    /// Number of agents launched so far.
    launched: AtomicU64,
}

/// An agent that reads the history for a page. When this value is dropped, also before the read has
/// ended, the agent is kept for the next read.
pub(super) struct PageReader<'r> {
    readers: &'r HistoryReaders,
    agent: AgentId,
    /// Present until this value is dropped.
    reader: Option<HistoryReader>,
}

impl HistoryReaders {
    /// Returns an agent for one read: an idle one, or a new one if there is none. `check` says whether
    /// an agent of this name may read; if not, none is launched.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for the person, if the agent may not read, if the ecosystem has no
    /// history, or if no agent can have the name.
    pub(super) fn take(
        &self,
        view: &EcosystemView,
        check: impl Fn(&AgentId) -> Result<(), String>,
    ) -> Result<PageReader<'_>, String> {
        if let Some((agent, reader, _)) = self.idle().pop() {
            let own = PageReader { readers: self, agent, reader: Some(reader) };
            return check(&own.agent).map(|()| own);
        }
        let agent = self.new_name(view)?;
        check(&agent)?;
        let reader = HistoryReader::open(view, agent.clone());
        let reader = reader.map_err(|error| format!("failed to {error}"))?;
        Ok(PageReader { readers: self, agent, reader: Some(reader) })
    }

    /// Returns a name that no present agent has. Two daemons may have names with equal beginnings.
    fn new_name(&self, view: &EcosystemView) -> Result<AgentId, String> {
        let daemon: String = view.router.daemon().as_str().chars().take(DAEMON_CHARS_MAX).collect();
        loop {
            let number = self.launched.fetch_add(1, Ordering::Relaxed) + 1;
            let agent = AgentId::new(&format!("page-reader{number}-{daemon}"));
            let agent = agent.map_err(|error| error.to_string())?;
            if view.router.find(&agent).is_none() {
                return Ok(agent);
            }
        }
    }

    /// Ends the agents that were not used for a while.
    pub(super) fn end_idle(&self) {
        self.idle().retain(|(_, _, since)| since.elapsed() < IDLE_MAX);
    }

    fn idle(&self) -> MutexGuard<'_, Vec<(AgentId, HistoryReader, Instant)>> {
        self.idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

// === impl PageReader ===

impl PageReader<'_> {
    /// Reads as [`HistoryReader::read`] does.
    pub(super) async fn read(
        &mut self,
        query: &HistoryQuery,
        limit: u32,
        reads_private: bool,
    ) -> Result<HistoryAnswer, String> {
        let reader = self.reader.as_mut().ok_or("the reader of the history has ended")?;
        let answer = reader.read(query, limit, reads_private).await;
        answer.map_err(|error| format!("failed to {error}"))
    }
}

impl Drop for PageReader<'_> {
    fn drop(&mut self) {
        let Some(reader) = self.reader.take().filter(|reader| !reader.has_ended()) else { return };
        let mut idle = self.readers.idle();
        if idle.len() < IDLE_READERS_MAX {
            idle.push((self.agent.clone(), reader, Instant::now()));
        }
    }
}
