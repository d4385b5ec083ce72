//! The Base Agent (the paper, “The Base Agent”): the interface that each kind of agent implements.

use substrate::{Presence, Resource};

use crate::callbacks::Callbacks;
use crate::context::Context;

/// An agent: its state and its callbacks.
pub trait Agent: Sized + Send + 'static {
    /// Returns the table of callbacks for messages.
    fn callbacks(&self) -> Callbacks<Self>;

    /// Called once, when the agent is present and its mailbox is open.
    fn activated(&mut self, _ctx: &mut Context<Self>) {}

    /// Called when the agent becomes the leader or a standby. While the agent is a standby, another
    /// replica of the same name leads at another daemon. An agent without replicas is the leader
    /// from its activation to its end.
    fn leadership_changed(&mut self, _is_leading: bool, _ctx: &mut Context<Self>) {}

    /// Called when another agent joins or leaves. After the activation, called once for each agent
    /// that is present already.
    fn presence(&mut self, _presence: &Presence, _ctx: &mut Context<Self>) {}

    /// Whether the agent wants presence callbacks now. If `false`, the runtime does not wake the
    /// agent when other agents join or leave; the agent can still read [`Context::directory`]. This
    /// avoids waking a thousand idle agents on each join. An agent that has replicas, or has sent
    /// messages that have no receipt yet, gets the callbacks in any case.
    fn wants_presence(&self) -> bool {
        true
    }

    /// Returns the action model that the agent would announce now, as PDDL text; `None` if the
    /// agent has no model.
    fn model(&self) -> Option<String> {
        None
    }

    /// Returns the answer to a query for a resource; `None` if this agent does not serve the
    /// resource.
    fn answer_query(&mut self, _resource: Resource, _ctx: &mut Context<Self>) -> Option<String> {
        None
    }

    /// Called while the daemon shuts down, so that the agent can end its commitments. Returns
    /// `true` once no commitment is open. Until then the method is called again after each event.
    /// The daemon aborts an agent that takes too long.
    fn drain(&mut self, _ctx: &mut Context<Self>) -> bool {
        true
    }
}
