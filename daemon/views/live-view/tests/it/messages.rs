//! Messages as agents send them, for tests.

use acl::{AgentId, ConversationId, DaemonId, EcosystemId, Message};
use live_view::{AgentPlace, LiveView, Moment, ViewEvent, ViewLimits};
use serde_json::{Value, json};

/// A view with a clock, to which messages are told.
pub(crate) struct Observer {
    pub(crate) view: LiveView,
    pub(crate) now: Moment,
    count: u64,
}

pub(crate) fn agent(name: &str) -> AgentId {
    AgentId::new(name).expect("a name")
}

pub(crate) fn conversation(id: &str) -> ConversationId {
    ConversationId::new(id)
}

pub(crate) fn place(agent_name: &str, daemon: &str, incarnation: u64) -> AgentPlace {
    AgentPlace {
        agent: agent(agent_name),
        daemon: DaemonId::new(daemon).expect("a name"),
        incarnation: acl::Incarnation(incarnation),
    }
}

/// Reads a content from JSON.
pub(crate) fn from_json<T: serde::de::DeserializeOwned>(value: Value) -> T {
    serde_json::from_value(value).expect("a content")
}

impl Observer {
    pub(crate) fn new() -> Observer {
        Observer::with(ViewLimits::default())
    }

    pub(crate) fn with(limits: ViewLimits) -> Observer {
        let ecosystem = EcosystemId::new("smart-office").expect("a name");
        Observer { view: LiveView::new(ecosystem, limits), now: Moment(1_000_000), count: 0 }
    }

    /// Lets time pass.
    pub(crate) fn after(&mut self, milliseconds: u64) -> &mut Observer {
        self.now = self.now.plus(milliseconds);
        self
    }

    pub(crate) fn observe(&mut self, event: ViewEvent) -> &mut Observer {
        self.view.observe(self.now, event);
        self
    }

    /// Tells a message. `line` is `SENDER>RECEIVER PERFORMATIVE PROTOCOL CONVERSATION EXCHANGE`;
    /// the receiver `*` is all, the protocol and the exchange may be `-`.
    pub(crate) fn hear(&mut self, line: &str, content: Value) -> &mut Observer {
        self.count += 1;
        let message = message(line, content, self.count);
        self.observe(ViewEvent::Message(Box::new(message)))
    }

    /// Tells the action model of an agent with the facts that it owns.
    pub(crate) fn announce(&mut self, name: &str, model: &str, facts: &str) -> &mut Observer {
        let model = format!("(define (agent {name}) (:domain smart-office) {model})");
        let content = json!({
            "of": "model", "model": model, "digest": "d", "sequence": 1, "facts": facts,
            "period": 1000,
        });
        self.hear(&format!("{name}>* inform - {name} -"), content)
    }

    /// Tells a heartbeat of an agent.
    pub(crate) fn beat(&mut self, name: &str, sequence: u64, facts: &str) -> &mut Observer {
        let content = json!({
            "of": "heartbeat", "digest": "d", "sequence": sequence, "facts": facts, "period": 1000,
        });
        self.hear(&format!("{name}>* inform - {name} -"), content)
    }

    /// Returns the sentences so far.
    pub(crate) fn sentences(&self) -> Vec<String> {
        self.view.activity().map(|entry| entry.text.clone()).collect()
    }
}

/// Returns the message that a line describes; see [`Observer::hear`].
pub(crate) fn message(line: &str, content: Value, number: u64) -> Message {
    let words: Vec<_> = line.split(' ').collect();
    let [who, performative, protocol, conversation, exchange] = words.as_slice() else {
        panic!("a test line has five words: {line}");
    };
    let (sender, receiver) = who.split_once('>').expect("a test line has an arrow");
    let opens = ["request", "cfp", "query-ref"].contains(performative);
    let mut message = json!({
        "version": 2, "id": format!("m{number}"), "performative": performative, "sender": sender,
        "incarnation": 1, "conversation_id": conversation, "content": content,
    });
    if receiver != "*" {
        message["receiver"] = receiver.split(',').collect();
    }
    if *protocol != "-" {
        message["protocol"] = json!(protocol);
    }
    if *exchange != "-" {
        let key = if opens { "reply_with" } else { "in_reply_to" };
        message[key] = json!(exchange);
    }
    if *performative == "query-ref" {
        message["reply_within"] = json!(60_000);
    }
    serde_json::from_value(message).expect("a message")
}
