//! Contents about the state: what agents report about themselves, requests to the Domain Maintainer, and
//! announcements of the Domain Maintainer.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Methods, Offers};
use crate::{AgentId, Millis};

/// The domain and the state as the Domain Maintainer knows them at one moment.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// The epoch: the number of changes of the set of capabilities so far.
    pub epoch: u64,
    /// The revision: the number of changes of any kind so far.
    pub revision: u64,
    /// The composite domain, as PDDL.
    pub domain: String,
    /// Digest of the text of the composite domain.
    pub digest: String,
    /// The objects and the state as known, as a PDDL problem without a goal.
    pub problem: String,
    /// The actions that each agent offers.
    pub offers: Offers,
    /// The guard of each action schema of the domain, whether or not any agent offers the schema now.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub guards: BTreeMap<String, Guard>,
    /// Action schemas that no present agent offers, but that an agent offered in the past or the ontology
    /// describes. Each is in an action model of its own. They are used for explanations, never for plans.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub former: Vec<String>,
    /// The predicates of the domain that describe what is unknown, by the name of the predicate or
    /// function that they are about.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
    /// The parts of each agent's model that could not be composed, each with the reason, as text for a
    /// person.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub conflicts: BTreeMap<AgentId, Vec<String>>,
}

/// Predicates that describe what is unknown about one symbol. The composite domain has them in addition
/// to the predicates of the agents, because planners know only true and false: see `pddl::knowledge`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Auxiliary {
    /// The predicates that describe what is unknown about a predicate.
    Predicate {
        /// Name of the predicate that holds if a fact is neither known to be true nor known to be false.
        unknown: String,
        /// Name of the predicate that holds if an action of a plan has observed the fact; `None` if no
        /// action observes it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// The predicates that describe what is unknown about a function.
    Function {
        /// Name of the predicate that holds if the value of the function is known.
        defined: String,
        /// Name of the predicate that holds if an action of a plan has observed the value; `None` if no
        /// action observes it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// The predicates that describe what is unknown about a predicate that axioms derive.
    Derived {
        /// Name of the predicate that holds if a derived fact may be true.
        maybe: String,
        /// Name of the predicate that holds if a derived fact may be true because of an agent that has
        /// left.
        unknown: String,
    },
}

/// The guard of an action schema: it allows only certain agents to use the schema.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Guard {
    /// Name of the action as the agents that offer it call it.
    pub action: String,
    /// Name of the guard predicate, which holds for each agent that offers the action.
    pub predicate: String,
}

/// The state as the Domain Maintainer believes it, with the origin of each fact.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedState {
    /// The epoch: the number of changes of the set of capabilities so far.
    pub epoch: u64,
    /// The revision: the number of changes of any kind so far.
    pub revision: u64,
    /// All believed facts in the order of their text, followed by the facts that axioms derive from them.
    pub facts: Vec<BelievedFact>,
}

/// A believed fact and its owners.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedFact {
    /// The fact, in PDDL.
    pub fact: String,
    /// The owners of the fact: agents, `the map`, or `axiom` for a derived fact.
    pub owners: Vec<String>,
    /// Time since the fact was last reported, in milliseconds.
    pub age_ms: u64,
    /// Time until the fact expires; `None` if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Millis>,
    /// All claims about the fact. If owners claim different values of a function, all of these claims are
    /// listed, and the newest is believed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// The claim of one owner about a fact.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// The owner that makes the claim: an agent, or `the map`.
    pub owner: String,
    /// The PDDL fact as this owner claims it; if it is about a function, with the claimed value.
    pub fact: String,
    /// Origin of the claim: `model`, `heartbeat`, `effect`, `request`, `observation`, `departure`,
    /// `announced`.
    pub source: String,
    /// Time since the claim was last made, in milliseconds.
    pub age_ms: u64,
    /// Time until the claim expires; `None` if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Millis>,
}

/// Request to change the believed state.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChangeState {
    /// PDDL facts that the Domain Maintainer should believe: `(door-open d1) (= (price) 3)`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believe: String,
    /// PDDL facts that the Domain Maintainer should no longer believe.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retract: String,
    /// The owner of the facts: the agent that carried out the confirmed action with these effects. `None`
    /// means that the sender is the owner.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<AgentId>,
}

/// Request to change the metric by which plans are compared.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeMetric {
    /// The new metric, `(:metric minimize EXPRESSION)`; `None` restores the metric of the map.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
}

/// Request to change which actions can be planned with. Either all of its changes take effect, or none.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeActions {
    /// Actions to withhold from planning.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withhold: Vec<ActionOf>,
    /// Withheld actions to give back, each named as it was when it was withheld.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub give_back: Vec<ActionOf>,
}

/// An action of one agent, or of all agents that offer it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionOf {
    /// Name of the action as the agents that offer it call it.
    pub action: String,
    /// The agent that offers the action; `None` means all agents that offer it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentId>,
}

/// Facts that the sender has observed. They are believed as claims of the sender until it reports
/// otherwise or they expire.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// The observed PDDL facts, and `(not FACT)` for each fact that is seen to be false.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub facts: String,
    /// The observed facts that expire, each with the time left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Millis>,
}

/// An actuator's announcement of its whole action model.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelAnnouncement {
    /// The action model: `(define (agent NAME) …)`.
    pub model: String,
    /// The method for each action of the model.
    #[serde(default)]
    pub methods: Methods,
    /// The state of the actuator at the time of the announcement.
    #[serde(flatten)]
    pub heartbeat: Heartbeat,
}

/// The state of an actuator, complete for the facts that the actuator owns: an owned fact that is missing
/// is false.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// Digest of the actuator's action model and methods.
    pub digest: String,
    /// Number of the heartbeat, from 1 in each incarnation. After a heartbeat has been received, those
    /// with smaller numbers are ignored.
    pub sequence: u64,
    /// All PDDL facts that the actuator owns now.
    #[serde(default)]
    pub facts: String,
    /// The owned facts that expire, each with the time left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Millis>,
    /// Longest time until the next heartbeat is sent.
    pub period: Millis,
}

/// A change of the ecosystem's capabilities, or of its believed state.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpochChange {
    /// The epoch after the change: the number of changes of the set of capabilities so far.
    pub epoch: u64,
    /// The revision after the change: the number of changes of any kind so far. A gap between two
    /// announcements means that one was lost.
    pub revision: u64,
    /// Agents with capabilities that have become available.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joined: Vec<AgentId>,
    /// Agents with capabilities that are no longer available, because the agents are gone or silent, or
    /// because their liveliness tokens are lost.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<AgentId>,
    /// PDDL facts that have become believed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believed: String,
    /// PDDL facts that have ceased to be believed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// All changes made by requests, as far as no heartbeat reports them. They are sent when an agent
    /// joins that has not received them, and once more shortly after a change; otherwise this is `None`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested: Option<Requested>,
    /// The changes made by requests since the last announcement; `None` if they are not announced.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested_since: Option<RequestedSince>,
}

/// All changes of the state and of planning that requests have made. A receiver needs no earlier
/// announcement.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Requested {
    /// Facts that were requested and that their owners do not report in heartbeats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// PDDL facts of the map that requests have retracted.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// The requested metric of plans; `None` if the metric of the map is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
    /// Actions that requests withhold from planning.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withheld: Vec<ActionOf>,
}

/// Changes made by requests since the last announcement of such changes. The length depends on these
/// changes only. A receiver that missed the last announcement may apply this one nevertheless, because
/// all changes are announced soon after.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RequestedSince {
    /// Requested facts that are new, or that expire at another time than announced before.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// Requested facts that are withdrawn; where they are about functions, their values have no meaning.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withdrawn: Vec<RequestedFact>,
    /// PDDL facts of the map that requests have retracted.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
}

/// A requested fact and its owner.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestedFact {
    /// The fact, in PDDL.
    pub fact: String,
    /// The owner of the fact.
    pub owner: AgentId,
    /// Time until the fact expires; `None` if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Millis>,
}
