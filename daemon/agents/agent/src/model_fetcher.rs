//! Requests for models that this daemon has missed. If many models of one daemon are missing at the
//! same moment, they are requested together. This happens to a daemon that joins a building full of
//! other daemons.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use acl::{AgentId, DaemonId};
use bytes::Bytes;
use substrate::{BoxFuture, Resource, ResourceQuery, Substrate};
use tokio::sync::oneshot;

use crate::broadcast_cache::MODEL_BYTES_MAX;

/// Number of requests to one daemon that are sent one by one, without delay. Thus the model of an
/// agent that has returned arrives before other agents decide by an outdated announcement.
const FEW: usize = 16;

/// Time for which the requests after the first [`FEW`] wait to be combined. A batch of heartbeats
/// reveals many missing models at one moment.
const GATHERED_WITHIN: Duration = Duration::from_millis(2);

/// Requests for models that are under way, by the daemon that hosts the agents.
#[derive(Clone, Default)]
pub(crate) struct ModelFetcher(Arc<Mutex<BTreeMap<DaemonId, PendingRequests>>>);

#[derive(Default)]
struct PendingRequests {
    /// Number of requests for a single model that are under way.
    asked: usize,
    /// Agents that the next joint request asks for their models, each with the channel that
    /// receives the model.
    waiting: Vec<(AgentId, oneshot::Sender<Vec<Bytes>>)>,
}

impl ModelFetcher {
    /// Requests the model of `agent` from the daemon that hosts the agent. Resolves to an empty
    /// list if no answer comes within `deadline`. The first [`FEW`] requests to a daemon are sent
    /// before this function returns.
    ///
    /// # Panics
    ///
    /// Panics if called outside a Tokio runtime.
    pub(crate) fn model_of(
        &self,
        agent: AgentId,
        daemon: DaemonId,
        substrate: &Arc<dyn Substrate>,
        deadline: Duration,
    ) -> BoxFuture<Vec<Bytes>> {
        let question = |agent| {
            let (daemon, resource) = (Some(daemon.clone()), Resource::Model);
            ResourceQuery { daemon, resource, agent }
        };
        let (tell, told) = oneshot::channel();
        let is_first = {
            let mut missing = self.missing();
            let missing = missing.entry(daemon.clone()).or_default();
            if missing.asked < FEW {
                missing.asked += 1;
                drop(tell);
                None
            } else {
                missing.waiting.push((agent.clone(), tell));
                Some(missing.waiting.len() == 1)
            }
        };
        match is_first {
            None => {
                let answers = substrate.ask(question(Some(agent)), deadline);
                let asked = SingleRequest(self.clone(), daemon);
                return Box::pin(async move {
                    let _asked = asked;
                    let mut answers = answers.await;
                    answers.retain(is_short_enough);
                    answers
                });
            }
            // Runs in a task of its own, because the first caller may drop its future.
            Some(true) => {
                let (fetching, substrate) = (self.clone(), Arc::clone(substrate));
                let question = question(None);
                tokio::spawn(async move {
                    tokio::time::sleep(GATHERED_WITHIN).await;
                    let waiting = fetching.take_waiting(&daemon);
                    share_out(waiting, substrate.ask(question, deadline).await);
                });
            }
            Some(false) => (),
        }
        Box::pin(async move { told.await.unwrap_or_default() })
    }

    fn take_waiting(&self, daemon: &DaemonId) -> Vec<(AgentId, oneshot::Sender<Vec<Bytes>>)> {
        let mut missing = self.missing();
        let waiting = missing.get_mut(daemon).map(|missing| std::mem::take(&mut missing.waiting));
        missing.retain(|_, missing| !missing.is_over());
        waiting.unwrap_or_default()
    }

    fn missing(&self) -> MutexGuard<'_, BTreeMap<DaemonId, PendingRequests>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// A request for a single model of this daemon's agents. The request counts as under way until this
/// value is dropped.
struct SingleRequest(ModelFetcher, DaemonId);

impl Drop for SingleRequest {
    fn drop(&mut self) {
        let mut missing = self.0.missing();
        if let Some(of_daemon) = missing.get_mut(&self.1) {
            of_daemon.asked = of_daemon.asked.saturating_sub(1);
            if of_daemon.is_over() {
                missing.remove(&self.1);
            }
        }
    }
}

impl PendingRequests {
    fn is_over(&self) -> bool {
        self.asked == 0 && self.waiting.is_empty()
    }
}

/// Whether the answer is no longer than a broadcast model may be. A longer answer is logged.
fn is_short_enough(answer: &Bytes) -> bool {
    let (bytes, is_short_enough) = (answer.len(), answer.len() <= MODEL_BYTES_MAX);
    if !is_short_enough {
        tracing::info!(bytes, "a model that is longer than {MODEL_BYTES_MAX} bytes is not read");
    }
    is_short_enough
}

fn share_out(wanted: Vec<(AgentId, oneshot::Sender<Vec<Bytes>>)>, answers: Vec<Bytes>) {
    let mut models = BTreeMap::<AgentId, Vec<Bytes>>::new();
    for answer in answers.into_iter().filter(is_short_enough) {
        match acl::sender_of(&answer) {
            Some(sender) => models.entry(sender).or_default().push(answer),
            None => tracing::info!("an answer that is no model"),
        }
    }
    for (agent, tell) in wanted {
        // The caller may have dropped its future.
        let _ = tell.send(models.remove(&agent).unwrap_or_default());
    }
}

#[cfg(test)]
mod tests {
    use acl::EcosystemId;
    use substrate::memory::Network;
    use substrate::{Delivery, Inbound, Presence, ReceivedQuery};

    use super::*;
    use crate::router::MessageRouter;
    use crate::settings::AgentSettings;

    /// A daemon that hosts many agents, and records the questions that it gets.
    #[derive(Default)]
    struct Full(Mutex<Vec<Option<AgentId>>>);

    impl Inbound for Full {
        fn deliver(&self, _: Delivery) {}
        fn presence(&self, _: Presence) {}
        fn receive_query(&self, question: ReceivedQuery) {
            self.0.lock().expect("no panic").push(question.agent.clone());
            let all = (0..FEW + 9).map(agent);
            for name in all.filter(|name| question.agent.as_ref().is_none_or(|one| one == name)) {
                (question.answer)(Bytes::from(format!(r#"{{"sender":"{name}"}}"#)));
            }
        }
    }

    fn agent(number: usize) -> AgentId {
        AgentId::new(&format!("a-{number}")).expect("a name")
    }

    async fn fetched(count: usize) -> (Vec<Vec<Bytes>>, usize) {
        let (network, full) = (Network::new(), Arc::new(Full::default()));
        let daemon = |name: &str| DaemonId::new(name).expect("a name");
        let ecosystem = EcosystemId::new("office").expect("a name");
        let own = MessageRouter::new(ecosystem, daemon("own"), AgentSettings::default());
        let substrate = network.open(daemon("own"), own);
        network.open(daemon("full"), Arc::<Full>::clone(&full));
        let (fetching, deadline) = (ModelFetcher::default(), Duration::from_secs(1));
        let asking: Vec<_> = (0..count)
            .map(|number| fetching.model_of(agent(number), daemon("full"), &substrate, deadline))
            .collect();
        let mut models = Vec::new();
        for answers in asking {
            models.push(answers.await);
        }
        assert!(fetching.missing().is_empty(), "no model is missing any more");
        let asked = full.0.lock().expect("no panic").len();
        (models, asked)
    }

    #[tokio::test(start_paused = true)]
    async fn many_models_are_requested_together_and_few_one_by_one() {
        for (count, expected) in [(1, 1), (FEW, FEW), (FEW + 1, FEW + 1), (FEW + 9, FEW + 1)] {
            let (mut models, asked) = fetched(count).await;
            models.sort();
            let each = |number| vec![Bytes::from(format!(r#"{{"sender":"a-{number}"}}"#))];
            let mut each: Vec<_> = (0..count).map(each).collect();
            each.sort();
            assert_eq!((models, asked), (each, expected));
        }
        let (models, _) = fetched(FEW + 10).await;
        assert_eq!(models.iter().filter(|models| models.is_empty()).count(), 1, "one is absent");
    }
}
