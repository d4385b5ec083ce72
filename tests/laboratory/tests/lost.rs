//! What a goal speaks of goes with whoever brought it, while the goal is pursued: the reason names it,
//! and a goal that is kept waits for it to come back.

mod house;
#[path = "house/sayer.rs"]
mod sayer;

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

use acl::content::{Achieve, Keep, Offer, Offers, Outcome, Partition, Report, Request, Snapshot};
use acl::{Performative, Protocol};
use agent::{Agent, Callbacks, Context, Engagement, Resource};
use tokio::sync::mpsc;
use tokio::time::timeout;

use house::{House, launch, name};
use sayer::{PATIENCE, Sayer};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (idle ?a - agent) (lit ?a - agent))
    (:action light :parameters (?a - agent) :precondition (idle ?a) :effect (lit ?a)))";
const WITH_LAMP: &str =
    "(define (problem p) (:domain d) (:objects lamp - agent) (:init (idle lamp)) (:goal (and)))";
const WITHOUT_LAMP: &str = "(define (problem p) (:domain d) (:init) (:goal (and)))";

/// Whether the lamp is here.
type Here = Arc<AtomicBool>;

/// Knows the lamp while it is here.
struct Maintainer(Here);

impl Agent for Maintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn asked(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        let is_here = self.0.load(Ordering::Relaxed);
        let offer = Offer { inside: "light".to_owned(), guard: String::new(), method: None };
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
            conflicts: [].into(),
        };
        (resource == Resource::Domain).then(|| serde_json::to_string(&snapshot).expect("JSON"))
    }
}

/// The lamp leaves as it is asked to carry a plan out.
struct Executor(Here);

impl Agent for Executor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Executor, message, ctx| {
            executor.0.store(false, Ordering::Relaxed);
            let report = Report::new(Outcome::Failed, "the lamp has left");
            ctx.answer(&Engagement::of(&message), Performative::Confirm, &report);
        })
    }
}

/// What is said first of a goal about the lamp with this outcome.
async fn told(keep: Keep, outcome: Outcome) -> String {
    let house = House::new(DOMAIN, WITH_LAMP, Vec::new());
    let machine = house.machine("here");
    let here = Here::new(true.into());
    let achieve =
        Achieve { goal: "(lit lamp)".to_owned(), keep, priority: 0, partition: Partition::Pursue };
    let (told, mut heard) = mpsc::unbounded_channel();
    let sayer = Sayer {
        to: name("plan-requester"),
        protocol: Protocol::Goal,
        conversation: "g",
        says: Request::Achieve(achieve),
        told,
    };
    let _lives = [
        launch(Box::new(Maintainer(here.clone())), "domain-maintainer", &machine, false),
        launch(house.built(&planning_agent::PLUGIN), "planning-agent", &machine, false),
        launch(Box::new(Executor(here)), "plan-executor", &machine, false),
        launch(house.built(&plan_requester::PLUGIN), "plan-requester", &machine, false),
        launch(Box::new(sayer), "asker", &machine, false),
    ];
    let about_the_lamp = async {
        loop {
            let report = heard.recv().await.expect("it lives");
            if report.outcome == outcome && report.detail.contains("who brought") {
                return report.detail;
            }
            assert!(report.outcome == Outcome::Progress, "{report:?}");
        }
    };
    timeout(PATIENCE, about_the_lamp).await.expect("in time")
}

#[tokio::test(start_paused = true)]
async fn the_reason_names_what_a_goal_has_lost() {
    let reason = told(Keep::Achieve, Outcome::Failed).await;
    assert_eq!(reason, "unknown object `lamp`: who brought it is not here");
}

#[tokio::test(start_paused = true)]
async fn a_goal_that_is_kept_waits_for_what_it_has_lost() {
    let news = told(Keep::Maintain, Outcome::Progress).await;
    assert_eq!(
        news,
        "no plan now: unknown object `lamp`: who brought it is not here; waiting for the ecosystem to \
         change"
    );
}
