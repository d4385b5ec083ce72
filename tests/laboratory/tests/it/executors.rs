//! A Plan Requester and the answers of its Plan Executor: one without time ends no goal, and a plan
//! that was carried out before the cancel came is compared with the known state.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, AtomicU32, Ordering};
use std::time::Duration;

use acl::content::{Achieve, Keep, Outcome, Partition, Reason, Report, Request, value};
use acl::{ConversationId, Performative, Protocol};
use agent::{
    Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening, LaunchError, LaunchableAgent,
    MessageRouter, Mode, Participation, Resource,
};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use crate::house::lamp::lamp_snapshot;
use crate::house::sayer::Sayer;
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (idle ?a - agent) (lit ?a - agent))
    (:action light :parameters (?a - agent) :precondition (idle ?a) :effect (lit ?a)))";

fn problem(facts: &str) -> String {
    format!(
        "(define (problem p) (:domain d) (:objects lamp - agent) (:init {facts}) (:goal (and)))"
    )
}

/// Longest time until a goal ends here.
const BY_THEN: Duration = Duration::from_secs(300);

/// Whether the lamp is lit.
type Light = Arc<AtomicBool>;

/// A Domain Maintainer that knows the lamp.
struct LampMaintainer(Light);

impl Agent for LampMaintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        let is_lit = self.0.load(Ordering::Relaxed);
        let problem = problem(if is_lit { "(idle lamp) (lit lamp)" } else { "(idle lamp)" });
        (resource == Resource::Domain)
            .then(|| lamp_snapshot(u64::from(is_lit), DOMAIN, &problem, ""))
    }
}

/// An executor that refuses plans, then lights the lamp.
struct RefusingExecutor {
    reason: Reason,
    refusals_left: u32,
    light: Light,
    asked: Arc<AtomicU32>,
}

impl Agent for RefusingExecutor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Self, message, ctx| {
            executor.asked.fetch_add(1, Ordering::Relaxed);
            let participation = Participation::of(&message);
            if executor.refusals_left > 0 {
                executor.refusals_left -= 1;
                return ctx.refuse(&participation, executor.reason, "not now");
            }
            executor.light.store(true, Ordering::Relaxed);
            let report = Report::new(Outcome::Done, "it is lit");
            ctx.answer(&participation, Performative::Confirm, &report);
        })
    }
}

/// An executor that answers a plan when the plan is cancelled: every step was done before.
struct LateExecutor {
    /// Whether the steps have lit the lamp.
    has_effect: bool,
    light: Light,
}

impl Agent for LateExecutor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |_: &mut Self, _, _| ()).on(
            Performative::Cancel,
            |executor: &mut Self, message, ctx| {
                executor.light.store(executor.has_effect, Ordering::Relaxed);
                let report = Report::new(Outcome::Done, "every step is done");
                ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
            },
        )
    }
}

/// Asks for the goal, cancels it as soon as there is a plan, and passes on the answers.
struct CancellingSayer {
    keep: Keep,
    told: mpsc::UnboundedSender<Report>,
}

impl Agent for CancellingSayer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let (goal, partition) = ("(lit lamp)".to_owned(), Partition::Pursue);
        let goal = Achieve { goal, keep: self.keep, priority: 0, partition };
        let opening = ExchangeOpening {
            to: Some(name("plan-requester")),
            performative: Performative::Request,
            protocol: Protocol::Goal,
            conversation: ConversationId::new("g"),
            content: value(&Request::Achieve(goal)),
        };
        ctx.open(opening, BY_THEN, |sayer: &mut Self, answer, ctx| {
            let ExchangeEvent::Message(message) = answer else { return };
            let Ok(report) = message.content_as::<Report>() else { return };
            if report.plan.is_some() {
                let (exchange, cancel) = (message.exchange(), Performative::Cancel);
                let exchange = exchange.expect("it is an answer").clone();
                ctx.send_turn(&exchange, &message.sender, cancel, serde_json::Value::Null);
            }
            sayer.told.send(report).expect("the test listens");
        });
    }
}

/// The agents that a goal about the lamp needs.
struct LampHouse {
    /// Keeps the network alive.
    _house: (House, Arc<MessageRouter>),
    _lives: [JoinHandle<Result<(), LaunchError>>; 5],
}

impl LampHouse {
    fn new(
        light: &Light,
        executor: Box<dyn LaunchableAgent>,
        asker: Box<dyn LaunchableAgent>,
    ) -> LampHouse {
        let house = House::new(Mode::Centralized, DOMAIN, &problem("(idle lamp)"), Vec::new());
        let machine = house.machine("here");
        let maintainer = Box::new(LampMaintainer(Arc::clone(light)));
        let _lives = [
            launch(maintainer, "domain-maintainer", &machine, false),
            launch(house.built(&planning_agent::PLUGIN), "planning-agent", &machine, false),
            launch(executor, "plan-executor", &machine, false),
            launch(house.built(&plan_requester::PLUGIN), "plan-requester", &machine, false),
            launch(asker, "asker", &machine, false),
        ];
        LampHouse { _house: (house, machine), _lives }
    }
}

async fn end(heard: &mut mpsc::UnboundedReceiver<Report>) -> Report {
    let end = async {
        loop {
            let report = heard.recv().await.expect("it lives");
            if report.outcome.is_final() {
                return report;
            }
        }
    };
    timeout(BY_THEN, end).await.expect("in time")
}

/// Returns the end of a goal whose plans the executor refuses for this reason, twenty times, and how
/// often the executor was asked.
async fn end_after_refusals(reason: Reason) -> (Report, u32) {
    let (light, asked) = (Light::default(), Arc::new(AtomicU32::new(0)));
    let executor = RefusingExecutor {
        reason,
        refusals_left: 20,
        light: Arc::clone(&light),
        asked: Arc::clone(&asked),
    };
    let (sayer, mut heard) = Sayer::of_goal("(lit lamp)", Keep::Achieve);
    let _house = LampHouse::new(&light, Box::new(executor), Box::new(sayer));
    (end(&mut heard).await, asked.load(Ordering::Relaxed))
}

#[tokio::test(start_paused = true)]
async fn an_executor_without_time_ends_no_goal() {
    let (report, asked) = end_after_refusals(Reason::Busy).await;
    assert_eq!((report.outcome, asked), (Outcome::Done, 21), "{report:?}");
}

#[tokio::test(start_paused = true)]
async fn a_plan_that_is_refused_for_good_has_failed() {
    let (report, asked) = end_after_refusals(Reason::BadContent).await;
    assert_eq!((report.outcome, asked), (Outcome::Failed, 12), "{report:?}");
    assert!(report.detail.contains("the Plan Executor declined: not now"), "{report:?}");
}

#[tokio::test(start_paused = true)]
async fn a_goal_that_is_cancelled_after_its_last_step_is_done_only_if_it_holds() {
    for (keep, has_effect, expected) in [
        (Keep::Achieve, true, Outcome::Done),
        (Keep::Achieve, false, Outcome::Cancelled),
        (Keep::Maintain, false, Outcome::Cancelled),
    ] {
        let (light, (told, mut heard)) = (Light::default(), mpsc::unbounded_channel());
        let sayer = CancellingSayer { keep, told };
        let executor = LateExecutor { has_effect, light: Arc::clone(&light) };
        let _house = LampHouse::new(&light, Box::new(executor), Box::new(sayer));
        let report = end(&mut heard).await;
        assert_eq!(report.outcome, expected, "{keep:?}, lit: {has_effect}: {report:?}");
    }
}
