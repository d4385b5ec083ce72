//! Tests of changes that are requested in a running ecosystem: how the Domain Maintainer answers,
//! that its state changes, and that the changes reach the Domain Maintainers of the actuators.

use std::time::Duration;

use acl::content::{
    ActionOf, BelievedState, ChangeActions, ChangeMetric, ChangeState, EpochChange, Inform,
    Observation, Request, RequestedFact, Snapshot,
};
use acl::{AgentId, Message, Millis, Performative};
use agent::{Agent, Callbacks, Context, Mode, Resource};
use tokio::sync::mpsc;

use super::asking::{change, office, read};

fn believe(believe: &str, retract: &str) -> Request {
    let (believe, retract) = (believe.to_owned(), retract.to_owned());
    Request::ChangeState(ChangeState { believe, retract, owner: None })
}

#[tokio::test(start_paused = true)]
async fn requested_changes_reach_the_actuators() {
    let (set, sensor) = office(Mode::Decentralized).await;
    let before: Snapshot = read(&set, &sensor, Resource::Domain).await;
    assert!(before.problem.contains("(connected corridor office1)"));
    assert!(!before.problem.contains("(known-humidity office2)"));
    let answer = change(&set, "ann", believe("", "(connected corridor office1)")).await;
    assert_eq!(answer, "done: believed");
    let known_for = [("(known-humidity office2)".to_owned(), Millis::from(20_000))].into();
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
        assert!(known.problem.contains("(known-humidity office2)"));
        assert!(known.problem.contains("(* 2 (total-cost))"));
        assert!(known.offers.keys().all(|agent| agent.as_str() != sensor));
    }
    // A temporary fact has expired in all maintainers.
    tokio::time::sleep(Duration::from_secs(20)).await;
    let local: Snapshot = read(&set, &sensor, Resource::Domain).await;
    assert!(!local.problem.contains("(known-humidity office2)"));
}

/// An agent that forwards to the test each change that the Domain Maintainer announces.
struct Listener(mpsc::UnboundedSender<EpochChange>);

impl Agent for Listener {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(Performative::Inform, Self::informed)
    }
}

impl Listener {
    fn informed(&mut self, message: Message, _: &mut Context<Self>) {
        if let Ok(Inform::Epoch(change)) = message.content_as()
            && (change.requested.is_some() || change.requested_since.is_some())
        {
            let _ = self.0.send(change);
        }
    }
}

#[tokio::test(start_paused = true)]
async fn a_change_is_announced_alone_and_all_changes_later() {
    let (set, _) = office(Mode::Decentralized).await;
    let (tell, mut announced) = mpsc::unbounded_channel();
    let listener = AgentId::new("listener").expect("a name");
    set.node.launch(listener, Listener(tell), set.ecosystem.domain.name.as_str());
    let facts = |told: Vec<RequestedFact>| -> Vec<String> {
        told.into_iter().map(|told| told.fact).collect()
    };
    let (one, two) = ("(connected office1 office2)", "(connected office2 office1)");
    let cases = [("ann", believe(one, "")), ("bob", believe(two, "")), ("cem", believe("", one))];
    let told = [(vec![one], vec![]), (vec![two], vec![]), (vec![], vec![one])];
    for ((who, request), (believed, withdrawn)) in cases.into_iter().zip(told) {
        assert_eq!(change(&set, who, request).await, "done: believed");
        let news = announced.recv().await.and_then(|change| change.requested_since).expect("news");
        assert_eq!(facts(news.facts), believed);
        assert_eq!(facts(news.withdrawn), withdrawn);
        if who == "ann" {
            continue;
        }
        // Announced once for all changes within a second.
        let all = announced.recv().await.and_then(|change| change.requested).expect("all");
        let expected = if who == "bob" { vec![one, two] } else { vec![two] };
        assert_eq!(facts(all.facts), expected);
    }
    tokio::time::sleep(Duration::from_secs(5)).await;
    assert!(announced.try_recv().is_err(), "nothing more is new");
}

#[tokio::test(start_paused = true)]
async fn a_requested_length_must_be_positive_and_replaces_that_of_the_map() {
    let (set, _) = office(Mode::Decentralized).await;
    let nothing = change(&set, "ann", believe("(= (distance corridor office1) 0)", "")).await;
    let expected = "the way from `corridor` to `office1` cannot be 0 m long; write more than 0";
    assert!(nothing.contains(expected), "{nothing}");
    let longer = change(&set, "bob", believe("(= (distance corridor office1) 90)", "")).await;
    let map = "done: believed; the map says `(= (distance corridor office1) ";
    assert!(longer.starts_with(map), "{longer}");
    assert!(longer.ends_with(", and this counts instead"), "{longer}");
}

#[tokio::test(start_paused = true)]
async fn contradicting_owners_are_reported() {
    let (set, _) = office(Mode::Decentralized).await;
    let observe = |facts: &str| {
        Request::Observe(Observation { facts: facts.to_owned(), known_for: [].into() })
    };
    let eighteen = "(= (temperature office1) 18)";
    assert_eq!(change(&set, "ann", observe(eighteen)).await, "done: believed");
    let answer = change(&set, "bob", observe("(= (temperature office1) 21)")).await;
    assert_eq!(
        answer,
        "done: believed; ann says `(= (temperature office1) 18)`, and this counts instead"
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
async fn a_senseless_change_is_refused_with_the_reason() {
    let (set, _) = office(Mode::Decentralized).await;
    let of = |action: &str| vec![ActionOf { action: action.to_owned(), agent: None }];
    let metric = |text: &str| Request::ChangeMetric(ChangeMetric { metric: Some(text.to_owned()) });
    let actions =
        |withhold, give_back| Request::ChangeActions(ChangeActions { withhold, give_back });
    let cases = [
        (actions(of("fly"), Vec::new()), "refuse: no agent offers `fly`"),
        (
            actions(Vec::new(), of("report-temperature")),
            "refuse: `report-temperature` is not withheld; name it as it was withheld",
        ),
        (actions(Vec::new(), Vec::new()), "refuse: it names no action to change"),
        (Request::Observe(Observation::default()), "refuse: it states no fact"),
        (metric("(:metric minimize (joy))"), "refuse: "),
        (metric("minimize"), "refuse: "),
        (believe("(at (", ""), "refuse: "),
    ];
    for (number, (request, expected)) in cases.into_iter().enumerate() {
        let answer = change(&set, &format!("ann-{number}"), request).await;
        assert!(answer.starts_with(expected), "{number}: {answer}");
    }
}
