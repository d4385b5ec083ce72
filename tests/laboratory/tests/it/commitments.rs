//! Tests of commitments to joint plans, with real actuators: two Plan Requesters that want the same two
//! agents at the same time do not interleave, and agents are free again after the death of a requester.
//! What counts is what the devices have done.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex};
use std::time::Duration;

use acl::content::{
    CallForProposals, JointPlanPart, Keep, Method, Outcome, PartStep, Report, value,
};
use acl::{AgentId, ConversationId, Message, Millis, Performative, Protocol};
use actuator::{
    BoxFuture, Description, Device, MethodCall, MethodFailure, MethodResult, OwnFact, facts_of,
    model_of,
};
use agent::{Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, Mode};
use tokio::sync::mpsc;
use tokio::time::{Instant, timeout};

use crate::house::sayer::Sayer;
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent door - object)
    (:predicates (real ?d - door) (opened ?a - agent ?d - door) (carried ?a - agent ?d - door)))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects left right - door)
    (:init (real left) (real right)) (:goal (and)))";

/// Time that each action takes.
const ACTION: Duration = Duration::from_millis(300);

/// Bound on the time until both goals are reached. Each plan takes less than two seconds; the goal that
/// is refused waits for 6.4 s at most, and as long again by its share.
const REACHED_WITHIN: Duration = Duration::from_secs(20);

/// The lease of an agreement and the longest wait of a goal that finds an agent held, twice.
const FREE_WITHIN: Duration = Duration::from_secs(40);

/// What has been done in the building, in order: `opened left`, `carried left`.
type Done = Arc<Mutex<Vec<String>>>;

/// A keeper that opens doors, or a porter that carries something through an open door.
struct Worker {
    agent: &'static str,
    done: Done,
}

impl Worker {
    /// Returns the action, its verb in the building, and its model.
    fn action(&self) -> (&'static str, &'static str, &'static str) {
        match self.agent {
            "keeper" => (
                "unlock",
                "opened",
                "(define (agent keeper) (:domain d) (:objects keeper - agent) (:action unlock :agent ?a - agent
                    :parameters (?d - door) :precondition (real ?d) :effect (opened ?a ?d)))",
            ),
            _ => (
                "carry",
                "carried",
                "(define (agent porter) (:domain d) (:objects porter - agent) (:action carry :agent ?a - agent
                    :parameters (?d - door ?k - agent) :precondition (opened ?k ?d)
                    :effect (carried ?a ?d)))",
            ),
        }
    }
}

impl Device for Worker {
    type Yield = ();

    fn describe(&self) -> Description {
        let (action, _, model) = self.action();
        let arguments = BTreeMap::from([("door".to_owned(), "?d".to_owned())]);
        let timeout = Millis(Duration::from_secs(5));
        let method = Method { method: action.to_owned(), arguments, timeout };
        Description { model: model_of(model), methods: [(action.to_owned(), method)].into() }
    }

    fn facts(&self) -> Vec<OwnFact> {
        let done = self.done.lock().expect("no test panics with it");
        let own = done.iter().filter_map(|what| what.strip_prefix(self.action().1));
        let facts = own.map(|door| format!("({} {}{door})", self.action().1, self.agent));
        facts_of(&facts.collect::<Vec<_>>().join(" "))
    }

    fn perform(&mut self, call: &MethodCall) -> BoxFuture<Result<(), MethodFailure>> {
        let (done, verb) = (Arc::clone(&self.done), self.action().1);
        let door = call.argument("door").map(str::to_owned);
        Box::pin(async move {
            let door = door?;
            tokio::time::sleep(ACTION).await;
            let mut done = done.lock().expect("no test panics with it");
            if verb == "carried" && !done.contains(&format!("opened {door}")) {
                return Err(MethodFailure::Hindered(format!("pass: {door} is shut")));
            }
            done.push(format!("{verb} {door}"));
            Ok(())
        })
    }

    fn on_success(&mut self, _call: &MethodCall, (): ()) -> MethodResult {
        MethodResult::default()
    }
}

/// Asks the keeper and the porter to agree to their parts of a plan, and then does nothing more.
struct DyingRequester(mpsc::UnboundedSender<Message>);

impl Agent for DyingRequester {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let own = |step: &str| PartStep::Own(step.to_owned());
        let opened = PartStep::Others("(opened keeper left)".to_owned());
        for (agent, steps) in [
            ("keeper", vec![own("(unlock keeper left)")]),
            ("porter", vec![opened, own("(carry porter left keeper)")]),
        ] {
            let part = Some(JointPlanPart { digest: "dead".to_owned(), steps });
            let conjuncts = vec!["(carried porter left)".to_owned()];
            let opening = ExchangeOpening {
                to: Some(name(agent)),
                performative: Performative::Cfp,
                protocol: Protocol::ContractNet,
                conversation: ConversationId::new("dead"),
                content: value(&CallForProposals { conjuncts, together: true, part }),
            };
            ctx.open(opening, FREE_WITHIN, |requester: &mut Self, answer, _| {
                if let ExchangeEvent::Message(message) = answer {
                    requester.0.send(*message).expect("the test listens");
                }
            });
        }
    }
}

/// Asks `requester` for a goal. Returns the channel of its reports.
fn asked(
    goal: &str,
    conversation: &'static str,
    requester: AgentId,
) -> (Sayer, mpsc::UnboundedReceiver<Report>) {
    let (sayer, reports) = Sayer::of_goal(goal, Keep::Achieve);
    (Sayer { to: requester, conversation, ..sayer }, reports)
}

/// Waits for the end of a goal, and returns all of its reports.
async fn ended(reports: &mut mpsc::UnboundedReceiver<Report>, within: Duration) -> Vec<Report> {
    let mut said = Vec::new();
    let end = timeout(within, async {
        while !said.last().is_some_and(|report: &Report| report.outcome.is_final()) {
            said.push(reports.recv().await.expect("the asker lives"));
        }
    });
    let is_in_time = end.await.is_ok();
    assert!(is_in_time, "no end: {said:#?}");
    said
}

#[tokio::test(start_paused = true)]
async fn two_requesters_that_want_the_same_agents_do_not_interleave() {
    let house = House::new(Mode::Decentralized, DOMAIN, PROBLEM, Vec::new());
    let (here, there) = (house.machine("here"), house.machine("there"));
    let done = Done::default();
    let worker = |agent| house.actuator(agent, Worker { agent, done: Arc::clone(&done) });
    let _lives = [
        launch(house.built(&domain_maintainer::PLUGIN), "domain-maintainer", &here, false),
        launch(worker("keeper"), "keeper", &here, false),
        launch(worker("porter"), "porter", &there, false),
        launch(house.built(&plan_executor::PLUGIN), "plan-executor", &here, false),
        launch(house.built(&plan_requester::PLUGIN), "plan-requester", &here, false),
        launch(house.built(&plan_requester::PLUGIN), "other-requester", &there, false),
    ];
    // The agents announce themselves first, so that both goals are planned for at the same time.
    tokio::time::sleep(Duration::from_secs(3)).await;
    let (first, mut of_first) = asked("(carried porter left)", "g1", name("plan-requester"));
    let (second, mut of_second) = asked("(carried porter right)", "g2", name("other-requester"));
    let begun = Instant::now();
    let _askers = [
        launch(Box::new(first), "first", &here, false),
        launch(Box::new(second), "second", &there, false),
    ];
    let mut said = ended(&mut of_first, REACHED_WITHIN).await;
    let rest = REACHED_WITHIN.saturating_sub(begun.elapsed());
    said.extend(ended(&mut of_second, rest).await);
    let outcomes: Vec<_> = { said.iter() }.filter(|report| report.outcome.is_final()).collect();
    assert!(outcomes.iter().all(|end| end.outcome == Outcome::Done), "{said:#?}");
    let done = done.lock().expect("no test panics with it").clone();
    let pairs: Vec<_> = done.chunks(2).map(|pair| pair.join(", ")).collect();
    for door in ["left", "right"] {
        assert!(pairs.contains(&format!("opened {door}, carried {door}")), "{done:?}");
    }
    assert_eq!(done.len(), 4, "nothing is done twice: {done:?}");
    let is_told = said.iter().any(|report| report.detail.contains("has other work"));
    assert!(is_told, "the requester that came second waits: {said:#?}");
}

#[tokio::test(start_paused = true)]
async fn agents_are_free_again_after_the_death_of_a_requester() {
    let house = House::new(Mode::Decentralized, DOMAIN, PROBLEM, Vec::new());
    let here = house.machine("here");
    let done = Done::default();
    let worker = |agent| house.actuator(agent, Worker { agent, done: Arc::clone(&done) });
    let _lives = [
        launch(house.built(&domain_maintainer::PLUGIN), "domain-maintainer", &here, false),
        launch(worker("keeper"), "keeper", &here, false),
        launch(worker("porter"), "porter", &here, false),
        launch(house.built(&plan_executor::PLUGIN), "plan-executor", &here, false),
        launch(house.built(&plan_requester::PLUGIN), "plan-requester", &here, false),
    ];
    tokio::time::sleep(Duration::from_secs(3)).await;
    let (told, mut heard) = mpsc::unbounded_channel();
    let dying = launch(Box::new(DyingRequester(told)), "dying", &here, false);
    for _ in 0..2 {
        let answer = heard.recv().await.expect("both answer");
        assert_eq!(answer.performative, Performative::Agree, "{answer:?}");
    }
    dying.abort();
    let (asker, mut reports) = asked("(carried porter right)", "g", name("plan-requester"));
    let _asker = launch(Box::new(asker), "asker", &here, false);
    let said = ended(&mut reports, FREE_WITHIN).await;
    assert_eq!(said.last().map(|end| end.outcome), Some(Outcome::Done), "{said:#?}");
    let held =
        "has other work: it has agreed to plan dead of `dying` for the goal `dead`, and is held";
    assert!(said.iter().any(|report| report.detail.contains(held)), "{said:#?}");
    let done = done.lock().expect("no test panics with it").clone();
    assert_eq!(done, ["opened right", "carried right"]);
}
