//! Requested changes during a partition, with a leading Domain Maintainer on either side: after the
//! heal no change is lost, and the remaining leader has all of them.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use acl::content::{BelievedState, ChangeState, Request, value};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation, Performative, Protocol};
use agent::{
    Agent, AgentSettings, Blueprint, Callbacks, Context, ExchangeEvent, ExchangeOpening, Host,
    LaunchContext, MessageRouter, Resource,
};
use substrate::ResourceQuery;
use substrate::faulty::Network;
use tokio::sync::mpsc;
use tokio::time::timeout;
use tokio_util::sync::CancellationToken;

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types lamp) (:predicates (lit ?l - lamp)) (:functions (price ?l - lamp)))";
const PROBLEM: &str = "(define (problem p) (:domain d)
    (:objects hall attic cellar porch - lamp) (:init (lit porch)) (:goal (and)))";

const LEASE: Duration = Duration::from_secs(4);
const PATIENCE: Duration = Duration::from_secs(30);

/// Requests a change and passes on the answer.
struct Asker(ChangeState, mpsc::UnboundedSender<Performative>);

impl Agent for Asker {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: Some(name("domain-maintainer")),
            performative: Performative::Request,
            protocol: Protocol::StateChange,
            conversation: ctx.new_conversation(),
            content: value(&Request::ChangeState(std::mem::take(&mut self.0))),
        };
        ctx.open(opening, PATIENCE, |asker: &mut Asker, answer, _| {
            if let ExchangeEvent::Message(message) = answer {
                asker.1.send(message.performative).expect("the test listens");
            }
        });
    }
}

fn name(text: &str) -> AgentId {
    AgentId::new(text).expect("a name")
}

struct Machine {
    router: Arc<MessageRouter>,
    lives: u64,
}

impl Machine {
    /// Creates a daemon with a Domain Maintainer; the smaller its incarnation, the sooner it leads.
    fn new(network: &Network, daemon: &str, incarnation: u64) -> Machine {
        let daemon = DaemonId::new(daemon).expect("a name");
        let ecosystem = EcosystemId::new("home").expect("a name");
        let settings = AgentSettings::default();
        let router = MessageRouter::new(ecosystem, daemon.clone(), settings.clone());
        router.connect(network.open(daemon, Arc::<MessageRouter>::clone(&router) as _));
        let ontology = pddl::parse_domain(DOMAIN).into_result().expect("a domain");
        let map = pddl::parse_problem(PROBLEM).into_result().expect("a problem");
        let host = Arc::new(Host { settings, ..Host::new(ontology, map) });
        let config = serde_json::json!({}).into();
        let (id, driver) = (name("domain-maintainer"), String::new());
        let blueprint = Blueprint { id: id.clone(), driver, config, host };
        let maintainer = (domain_maintainer::PLUGIN.build)(blueprint).expect("built");
        let mut machine = Machine { router, lives: incarnation };
        let launch_context = machine.launch_context(id, true);
        drop(maintainer.launch(launch_context));
        machine
    }

    fn launch_context(&mut self, id: AgentId, stands_by: bool) -> LaunchContext {
        self.lives += 10;
        LaunchContext {
            id,
            incarnation: Incarnation(self.lives),
            router: Arc::clone(&self.router),
            ontology: Arc::from("d"),
            stopping: CancellationToken::new(),
            has_replicas: stands_by,
            via: [].into(),
        }
    }

    /// Requests a change in the name of `owner`, by an agent on this machine.
    async fn change(&mut self, owner: &str, believe: &str, retract: &str) {
        let (told, mut heard) = mpsc::unbounded_channel();
        let (believe, retract) = (believe.to_owned(), retract.to_owned());
        let asker = Asker(ChangeState { believe, retract, owner: Some(name(owner)) }, told);
        let id = name(&format!("asker-{}", self.lives));
        let launch_context = self.launch_context(id, false);
        drop(agent::LaunchableAgent::launch(Box::new(asker), launch_context));
        let answer = timeout(PATIENCE, heard.recv()).await.expect("in time");
        assert_eq!(answer, Some(Performative::Confirm));
    }

    /// Returns the facts that the Domain Maintainer of this machine believes.
    async fn believes(&self) -> BTreeSet<String> {
        let ask = ResourceQuery {
            daemon: Some(self.router.daemon().clone()),
            resource: Resource::State,
            agent: Some(name("domain-maintainer")),
        };
        let answers = self.router.ask(ask, PATIENCE).await;
        let states = answers.iter().filter_map(|text| serde_json::from_slice(text).ok());
        let facts = states.flat_map(|state: BelievedState| state.facts);
        facts.map(|fact| fact.fact).collect()
    }

    /// Waits until the Domain Maintainer of this machine leads and believes exactly these facts.
    async fn comes_to_believe(&self, expected: &[&str]) {
        let expected: BTreeSet<_> = expected.iter().map(|&fact| fact.to_owned()).collect();
        let mut believed = BTreeSet::new();
        let waiting = async {
            while believed != expected {
                tokio::time::sleep(Duration::from_millis(100)).await;
                believed = self.believes().await;
            }
        };
        let in_time = timeout(PATIENCE, waiting).await;
        assert!(in_time.is_ok(), "{}: {believed:?}", self.router.daemon());
    }
}

#[tokio::test(start_paused = true)]
async fn changes_on_both_sides_of_a_partition_are_known_after_the_heal() {
    let network = Network::new(7);
    let mut one = Machine::new(&network, "one", 1);
    let mut two = Machine::new(&network, "two", 1_000);
    one.comes_to_believe(&["(lit porch)"]).await;
    one.change("ann", "(lit hall) (= (price hall) 1) (= (price attic) 1)", "").await;
    // Long enough for the replicas to count as together.
    tokio::time::sleep(Duration::from_secs(20)).await;
    one.change("cem", "(lit cellar)", "").await;

    let cut = network.cut([DaemonId::new("two").expect("a name")].into(), LEASE);
    let before = ["(lit porch)", "(lit hall)", "(= (price hall) 1)", "(= (price attic) 1)"];
    two.comes_to_believe(&[&before[..], &["(lit cellar)"]].concat()).await;
    // On one side a price rises and the hall goes dark; on the other side another price changes and
    // a room is lit. The attic's price changes on both sides.
    one.change("ann", "(= (price attic) 2)", "(lit hall)").await;
    two.change("ann", "(= (price hall) 5) (= (price attic) 9)", "").await;
    two.change("bob", "(lit attic)", "(lit porch)").await;
    two.change("cem", "", "(lit cellar)").await;

    network.heal(cut);
    let after = ["(lit attic)", "(= (price hall) 5)", "(= (price attic) 2)"];
    one.comes_to_believe(&after).await;
    // The standby has received all changes and keeps them when it takes over.
    tokio::time::sleep(Duration::from_secs(5)).await;
    network.kill(&DaemonId::new("one").expect("a name"));
    two.comes_to_believe(&after).await;
}
