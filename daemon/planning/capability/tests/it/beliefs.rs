//! Tests which claims are believed, for how long, and in which order.

use acl::Incarnation;
use capability::{Declined, Owner, Timestamp};
use expect_test::expect;

use crate::office::{Office, effects, facts, id, ir_sensor, office, thermometer, told, turtlebot};

fn robots() -> Office {
    office().with([turtlebot("turtlebot-1"), turtlebot("turtlebot-2")])
}

#[test]
fn a_fact_missing_in_a_heartbeat_is_false_if_its_agent_owns_it() {
    let mut office = robots();
    let at = "(at turtlebot-1 office2)";
    let change = office.beat("turtlebot-1", (1, 1), at, "").expect("a heartbeat");
    expect![[r#"
        epoch 2, revision 3
        + (at turtlebot-1 office2)
        - (at turtlebot-1 corridor)
    "#]]
    .assert_eq(&told(&change));
    // The robot's model contains its speed, which no action changes, so a missing speed is not
    // false. A missing position is false.
    let change = office.beat("turtlebot-1", (1, 2), "", "").expect("a heartbeat");
    expect![[r#"
        epoch 2, revision 4
        - (at turtlebot-1 office2)
    "#]]
    .assert_eq(&told(&change));
    assert_eq!(office.known("speed"), "(= (speed turtlebot-1) 0.3)\n(= (speed turtlebot-2) 0.3)");
    // After the first heartbeat with the speed, a missing speed is false, too.
    office.beat("turtlebot-1", (1, 3), "(= (speed turtlebot-1) 0.1)", "").expect("a heartbeat");
    assert_eq!(office.known("speed"), "(= (speed turtlebot-1) 0.1)\n(= (speed turtlebot-2) 0.3)");
    office.beat("turtlebot-1", (1, 4), "", "").expect("a heartbeat");
    assert_eq!(office.known("speed"), "(= (speed turtlebot-2) 0.3)");
}

#[test]
fn late_reports_are_declined() {
    let mut office = robots();
    office.beat("turtlebot-1", (1, 7), "(at turtlebot-1 office2)", "").expect("a heartbeat");
    let late = office.beat("turtlebot-1", (1, 7), "(at turtlebot-1 corridor)", "");
    assert!(matches!(late, Err(Declined::OldSequence { reported: 7, current: 7, .. })), "{late:?}");

    office.admit_life(&turtlebot("turtlebot-1"), 5).expect("a new incarnation");
    let late = office.beat("turtlebot-1", (1, 8), "(at turtlebot-1 office2)", "");
    expect!["`turtlebot-1` is in incarnation 5; incarnation 1 is not believed"]
        .assert_eq(&late.expect_err("an earlier incarnation").to_string());
    let done = effects("(at turtlebot-1 office2)");
    let now = office.now;
    let agent = id("turtlebot-1");
    let late = office.maintainer.apply_effects(&agent, Some(Incarnation(1)), &done, now);
    assert!(matches!(late, Err(Declined::FormerIncarnation { .. })), "{late:?}");
    assert!(office.admit_life(&turtlebot("turtlebot-1"), 4).is_err());
    assert_eq!(office.known("at"), "(at turtlebot-1 corridor)\n(at turtlebot-2 corridor)");

    // The former incarnation is still rejected after the new one has left.
    office.maintainer.remove(&agent, Incarnation(5), now);
    assert!(office.admit_life(&turtlebot("turtlebot-1"), 4).is_err());
    // The same incarnation can return: only the network had failed.
    assert!(office.admit_life(&turtlebot("turtlebot-1"), 5).is_ok());
}

#[test]
fn a_new_incarnation_with_the_same_model_sends_no_model() {
    let mut office = robots();
    office.beat("turtlebot-1", (1, 9), "(at turtlebot-1 office2)", "").expect("a heartbeat");
    let change = office.beat("turtlebot-1", (2, 1), "(docked turtlebot-1)", "");
    // Of the new incarnation, the facts of the model are known, except those that the heartbeat
    // omits.
    expect![[r#"
        epoch 2, revision 4
        - (at turtlebot-1 office2)
    "#]]
    .assert_eq(&told(&change.expect("a heartbeat of the new incarnation")));
    let stranger = office.beat("turtlebot-3", (1, 1), "", "");
    assert!(matches!(stranger, Err(Declined::UnknownAgent { .. })), "{stranger:?}");
}

#[test]
fn effects_are_believed_until_the_next_heartbeat_of_the_owner() {
    let mut office = robots().with([thermometer("t-1")]);
    let now = office.now;
    let moved = effects("(not (at turtlebot-1 corridor)) (at turtlebot-1 office2)");
    let change = office.maintainer.apply_effects(&id("turtlebot-1"), None, &moved, now);
    expect![[r#"
        epoch 3, revision 4
        + (at turtlebot-1 office2)
        - (at turtlebot-1 corridor)
    "#]]
    .assert_eq(&told(&change.expect("it is here")));
    let change = office.beat("turtlebot-1", (1, 1), "(at turtlebot-1 corridor)", "");
    expect![[r#"
        epoch 3, revision 5
        + (at turtlebot-1 corridor)
        - (at turtlebot-1 office2)
    "#]]
    .assert_eq(&told(&change.expect("a heartbeat")));
    // No heartbeat of the thermometer contains the measured fact, so this fact stays.
    let measured = effects("(known-temperature office2)");
    office.maintainer.apply_effects(&id("t-1"), None, &measured, now).expect("it is here");
    office.beat("t-1", (1, 1), "(located t-1 office2)", "").expect("a heartbeat");
    assert_eq!(office.known("known-temperature"), "(known-temperature office2)");
}

#[test]
fn another_owner_does_not_override_an_effect_of_a_responsible_agent() {
    let mut office = office().with([thermometer("t-1"), thermometer("t-2")]);
    let (known, not_known) = ("(known-temperature office2)", "(not (known-temperature office2))");
    office.beat("t-1", (1, 1), not_known, "").expect("a heartbeat");
    office.beat("t-2", (1, 1), not_known, "").expect("a heartbeat");
    // `t-1` measures and reports it, and the Plan Executor reports the effect of the action.
    office.beat("t-1", (1, 2), known, "").expect("a heartbeat");
    let now = office.now;
    office.maintainer.apply_effects(&id("t-1"), None, &effects(known), now).expect("it is here");
    // `t-2` repeats its earlier heartbeat: it has not measured.
    office.beat("t-2", (1, 2), not_known, "").expect("a heartbeat");
    assert_eq!(office.known("known-temperature"), known);
    // The heartbeat of `t-1` itself overrides the effect.
    office.beat("t-1", (1, 3), not_known, "").expect("a heartbeat");
    assert_eq!(office.known("known-temperature"), "");
}

#[test]
fn facts_can_be_known_for_a_while() {
    let mut office = office().with([thermometer("t-1"), thermometer("t-2")]);
    let known = "(known-temperature office2)";
    office.beat("t-1", (1, 1), "", known).expect("a heartbeat");
    office.now = Timestamp(2_000);
    office.beat("t-2", (1, 1), "", known).expect("a heartbeat");
    // The claim of one owner has expired; that of the other owner has not.
    office.now = Timestamp(11_000);
    assert_eq!(office.known("known-temperature"), known);
    assert_eq!(told(&office.maintainer.expire(office.now)).matches("known").count(), 0);
    office.now = Timestamp(12_000);
    // A snapshot omits the expired fact even before `expire` is called.
    assert_eq!(office.known("known-temperature"), "");
    let change = office.maintainer.expire(office.now);
    assert_eq!(change.retracted, facts(known));
}

#[test]
fn several_owners_may_claim_one_fact() {
    let mut office = robots();
    let door = "(connected office2 corridor)";
    office.set("keyboard", door).expect("a request");
    office.set("desk", door).expect("a request");
    assert!(office.remove("desk").retracted.is_empty());
    assert!(office.known("connected").contains(door));
    let change = office.remove("keyboard");
    assert_eq!(change.retracted, facts(door));
}

#[test]
fn a_request_against_the_fact_of_a_responsible_agent_is_refused() {
    let mut office = robots();
    let at = |place: &str| format!("(at turtlebot-1 {place})");
    let refused = |office: &mut Office, fact: &str| match office.set("keyboard", fact) {
        Err(declined) => declined.to_string(),
        Ok(change) => panic!("{fact} was believed: {change:?}"),
    };
    assert_eq!(
        refused(&mut office, &at("office2")),
        "`turtlebot-1` answers for `(at turtlebot-1 office2)`, and it says `(at turtlebot-1 \
         corridor)`"
    );
    assert!(refused(&mut office, "(not (at turtlebot-1 corridor))").contains("it says"));
    assert!(refused(&mut office, "(= (speed turtlebot-1) 3)").contains("turtlebot-1) 0.3)`"));
    // A request may repeat the agent's own fact. Any owner may request a fact that no agent is
    // responsible for.
    assert!(office.set("keyboard", &at("corridor")).expect("it is so").is_empty());
    office.set("keyboard", "(known-temperature office2)").expect("no agent answers for it");
    // A silent or masked agent is not responsible for any fact.
    office.mask("turtlebot-1");
    office.set("keyboard", &at("office2")).expect("it is away");
    assert!(office.known("at").contains(&at("office2")));
    office.unmask("turtlebot-1");
    office.beat("turtlebot-1", (1, 1), &at("corridor"), "").expect("a heartbeat");
    assert!(!office.known("at").contains(&at("office2")), "its heartbeat overrides");
}

#[test]
fn the_claim_of_a_responsible_agent_ends_all_other_claims() {
    let mut office = office().with([turtlebot("turtlebot-1"), thermometer("t-1")]);
    let known = "(known-temperature office2)";
    let now = office.now;
    // The robot claims a fact about a room that no heartbeat of the thermometer has contained.
    office.maintainer.apply_effects(&id("turtlebot-1"), None, &effects(known), now).expect("here");
    office.beat("t-1", (1, 1), "(located t-1 office2)", "").expect("a heartbeat");
    assert_eq!(office.known("known-temperature"), known);
    // From now on the thermometer is responsible for the fact, which is false if a heartbeat omits
    // it.
    office.beat("t-1", (1, 2), &format!("(located t-1 office2) {known}"), "").expect("a beat");
    assert_eq!(office.known("known-temperature"), known);
    office.beat("t-1", (1, 3), "(located t-1 office2)", "").expect("a heartbeat");
    assert_eq!(office.known("known-temperature"), "");
    assert!(office.set("keyboard", known).is_err());
    // The claim of the map is withdrawn when an agent denies the fact explicitly.
    office.beat("t-1", (1, 4), "(not (connected corridor office2))", "").expect("a heartbeat");
    assert_eq!(office.known("connected"), "");
}

#[test]
fn a_cost_below_zero_is_refused() {
    let mut office = robots();
    let declined = office.set("keyboard", "(= (distance corridor office2) -5)").expect_err("no");
    assert_eq!(
        declined.to_string(),
        "`(= (distance corridor office2) -5)` cannot be: `distance` is part of the cost of actions, \
         which is 0 or more"
    );
    office.set("keyboard", "(= (distance corridor office2) 0)").expect("it may be");
}

#[test]
fn a_claimed_cost_below_zero_is_ignored() {
    let mut office = robots();
    office.beat("turtlebot-1", (1, 1), "(= (distance corridor office2) -5)", "").expect("a beat");
    assert_eq!(office.known("distance"), "(= (distance corridor office2) 6)", "the map's fact");
    let misfit = office.maintainer.misfit(&facts("(= (distance corridor office2) -5)")[0]);
    assert_eq!(misfit.as_deref(), Some("actions cost `distance`, and nothing costs less than 0"));
    office.beat("turtlebot-1", (1, 2), "(= (distance corridor office2) 5)", "").expect("a beat");
    assert_eq!(office.known("distance"), "(= (distance corridor office2) 5)");
}

#[test]
fn a_missing_fact_does_not_override_the_claim_of_another_owner() {
    let mut office = office().with([thermometer("t-1"), thermometer("t-2")]);
    let known = "(known-temperature office2)";
    // The heartbeats of both agents have contained the fact, so both are responsible for it.
    office.beat("t-2", (1, 1), known, "").expect("a heartbeat");
    office.beat("t-2", (1, 2), "", "").expect("a heartbeat");
    office.beat("t-1", (1, 1), known, "").expect("a heartbeat");
    office.set("keyboard", &format!("(not {known})")).expect_err("`t-1` says that it is so");
    assert_eq!(office.known("known-temperature"), known);
}

#[test]
fn the_newest_claim_of_a_number_is_believed() {
    let mut office = robots();
    let meters = |number: u32| format!("(= (distance corridor office2) {number})");
    assert_eq!(office.known("distance"), meters(6));
    office.set("keyboard", &meters(9)).expect("a request");
    assert_eq!(office.known("distance"), meters(9));
    office.set("desk", &meters(7)).expect("a request");
    assert_eq!(office.known("distance"), meters(7));
    office.remove("desk");
    assert_eq!(office.known("distance"), meters(9));
}

#[test]
fn contradicting_heartbeats_do_not_alternate() {
    let mut office = robots();
    let speed = |office: &Office| office.known("speed").lines().next().map(str::to_owned);
    let word = |number: &str| format!("(= (speed turtlebot-1) {number})");
    let says = |office: &mut Office, who: &str, beat: u64, number: &str| {
        let change = office.beat(who, (1, beat), &word(number), "").expect("a heartbeat");
        change.believed.iter().any(|fact| fact.to_string().contains("speed turtlebot-1"))
    };
    assert!(says(&mut office, "turtlebot-1", 1, "0.2"));
    assert!(says(&mut office, "turtlebot-2", 1, "0.7"));
    for beat in 2..10 {
        assert!(!says(&mut office, "turtlebot-1", beat, "0.2"), "it is what it said before");
        assert!(!says(&mut office, "turtlebot-2", beat, "0.7"), "it is believed already");
    }
    assert_eq!(speed(&office), Some(word("0.7")), "the claim that changed last");
    assert!(says(&mut office, "turtlebot-1", 10, "0.3"), "a new claim is newer");
    assert_eq!(speed(&office), Some(word("0.3")));
    office.set("keyboard", &word("0.9")).expect_err("both answer for it");
    assert_eq!(speed(&office), Some(word("0.3")));
}

#[test]
fn a_request_changes_the_map() {
    let mut office = office();
    let now = office.now;
    let door = facts("(connected corridor office2)");
    let change = office.maintainer.retract(&door, now);
    assert_eq!((change.retracted, change.epoch_changed), (door, false));
    let opened = effects("(connected office2 corridor) (= (distance corridor office2) 9)");
    office.maintainer.apply_request(&Owner::Map, &opened, now).expect("a request");
    assert_eq!(office.known("connected"), "(connected office2 corridor)");
    assert_eq!(office.known("distance"), "(= (distance corridor office2) 9)");
}

#[test]
fn facts_are_left_out_until_their_names_are_declared() {
    let mut office = office();
    let bad = "(at turtlebot-1 corridor) (at corridor corridor) (at corridor) (flying corridor)";
    assert!(office.set("keyboard", bad).expect("a request").is_empty());
    let reasons: Vec<String> = { office.maintainer.provenance(office.now).into_iter() }
        .filter_map(|fact| Some(format!("{}: {}\n", fact.fact, fact.left_out?)))
        .collect();
    expect![[r#"
        (at corridor): it has 1 of the 2 arguments of `at`
        (at corridor corridor): `corridor` is not of the type that `at` takes
        (at turtlebot-1 corridor): `turtlebot-1` is not here
        (flying corridor): `flying` is not declared
    "#]]
    .assert_eq(&reasons.concat());
    office.admit(&turtlebot("turtlebot-1"));
    let change = office.remove("turtlebot-1");
    assert!(change.retracted.contains(&facts("(at turtlebot-1 corridor)")[0]), "{change:?}");
}

#[test]
fn provenance_names_owners_and_ages() {
    let mut office = office().with([thermometer("t-1"), ir_sensor("ir-1", "base")]);
    office.beat("t-1", (1, 3), "", "(known-temperature office2)").expect("a heartbeat");
    office.set("keyboard", "(known-temperature office2)").expect("a request");
    office.now = Timestamp(5_000);
    let lines: Vec<String> = { office.maintainer.provenance(office.now).into_iter() }
        .map(|fact| {
            let claims: Vec<String> = { fact.claims.iter() }
                .map(|by| {
                    format!(
                        "  {} ({:?}, incarnation {}, heartbeat {}) {:?} ago, {:?} left\n",
                        by.owner, by.source, by.incarnation, by.sequence, by.age, by.left
                    )
                })
                .collect();
            format!("{} {}\n{}", fact.fact, fact.left_out.unwrap_or_default(), claims.concat())
        })
        .collect();
    expect![[r#"
        (connected corridor office2) 
          the map (Model, incarnation 0, heartbeat 0) 5s ago, None left
        (known-temperature office2) 
          keyboard (Request, incarnation 0, heartbeat 0) 4s ago, None left
          t-1 (Heartbeat, incarnation 1, heartbeat 3) 4s ago, Some(6s) left
        (located t-1 office2) 
          t-1 (Model, incarnation 1, heartbeat 0) 4s ago, None left
        (mounted-on ir-1 base) `base` is not here
          ir-1 (Model, incarnation 1, heartbeat 0) 4s ago, None left
        (= (distance corridor office2) 6) 
          the map (Model, incarnation 0, heartbeat 0) 5s ago, None left
    "#]]
    .assert_eq(&lines.concat());
}
