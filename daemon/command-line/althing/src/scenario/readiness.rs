//! A helper agent that notifies the scenario when all expected agents are in the composite domain.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use acl::content::{Inform, Snapshot};
use agent::{Agent, Callbacks, Context, Presence, Resource, ResourceQuery, WorkHandle};
use tokio::sync::oneshot;

/// An agent that waits until the expected agents are in the composite domain.
pub(super) struct ReadinessProbe {
    /// Names of agents, each with the actions that it must offer.
    expected: BTreeMap<String, Vec<String>>,
    /// Names of objects that must be in the composite domain.
    objects: BTreeSet<String>,
    seen: Option<oneshot::Sender<()>>,
    asking: Option<WorkHandle>,
}

impl Agent for ReadinessProbe {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(acl::Performative::Inform, Self::informed)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.look(ctx);
    }

    fn presence(&mut self, _presence: &Presence, ctx: &mut Context<Self>) {
        self.look(ctx);
    }
}

impl ReadinessProbe {
    /// Creates an agent that waits for the agents in `expected`, each with its actions, and for
    /// `objects`; `seen` is notified when all are in the composite domain.
    pub(super) fn new(
        expected: BTreeMap<String, Vec<String>>,
        objects: BTreeSet<String>,
        seen: oneshot::Sender<()>,
    ) -> ReadinessProbe {
        ReadinessProbe { expected, objects, seen: Some(seen), asking: None }
    }

    fn informed(&mut self, message: acl::Message, ctx: &mut Context<Self>) {
        if let Ok(Inform::Epoch(_)) = message.content_as::<Inform>() {
            self.look(ctx);
        }
    }

    /// Queries the composite domain, and finds out which agents plans can use.
    fn look(&mut self, ctx: &mut Context<Self>) {
        if self.seen.is_none() {
            return;
        }
        let ask = ResourceQuery {
            daemon: None,
            resource: Resource::Domain,
            agent: AgentId::new("domain-maintainer").ok(),
        };
        let asked = ctx.query(ask);
        self.asking = Some(ctx.run(asked, |usher: &mut Self, answers, _| {
            let snapshot =
                answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
            let Some(snapshot) = snapshot else { return };
            let is_here = |(name, actions): (&String, &Vec<String>)| {
                let offers = snapshot.offers.get(name.as_str());
                offers.is_some_and(|offers| actions.iter().all(|name| offers.contains_key(name)))
            };
            // The domain contains a sensor on a robot only if the robot is present, too.
            let is_known = |name: &String| {
                snapshot.problem.split([' ', '\n', '(', ')']).any(|word| word == name)
            };
            if usher.expected.iter().all(is_here)
                && usher.objects.iter().all(is_known)
                && let Some(seen) = usher.seen.take()
            {
                // The receiver is gone if the scenario has ended.
                let _ = seen.send(());
            }
        }));
    }
}
