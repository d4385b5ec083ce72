//! The agent that brought an object of a goal leaves while the goal is pursued: the reason names
//! the object, and a kept goal waits for the agent to come back.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use acl::Performative;
use acl::content::{Keep, Offer, Offers, Outcome, Report, Snapshot};
use agent::{Agent, Callbacks, Context, LaunchError, MessageRouter, Mode, Participation, Resource};
use tokio::sync::mpsc;
use tokio::task::JoinHandle;
use tokio::time::timeout;

use crate::house::sayer::{PATIENCE, Sayer};
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (idle ?a - agent) (lit ?a - agent))
    (:action light :parameters (?a - agent) :precondition (idle ?a) :effect (lit ?a)))";
const WITH_LAMP: &str =
    "(define (problem p) (:domain d) (:objects lamp - agent) (:init (idle lamp)) (:goal (and)))";
const WITHOUT_LAMP: &str = "(define (problem p) (:domain d) (:init) (:goal (and)))";

/// Whether the lamp is present.
type Here = Arc<AtomicBool>;

/// A Domain Maintainer that knows the lamp while it is present.
struct Maintainer(Here);

impl Agent for Maintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        let is_here = self.0.load(Ordering::Relaxed);
        let offer =
            Offer { schema: "light".to_owned(), guard: String::new(), method: None, agents: 1 };
        let offered = [(name("lamp"), [("light".to_owned(), offer)].into())];
        let offers = if is_here { Offers::from(offered) } else { Offers::new() };
        let snapshot = Snapshot {
            epoch: u64::from(!is_here),
            revision: u64::from(!is_here),
            domain: DOMAIN.to_owned(),
            digest: String::new(),
            problem: if is_here { WITH_LAMP } else { WITHOUT_LAMP }.to_owned(),
            offers,
            guards: [].into(),
            former: Vec::new(),
            knowledge: [].into(),
            conflicts: [].into(),
        };
        (resource == Resource::Domain).then(|| serde_json::to_string(&snapshot).expect("JSON"))
    }
}

/// An executor; the lamp leaves when it is asked to execute a plan.
struct Executor {
    lamp: Here,
    asked: mpsc::UnboundedSender<()>,
}

impl Agent for Executor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Executor, message, ctx| {
            executor.lamp.store(false, Ordering::Relaxed);
            executor.asked.send(()).expect("the test listens");
            let report = Report::new(Outcome::Failed, "the lamp has left");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        })
    }
}

/// A goal about the lamp, with all agents that it needs.
struct Trial {
    lamp: Here,
    /// Plans to be executed.
    plans: mpsc::UnboundedReceiver<()>,
    heard: mpsc::UnboundedReceiver<Report>,
    /// Keeps the network alive.
    _house: (House, Arc<MessageRouter>),
    _lives: [JoinHandle<Result<(), LaunchError>>; 5],
}

impl Trial {
    fn new(keep: Keep) -> Trial {
        let house = House::new(Mode::Centralized, DOMAIN, WITH_LAMP, Vec::new());
        let machine = house.machine("here");
        let lamp = Here::new(true.into());
        let (asked, plans) = mpsc::unbounded_channel();
        let (sayer, heard) = Sayer::of_goal("(lit lamp)", keep);
        let executor = Executor { lamp: lamp.clone(), asked };
        let lives = [
            launch(Box::new(Maintainer(lamp.clone())), "domain-maintainer", &machine, false),
            launch(house.built(&planning_agent::PLUGIN), "planning-agent", &machine, false),
            launch(Box::new(executor), "plan-executor", &machine, false),
            launch(house.built(&plan_requester::PLUGIN), "plan-requester", &machine, false),
            launch(Box::new(sayer), "asker", &machine, false),
        ];
        Trial { lamp, plans, heard, _house: (house, machine), _lives: lives }
    }

    /// Returns the first report with this outcome and text; only progress may come before it.
    async fn told(&mut self, outcome: Outcome, of: &str) -> String {
        let said = async {
            loop {
                let report = self.heard.recv().await.expect("it lives");
                if report.outcome == outcome && report.detail.contains(of) {
                    return report.detail;
                }
                assert_eq!(report.outcome, Outcome::Progress, "{report:?}");
            }
        };
        timeout(PATIENCE, said).await.expect("in time")
    }

    async fn a_plan_is_to_be_carried_out(&mut self) {
        timeout(PATIENCE, self.plans.recv()).await.expect("in time").expect("it lives");
    }
}

#[tokio::test(start_paused = true)]
async fn the_reason_names_the_lost_object_of_a_goal() {
    let reason = Trial::new(Keep::Achieve).told(Outcome::Failed, "").await;
    assert_eq!(reason, "unknown object `lamp`: its agent is not here");
}

#[tokio::test(start_paused = true)]
async fn a_kept_goal_waits_for_a_lost_object_and_continues() {
    let mut trial = Trial::new(Keep::Maintain);
    trial.a_plan_is_to_be_carried_out().await;
    let news = trial.told(Outcome::Progress, "no plan now").await;
    let lost = "unknown object `lamp`: its agent is not here";
    assert_eq!(news, format!("no plan now: {lost}; waiting for the ecosystem to change"));
    trial.lamp.store(true, Ordering::Relaxed);
    trial.a_plan_is_to_be_carried_out().await;
}
