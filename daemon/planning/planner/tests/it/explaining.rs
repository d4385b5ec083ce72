//! Explanations of unsolvable goals: the smart office without some of its agents, and small tasks
//! with other obstacles.

use std::collections::BTreeMap;

use expect_test::{Expect, expect};
use pddl::{ActionModel, Domain, Name, Problem};
use planner::explain::{ActionGuard, Explanation, ExplanationInput, explain};
use planner::validate::World;
use planner::{Cancel, Options};
use proptest::prelude::*;

use crate::support::parse;

const HEAD: &str = "(define (domain office) (:requirements :typing :action-costs)
    (:types location agent - object room corridor - location mobile-base sensor - agent
        temperature-sensor ir-temperature-sensor - sensor)
    (:predicates (connected ?a ?b - location) (at ?b - mobile-base ?l - location)
        (located ?s - sensor ?r - room) (mounted-on ?s - sensor ?b - mobile-base)
        (known-temperature ?r - room) (offers-move ?b - mobile-base)
        (offers-drive ?b - mobile-base) (offers-report ?s - temperature-sensor) (offers-measure ?s - ir-temperature-sensor))
    (:functions (distance ?a ?b - location) (total-cost))";

const MOVE: &str = "(:action move :agent ?b - mobile-base :parameters (?from ?to - location)
    :precondition (and (offers-move ?b) (at ?b ?from) (connected ?from ?to))
    :effect (and (not (at ?b ?from)) (at ?b ?to)
        (increase (total-cost) (distance ?from ?to))))";

const REPORT: &str = "(:action report-temperature--one :agent ?s - temperature-sensor
    :parameters (?r - room) :precondition (and (offers-report ?s) (located ?s ?r))
    :effect (and (known-temperature ?r) (increase (total-cost) 1)))";

const MEASURE: &str = "(:action report-temperature--two :agent ?s - ir-temperature-sensor
    :parameters (?b - mobile-base ?r - room)
    :precondition (and (offers-measure ?s) (mounted-on ?s ?b) (at ?b ?r))
    :effect (and (known-temperature ?r) (increase (total-cost) 2)))";

const MAP: &str = "(connected corridor office1) (connected office1 corridor)
    (= (distance corridor office1) 4) (= (distance office1 corridor) 4)
    (connected corridor office2) (connected office2 corridor)
    (= (distance corridor office2) 6) (= (distance office2 corridor) 6) (= (total-cost) 0)";

const GUARDS: &[(&str, &str, &str)] = &[
    ("move", "move", "offers-move"),
    ("report-temperature--one", "report-temperature", "offers-report"),
    ("report-temperature--two", "report-temperature", "offers-measure"),
];

fn guards(of: &[(&str, &str, &str)]) -> BTreeMap<Name, ActionGuard> {
    let guard = |(inside, outside, predicate): &(&str, &str, &str)| {
        let (outside, predicate) = (Name::new(outside), Name::new(predicate));
        (Name::new(inside), ActionGuard { outside, predicate })
    };
    of.iter().map(guard).collect()
}

fn office(actions: &str, objects: &str, init: &str) -> (Domain, Problem) {
    let problem = format!(
        "(define (problem p) (:domain office)
            (:objects office1 office2 - room corridor - corridor {objects})
            (:init {MAP} {init}) (:goal (and)))"
    );
    parse(&format!("{HEAD} {actions})"), &problem)
}

fn explained(
    (domain, problem): &(Domain, Problem),
    of: &[(&str, &str, &str)],
    former: &[ActionModel],
    goal: &str,
) -> Explanation {
    let goal = pddl::parse_condition(goal).into_result().expect("the goal parses");
    let world = World::initial(domain, problem).expect("makes sense");
    let parts = planner::goal::conjuncts(&world, &goal).expect("it is small");
    let guards = guards(of);
    let known = ExplanationInput { domain, problem, guards: &guards, former };
    explain(known, &parts, &Options::default(), &Cancel::new()).expect("supported")
}

/// Formats an explanation with one clause per line.
fn lines(explanation: &Explanation) -> String {
    let text = explanation.to_string().replace("; ", ";\n").replace(", or ", ",\nor ");
    text.replace(". Also", ".\nAlso") + "\n"
}

#[track_caller]
fn check(objects: &str, init: &str, expected: Expect) {
    let office = office(&[MOVE, REPORT, MEASURE].concat(), objects, init);
    let goal = "(forall (?r - room) (known-temperature ?r))";
    expected.assert_eq(&lines(&explained(&office, GUARDS, &[], goal)));
}

/// A robot on ways that are blocked for it, to places that are shut.
const WAYS: &str = "(define (domain ways) (:requirements :typing :negative-preconditions)
        (:types place robot) (:predicates (at ?r - robot ?p - place) (way ?a ?b - place)
            (blocked ?r - robot ?a ?b - place) (shut ?p - place))
        (:action move :parameters (?r - robot ?a ?b - place)
            :precondition (and (at ?r ?a) (way ?a ?b) (not (blocked ?r ?a ?b)) (not (shut ?b)))
            :effect (and (not (at ?r ?a)) (at ?r ?b))))";

/// Of three blocked ways, one has to be opened; which one of two ways to an office is opened does
/// not matter.
#[test]
fn facts_that_no_agent_ends_are_named_as_hindrances() {
    let problem = |init: &str| {
        format!(
            "(define (problem p) (:domain ways) (:objects hall lab attic store - place r - robot)
            (:init (at r hall) (way hall lab) (way hall attic) (way attic lab) (way lab store)
                {init}) (:goal (and)))"
        )
    };
    let both = parse(WAYS, &problem("(blocked r hall lab) (blocked r attic lab)"));
    let explanation = explained(&both, &[], &[], "(at r lab)");
    assert_eq!(
        explanation.to_string(),
        "no agent here can reach `(at r lab)`; `(blocked r hall lab)` prevents it, which no agent \
         here ends"
    );
    let all = parse(
        WAYS,
        &problem("(blocked r hall lab) (blocked r attic lab) (shut store) (shut hall)"),
    );
    let explanation = explained(&all, &[], &[], "(at r store)");
    assert_eq!(
        explanation.to_string(),
        "no agent here can reach `(at r store)`; `(blocked r hall lab)` and `(shut store)` prevent \
         it, which no agent here ends"
    );
    // A fact that does not matter is not named.
    let far = parse(WAYS, &problem("(blocked r hall lab)"));
    let explanation = explained(&far, &[], &[], "(way store hall)");
    assert!(explanation.obstacles[0].hindrances.is_empty(), "{explanation}");
}

#[test]
fn without_agents_a_sensor_or_a_robot_with_a_sensor_is_suggested() {
    check(
        "",
        "",
        expect![[r#"
        no agent can `report-temperature` at `office1` and `office2`;
        a temperature sensor there,
        or an ir temperature sensor mounted on a mobile base that can `move`, would do
    "#]],
    );
}

#[test]
fn a_sensor_without_a_robot_needs_one() {
    check(
        "ir - ir-temperature-sensor",
        "(offers-measure ir)",
        expect![[r#"
        no agent can `report-temperature` at `office1` and `office2`;
        a mobile base that can `move`, with `ir` mounted on it,
        or a temperature sensor there, would do
    "#]],
    );
}

/// Two kinds of robots have different actions with the same name. The explanation must list the
/// name once.
#[test]
fn actions_of_one_name_are_one_alternative() {
    let drive =
        MOVE.replace("move :agent", "move--two :agent").replace("offers-move", "offers-drive");
    let (objects, init) = ("tb - mobile-base", "(at tb corridor)");
    let office = office(&[MOVE, &drive].concat(), objects, init);
    let guards = [("move", "move", "offers-move"), ("move--two", "move", "offers-drive")];
    let explanation = explained(&office, &guards, &[], "(at tb office1)");
    assert_eq!(explanation.obstacles[0].alternatives.len(), 1, "{explanation:#?}");
    expect![[r#"
        no agent can `move` for `(at tb office1)`;
        `tb` does not offer `move` now
    "#]]
    .assert_eq(&lines(&explanation));
}

#[test]
fn a_present_agent_that_does_not_offer_the_action_is_named() {
    check(
        "tb - mobile-base ir - ir-temperature-sensor",
        "(offers-measure ir) (mounted-on ir tb) (at tb corridor)",
        expect![[r#"
            no agent can `report-temperature` at `office1` and `office2`;
            `tb` does not offer `move` now;
            a temperature sensor there,
            or an ir temperature sensor mounted on a mobile base that can `move`, would do
        "#]],
    );
}

#[test]
fn a_sensor_that_offers_nothing_is_named_only_for_its_room() {
    check(
        "one two - temperature-sensor",
        "(located one office1) (located two office2) (offers-report two)",
        expect![[r#"
            no agent can `report-temperature` at `office1`;
            `one` does not offer `report-temperature` now;
            a temperature sensor there,
            or an ir temperature sensor mounted on a mobile base that can `move`, would do
        "#]],
    );
}

#[test]
fn a_robot_without_a_sensor_needs_one_mounted_on_it() {
    check(
        "tb - mobile-base",
        "(offers-move tb) (at tb corridor)",
        expect![[r#"
        no agent can `report-temperature` at `office1` and `office2`;
        a temperature sensor there,
        or an ir temperature sensor mounted on `tb`, would do
    "#]],
    );
}

#[test]
fn a_sensor_in_another_room_is_not_suggested() {
    check(
        "one - temperature-sensor",
        "(located one office1) (offers-report one)",
        expect![[r#"
            no agent can `report-temperature` at `office2`;
            a temperature sensor there,
            or an ir temperature sensor mounted on a mobile base that can `move`, would do
        "#]],
    );
}

#[test]
fn actions_of_former_agents_are_suggested() {
    let office = office("", "", "");
    let model = |text: &str| pddl::parse_action_model(text).into_result().expect("a model");
    let former = [
        model(
            "(define (agent tb) (:domain office) (:types turtlebot - mobile-base)
                (:action move :agent ?b - turtlebot :parameters (?from ?to - location)
                    :precondition (and (at ?b ?from) (connected ?from ?to))
                    :effect (and (not (at ?b ?from)) (at ?b ?to))))",
        ),
        model(
            "(define (agent one) (:domain office)
                (:action report-temperature :agent ?s - temperature-sensor :parameters (?r - room)
                    :precondition (located ?s ?r) :effect (known-temperature ?r)))",
        ),
        // This model does not fit the current ontology, and must not affect the others.
        model(
            "(define (agent odd) (:domain office)
                (:action odd :agent ?s - unheard-of :parameters () :effect (unheard-of ?s)))",
        ),
    ];
    let goal = "(and (known-temperature office1) (exists (?b - mobile-base) (at ?b office2)))";
    let explanation = explained(&office, &[], &former, goal);
    expect![[r#"
        no agent can `report-temperature` at `office1`;
        a temperature sensor there would do.
        Also, no agent here can reach `(exists (?b - mobile-base) (at ?b office2))`;
        a turtlebot that can `move` would do
    "#]]
    .assert_eq(&lines(&explanation));
}

#[test]
fn an_action_that_no_agent_ever_had_is_reported() {
    let office = office(MOVE, "tb - mobile-base", "(offers-move tb) (at tb corridor)");
    let explanation = explained(&office, &GUARDS[..1], &[], "(known-temperature office1)");
    expect![[r#"
        no agent here can reach `(known-temperature office1)`;
        no agent that is or was here has an action for it
    "#]]
    .assert_eq(&lines(&explanation));
}

#[test]
fn parts_reachable_only_one_at_a_time_are_reported_to_interfere() {
    let actions = [MOVE, REPORT].concat();
    let office = office(&actions, "tb - mobile-base", "(offers-move tb) (at tb corridor)");
    let both = explained(&office, GUARDS, &[], "(and (at tb office1) (at tb office2))");
    expect![[r#"
        each part can be reached alone;
        together they interfere
    "#]]
    .assert_eq(&lines(&both));
    let one = explained(&office, GUARDS, &[], "(at tb office1)");
    expect![[r#"
        it can be reached if no step undoes anything;
        the steps towards it interfere
    "#]]
    .assert_eq(&lines(&one));
}

#[test]
fn a_numeric_obstacle_is_reported() {
    let texts = parse(
        "(define (domain d) (:requirements :typing :numeric-fluents) (:types robot)
            (:predicates (done) (offers-work ?r - robot)) (:functions (charge ?r - robot))
            (:action work :agent ?r - robot :parameters ()
                :precondition (and (offers-work ?r) (>= (charge ?r) 5)) :effect (done)))",
        "(define (problem p) (:domain d) (:objects r - robot)
            (:init (offers-work r) (= (charge r) 3)) (:goal (and)))",
    );
    let explanation = explained(&texts, &[("work", "work", "offers-work")], &[], "(done)");
    expect![[r#"
        no agent here can reach `(done)`;
        an action would do, but a numeric condition prevents it
    "#]]
    .assert_eq(&lines(&explanation));
}

#[test]
fn one_agent_may_lack_two_capabilities() {
    let texts = parse(
        "(define (domain d) (:requirements :typing) (:types robot box place)
            (:predicates (at ?r - robot ?p - place) (in ?b - box ?p - place)
                (holds ?r - robot ?b - box) (offers-go ?r - robot) (offers-pick ?r - robot)
                (offers-drop ?r - robot))
            (:action go :agent ?r - robot :parameters (?a ?b - place)
                :precondition (and (offers-go ?r) (at ?r ?a))
                :effect (and (at ?r ?b) (not (at ?r ?a))))
            (:action pick :agent ?r - robot :parameters (?b - box ?p - place)
                :precondition (and (offers-pick ?r) (at ?r ?p) (in ?b ?p)) :effect (holds ?r ?b))
            (:action drop :agent ?r - robot :parameters (?b - box ?p - place)
                :precondition (and (offers-drop ?r) (at ?r ?p) (holds ?r ?b))
                :effect (in ?b ?p)))",
        "(define (problem p) (:domain d) (:objects r - robot b - box x y z - place)
            (:init (at r x) (in b y) (offers-drop r)) (:goal (and)))",
    );
    let guards = &[
        ("go", "go", "offers-go"),
        ("pick", "pick", "offers-pick"),
        ("drop", "drop", "offers-drop"),
    ];
    expect![[r#"
        no agent can `drop` for `(in b z)`;
        `r` does not offer `go` and `pick` now;
        a robot there would do
    "#]]
    .assert_eq(&lines(&explained(&texts, guards, &[], "(in b z)")));
}

proptest! {
    /// In any building, the hindrances are a smallest set: without them the goal can be reached, and
    /// with any one of them it cannot. If there are none, no set of such facts would do.
    #[test]
    fn hindrances_suffice_and_none_is_too_many(
        ways in proptest::collection::vec((0..5_usize, 0..5_usize, any::<bool>()), 3..14),
        shut in proptest::collection::vec(any::<bool>(), 5),
    ) {
        let places = ["a", "b", "c", "d", "e"];
        let mut facts = vec!["(at r a)".to_owned()];
        let mut hindering = Vec::new();
        for (from, to, blocked) in ways {
            let (from, to) = (places[from], places[to]);
            facts.push(format!("(way {from} {to})"));
            hindering.extend(blocked.then(|| format!("(blocked r {from} {to})")));
        }
        let shut = places.iter().zip(shut).filter(|(_, shut)| *shut);
        hindering.extend(shut.map(|(place, _)| format!("(shut {place})")));
        hindering.sort();
        hindering.dedup();
        let building = |left_out: &[String]| {
            let kept = hindering.iter().filter(|fact| !left_out.contains(fact));
            let init: Vec<&str> = facts.iter().chain(kept).map(String::as_str).collect();
            parse(WAYS, &format!(
                "(define (problem p) (:domain ways) (:objects a b c d e - place r - robot)
                    (:init {}) (:goal (at r e)))", init.join(" ")))
        };
        let is_reachable = |left_out: &[String]| {
            let (domain, problem) = building(left_out);
            let outcome = planner::plan(&domain, &problem, &Options::default(), &Cancel::new());
            outcome.expect("supported").plan.is_some()
        };
        let told = explained(&building(&[]), &[], &[], "(at r e)");
        let found: Vec<String> = { told.obstacles.iter() }
            .flat_map(|obstacle| &obstacle.hindrances)
            .map(ToString::to_string)
            .collect();
        if is_reachable(&[]) {
            prop_assert!(told.obstacles.is_empty());
        } else if found.is_empty() {
            prop_assert!(!is_reachable(&hindering));
        } else {
            prop_assert!(is_reachable(&found), "{found:?}");
            for one in 0..found.len() {
                let mut fewer = found.clone();
                fewer.remove(one);
                prop_assert!(!is_reachable(&fewer), "{fewer:?} would do");
            }
        }
    }

    /// For any set of facts: every alternative names one or two missing capabilities, and the same
    /// query has the same result. A part that is reported unreachable has no plan. Without
    /// obstacles, the goal has a plan.
    #[test]
    fn explanations_are_sound_and_deterministic(
        bits in proptest::collection::vec(any::<bool>(), 8),
    ) {
        let facts = ["(offers-move tb)", "(at tb corridor)", "(offers-measure ir)",
            "(mounted-on ir tb)", "(offers-report one)", "(located one office1)",
            "(offers-report two)", "(located two office2)"];
        let chosen: Vec<&str> =
            facts.iter().zip(&bits).filter(|(_, bit)| **bit).map(|(fact, _)| *fact).collect();
        let office = office(
            &[MOVE, REPORT, MEASURE].concat(),
            "tb - mobile-base ir - ir-temperature-sensor one two - temperature-sensor",
            &chosen.join(" "),
        );
        let goal = "(forall (?r - room) (known-temperature ?r))";
        let told = explained(&office, GUARDS, &[], goal);
        prop_assert_eq!(&told, &explained(&office, GUARDS, &[], goal));
        prop_assert!(told.is_complete);
        for obstacle in &told.obstacles {
            prop_assert!(!obstacle.alternatives.is_empty());
            for alternative in &obstacle.alternatives {
                prop_assert!((1..=2).contains(&alternative.missing.len()));
            }
            let problem = Problem { goal: obstacle.conjunct.clone(), ..office.1.clone() };
            let outcome = planner::plan(&office.0, &problem, &Options::default(), &Cancel::new());
            prop_assert!(outcome.expect("supported").plan.is_none());
        }
        if told.obstacles.is_empty() {
            let goal = pddl::parse_condition(goal).into_result().expect("parses");
            let problem = Problem { goal, ..office.1.clone() };
            let outcome = planner::plan(&office.0, &problem, &Options::default(), &Cancel::new());
            prop_assert!(outcome.expect("supported").plan.is_some());
        }
    }
}

const LIFT: &str = "(:action lift :agent (?a - mobile-base ?b - mobile-base)
    :parameters (?r - room)
    :precondition (and (offers-lift ?a) (offers-lift ?b) (not (= ?a ?b)) (at ?a ?r) (at ?b ?r))
    :effect (and (lifted ?r) (increase (total-cost) 1)))";

#[track_caller]
fn check_joint(objects: &str, init: &str, expected: &Expect) {
    let head = HEAD
        .replace("(offers-move", "(lifted ?r - room) (offers-lift ?b - mobile-base) (offers-move");
    let problem = format!(
        "(define (problem p) (:domain office)
            (:objects office1 office2 - room corridor - corridor {objects})
            (:init {MAP} {init}) (:goal (and)))"
    );
    let task = parse(&format!("{head} {LIFT} {MOVE})"), &problem);
    let guards = [("lift", "lift", "offers-lift"), ("move", "move", "offers-move")];
    expected.assert_eq(&explained(&task, &guards, &[], "(lifted office1)").to_string());
}

#[test]
fn a_joint_action_lacks_the_agents_that_are_not_there() {
    let one = "(offers-lift robot) (offers-move robot) (at robot corridor)";
    check_joint(
        "robot - mobile-base",
        one,
        &expect!["no two agents can `lift` at `office1`; another mobile base there would do"],
    );
    check_joint(
        "",
        "",
        &expect![
            "no two agents can `lift` at `office1`; a mobile base there and another one would do"
        ],
    );
    let both = "(offers-lift robot) (offers-move robot) (at robot office1)
        (offers-move other) (at other corridor)";
    check_joint(
        "robot other - mobile-base",
        both,
        &expect![
            "no two agents can `lift` at `office1`; `other` does not offer `lift` now; another mobile base there would do"
        ],
    );
    let far = "(offers-lift robot) (offers-move robot) (at robot office1)
        (offers-lift other) (at other corridor)";
    check_joint(
        "robot other - mobile-base",
        far,
        &expect![
            "no two agents can `lift` at `office1`; `other` does not offer `move` now; another mobile base there would do"
        ],
    );
}
