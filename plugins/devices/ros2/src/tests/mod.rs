//! Tests of entries with mistakes (`configs`), and of an arm whose nodes are served in the process of
//! the test and reached over Zenoh, as real ones are (`arm`).

mod arm;
mod configs;

use std::sync::Arc;

use agent::Host;
use serde_json::{Value, json};

use super::*;

const ONTOLOGY: &str = include_str!("../../../../../domains/smart-office/domain.pddl");

const PICK: &str = include_str!("arm_msgs/action/Pick.action");
const PLACE: &str = include_str!("arm_msgs/action/Place.action");
const GRIPPER: &str = include_str!("arm_msgs/msg/Gripper.msg");

const MODEL: &str = "(define (agent arm-1) (:domain smart-office)
    (:types arm part spot - object)
    (:predicates (held ?a - arm ?p - part) (empty ?a - arm) (lies ?p - part ?s - spot)
      (gripping ?a - arm) (calibrated ?a - arm))
    (:functions (weight ?p - part) (force ?a - arm))
    (:objects arm-1 - arm cup-1 nut-1 - part tray shelf - spot)
    (:init (empty arm-1) (lies cup-1 tray))
    (:action pick :agent ?a - arm :parameters (?p - part ?s - spot)
      :precondition (and (empty ?a) (lies ?p ?s))
      :effect (and (held ?a ?p) (not (empty ?a)) (not (lies ?p ?s)) (gripping ?a)
        (increase (total-cost) 2)))
    (:action place :agent ?a - arm :parameters (?p - part ?s - spot)
      :precondition (held ?a ?p)
      :effect (and (lies ?p ?s) (empty ?a) (not (held ?a ?p)) (increase (total-cost) 2)))
    (:action calibrate :agent ?a - arm :parameters ()
      :effect (and (calibrated ?a) (increase (total-cost) 5))))";

fn blueprint(config: Value) -> Blueprint {
    let map = "(define (problem map) (:domain smart-office) (:init) (:goal (and)))";
    let ontology = pddl::parse_domain(ONTOLOGY).value.expect("a domain");
    let host = Host::new(ontology, pddl::parse_problem(map).value.expect("a map"));
    let id = acl::AgentId::new("arm-1").expect("a name");
    Blueprint { id, driver: String::new(), config: config.into(), host: Arc::new(host) }
}

/// Returns the config of the arm, whose nodes are reached at `endpoint`.
fn config(endpoint: &str, dialect: &str) -> Value {
    json!({
        "ros2": { "endpoint": endpoint, "dialect": dialect, "namespace": "cell", "domain-id": 7 },
        "definitions": {
            "arm_msgs/action/Pick": PICK,
            "arm_msgs/action/Place": PLACE,
            "arm_msgs/msg/Gripper": GRIPPER,
        },
        "model": MODEL,
        "objects": {
            "tray": { "x": 0.25, "y": 0.5 },
            "shelf": { "x": 1, "y": -0.125 },
        },
        "actions": {
            "pick": {
                "ros-action": {
                    "name": "pick",
                    "type": "arm_msgs/action/Pick",
                    "goal": { "object": "{p}", "at": { "x": "{s.x}", "y": "{s.y}" }, "speed": 0.5 },
                },
                "success": "result.success == true",
                "reason": "result.message",
                "facts": ["(= (weight {p}) {result.weight})"],
                "time-out": "20s",
            },
            "place": {
                "ros-action": {
                    "name": "place",
                    "type": "arm_msgs/action/Place",
                    "goal": { "at": { "x": "{s.x}", "y": "{s.y}" } },
                },
                "reason": "result.message",
                "time-out": "20s",
            },
            "calibrate": {
                "service": { "name": "calibrate", "type": "std_srvs/srv/Trigger" },
                "success": "result.success == true",
                "reason": "result.message",
                "time-out": "3s",
            },
        },
        "topics": [{
            "name": "gripper",
            "type": "arm_msgs/msg/Gripper",
            "facts": [
                { "fact": "(gripping arm-1)", "when": "message.force >= 2.5" },
                "(= (force arm-1) {message.force})",
            ],
            "valid-for": "1s",
        }],
    })
}
