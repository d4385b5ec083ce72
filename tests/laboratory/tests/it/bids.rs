//! Tests of a bid by an action model that the Domain Maintainer does not have yet, because the
//! bidder's announcement is still on its way.

use std::sync::Arc;
use std::sync::atomic::{AtomicU32, Ordering};

use acl::Performative;
use acl::content::{
    Bid, CallForProposals, Execute, Keep, Offer, Offers, Outcome, Proposal, Report, Request,
    Snapshot,
};
use agent::{Agent, Callbacks, Context, Mode, Participation, Resource};
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::house::sayer::{PATIENCE, Sayer};
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (idle ?a - agent) (bright))
    (:action set-up :parameters (?a - agent) :precondition (idle ?a) :effect (idle ?a))
    (:action light :parameters (?a - agent) :precondition (idle ?a) :effect (bright)))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects lamp robot - agent)
    (:init (idle lamp) (idle robot)) (:goal (and)))";

/// A Domain Maintainer that offers the lamp's `light` only after `behind` queries.
struct Maintainer {
    behind: u32,
    asked: Arc<AtomicU32>,
}

impl Agent for Maintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        let is_behind = self.asked.fetch_add(1, Ordering::Relaxed) < self.behind;
        let offer = |action: &str| {
            let offer =
                Offer { schema: action.to_owned(), guard: String::new(), method: None, agents: 1 };
            (action.to_owned(), offer)
        };
        let of_lamp = if is_behind { vec!["set-up"] } else { vec!["set-up", "light"] };
        let offers: Offers = [
            (name("lamp"), of_lamp.into_iter().map(offer).collect()),
            (name("robot"), [offer("light")].into()),
        ]
        .into();
        let epoch = u64::from(!is_behind);
        let snapshot = Snapshot {
            epoch,
            revision: epoch,
            domain: DOMAIN.to_owned(),
            digest: String::new(),
            problem: PROBLEM.to_owned(),
            offers,
            guards: [].into(),
            former: Vec::new(),
            knowledge: [].into(),
            conflicts: [].into(),
        };
        (resource == Resource::Domain).then(|| serde_json::to_string(&snapshot).expect("JSON"))
    }
}

/// A bidder that proposes to light, at this cost.
struct Bidder(f64);

impl Agent for Bidder {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Cfp, |bidder: &mut Bidder, message, ctx| {
            let call: CallForProposals = message.content_as().expect("a call");
            let plan = format!("(light {})", ctx.id());
            let proposal = Proposal { covers: call.conjuncts, plan, cost: bidder.0 };
            let bid = Bid { proposals: vec![proposal], ..Bid::default() };
            ctx.answer(&Participation::of(&message), Performative::Agree, &bid);
        })
    }
}

/// An executor that reports the plans it is asked to execute, and fails them.
struct Executor(mpsc::UnboundedSender<String>);

impl Agent for Executor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Executor, message, ctx| {
            if let Ok(Request::Execute(asked)) = message.content_as::<Request>() {
                let Execute { plan, .. } = *asked;
                executor.0.send(plan).expect("the test listens");
            }
            let report = Report::new(Outcome::Failed, "for the test");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        })
    }
}

/// Returns the first plan to be executed, and the number of queries, if the Domain Maintainer lacks
/// the new model for `behind` queries.
async fn first_plan(behind: u32) -> (String, u32) {
    let house = House::new(Mode::Decentralized, DOMAIN, PROBLEM, Vec::new());
    let machine = house.machine("here");
    let asked = Arc::<AtomicU32>::default();
    let maintainer = Maintainer { behind, asked: Arc::clone(&asked) };
    let (told, mut plans) = mpsc::unbounded_channel();
    let (sayer, _heard) = Sayer::of_goal("(bright)", Keep::Maintain);
    let _lives = [
        launch(Box::new(maintainer), "domain-maintainer", &machine, false),
        launch(Box::new(Bidder(1.0)), "lamp", &machine, false),
        launch(Box::new(Bidder(39.0)), "robot", &machine, false),
        launch(Box::new(Executor(told)), "plan-executor", &machine, false),
        launch(house.built(&plan_requester::PLUGIN), "plan-requester", &machine, false),
        launch(Box::new(sayer), "asker", &machine, false),
    ];
    let plan = timeout(PATIENCE, plans.recv()).await.expect("in time").expect("it lives");
    (plan.trim().to_owned(), asked.load(Ordering::Relaxed))
}

#[tokio::test(start_paused = true)]
async fn a_bid_by_a_newer_action_model_is_called_for_again() {
    for behind in [0, 1, 3] {
        let (plan, asked) = first_plan(behind).await;
        assert!(plan.starts_with("(light lamp)"), "behind {behind}: {plan}");
        assert!(asked <= behind + 2, "no more rounds than it takes: {asked}");
    }
}

/// If the new model never arrives, another agent does the job.
#[tokio::test(start_paused = true)]
async fn a_bid_by_a_model_that_never_arrives_is_replaced() {
    let (plan, asked) = first_plan(u32::MAX).await;
    assert!(plan.starts_with("(light robot)"), "{plan}");
    assert!((2..200).contains(&asked), "{asked} rounds");
}
