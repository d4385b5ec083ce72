//! Table of callbacks: the messages that an agent reacts to.

use std::collections::BTreeMap;

use acl::{Message, Performative};

use crate::context::Context;

/// Handler of a message.
pub(crate) type Callback<A> = fn(&mut A, Message, &mut Context<A>);

/// Table of an agent's callbacks: one per performative, for messages to this agent and for messages to
/// all agents.
///
/// A message that continues an exchange opened by this agent goes to the callback of that exchange
/// instead. A direct message with a performative without a callback is answered with `not-understood`;
/// a broadcast with such a performative is not even delivered.
pub struct Callbacks<A> {
    direct: BTreeMap<Performative, Callback<A>>,
    broadcast: BTreeMap<Performative, Callback<A>>,
}

impl<A> Default for Callbacks<A> {
    fn default() -> Callbacks<A> {
        Callbacks { direct: BTreeMap::new(), broadcast: BTreeMap::new() }
    }
}

impl<A> Callbacks<A> {
    /// Creates a table without callbacks.
    pub fn new() -> Callbacks<A> {
        Callbacks::default()
    }

    /// Sets the callback for messages with this performative to this agent.
    #[must_use]
    pub fn on(mut self, performative: Performative, callback: Callback<A>) -> Callbacks<A> {
        self.direct.insert(performative, callback);
        self
    }

    /// Sets the callback for messages with this performative to all agents.
    #[must_use]
    pub fn on_broadcast(
        mut self,
        performative: Performative,
        callback: Callback<A>,
    ) -> Callbacks<A> {
        self.broadcast.insert(performative, callback);
        self
    }

    pub(crate) fn direct(&self, performative: Performative) -> Option<Callback<A>> {
        self.direct.get(&performative).copied()
    }

    pub(crate) fn broadcast(&self, performative: Performative) -> Option<Callback<A>> {
        self.broadcast.get(&performative).copied()
    }

    /// Returns the performatives of the broadcasts that this agent listens to.
    pub(crate) fn interests(&self) -> Vec<Performative> {
        self.broadcast.keys().copied().collect()
    }

    /// Returns the performatives of the messages that this agent takes, as text for a person.
    pub(crate) fn understood(&self) -> String {
        let names: Vec<_> = self.direct.keys().map(|performative| performative.as_str()).collect();
        names.join(", ")
    }
}
