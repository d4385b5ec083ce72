//! What anyone may change by request while the house lives: what the Domain Maintainer answers,
//! what it shows, and that it reaches the actuators' own maintainers.

use std::time::Duration;

use acl::content::{
    ActionOf, BelievedState, ChangeActions, ChangeMetric, ChangeState, Observation, Request,
    Snapshot,
};
use acl::{AgentId, Deadline};
use agent::{Mode, Resource};

use super::asking::{change, office, read};

fn believe(believe: &str, retract: &str) -> Request {
    let (believe, retract) = (believe.to_owned(), retract.to_owned());
    Request::ChangeState(ChangeState { believe, retract, owner: None })
}

#[tokio::test(start_paused = true)]
async fn what_is_changed_by_request_reaches_those_who_plan_alone() {
    let (set, sensor) = office(Mode::Decentralized).await;
    let before: Snapshot = read(&set, &sensor, Resource::Domain).await;
    assert!(before.problem.contains("(connected corridor office1)"));
    assert!(!before.problem.contains("(known-temperature office2)"));
    let answer = change(&set, "ann", believe("", "(connected corridor office1)")).await;
    assert_eq!(answer, "done: believed");
    let known_for = [("(known-temperature office2)".to_owned(), Deadline::from(20_000))].into();
    let observation = Observation { facts: String::new(), known_for };
    assert_eq!(change(&set, "bob", Request::Observe(observation)).await, "done: believed");
    let metric = "(:metric minimize (* 2 (total-cost)))".to_owned();
    let metric = Request::ChangeMetric(ChangeMetric { metric: Some(metric) });
    assert_eq!(
        change(&set, "cem", metric).await,
        "done: plans are measured by `(:metric minimize (* 2 (total-cost)))` from now on"
    );
    let of = ActionOf { action: "report-temperature".into(), agent: AgentId::new(&sensor).ok() };
    let withhold = ChangeActions { withhold: vec![of], give_back: Vec::new() };
    assert_eq!(
        change(&set, "dan", Request::ChangeActions(withhold)).await,
        format!("done: withheld: `report-temperature` of `{sensor}`")
    );
    let central: Snapshot = read(&set, "domain-maintainer", Resource::Domain).await;
    let local: Snapshot = read(&set, &sensor, Resource::Domain).await;
    for known in [&central, &local] {
        assert!(!known.problem.contains("(connected corridor office1)"));
        assert!(known.problem.contains("(connected office1 corridor)"));
        assert!(known.problem.contains("(known-temperature office2)"));
        assert!(known.problem.contains("(* 2 (total-cost))"));
        assert!(known.offers.keys().all(|agent| agent.as_str() != sensor));
    }
    // What is known for a while is over for all.
    tokio::time::sleep(Duration::from_secs(20)).await;
    let local: Snapshot = read(&set, &sensor, Resource::Domain).await;
    assert!(!local.problem.contains("(known-temperature office2)"));
}

#[tokio::test(start_paused = true)]
async fn who_contradicts_whom_is_answered_and_seen() {
    let (set, _) = office(Mode::Decentralized).await;
    let observe = |facts: &str| {
        Request::Observe(Observation { facts: facts.to_owned(), known_for: [].into() })
    };
    let eighteen = "(= (temperature office1) 18)";
    assert_eq!(change(&set, "ann", observe(eighteen)).await, "done: believed");
    let answer = change(&set, "bob", observe("(= (temperature office1) 21)")).await;
    assert_eq!(
        answer,
        "done: believed; ann says `(= (temperature office1) 18)`, and its next word goes before"
    );
    let state: BelievedState = read(&set, "domain-maintainer", Resource::State).await;
    let fact = state.facts.iter().find(|fact| fact.fact.contains("temperature office1"));
    let fact = fact.expect("it is believed");
    assert_eq!(fact.fact, "(= (temperature office1) 21)");
    let said: Vec<_> =
        fact.claims.iter().map(|claim| (&*claim.owner, &*claim.fact, &*claim.source)).collect();
    let twenty_one = "(= (temperature office1) 21)";
    assert_eq!(said, [("ann", eighteen, "observation"), ("bob", twenty_one, "observation")]);
    let answer = change(&set, "cem", observe("(known-temperature attic)")).await;
    assert_eq!(
        answer,
        "done: believed; `(known-temperature attic)` does not count as long as `attic` is not \
         here"
    );
}

#[tokio::test(start_paused = true)]
async fn what_makes_no_sense_is_refused_with_the_reason() {
    let (set, _) = office(Mode::Decentralized).await;
    let of = |action: &str| vec![ActionOf { action: action.to_owned(), agent: None }];
    let metric = |text: &str| Request::ChangeMetric(ChangeMetric { metric: Some(text.to_owned()) });
    let actions =
        |withhold, give_back| Request::ChangeActions(ChangeActions { withhold, give_back });
    let cases = [
        (actions(of("fly"), Vec::new()), "refuse: nobody offers `fly`"),
        (
            actions(Vec::new(), of("report-temperature")),
            "refuse: `report-temperature` is not withheld; name it as it was withheld",
        ),
        (actions(Vec::new(), Vec::new()), "refuse: it names no action to change"),
        (Request::Observe(Observation::default()), "refuse: it says nothing"),
        (metric("(:metric minimize (joy))"), "refuse: "),
        (metric("minimize"), "refuse: "),
        (believe("(at (", ""), "refuse: "),
    ];
    for (number, (request, expected)) in cases.into_iter().enumerate() {
        let answer = change(&set, &format!("ann-{number}"), request).await;
        assert!(answer.starts_with(expected), "{number}: {answer}");
    }
}
