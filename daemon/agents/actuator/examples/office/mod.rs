//! Surroundings of the examples: one daemon on an in-memory network, with the device and a visitor.
//!
//! The visitor calls for proposals for a goal, accepts the first bid, and requests the first step
//! of its plan, as the Plan Requester and the Plan Executor do in an ecosystem.

use std::collections::BTreeMap;
use std::error::Error;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{
    Act, ActionToken, Bid, CallForProposals, Choice, Inform, Refusal, Report, Request, value,
};
use acl::{AgentId, ConversationId, DaemonId, EcosystemId, Message, Performative, Protocol};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, ExchangeEvent, ExchangeOpening, Host,
    LaunchContext, LaunchableAgent, MessageRouter, PluginEntry,
};
use serde_json::Value;
use substrate::memory::Network;
use tokio::sync::Notify;
use tokio_util::sync::CancellationToken;

const ONTOLOGY: &str = include_str!("../../../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../../../domains/smart-office/map.pddl");

/// Maximum time that the visitor waits for bids, and for the end of the action.
const PATIENCE: Duration = Duration::from_secs(5);

/// Wish of the visitor: a goal, and the call of the method that carries out the plan's first step.
pub(crate) struct Wish {
    /// The goal, written as one PDDL fact.
    pub(crate) goal: &'static str,
    /// The method that carries out the first step of the plan. In an ecosystem, the Plan Executor
    /// reads the method from the device's announcement.
    pub(crate) method: &'static str,
    /// The arguments of the method.
    pub(crate) arguments: BTreeMap<String, String>,
}

/// Runs the device `name` until the visitor's request has succeeded or failed.
pub(crate) async fn play(
    plugin: PluginEntry,
    name: &str,
    config: Value,
    wish: Wish,
) -> Result<(), Box<dyn Error>> {
    let ontology = pddl::parse_domain(ONTOLOGY).into_result().expect("the ontology is correct");
    let map = pddl::parse_problem(MAP).into_result().expect("the map is correct");
    let device = (plugin.build)(Blueprint {
        id: AgentId::new(name)?,
        driver: String::new(),
        config: Arc::new(config),
        host: Arc::new(Host::new(ontology, map)),
    })?;

    let network = Network::new();
    let daemon = DaemonId::new("example")?;
    let ecosystem = EcosystemId::new("smart-office")?;
    let router = MessageRouter::new(ecosystem, daemon.clone(), AgentSettings::default());
    router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
    let stopping = CancellationToken::new();
    let launch_context = |id: AgentId| LaunchContext {
        id,
        incarnation: router.host_services().next_incarnation(),
        router: Arc::clone(&router),
        ontology: Arc::from("smart-office"),
        stopping: stopping.clone(),
        has_replicas: false,
        via: [].into(),
    };

    let ended = Arc::new(Notify::new());
    let visitor = Visitor { wish, has_called: false, ended: Arc::clone(&ended) };
    let visitor = Box::new(visitor).launch(launch_context(AgentId::new("visitor")?));
    let device = device.launch(launch_context(AgentId::new(name)?));
    if tokio::time::timeout(2 * PATIENCE, ended.notified()).await.is_err() {
        println!("the wish was not answered in time");
    }
    stopping.cancel();
    visitor.await??;
    device.await??;
    Ok(())
}

/// An agent that listens to the device and requests one action of it.
struct Visitor {
    wish: Wish,
    has_called: bool,
    ended: Arc<Notify>,
}

impl Agent for Visitor {
    fn callbacks(&self) -> Callbacks<Visitor> {
        Callbacks::new().on_broadcast(Performative::Inform, Visitor::informed)
    }
}

impl Visitor {
    /// Prints announcements and heartbeats. The first announcement starts the call for proposals.
    fn informed(&mut self, message: Message, ctx: &mut Context<Visitor>) {
        match message.content_as::<Inform>() {
            Ok(Inform::Model(announcement)) => {
                println!("{} announces\n{}\n", message.sender, announcement.model);
                if !self.has_called {
                    self.has_called = true;
                    self.call(ctx);
                }
            }
            Ok(Inform::Heartbeat(heartbeat)) => {
                // Facts that are known for a limited time are in a table of their own.
                let passing: Vec<_> = heartbeat.known_for.keys().map(String::as_str).collect();
                let (facts, passing) = (heartbeat.facts.trim(), passing.join(" "));
                println!("{} reports {facts} {passing}\n", message.sender);
            }
            _ => (),
        }
    }

    fn call(&mut self, ctx: &mut Context<Visitor>) {
        let conjuncts = vec![self.wish.goal.to_owned()];
        println!("visitor calls for proposals for {}\n", self.wish.goal);
        let call = ExchangeOpening {
            to: None,
            performative: Performative::Cfp,
            protocol: Protocol::ContractNet,
            conversation: ctx.new_conversation(),
            content: value(&CallForProposals { conjuncts, ..CallForProposals::default() }),
        };
        ctx.open(call, PATIENCE, Visitor::judge);
    }

    /// Accepts a bid, and requests the first step of the plan in the bid.
    fn judge(&mut self, answer: ExchangeEvent, ctx: &mut Context<Visitor>) {
        let ExchangeEvent::Message(message) = answer else { return };
        if message.performative != Performative::Agree {
            return self.refused(&message);
        }
        let Ok(Bid { proposals, .. }) = message.content_as::<Bid>() else { return };
        let Some(proposal) = proposals.into_iter().next() else { return };
        println!("{} proposes, at cost {}\n{}", message.sender, proposal.cost, proposal.plan);
        if let Some(exchange) = message.exchange() {
            let detail = "it is the first bid".to_owned();
            let choice = value(&Choice::new(proposal.covers, detail));
            ctx.send_turn(exchange, &message.sender, Performative::AcceptProposal, choice);
        }
        let action = proposal.plan.lines().next().unwrap_or_default().to_owned();
        self.request(action, &message.sender, &message.conversation_id, ctx);
    }

    fn request(
        &self,
        action: String,
        device: &AgentId,
        conversation: &ConversationId,
        ctx: &mut Context<Visitor>,
    ) {
        // The device carries out this token at most once, however often it is requested.
        let token = ActionToken { term: 1, conversation: conversation.clone(), round: 1, step: 0 };
        let (method, arguments) = (self.wish.method.to_owned(), self.wish.arguments.clone());
        let act = Request::Act(Box::new(Act { action, method, arguments, token, ready_for: None }));
        let request = ExchangeOpening {
            to: Some(device.clone()),
            performative: Performative::Request,
            protocol: Protocol::Action,
            conversation: conversation.clone(),
            content: value(&act),
        };
        ctx.open(request, PATIENCE, |visitor: &mut Visitor, answer, _| match answer {
            ExchangeEvent::Message(message) => visitor.answered(&message),
            ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) => visitor.ended.notify_one(),
        });
    }

    fn answered(&self, message: &Message) {
        match message.performative {
            Performative::Agree => println!("{} agrees\n", message.sender),
            Performative::Confirm => {
                if let Ok(report) = message.content_as::<Report>() {
                    println!("{} confirms: {}, {}", message.sender, report.outcome, report.detail);
                }
                self.ended.notify_one();
            }
            _ => self.refused(message),
        }
    }

    fn refused(&self, message: &Message) {
        if let Ok(refusal) = message.content_as::<Refusal>() {
            println!("{} refuses: {}", message.sender, refusal.detail);
        }
        self.ended.notify_one();
    }
}
