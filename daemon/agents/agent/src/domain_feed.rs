//! Feed of the shared domain of one daemon: passes broadcasts and changes of presence to the
//! [`SharedDomain`], and the models that were requested for it.

use std::sync::{Arc, OnceLock};
use std::time::Duration;

use acl::content::Inform;
use acl::{AgentId, Message};
use bytes::Bytes;
use substrate::{BoxFuture, Presence, Resident};
use tokio::runtime::Handle;

use crate::broadcast_cache::{HeartbeatRepetition, inform_of};
use crate::domain_tracker::answered_models;
use crate::host::Host;
use crate::rejections::Rejections;
use crate::shared_domain::SharedDomain;

/// Passes broadcasts to the [`SharedDomain`], the composite domain that the actuators of this
/// daemon share. Does nothing before that domain is created.
pub(crate) struct DomainFeed {
    target: OnceLock<FeedTarget>,
    rejections: Arc<Rejections>,
}

/// The [`SharedDomain`] of a daemon, and the runtime on which requests for models wait for answers.
struct FeedTarget {
    domain: Arc<SharedDomain>,
    runtime: Handle,
}

impl DomainFeed {
    /// Creates a feed without a [`SharedDomain`].
    pub(crate) fn new(rejections: Arc<Rejections>) -> DomainFeed {
        DomainFeed { target: OnceLock::new(), rejections }
    }

    /// Creates the [`SharedDomain`], if it does not exist yet. Returns that domain, and whether it
    /// is new.
    ///
    /// # Panics
    ///
    /// Panics if called outside a Tokio runtime.
    pub(crate) fn create_domain(&self, host: &Host) -> (Arc<SharedDomain>, bool) {
        let create =
            || FeedTarget { domain: Arc::new(SharedDomain::new(host)), runtime: Handle::current() };
        let is_new = self.domain().is_none();
        (Arc::clone(&self.target.get_or_init(create).domain), is_new)
    }

    /// Returns the [`SharedDomain`]; `None` if it is not created yet.
    pub(crate) fn domain(&self) -> Option<&Arc<SharedDomain>> {
        self.target.get().map(|target| &target.domain)
    }

    /// Passes a broadcast `inform` to the [`SharedDomain`]. Returns whether the sender's model must
    /// be requested.
    pub(crate) fn receive(&self, message: &Message, inform: &Inform) -> bool {
        let Some(domain) = self.domain() else { return false };
        let outcome = domain.receive(message, inform);
        if let Some(why) = outcome.not_taken() {
            self.rejections.not_taken(message, why);
        }
        outcome.lacks_model
    }

    /// Passes heartbeats that repeat the previous ones of their senders to the [`SharedDomain`].
    /// Returns, for each, `false` if the heartbeat must be decoded.
    pub(crate) fn receive_repetitions<'r>(
        &self,
        repetitions: impl Iterator<Item = (&'r AgentId, &'r HeartbeatRepetition)>,
    ) -> Vec<bool> {
        match self.domain() {
            Some(domain) => domain.receive_repetitions(repetitions),
            None => repetitions.map(|_| true).collect(),
        }
    }

    /// Passes a change of presence to the [`SharedDomain`]. Returns the time after which the
    /// agent's model must be requested; `None` if the model need not be requested.
    pub(crate) fn presence(&self, presence: &Presence) -> Option<Duration> {
        self.domain()?.presence(presence)
    }

    /// Requests a model by `fetch`, and passes the answers to the [`SharedDomain`]. If the agent
    /// announces its model within `wait`, `fetch` is not called. At most one request per agent is
    /// under way. Reasoning agents have no model and do not answer.
    pub(crate) fn request_model(
        &self,
        of: &Resident,
        wait: Duration,
        fetch: impl FnOnce() -> BoxFuture<Vec<Bytes>> + Send + 'static,
    ) {
        let Some(FeedTarget { domain, runtime }) = self.target.get() else { return };
        if !domain.begin_request(&of.agent) {
            return;
        }
        let (domain, rejections) = (Arc::clone(domain), Arc::clone(&self.rejections));
        let (agent, incarnation) = (of.agent.clone(), of.incarnation);
        runtime.spawn(async move {
            let mut is_announced = false;
            if !wait.is_zero() {
                tokio::time::sleep(wait).await;
                is_announced = domain.has_model(&agent, incarnation);
            }
            let answers = if is_announced { Vec::new() } else { fetch().await };
            for message in answered_models(&agent, answers) {
                if let Some(inform) = inform_of(&message)
                    && let Some(why) = domain.receive(&message, &inform).not_taken()
                {
                    rejections.not_taken(&message, why);
                }
            }
            domain.end_request(&agent);
        });
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicUsize, Ordering};

    use acl::{DaemonId, Incarnation};

    use super::*;

    fn feed() -> DomainFeed {
        let ontology = "(define (domain test) (:predicates (lit)))";
        let map = "(define (problem map) (:domain test) (:init) (:goal (and)))";
        let (ontology, map) = (pddl::parse_domain(ontology).value, pddl::parse_problem(map).value);
        let feed = DomainFeed::new(Arc::default());
        let host = Host::new(ontology.expect("a domain"), map.expect("a problem"));
        assert!(feed.create_domain(&host).1);
        assert!(!feed.create_domain(&host).1, "there is one only");
        feed
    }

    fn lamp() -> Resident {
        Resident {
            agent: AgentId::new("lamp").expect("a name"),
            daemon: DaemonId::new("d").expect("a name"),
            incarnation: Incarnation(1),
        }
    }

    #[tokio::test(start_paused = true)]
    async fn one_request_per_agent_is_under_way() {
        let (feed, fetched) = (feed(), Arc::new(AtomicUsize::new(0)));
        let fetch = |wait| {
            let fetched = Arc::clone(&fetched);
            feed.request_model(&lamp(), wait, move || {
                fetched.fetch_add(1, Ordering::Relaxed);
                Box::pin(std::future::ready(Vec::new()))
            });
        };
        let wait = Duration::from_millis(20);
        fetch(wait);
        fetch(Duration::ZERO);
        tokio::time::sleep(wait * 2).await;
        assert_eq!(fetched.load(Ordering::Relaxed), 1);
        fetch(Duration::ZERO);
        tokio::task::yield_now().await;
        assert_eq!(fetched.load(Ordering::Relaxed), 2, "the first one has ended");
    }

    #[tokio::test]
    async fn nothing_is_requested_before_the_shared_domain_exists() {
        let feed = DomainFeed::new(Arc::default());
        assert_eq!(feed.presence(&Presence::Joined(lamp())), None);
        feed.request_model(&lamp(), Duration::ZERO, || panic!("there is no shared domain"));
        tokio::task::yield_now().await;
    }
}
