//! Tests of changes by requests at run time, and of their announcement to the maintainers of
//! actuators.

use acl::content::{Observation, Requested, RequestedSince};
use acl::{AgentId, Millis};
use capability::{
    ClaimSource, Declined, KnownFact, Owner, RequestedChanges, RequestedChangesSince, Timestamp,
};
use expect_test::expect;
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::sample::select;

use crate::office::{Office, effects, facts, id, office, office_of, thermometer, turtlebot};

fn observed(office: &mut Office, who: &str, facts: &str, known_for: &[(&str, u64)]) {
    let known_for = known_for.iter().map(|(fact, ms)| ((*fact).to_owned(), Millis::from(*ms)));
    let observation = Observation { facts: facts.to_owned(), known_for: known_for.collect() };
    let known = KnownFact::read(&observation, office.now).expect("PDDL");
    office.maintainer.apply_observation(&id(who), &known, office.now).expect("room");
}

/// Announces all requested changes of the maintainer in `central` to the actuator's maintainer in
/// `local`.
fn tell(central: &Office, local: &mut Office) -> Requested {
    let told = central.maintainer.requested(central.now);
    let requests = RequestedChanges::read(&told, local.now).expect("PDDL");
    local.maintainer.apply_leader_requests(&requests, local.now).expect("room");
    told
}

/// Announces the requested changes since the last call to the actuator's maintainer, or all of them
/// if that is necessary.
fn tell_news(central: &mut Office, local: &mut Office) -> Option<RequestedSince> {
    let Some(since) = central.maintainer.requested_since(central.now) else {
        tell(central, local);
        return None;
    };
    let requests = RequestedChangesSince::read(&since, local.now).expect("PDDL");
    local.maintainer.follow_since(&requests, local.now).expect("room");
    Some(since)
}

fn metric(text: &str) -> Option<pddl::Metric> {
    Some(pddl::parse_metric(text).into_result().expect("a metric"))
}

#[test]
fn an_observation_is_a_claim_of_its_observer_until_it_expires() {
    let mut office = office().with([thermometer("t-1")]);
    observed(&mut office, "ann", "", &[("(known-temperature office2)", 10_000)]);
    assert_eq!(office.known("known-temperature"), "(known-temperature office2)");
    let provenance = office.maintainer.provenance(office.now);
    let claims = provenance.iter().flat_map(|fact| &fact.claims);
    let claim = claims.into_iter().find(|claim| claim.owner == id("ann").into()).expect("hers");
    assert_eq!(
        (claim.source, claim.left.map(|left| left.as_secs())),
        (ClaimSource::Observation, Some(10))
    );
    office.now = Timestamp(11_000);
    assert_eq!(office.known("known-temperature"), "");
}

#[test]
fn all_contradicting_observations_are_kept_and_the_newest_is_believed() {
    let ontology_has = "(= (distance corridor office2) 6)";
    let mut office = office();
    observed(&mut office, "ann", "(= (distance corridor office2) 7)", &[]);
    observed(&mut office, "bob", "(= (distance corridor office2) 5)", &[]);
    assert_eq!(office.known("distance"), "(= (distance corridor office2) 5)");
    let provenance = office.maintainer.provenance(office.now);
    let of = provenance.iter().find(|fact| fact.fact.to_string().contains("distance"));
    let said: Vec<String> = of
        .expect("it is claimed")
        .claims
        .iter()
        .map(|claim| format!("{}: {}", claim.owner, claim.said))
        .collect();
    expect![[r#"
        [
            "the map: (= (distance corridor office2) 6)",
            "ann: (= (distance corridor office2) 7)",
            "bob: (= (distance corridor office2) 5)",
        ]
    "#]]
    .assert_debug_eq(&said);
    let fact = &facts(ontology_has)[0];
    let others = office.maintainer.contradicting(fact, &Owner::Map);
    assert_eq!(others.len(), 2);
    // All owners that claim a fact contradict an observed `(not FACT)`.
    let not = &facts("(not (connected corridor office2))")[0];
    let others = office.maintainer.contradicting(not, &Owner::Agent(id("ann")));
    assert_eq!(others[0].0, Owner::Map);
    observed(&mut office, "ann", "(not (connected corridor office2))", &[]);
    assert_eq!(office.known("connected"), "");
}

#[test]
fn a_heartbeat_of_the_owner_overrides_an_observation() {
    let mut office = office().with([turtlebot("t")]);
    observed(&mut office, "ann", "(= (speed t) 9)", &[]);
    assert_eq!(office.known("speed"), "(= (speed t) 9)");
    office.beat("t", (1, 1), "(at t corridor) (= (speed t) 0.2)", "").expect("a heartbeat");
    assert_eq!(office.known("speed"), "(= (speed t) 0.2)");
}

#[test]
fn actions_are_changed_atomically() {
    let mut office = office().with([turtlebot("t"), thermometer("one")]);
    let of = |action: &str, agent: Option<AgentId>| (action.into(), agent);
    let now = office.now;
    let wrong = [of("move", None), of("fly", Some(id("t")))];
    let declined = office.maintainer.change_actions(&wrong, &[], now).expect_err("no fly");
    assert_eq!(declined.to_string(), "no agent offers `fly` of `t`");
    assert_eq!(office.known("offers-move"), "(offers-move t)");
    let wrong = [of("move", None)];
    let declined = office.maintainer.change_actions(&[], &wrong, now).expect_err("it is not");
    assert!(matches!(declined, Declined::UnknownAction { is_given_back: true, .. }));
    let change = office.maintainer.change_actions(&[of("move", None)], &[], now).expect("offered");
    assert!(change.epoch_changed);
    let (give, take) = ([of("move", None)], [of("report-temperature", Some(id("one")))]);
    office.maintainer.change_actions(&take, &give, now).expect("offered, withheld");
    assert_eq!(office.known("offers-move"), "(offers-move t)");
    assert_eq!(office.known("offers-report-temperature"), "");
}

#[test]
fn a_meaningless_metric_is_declined() {
    let mut office = office().with([turtlebot("t")]);
    let now = office.now;
    let nonsense = metric("(:metric minimize (joy t))");
    assert!(matches!(
        office.maintainer.set_metric(nonsense, now),
        Err(Declined::Meaningless { .. })
    ));
    let slow = metric("(:metric minimize (* 2 (total-cost)))");
    let change = office.maintainer.set_metric(slow.clone(), now).expect("it makes sense");
    assert!(change.epoch_changed);
    assert_eq!(office.snapshot().problem.metric, slow);
    let again = office.maintainer.set_metric(slow, now).expect("it makes sense");
    assert!(again.is_empty());
}

#[test]
fn changes_by_requests_reach_an_actuators_maintainer() {
    let mut central = office().with([turtlebot("t"), thermometer("one")]);
    let mut local = office_of("one").with([turtlebot("t"), thermometer("one")]);
    assert_eq!(tell(&central, &mut local), Requested::default());
    let (ann, now) = (Owner::Agent(id("ann")), central.now);
    let change = effects("(connected office2 corridor) (not (connected corridor office2))");
    central.maintainer.apply_request(&ann, &change, now).expect("room");
    observed(&mut central, "bob", "", &[("(known-temperature office2)", 10_000)]);
    let slow = metric("(:metric minimize (* 2 (total-cost)))");
    central.maintainer.set_metric(slow.clone(), now).expect("it makes sense");
    let one = Some(id("one"));
    central
        .maintainer
        .disable_action("report-temperature".into(), one.clone(), now)
        .expect("offered");
    tell(&central, &mut local);
    assert_eq!(local.known("connected"), "(connected office2 corridor)");
    assert_eq!(local.known("known-temperature"), "(known-temperature office2)");
    assert_eq!(local.snapshot().problem.metric, slow);
    assert!(local.snapshot().offers().is_empty());
    // A repeated announcement changes nothing.
    let told = RequestedChanges::read(&central.maintainer.requested(central.now), local.now);
    let change =
        local.maintainer.apply_leader_requests(&told.expect("PDDL"), local.now).expect("room");
    assert!(change.is_empty(), "{change:?}");
    // A fact that is no longer announced is withdrawn. A fact that is announced again keeps its
    // expiry.
    central
        .maintainer
        .apply_request(&ann, &effects("(not (connected office2 corridor))"), now)
        .expect("room");
    central.maintainer.enable_action("report-temperature".into(), one, now).expect("withheld");
    central.maintainer.set_metric(None, now).expect("it makes sense");
    tell(&central, &mut local);
    assert_eq!(local.known("connected"), "");
    assert_eq!(local.snapshot().offers().len(), 1);
    local.now = Timestamp(11_000);
    assert_eq!(local.known("known-temperature"), "");
}

/// A change of requested facts, and whether the change is announced to the actuators afterwards.
#[derive(Clone, Copy, Debug)]
struct Step {
    what: u8,
    who: &'static str,
    fact: &'static str,
    number: u8,
    is_told: bool,
}

fn steps() -> impl Strategy<Value = Vec<Step>> {
    let facts =
        ["(connected office2 corridor)", "(= (speed t) 9)", "(= (speed t) 8)", "(at t office2)"];
    let step = (0..6u8, select(vec!["ann", "bob", "t", "one"]), select(facts.to_vec()), 1..4u8);
    let step = (step, any::<bool>()).prop_map(|((what, who, fact, number), is_told)| Step {
        what,
        who,
        fact,
        number,
        is_told,
    });
    vec(step, 1..60)
}

/// Applies a step to the central maintainer. Heartbeats and steps of time are also applied to the
/// maintainers of the actuators.
fn happen(step: Step, beat: u64, central: &mut Office, locals: [&mut Office; 2]) {
    let Step { what, who, fact, number, .. } = step;
    let (owner, now) = (Owner::Agent(id(who)), central.now);
    let maintainer = &mut central.maintainer;
    match what {
        // If another agent is responsible for the fact, the request is refused.
        0 => drop(maintainer.apply_request(&owner, &effects(fact), now)),
        1 if fact.starts_with("(=") => (),
        1 => {
            let not = effects(&format!("(not {fact}) (not (connected corridor office2))"));
            drop(maintainer.apply_request(&owner, &not, now));
        }
        2 => observed(central, who, "", &[(fact, u64::from(number) * 1_000)]),
        3 => {
            drop(maintainer.apply_effects(&id("t"), None, &effects(fact), now).expect("it is here"))
        }
        4 => {
            let said = format!("(at t corridor) (= (speed t) {number})");
            for office in { locals }.into_iter().chain([central]) {
                office.beat("t", (1, beat), &said, "").expect("a heartbeat");
            }
        }
        _ => {
            for office in { locals }.into_iter().chain([central]) {
                office.now = Timestamp(now.0 + 2_000);
                office.maintainer.expire(office.now);
            }
        }
    }
}

/// Returns all claims in the office, each with owner, source and expiry.
fn claims(office: &Office) -> Vec<String> {
    let mut claims = Vec::new();
    for fact in office.maintainer.provenance(office.now) {
        claims.extend(fact.claims.iter().map(|claim| {
            format!("{} of {}, {}, {:?}", claim.said, claim.owner, claim.source, claim.left)
        }));
    }
    claims
}

proptest! {
    #[test]
    fn incremental_request_updates_equal_full_updates(
        steps in steps(),
    ) {
        let house = || [turtlebot("t"), thermometer("one"), thermometer("two")];
        let mut central = office().with(house());
        let mut by_all = office_of("one").with(house());
        let mut by_news = office_of("one").with(house());
        let _ = central.maintainer.requested_since(central.now);
        for (beat, step) in (1..).zip(steps) {
            happen(step, beat, &mut central, [&mut by_all, &mut by_news]);
            if step.is_told {
                tell(&central, &mut by_all);
                prop_assert!(tell_news(&mut central, &mut by_news).is_some());
                prop_assert_eq!(claims(&by_news), claims(&by_all));
            }
        }
    }
}

#[test]
fn incremental_request_updates_contain_only_the_changes() {
    let mut central = office().with([turtlebot("t"), thermometer("one")]);
    let mut local = office_of("one").with([turtlebot("t"), thermometer("one")]);
    let ann = Owner::Agent(id("ann"));
    let now = central.now;
    assert_eq!(tell_news(&mut central, &mut local), None);
    assert_eq!(tell_news(&mut central, &mut local), Some(RequestedSince::default()));
    for number in 0..1_000 {
        let fact = effects(&format!("(connected room-{number} corridor)"));
        central.maintainer.apply_request(&ann, &fact, now).expect("room");
        let since = tell_news(&mut central, &mut local).expect("no more than facts");
        assert_eq!((since.facts.len(), since.withdrawn.len()), (1, 0));
    }
    central
        .maintainer
        .apply_request(&ann, &effects("(not (connected room-7 corridor))"), now)
        .expect("room");
    let since = tell_news(&mut central, &mut local).expect("no more than facts");
    assert_eq!((since.facts.len(), since.withdrawn.len()), (0, 1));
    assert_eq!(since.withdrawn[0].fact, "(connected room-7 corridor)");
    // If very many facts change at once, all of them are announced anew.
    for number in 1_000..2_500 {
        let fact = effects(&format!("(connected room-{number} corridor)"));
        central.maintainer.apply_request(&ann, &fact, now).expect("room");
    }
    assert_eq!(tell_news(&mut central, &mut local), None);
    assert_eq!(local.known("connected"), central.known("connected"));
}

#[test]
fn facts_in_an_agents_own_heartbeats_are_not_announced() {
    let mut central = office().with([turtlebot("t")]);
    let now = central.now;
    let _ = central.maintainer.requested_since(now);
    let moved = effects("(not (at t corridor)) (at t office2)");
    central.maintainer.apply_effects(&id("t"), None, &moved, now).expect("it is here");
    assert_eq!(central.maintainer.requested_since(now), Some(RequestedSince::default()));
    central.beat("t", (1, 1), "(at t office2)", "").expect("a heartbeat");
    assert_eq!(central.maintainer.requested_since(now), Some(RequestedSince::default()));
}

#[test]
fn the_last_of_several_claims_is_announced_last() {
    let mut central = office().with([turtlebot("t")]);
    let mut local = office_of("one").with([turtlebot("t"), thermometer("one")]);
    let _ = central.maintainer.requested_since(central.now);
    for (who, number) in [("zed", 9), ("bob", 8), ("zed", 9), ("bob", 7), ("ann", 6), ("zed", 5)] {
        observed(&mut central, who, &format!("(= (distance corridor office2) {number})"), &[]);
        if number < 9 {
            tell_news(&mut central, &mut local);
            assert_eq!(local.known("distance"), central.known("distance"));
        }
    }
}

#[test]
fn an_announced_claim_does_not_override_the_owners_heartbeat() {
    let mut central = office().with([turtlebot("t")]);
    let mut local = office_of("one").with([turtlebot("t"), thermometer("one")]);
    // An effect is not announced if the robot's own heartbeats report such facts.
    let moved = effects("(not (at t corridor)) (at t office2)");
    let now = central.now;
    central.maintainer.apply_effects(&id("t"), None, &moved, now).expect("it is here");
    assert_eq!(tell(&central, &mut local), Requested::default());
    local.beat("t", (1, 1), "(at t corridor)", "").expect("a heartbeat");
    observed(&mut central, "t", "(at t office2)", &[]);
    tell(&central, &mut local);
    assert_eq!(local.known("at"), "(at t corridor)");
    // An effect on facts outside the robot's heartbeats is announced.
    let opened = effects("(connected office2 corridor)");
    central.maintainer.apply_effects(&id("t"), None, &opened, now).expect("it is here");
    tell(&central, &mut local);
    assert!(local.known("connected").contains("(connected office2 corridor)"));
    // An announced number does not override the number of the agent that is responsible for the
    // fact.
    observed(&mut central, "ann", "(= (speed t) 9)", &[]);
    tell(&central, &mut local);
    for office in [&mut central, &mut local] {
        office.beat("t", (1, 2), "(at t corridor) (= (speed t) 0.2)", "").expect("a heartbeat");
    }
    tell(&central, &mut local);
    assert_eq!(local.known("speed"), "(= (speed t) 0.2)");
}

#[test]
fn the_central_maintainer_ignores_announced_requests() {
    let mut central = office();
    let told =
        Requested { retracted: "(connected corridor office2)".into(), ..Requested::default() };
    let requests = RequestedChanges::read(&told, central.now).expect("PDDL");
    let change =
        central.maintainer.apply_leader_requests(&requests, central.now).expect("nothing to take");
    assert!(change.is_empty());
    assert_eq!(central.known("connected"), "(connected corridor office2)");
    let unreadable = Requested { metric: Some("minimize".into()), ..Requested::default() };
    assert!(RequestedChanges::read(&unreadable, central.now).is_err());
}

#[test]
fn earlier_requests_are_restored_below_younger_ones() {
    let mut office = office();
    office.maintainer.set_standby(true);
    office.maintainer.set_standby(false);
    office.maintainer.begin_partition_log();
    office.set("bob", "(= (distance corridor office2) 5)").expect("a request");
    office.set("bob", "(not (known-temperature office2))").expect("a request");
    office.set("cem", "(connected office2 corridor)").expect("a request");
    let of_ann = |fact: &str| (id("ann"), KnownFact::from(facts(fact)[0].clone()));
    let earlier = RequestedChanges {
        facts: vec![
            of_ann("(= (distance corridor office2) 3)"),
            of_ann("(= (distance office2 corridor) 3)"),
            of_ann("(known-temperature office2)"),
        ],
        ..RequestedChanges::default()
    };
    office.maintainer.restore_earlier_requests(&earlier, office.now).expect("room");
    let expected = "(= (distance corridor office2) 5)\n(= (distance office2 corridor) 3)";
    assert_eq!(office.known("distance"), expected);
    assert_eq!(office.known("known-temperature"), "", "it was denied later");
    assert_eq!(
        office.known("connected"),
        "(connected corridor office2)\n(connected office2 corridor)"
    );
}
