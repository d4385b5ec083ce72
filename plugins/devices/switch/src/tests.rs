//! Tests of the facts and models of switches, and of the errors for mistakes in an entry.

use agent::Host;
use serde_json::{Value, json};

use super::*;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");

const PATIENCE: Duration = Duration::from_secs(20);

pub(crate) fn blueprint(driver: &str, config: Value) -> Blueprint {
    let map = "(define (problem map) (:domain smart-office) (:init) (:goal (and)))";
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let host = Host::new(ontology, pddl::parse_problem(map).value.expect("a map"));
    let id = acl::AgentId::new("s").expect("a name");
    Blueprint { id, driver: driver.to_owned(), config: config.into(), host: Arc::new(host) }
}

pub(crate) fn call(method: &str) -> MethodCall {
    MethodCall {
        action: format!("({method} s lab)"),
        method: method.to_owned(),
        arguments: BTreeMap::new(),
    }
}

/// Calls a method of the switch as its agent does. Returns the detail of the result.
pub(crate) async fn switch(switch: &mut Switch, method: &str) -> Result<String, String> {
    let call = call(method);
    match switch.perform(&call).await {
        Ok(is_on) => Ok(switch.on_success(&call, is_on).detail),
        Err(failure) => {
            switch.on_failure(&call, &failure);
            Err(failure.to_string())
        }
    }
}

/// Returns the facts of a lamp or a relay that is on, off, or in an unknown state (`None`).
pub(crate) fn told(own: &str, state: Option<bool>) -> String {
    let state = match state {
        Some(true) => format!("({own} s)"),
        Some(false) => format!("(not ({own} s))"),
        None => format!("(unknown ({own} s))"),
    };
    format!("(installed s lab) {state}")
}

pub(crate) fn facts(switch: &Switch) -> String {
    let facts: Vec<_> = switch.facts().iter().map(|fact| fact.fact.to_string()).collect();
    facts.join(" ")
}

pub(crate) fn offers(switch: &Switch) -> usize {
    switch.describe().model.actions.len()
}

/// Handles events of the switch until `is_so` holds.
pub(crate) async fn until(switch: &mut Switch, is_so: impl Fn(&Switch) -> bool) {
    let waiting = async {
        while !is_so(switch) {
            let stir = switch.next_event().expect("it is looked at").await;
            assert!(stir(switch).is_empty());
        }
    };
    let in_time = tokio::time::timeout(PATIENCE, waiting).await;
    assert!(in_time.is_ok(), "{} actions, {}", offers(switch), facts(switch));
}

fn commanded(kind: &str, more: Value) -> Value {
    let mut config = json!({ "location": "lab", "kind": kind, "on": ["true"], "off": ["true"] });
    if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
        config.extend(more);
    }
    config
}

#[tokio::test]
async fn the_model_of_a_sensor_has_its_type_and_its_action() {
    let lock = super::switch(&blueprint("command", commanded("lock", json!({})))).expect("a lock");
    let Description { model, methods } = lock.describe();
    let expected = model_of(
        "(define (agent s) (:domain smart-office)
            (:types door-lock - object)
            (:predicates (locked ?r - room) (bolted ?d - door-lock)
                (installed ?d - object ?r - room))
            (:objects s - door-lock)
            (:init (installed s lab))
            (:derived (locked ?r - room) (and (exists (?d - door-lock) (installed ?d ?r))
                (forall (?d - door-lock) (imply (installed ?d ?r) (bolted ?d)))))
            (:action lock-door :agent ?d - door-lock :parameters (?r - room)
                :precondition (installed ?d ?r)
                :effect (and (bolted ?d) (increase (total-cost) 1)))
            (:action unlock-door :agent ?d - door-lock :parameters (?r - room)
                :precondition (installed ?d ?r)
                :effect (and (not (bolted ?d)) (increase (total-cost) 1))))",
    );
    assert_eq!(model.to_string(), expected.to_string());
    assert_eq!(methods["lock-door"].method, "on");
    assert_eq!(methods["unlock-door"].method, "off");
    assert_eq!(methods["lock-door"].timeout, Millis(Duration::from_secs(6)));
}

#[tokio::test]
async fn an_unknown_method_is_reported() {
    let lamp = blueprint("command", commanded("lamp", json!({})));
    let mut lamp = super::switch(&lamp).expect("a lamp");
    let problem = switch(&mut lamp, "dim").await.expect_err("there is none");
    assert_eq!(problem, "find a method `dim`");
}

#[test]
fn errors_of_an_entry_name_the_correction() {
    let wired = |more: Value| {
        let mut config = json!({ "location": "lab", "kind": "relay", "line": "GPIO4" });
        if let (Value::Object(config), Value::Object(more)) = (&mut config, more) {
            config.extend(more);
        }
        config
    };
    for (driver, config, expected) in [
        ("gpio", wired(json!({ "line": null })), "driver `gpio` needs a `line`: its chip and"),
        ("gpio", wired(json!({ "line": "4" })), "`4` names no line: write its chip and number"),
        (
            "gpio",
            wired(json!({ "kind": "door" })),
            "unknown variant `door`, expected one of `lamp`",
        ),
        ("gpio", wired(json!({ "location": "Lab" })), "`Lab` cannot be the name of a place"),
        ("gpio", wired(json!({ "bias": "pull-up" })), "unknown field `bias`"),
        (
            "gpio",
            wired(json!({ "every": "1s" })),
            "`every` is for `driver = \"command\"`, and this driver is `gpio`",
        ),
        (
            "command",
            wired(json!({})),
            "a switch with driver = \"command\" has no `line`: write driver = \"gpio\" beside `plugin`",
        ),
        (
            "gpio",
            commanded("lamp", json!({ "state": ["x"], "every": "1s" })),
            "a switch with driver = \"gpio\" has no `on`: write driver = \"command\" beside `plugin`",
        ),
        (
            "command",
            commanded("lamp", json!({ "line": "GPIO4" })),
            "`line` is for `driver = \"gpio\"`, and this driver is `command`",
        ),
        (
            "command",
            commanded("lamp", json!({ "on": [] })),
            "driver `command` needs a program for `on` and its arguments, such as \
             on = [\"/usr/local/bin/lamp\", \"on\"]",
        ),
        ("command", commanded("lamp", json!({ "off": null })), "needs a program for `off`"),
        ("command", commanded("lamp", json!({ "state": [""] })), "needs a program for `state`"),
        ("command", commanded("lamp", json!({ "every": "1s" })), "`every` is the period"),
        (
            "command",
            commanded("lamp", json!({ "state": ["x"], "every": "1ms" })),
            "every `1ms`: write a time between 100ms and 1day",
        ),
        (
            "command",
            commanded("lamp", json!({ "time-out": "1h" })),
            "write a time between 1ms and 2m",
        ),
        ("command", commanded("lamp", json!({ "time-out": "soon" })), "time-out `soon`: expected"),
        ("", json!({ "location": "lab", "kind": "lamp" }), "it needs a `driver`: \"gpio\" for a"),
    ] {
        let built = super::switch(&blueprint(driver, config));
        let problem = built.err().map(|error| error.to_string()).unwrap_or_default();
        assert!(problem.contains(expected), "{problem} is not {expected}");
    }
}
