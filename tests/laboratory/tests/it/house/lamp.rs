//! A lamp that agents can light: what its Domain Maintainer answers, and the record of a goal about it.

use acl::content::{Offer, Offers, Record, Snapshot, Version};
use serde_json::{Value, json};

use super::name;

/// Returns the answer of a Domain Maintainer whose only action is `light`, by the agent `lamp`.
pub(crate) fn lamp_snapshot(revision: u64, domain: &str, problem: &str, guard: &str) -> String {
    let offer =
        Offer { schema: "light".to_owned(), guard: guard.to_owned(), method: None, agents: 1 };
    let snapshot = Snapshot {
        epoch: 1,
        revision,
        domain: domain.to_owned(),
        digest: String::new(),
        problem: problem.to_owned(),
        offers: Offers::from([(name("lamp"), [("light".to_owned(), offer)].into())]),
        guards: [].into(),
        former: Vec::new(),
        knowledge: [].into(),
        conflicts: [].into(),
    };
    serde_json::to_string(&snapshot).expect("JSON")
}

/// Returns the record of the goal `g` that an earlier leader has kept, with these further fields.
pub(crate) fn kept_goal(fields: &Value) -> Record {
    let mut body = json!({
        "participation": {
            "initiator": "user", "incarnation": 7, "exchange": "t", "conversation": "g",
            "protocol": "goal"
        },
        "incarnation": 7, "rounds": 1
    });
    let further = fields.as_object().expect("an object").clone();
    body.as_object_mut().expect("an object").extend(further);
    let version = Version { term: u64::MAX / 2, count: 7 };
    Record { key: "goal/g".to_owned(), version, body }
}
