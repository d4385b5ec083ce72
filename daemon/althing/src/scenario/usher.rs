//! The usher: says when all who are expected can be planned with.

use std::collections::BTreeSet;

use acl::AgentId;
use acl::content::{Inform, Snapshot};
use agent::{Agent, Ask, Callbacks, Context, Presence, Resource, Work};
use tokio::sync::oneshot;

/// Stands at the door.
pub(super) struct Usher {
    expected: BTreeSet<String>,
    seen: Option<oneshot::Sender<()>>,
    asking: Option<Work>,
}

impl Agent for Usher {
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

impl Usher {
    /// Waits for these; `seen` hears when all are there.
    pub(super) fn new(expected: BTreeSet<String>, seen: oneshot::Sender<()>) -> Usher {
        Usher { expected, seen: Some(seen), asking: None }
    }

    fn informed(&mut self, message: acl::Message, ctx: &mut Context<Self>) {
        if let Ok(Inform::Epoch(_)) = message.content_as::<Inform>() {
            self.look(ctx);
        }
    }

    /// Asks who can be planned with.
    fn look(&mut self, ctx: &mut Context<Self>) {
        if self.seen.is_none() {
            return;
        }
        let ask = Ask {
            daemon: None,
            resource: Resource::Domain,
            agent: AgentId::new("domain-maintainer").ok(),
        };
        let asked = ctx.switchboard().ask(ask, ctx.settings().answer_deadline);
        self.asking = Some(ctx.run(asked, |usher: &mut Self, answers, _| {
            let snapshot =
                answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
            let Some(snapshot) = snapshot else { return };
            let is_here = |name: &String| snapshot.offers.contains_key(name.as_str());
            // A sensor mounted on a robot can act once its robot is there too.
            if usher.expected.iter().all(is_here)
                && let Some(seen) = usher.seen.take()
            {
                // The play may be over.
                let _ = seen.send(());
            }
        }));
    }
}
