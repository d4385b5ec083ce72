//! A Domain Maintainer that leads before any Journal can be read: what was requested earlier, by the
//! record of the Journal, and what is requested meanwhile are both in force afterwards, and both
//! recorded.

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::Duration;

use acl::Protocol;
use acl::content::{BelievedState, ChangeState, Outcome, Record, Request, Version};
use agent::{MessageRouter, Mode, Resource};
use serde_json::json;
use substrate::ResourceQuery;
use tokio::sync::mpsc;
use tokio::time::timeout;

use crate::house::opening_journal::OpeningJournal;
use crate::house::sayer::{PATIENCE, Sayer};
use crate::house::{House, launch, name};

const DOMAIN: &str = "(define (domain d) (:requirements :strips :typing)
    (:types lamp) (:predicates (lit ?l - lamp)) (:functions (price ?l - lamp) (total-cost)))";
const PROBLEM: &str = "(define (problem p) (:domain d)
    (:objects hall attic cellar porch - lamp) (:init (lit porch)) (:goal (and)))";

const METRIC: &str = "(:metric minimize (* 2 (total-cost)))";

/// Requests a change in the name of an owner.
async fn change(here: &Arc<MessageRouter>, owner: &'static str, believe: &str, retract: &str) {
    let (told, mut heard) = mpsc::unbounded_channel();
    let (believe, retract) = (believe.to_owned(), retract.to_owned());
    let says = Request::ChangeState(ChangeState { believe, retract, owner: Some(name(owner)) });
    let sayer = Sayer {
        to: name("domain-maintainer"),
        protocol: Protocol::StateChange,
        conversation: owner,
        says,
        told,
    };
    drop(launch(Box::new(sayer), &format!("asker-{owner}"), here, false));
    let report = timeout(PATIENCE, heard.recv()).await.expect("in time").expect("it lives");
    assert_eq!(report.outcome, Outcome::Done, "{report:?}");
}

/// Returns the facts that the Domain Maintainer believes.
async fn believed(here: &Arc<MessageRouter>) -> BTreeSet<String> {
    let ask = ResourceQuery {
        daemon: Some(here.daemon().clone()),
        resource: Resource::State,
        agent: Some(name("domain-maintainer")),
    };
    let answers = here.ask(ask, PATIENCE).await;
    let states = answers.iter().filter_map(|text| serde_json::from_slice(text).ok());
    let facts = states.flat_map(|state: BelievedState| state.facts);
    facts.map(|fact| fact.fact).collect()
}

#[tokio::test(start_paused = true)]
async fn requests_from_before_the_journals_are_read_replace_no_earlier_ones() {
    let house = House::new(Mode::Centralized, DOMAIN, PROBLEM, vec![name("journal")]);
    let here = house.machine("here");
    let fact = |fact: &str| json!({"fact": fact, "owner": "ann"});
    let facts = ["(lit hall)", "(lit cellar)", "(= (price hall) 1)", "(= (price attic) 1)"];
    let requested = json!({
        "facts": facts.map(fact), "metric": METRIC, "withheld": [{"action": "light"}],
    });
    let kept = Record {
        key: "state/requested".to_owned(),
        version: Version { term: u64::MAX / 2, count: 7 },
        body: json!({"at_ms": 0, "requested": requested}),
    };
    let (journal, mut file) = OpeningJournal::new(kept.clone());
    drop(launch(Box::new(journal), "journal", &here, false));
    drop(launch(house.built(&domain_maintainer::PLUGIN), "domain-maintainer", &here, true));
    tokio::time::sleep(Duration::from_secs(1)).await;

    change(&here, "bob", "(lit attic) (= (price hall) 5)", "(lit cellar)").await;
    tokio::time::sleep(Duration::from_secs(30)).await;
    let early = file.take_stored();
    assert!(early.is_empty(), "a record that was not read is replaced: {early:?}");

    file.open();
    tokio::time::sleep(Duration::from_secs(10)).await;
    let expected = ["(lit porch)", "(lit hall)", "(lit attic)", "(= (price hall) 5)"];
    let expected = expected.into_iter().chain(["(= (price attic) 1)"]);
    assert_eq!(believed(&here).await, expected.map(ToOwned::to_owned).collect());

    let stored = file.take_stored();
    assert!(stored.iter().all(|record| record.version > kept.version), "{stored:?}");
    let last = stored.last().expect("a record").body["requested"].clone();
    assert_eq!(last["metric"], METRIC, "{last}");
    assert_eq!(last["withheld"][0]["action"], "light", "{last}");
    let facts = last["facts"].as_array().expect("facts");
    let facts: BTreeSet<_> = facts.iter().filter_map(|fact| fact["fact"].as_str()).collect();
    let expected = ["(lit hall)", "(lit attic)", "(= (price attic) 1)", "(= (price hall) 5)"];
    assert!(expected.iter().all(|fact| facts.contains(fact)), "{last}");
    assert!(!facts.contains("(lit cellar)"), "{last}");
}
