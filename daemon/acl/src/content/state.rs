//! Contents about the state: from agents about themselves, requests to the Domain Maintainer, and its
//! announcements.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Methods, Offers};
use crate::{AgentId, Deadline};

/// The domain and the state as the Domain Maintainer knows them at one moment.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Number of changes of the set of capabilities.
    pub epoch: u64,
    /// Number of changes of any kind.
    pub revision: u64,
    /// The composite domain, as PDDL.
    pub domain: String,
    /// Digest of that text.
    pub digest: String,
    /// Objects and the state as known, as a PDDL problem without a goal.
    pub problem: String,
    /// The actions that each agent offers.
    pub offers: Offers,
    /// The guard of each schema of the domain, whether or not any agent offers it now.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub guards: BTreeMap<String, Guard>,
    /// Action schemas that no present agent offers, but that were offered in the past or are described
    /// in the ontology, each in an action model of its own. Used for explanations, never for plans.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub former: Vec<String>,
    /// The symbols of the domain that describe what is unknown, by the symbol that they are about.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
    /// The parts of each agent's model that could not be composed, each with the reason, for a person.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub conflicts: BTreeMap<AgentId, Vec<String>>,
}

/// Predicates that the composite domain has in addition to those of the agents, because planners know
/// only true and false: see `pddl::knowledge`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Auxiliary {
    /// For a predicate.
    Predicate {
        /// Predicate that holds for a fact that is neither known to be true nor known to be false.
        unknown: String,
        /// Predicate that holds for a fact that a plan has observed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// For a function.
    Function {
        /// Predicate that holds if the value is known.
        defined: String,
        /// Predicate that holds if a plan has observed the value.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// For a predicate that axioms derive.
    Derived {
        /// Predicate that holds for a fact that may be true.
        maybe: String,
        /// Predicate that holds for a fact that may be true because of an agent that has left.
        unknown: String,
    },
}

/// The guard of a schema, which allows agents to use it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Guard {
    /// The name of the action as its agents call it.
    pub outside: String,
    /// The predicate that holds for the agents that offer it.
    pub predicate: String,
}

/// The state as the Domain Maintainer believes it, with provenance.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedState {
    /// Number of changes of the set of capabilities.
    pub epoch: u64,
    /// Number of changes of any kind.
    pub revision: u64,
    /// All facts in the order of their text, followed by the facts that axioms derive from them.
    pub facts: Vec<BelievedFact>,
}

/// A fact and its owners.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedFact {
    /// The PDDL fact.
    pub fact: String,
    /// The owners: agents, `the map`, or `axiom` for a derived fact.
    pub owners: Vec<String>,
    /// Time since it was last reported, in milliseconds.
    pub age_ms: u64,
    /// Time until it expires; `None` if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Deadline>,
    /// All claims about it. If owners claim different values of a function, all of them are listed, and
    /// the newest is believed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// The claim of one owner about a fact.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// The owner.
    pub owner: String,
    /// The PDDL fact as this owner claims it; for a function, with its value.
    pub fact: String,
    /// Origin of the claim: `model`, `heartbeat`, `effect`, `request`, `observation`, `departure`,
    /// `told`.
    pub source: String,
    /// Time since the claim was last made, in milliseconds.
    pub age_ms: u64,
    /// Time until the claim expires; `None` if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Deadline>,
}

/// Request to change the believed state.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChangeState {
    /// PDDL facts to believe: `(door-open d1) (= (price) 3)`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believe: String,
    /// PDDL facts to retract.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retract: String,
    /// The owner of the facts: the agent with the confirmed action that had these effects; without it,
    /// the sender.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<AgentId>,
}

/// Request to change the metric of plans.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeMetric {
    /// `(:metric minimize EXPRESSION)`; without it, the map's metric is restored.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
}

/// Request to change which actions can be planned with. Either all of it takes effect, or nothing.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeActions {
    /// Actions to withhold.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withhold: Vec<ActionOf>,
    /// Withheld actions to give back, named as they were withheld.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub give_back: Vec<ActionOf>,
}

/// An action of one agent, or of all agents that offer it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionOf {
    /// The name of the action as its agents call it.
    pub action: String,
    /// The agent; without it, all agents.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentId>,
}

/// Facts observed by the sender. They are believed as the sender's own until it reports otherwise or
/// they expire.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// PDDL facts, and `(not FACT)` for a fact that is seen to be false.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub facts: String,
    /// Facts that expire, each with the time left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Deadline>,
}

/// An actuator's announcement of its whole action model.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelAnnouncement {
    /// The action model: `(define (agent NAME) …)`.
    pub model: String,
    /// The method for each action.
    #[serde(default)]
    pub methods: Methods,
    /// The state at the same time.
    #[serde(flatten)]
    pub heartbeat: Heartbeat,
}

/// An actuator's state, complete for the facts that it owns: an owned fact that is missing is false.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// Digest of the model and the methods.
    pub digest: String,
    /// Number of the heartbeat, from 1 in each incarnation; a smaller one is ignored after a greater
    /// one.
    pub sequence: u64,
    /// All PDDL facts that the actuator owns now.
    #[serde(default)]
    pub facts: String,
    /// Facts that expire, each with the time left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Deadline>,
    /// Time until the next heartbeat is due at the latest.
    pub period: Deadline,
}

/// A change of the ecosystem's capabilities, or of its believed state.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpochChange {
    /// Number of changes of the set of capabilities.
    pub epoch: u64,
    /// Number of changes of any kind; a gap between two announcements means that one was lost.
    pub revision: u64,
    /// Agents with capabilities that have become available.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joined: Vec<AgentId>,
    /// Agents with capabilities that are no longer available: the agents are gone, silent or masked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<AgentId>,
    /// PDDL facts that are believed now.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believed: String,
    /// PDDL facts that are no longer believed.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// All changes by requests that no heartbeat reports. Sent when an agent joins that has not
    /// received them, and once more shortly after a change.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested: Option<Requested>,
    /// The changes by requests since the last announcement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested_since: Option<RequestedSince>,
}

/// All changes by requests. A receiver needs no earlier announcement.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Requested {
    /// Facts with an owner that does not report them in heartbeats.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// PDDL facts of the map that are retracted.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// The metric of plans; without it, the map's metric is used.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
    /// Actions that are withheld.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withheld: Vec<ActionOf>,
}

/// Changes by requests since the last announcement of them. Its length depends on these changes only. A
/// receiver that missed the last announcement may apply it too; all changes are announced soon after.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RequestedSince {
    /// Facts that are new, or that have another expiry than before.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// Facts that are withdrawn; the values of functions are arbitrary.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withdrawn: Vec<RequestedFact>,
    /// PDDL facts of the map that are retracted.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
}

/// A fact and its owner.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestedFact {
    /// The PDDL fact.
    pub fact: String,
    /// The owner of the fact.
    pub owner: AgentId,
    /// Time until it expires; `None` if it does not expire.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Deadline>,
}
