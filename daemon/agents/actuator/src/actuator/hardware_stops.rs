//! Hardware stops at an actuator: it tells its daemon whether it is a button that is pressed, and
//! whether the agents of buttons are absent. The rules are those of the crate `agent`
//! (`stop_buttons.rs`).

use acl::content::{Reason, Refusal};
use agent::Context;
use pddl::InitElement;

use super::Actuator;

impl Actuator {
    /// Makes the stops of the daemon follow the hardware stops of the ecosystem. Called with each
    /// heartbeat, before it lists the stops in force.
    pub(super) fn apply_buttons(&self, ctx: &Context<Self>) {
        let Some(buttons) = &self.buttons else { return };
        let now = ctx.now();
        for button in buttons.names() {
            if button == ctx.id() {
                let facts = self.device.facts().into_iter();
                let facts: Vec<InitElement> = facts.map(|fact| fact.fact).collect();
                buttons.hear(button, ctx.incarnation(), &facts, now);
            } else if ctx.find(button).is_none() {
                buttons.miss(button, now);
            }
        }
        buttons.apply(&self.stops, now);
    }

    /// Splits the identifiers of stops that are to be released into those that may be released and
    /// the refusal of the others: a button that is pressed goes on stopping.
    pub(super) fn releasable(
        &self,
        ids: &[String],
        ctx: &Context<Self>,
    ) -> (Vec<String>, Option<Refusal>) {
        let Some(buttons) = &self.buttons else { return (ids.to_vec(), None) };
        let (mut releasable, mut refusal) = (Vec::new(), None);
        for id in ids {
            match buttons.objection(&self.stops, id, ctx.now()) {
                // The stop stays in force at this daemon, and does not concern this agent.
                Some(_) if !self.is_stopped_by(id, ctx.id()) => (),
                Some(why) => {
                    let detail = format!("still stopped: {why}");
                    refusal = Some(Refusal::new(Reason::Conflict, detail));
                }
                None => releasable.push(id.clone()),
            }
        }
        (releasable, refusal)
    }
}
