//! A new leader takes over a goal for which a person has forbidden an action: it does not have the
//! action tried again, and so does not ask the person again.

use std::time::Duration;

use acl::Performative;
use acl::content::{Outcome, Report};
use agent::{Agent, Callbacks, Context, Mode, Participation, Resource};
use serde_json::json;
use tokio::sync::mpsc;

use crate::house::lamp::{kept_goal, lamp_snapshot};
use crate::house::opening_journal::OpeningJournal;
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types agent) (:predicates (offers-light ?a - agent) (lit ?a - agent))
    (:action light :parameters (?a - agent) :precondition (offers-light ?a) :effect (lit ?a)))";
const PROBLEM: &str = "(define (problem p) (:domain d) (:objects lamp - agent)
    (:init (offers-light lamp)) (:goal (and)))";

/// A Domain Maintainer that knows the lamp.
struct Maintainer;

impl Agent for Maintainer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn answer_query(&mut self, resource: Resource, _: &mut Context<Self>) -> Option<String> {
        (resource == Resource::Domain)
            .then(|| lamp_snapshot(1, DOMAIN, PROBLEM, "(offers-light lamp)"))
    }
}

/// An executor that notes each request.
struct Executor(mpsc::UnboundedSender<()>);

impl Agent for Executor {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, |executor: &mut Executor, message, ctx| {
            executor.0.send(()).expect("the test listens");
            let report = Report::new(Outcome::Done, "the lamp is lit");
            ctx.answer(&Participation::of(&message), Performative::Confirm, &report);
        })
    }
}

/// Returns whether a goal with these failed actions in its record is executed, and the reason with
/// which it ended by the records of the Journal.
async fn taken_over(failed: serde_json::Value) -> (bool, Option<String>) {
    let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, vec![name("journal")]);
    let here = house.machine("here");
    let kept =
        kept_goal(&json!({ "asked": { "goal": "(lit lamp)" }, "failures": 1, "failed": failed }));
    let (journal, mut file) = OpeningJournal::new(kept);
    file.open();
    let (asked, mut executions) = mpsc::unbounded_channel();
    drop(launch(Box::new(journal), "journal", &here, false));
    drop(launch(Box::new(Maintainer), "domain-maintainer", &here, false));
    drop(launch(Box::new(Executor(asked)), "plan-executor", &here, false));
    drop(launch(house.built(&planning_agent::PLUGIN), "planning-agent", &here, false));
    drop(launch(house.built(&plan_requester::PLUGIN), "plan-requester", &here, true));
    tokio::time::sleep(Duration::from_secs(60)).await;
    let stored = file.take_stored();
    let last = stored.iter().rev().find(|record| record.key == "goal/g");
    let detail = last.and_then(|record| record.body["ended"]["detail"].as_str());
    (executions.try_recv().is_ok(), detail.map(ToOwned::to_owned))
}

#[tokio::test(start_paused = true)]
async fn a_forbidden_action_is_not_tried_again_by_a_new_leader() {
    let no = json!([
        {"agent": "lamp", "action": "light", "times": 1, "refused": true, "why": "ann says no"}
    ]);
    let (is_executed, ended) = taken_over(no).await;
    assert!(!is_executed, "{ended:?}");
    let ended = ended.expect("it cannot be reached without the action");
    assert!(ended.contains("ann says no"), "{ended}");
    // Without it, the same goal is executed.
    assert!(taken_over(json!([])).await.0);
}
