//! Open exchanges of the agents of a process.

use std::collections::BTreeMap;
use std::sync::{Mutex, PoisonError};
use std::time::Duration;

use acl::{AgentId, Incarnation};
use agent::ExchangeSummary;
use tokio::time::Instant;

/// How long an exchange may stay open after its deadline. The waiting agent is woken at the
/// deadline in simulated time, and its reaction takes no time.
const MARGIN: Duration = Duration::from_millis(100);

/// Open exchanges of each incarnation of each agent, as last reported.
#[derive(Default)]
pub struct OpenExchanges(Mutex<BTreeMap<(AgentId, Incarnation), ExchangeSummary>>);

impl OpenExchanges {
    /// Records the open exchanges of an agent.
    pub fn record_exchanges(
        &self,
        agent: &AgentId,
        incarnation: Incarnation,
        exchanges: ExchangeSummary,
    ) {
        self.with(|waits| {
            if exchanges.open_count == 0 {
                waits.remove(&(agent.clone(), incarnation));
            } else {
                waits.insert((agent.clone(), incarnation), exchanges);
            }
        });
    }

    /// Returns the exchanges that are open beyond their deadline.
    pub fn overdue(&self, now: Instant) -> Vec<String> {
        self.with(|waits| {
            let late = waits.iter().filter(|(_, it)| it.due.is_none_or(|due| due + MARGIN < now));
            late.map(|((agent, _), _)| format!("`{agent}` waits beyond its deadline")).collect()
        })
    }

    /// Returns the agents that wait, each with its number of open exchanges.
    pub fn open(&self) -> Vec<(AgentId, usize)> {
        self.with(|waits| {
            waits.iter().map(|((agent, _), it)| (agent.clone(), it.open_count)).collect()
        })
    }

    fn with<T>(
        &self,
        act: impl FnOnce(&mut BTreeMap<(AgentId, Incarnation), ExchangeSummary>) -> T,
    ) -> T {
        act(&mut self.0.lock().unwrap_or_else(PoisonError::into_inner))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[tokio::test(start_paused = true)]
    async fn an_overdue_exchange_is_listed_until_it_ends() {
        let (waits, now) = (OpenExchanges::default(), Instant::now());
        let (robot, incarnation) = (AgentId::new("robot").expect("a name"), Incarnation(1));
        let due = now + Duration::from_secs(1);
        waits.record_exchanges(
            &robot,
            incarnation,
            ExchangeSummary { open_count: 2, due: Some(due) },
        );
        assert_eq!(waits.open(), [(robot.clone(), 2)]);
        assert_eq!(waits.overdue(due + MARGIN), [""; 0]);
        assert_eq!(waits.overdue(due + MARGIN * 2).len(), 1);
        waits.record_exchanges(&robot, incarnation, ExchangeSummary::default());
        assert_eq!((waits.open(), waits.overdue(due + MARGIN * 2)), (vec![], vec![]));
    }
}
