//! A call for proposals, the proposals, and their acceptance or rejection: which agent receives
//! what, and how many messages that takes.

use std::sync::{Arc, Mutex};
use std::time::Duration;

use acl::{
    AgentId, ConversationId, DaemonId, EcosystemId, Incarnation, Message, Performative, Protocol,
};
use agent::{
    Agent, AgentSettings, Callbacks, Context, ExchangeEvent, ExchangeOpening, LaunchContext,
    LaunchableAgent, MessageRouter, Participation,
};
use serde_json::Value;
use substrate::memory::Network;
use substrate::{Destination, Subject};
use tokio::sync::mpsc;
use tokio_util::sync::CancellationToken;

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

/// Agent that calls for proposals, accepts the first of `bidders` proposals, and rejects the rest.
struct Caller {
    bidders: usize,
    proposed: Vec<AgentId>,
}

impl Agent for Caller {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: None,
            performative: Performative::Cfp,
            protocol: Protocol::ContractNet,
            conversation: ConversationId::new("c"),
            content: Value::Null,
        };
        let token = Arc::new(Mutex::new(None));
        let called = Arc::clone(&token);
        let opened =
            ctx.open(opening, Duration::from_secs(10), move |caller: &mut Self, answer, ctx| {
                let ExchangeEvent::Message(message) = answer else { return };
                caller.proposed.push(message.sender.clone());
                let token = called.lock().expect("unbroken").clone();
                if let Some(token) = token.filter(|_| caller.proposed.len() == caller.bidders) {
                    caller.proposed.sort();
                    let rejected = caller.proposed.split_off(1);
                    let first = &caller.proposed[0];
                    ctx.send_turn(&token, first, Performative::AcceptProposal, Value::Null);
                    ctx.multicast_turn(&token, rejected, Performative::RejectProposal, Value::Null);
                    ctx.close(&token);
                }
            });
        *token.lock().expect("unbroken") = Some(opened);
    }
}

/// Agent that proposes, and reports whether its proposal is accepted or rejected.
struct Bidder(mpsc::UnboundedSender<String>);

impl Agent for Bidder {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on_broadcast(Performative::Cfp, Self::called)
            .on_broadcast(Performative::RejectProposal, Self::judged)
            .on(Performative::AcceptProposal, Self::judged)
            .on(Performative::RejectProposal, Self::judged)
    }
}

impl Bidder {
    fn called(&mut self, message: Message, ctx: &mut Context<Self>) {
        ctx.answer(&Participation::of(&message), Performative::Agree, &());
    }

    fn judged(&mut self, message: Message, ctx: &mut Context<Self>) {
        let _ = self.0.send(format!("{} {}", ctx.id(), message.performative));
    }
}

#[tokio::test(start_paused = true)]
async fn one_broadcast_rejects_all_other_proposals_and_replaces_their_receipts() {
    let network = Network::default();
    let said = Arc::new(Mutex::new(Vec::new()));
    let taps = Arc::clone(&said);
    network.tap(move |addressed, _| {
        let what = match addressed {
            Destination::To(_, Subject::Receipt) => "receipt".to_owned(),
            Destination::To(_, Subject::Message(performative)) => performative.to_string(),
            Destination::All(_, performative) => format!("{performative} to all"),
            Destination::AgentState(_) => "beat".to_owned(),
        };
        taps.lock().expect("unbroken").push(what);
    });
    let (tell, mut heard) = mpsc::unbounded_channel();
    let launch = |agent: Box<dyn LaunchableAgent>, id: &str, router: &Arc<MessageRouter>| {
        agent.launch(LaunchContext {
            id: name(id),
            incarnation: Incarnation(1),
            router: Arc::clone(router),
            ontology: Arc::from("test"),
            stopping: CancellationToken::new(),
            has_replicas: false,
            via: [].into(),
        })
    };
    let open = |daemon: &str| {
        let daemon = DaemonId::new(daemon).expect("a name");
        let ecosystem = EcosystemId::new("test").expect("a name");
        let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
        router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
        router
    };
    let (here, there) = (open("here"), open("there"));
    for (id, daemon) in [("a", &here), ("b", &here), ("c", &there), ("d", &there)] {
        launch(Box::new(Bidder(tell.clone())), id, daemon);
    }
    tokio::time::sleep(Duration::from_millis(1)).await;
    launch(Box::new(Caller { bidders: 4, proposed: Vec::new() }), "caller", &here);
    let mut judged = Vec::new();
    for _ in 0..4 {
        judged.push(heard.recv().await.expect("a judgment"));
    }
    judged.sort();
    let rejected = ["b", "c", "d"].map(|who| format!("{who} reject-proposal"));
    assert_eq!(judged[0], "a accept-proposal");
    assert_eq!(judged[1..], rejected);
    // Long enough for every receipt and every retry.
    tokio::time::sleep(Duration::from_secs(5)).await;
    let mut said = said.lock().expect("unbroken").clone();
    said.sort();
    let agrees = ["agree"; 4];
    let expected =
        [&["accept-proposal"][..], &agrees, &["cfp to all", "receipt", "reject-proposal to all"]];
    assert_eq!(said, expected.concat(), "one receipt: for what is to be done");
}
