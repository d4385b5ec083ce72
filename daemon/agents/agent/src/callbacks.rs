//! Table of callbacks: the messages that an agent reacts to.

use std::collections::BTreeMap;

use acl::{Message, Performative};

use crate::context::Context;

/// Handler of a message.
pub(crate) type Callback<A> = fn(&mut A, Message, &mut Context<A>);

/// Table of an agent's callbacks: one per performative for direct messages, and one per
/// performative for broadcasts.
///
/// A message that continues an exchange opened by this agent goes to the callback of that exchange
/// instead. A direct message without a callback is answered with `not-understood`. A broadcast
/// without a callback is not put into the agent's mailbox.
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

    /// Sets the callback for direct messages with this performative.
    #[must_use]
    pub fn on(mut self, performative: Performative, callback: Callback<A>) -> Callbacks<A> {
        self.direct.insert(performative, callback);
        self
    }

    /// Sets the callback for broadcasts with this performative.
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

    /// Returns the performatives of the direct messages that have a callback, separated by commas,
    /// for an error message.
    pub(crate) fn understood(&self) -> String {
        let names: Vec<_> = self.direct.keys().map(|performative| performative.as_str()).collect();
        names.join(", ")
    }
}
