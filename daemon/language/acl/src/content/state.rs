//! Contents about the state: reports of agents about themselves, requests to the Domain Maintainer,
//! and its announcements.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Methods, Offers, Stop};
use crate::{AgentId, Millis};

/// The domain and the state of one moment, as known to the Domain Maintainer.
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
    /// The objects and the known state, as a PDDL problem without a goal.
    pub problem: String,
    /// The actions that each agent offers.
    pub offers: Offers,
    /// The guard of each action schema of the domain, even if no agent offers the schema now.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub guards: BTreeMap<String, Guard>,
    /// Action schemas that no present agent offers, but that an agent offered in the past or the
    /// ontology describes. Each is an action model with one action. Explanations use them, plans
    /// never do.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub former: Vec<String>,
    /// The predicates of the domain that describe unknown facts, by the name of the predicate or
    /// function that they are about.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
    /// Parts of each agent's model that could not be composed, each as text for a person with the
    /// reason.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub conflicts: BTreeMap<AgentId, Vec<String>>,
}

/// Predicates of the composite domain that state which facts of one predicate or function are
/// unknown. Planners support only true and false, so the composite domain needs them; see
/// `pddl::knowledge`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Auxiliary {
    /// Predicates that describe unknown facts of a predicate.
    Predicate {
        /// Name of the predicate that holds if a fact is unknown.
        unknown: String,
        /// Name of the predicate that becomes true when an action of a plan observes the fact;
        /// `None` if no action observes it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// Predicates that describe unknown values of a function.
    Function {
        /// Name of the predicate that holds if the value of the function is known.
        defined: String,
        /// Name of the predicate that becomes true when an action of a plan observes the value;
        /// `None` if no action observes it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// Predicates that describe unknown facts of a derived predicate.
    Derived {
        /// Name of the predicate that holds if a derived fact may be true.
        maybe: String,
        /// Name of the predicate that holds if a derived fact may be true because of an agent that
        /// has left.
        unknown: String,
    },
}

/// The guard of an action schema: only agents with the guard fact may use the schema.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Guard {
    /// Name of the action that its agents use.
    pub action: String,
    /// Name of the guard predicate, which holds for each agent that offers the action.
    pub predicate: String,
}

/// The state that the Domain Maintainer believes, with the source of each fact.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedState {
    /// The epoch: the number of changes of the set of capabilities so far.
    pub epoch: u64,
    /// The revision: the number of changes of any kind so far.
    pub revision: u64,
    /// All believed facts in the order of their text, and then the facts that axioms derive from
    /// them.
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
    /// All claims about the fact. If owners claim different values of a function, the newest claim
    /// is believed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// The claim of one owner about a fact.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// The owner that makes the claim: an agent, or `the map`.
    pub owner: String,
    /// The claimed PDDL fact. A fact about a function has the value that this owner claims.
    pub fact: String,
    /// Source of the claim: `model`, `heartbeat`, `effect`, `request`, `observation`, `departure`,
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
    /// The owner of the facts, if they are effects of an action: the agent that confirmed the
    /// action. `None` if the sender is the owner.
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

/// Request to change the set of actions that planning may use. Either all changes take effect, or
/// none.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeActions {
    /// Actions to withhold from planning.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withhold: Vec<ActionOf>,
    /// Withheld actions to give back. Each must be named as in the request that withheld it.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub give_back: Vec<ActionOf>,
}

/// An action of one agent, or of all agents that offer it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionOf {
    /// Name of the action that its agents use.
    pub action: String,
    /// The agent that offers the action; `None` means all agents that offer it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentId>,
}

/// Facts that the sender has observed. They are believed as claims of the sender until they expire
/// or the sender contradicts them.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// The observed PDDL facts, and `(not FACT)` for each fact that was observed to be false.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub facts: String,
    /// Remaining validity of each observed fact that expires.
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

/// The state of an actuator. It lists all true facts that the actuator owns: an owned fact that is
/// missing is false.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// Digest of the actuator's action model and methods.
    pub digest: String,
    /// Number of the heartbeat, from 1 in each incarnation. A receiver ignores a heartbeat with a
    /// smaller number than an earlier one.
    pub sequence: u64,
    /// All true PDDL facts that the actuator owns now.
    #[serde(default)]
    pub facts: String,
    /// Remaining validity of each fact that expires.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Millis>,
    /// Longest time until the next heartbeat is sent. After several such periods without a
    /// heartbeat, the agent counts as silent.
    pub period: Millis,
    /// Stops that are in force at the actuator's daemon.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub stops: Vec<Stop>,
}

/// A change of the ecosystem's capabilities, or of its believed state.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpochChange {
    /// The epoch after the change: the number of changes of the set of capabilities so far.
    pub epoch: u64,
    /// The revision after the change: the number of changes of any kind so far. If a revision is
    /// missing between those of two messages, a message was lost.
    pub revision: u64,
    /// Agents with capabilities that have become available.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joined: Vec<AgentId>,
    /// Agents with capabilities that are no longer available, because the agents are gone or
    /// silent, or because their liveliness tokens are lost.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<AgentId>,
    /// PDDL facts that have become believed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believed: String,
    /// PDDL facts that have ceased to be believed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// All changes made by requests that no heartbeat reports. Sent when an agent joins that lacks
    /// them, and once more shortly after a change; otherwise `None`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested: Option<Requested>,
    /// The changes made by requests since the last message of a change; `None` if they are not
    /// sent.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested_since: Option<RequestedSince>,
}

/// All changes of the state and of planning by requests. The list is complete, so a receiver needs
/// no earlier message.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Requested {
    /// Requested facts that the heartbeats of their owners do not report.
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

/// Changes made by requests since the last message of this kind. The length of this content depends
/// on these changes only. A receiver that missed the previous message may still apply this one,
/// because a message with all changes follows soon.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RequestedSince {
    /// Requested facts that are new, or have a new value or expiry.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// Requested facts that their owners no longer claim. If such a fact gives the value of a
    /// function, the value is arbitrary: only the function and its arguments count.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withdrawn: Vec<RequestedFact>,
    /// PDDL facts of the map that requests have retracted.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
}

/// A fact that the central Domain Maintainer announces, because no heartbeat reports it. An agent
/// has requested or observed the fact, an action has caused it, or it is unknown because the agent
/// that was responsible for it has left.
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
