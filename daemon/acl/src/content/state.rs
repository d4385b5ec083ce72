//! What is known: what agents say of themselves, what anyone asks the Domain Maintainer to believe,
//! and what it tells.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::{Methods, Offers};
use crate::{AgentId, Deadline};

/// What the Domain Maintainer knows, at one moment.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Snapshot {
    /// Counts changes of the set of capabilities.
    pub epoch: u64,
    /// Counts changes of anything.
    pub revision: u64,
    /// The composite domain, as PDDL.
    pub domain: String,
    /// Digest of that text.
    pub digest: String,
    /// Objects and the state as known, as a PDDL problem without a goal.
    pub problem: String,
    /// Who offers what.
    pub offers: Offers,
    /// What lets an agent act by each schema of the domain, whether or not anybody offers it now.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub guards: BTreeMap<String, Guard>,
    /// Action schemas that nobody here offers and somebody offered once, or the ontology
    /// describes: each in an action model of its own. For explanations, never for plans.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub former: Vec<String>,
    /// The words of the domain for what is unknown, by the symbol that they are about.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub knowledge: BTreeMap<String, Auxiliary>,
    /// What of an agent's model could not be taken as it is, and why, for a person.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub conflicts: BTreeMap<AgentId, Vec<String>>,
}

/// Predicates that a composite domain has beside those that agents speak of, because planners know
/// true and false only: see `pddl::knowledge`.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "of", rename_all = "kebab-case")]
pub enum Auxiliary {
    /// Of a predicate.
    Predicate {
        /// Holds of a fact that is neither known to be true nor known to be false.
        unknown: String,
        /// Holds of a fact that a plan has observed.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// Of a function.
    Function {
        /// Holds where its value is known.
        defined: String,
        /// Holds where a plan has observed it.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        found: Option<String>,
    },
    /// Of a predicate that axioms derive.
    Derived {
        /// Holds of a fact that cannot be ruled out.
        maybe: String,
        /// Holds of a fact that cannot be ruled out because of an agent that left.
        unknown: String,
    },
}

/// What lets agents act by a schema.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Guard {
    /// The name that its agents know the action by.
    pub outside: String,
    /// The predicate that holds of those who offer it.
    pub predicate: String,
}

/// The state as the Domain Maintainer believes it, with provenance.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedState {
    /// Counts changes of the set of capabilities.
    pub epoch: u64,
    /// Counts changes of anything.
    pub revision: u64,
    /// Every fact, in the order of its text; then what follows from them by axioms.
    pub facts: Vec<BelievedFact>,
}

/// One fact, and whose word it is.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct BelievedFact {
    /// The PDDL fact.
    pub fact: String,
    /// Who says so: agents, `the map`, or `axiom` of what follows from other facts.
    pub owners: Vec<String>,
    /// How long ago it was last said, in milliseconds.
    pub age_ms: u64,
    /// How long it is still known; `None` means until further notice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Deadline>,
    /// Whose word it is, one by one; owners who contradict each other about a number are all
    /// here, and the newest is believed.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub claims: Vec<Claim>,
}

/// One owner's word about a fact.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Claim {
    /// Who says so.
    pub owner: String,
    /// The PDDL fact as this owner says it: of a number, with its value.
    pub fact: String,
    /// How it came about: `model`, `heartbeat`, `effect`, `request`, `observation`, `told`.
    pub source: String,
    /// How long ago it was last said, in milliseconds.
    pub age_ms: u64,
    /// How long it is still known; `None` means until further notice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Deadline>,
}

/// Ask for a change of the state as believed.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ChangeState {
    /// PDDL facts to believe: `(door-open d1) (= (price) 3)`.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believe: String,
    /// PDDL facts to believe no longer.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retract: String,
    /// Whose word it is: the agent whose confirmed action had these effects; without it, the
    /// asker's own.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub owner: Option<AgentId>,
}

/// Ask for another measure of plans.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeMetric {
    /// `(:metric minimize EXPRESSION)`; without it, the map's is the measure again.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
}

/// Ask for a change of the actions that can be planned with. All of it is taken, or nothing.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ChangeActions {
    /// Actions to plan with no longer.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withhold: Vec<ActionOf>,
    /// Withheld actions to plan with again, named as they were withheld.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub give_back: Vec<ActionOf>,
}

/// An action of one agent, or of all who offer it.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub struct ActionOf {
    /// The name its agents know it by.
    pub action: String,
    /// Whose; without it, everyone's.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub agent: Option<AgentId>,
}

/// What the asker has observed: its own word, until it says otherwise or the time is over.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Observation {
    /// PDDL facts, and `(not FACT)` for what is seen not to be so.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub facts: String,
    /// Facts that are known for a while only: each with the time left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Deadline>,
}

/// An actuator's whole self-description.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ModelAnnouncement {
    /// `(define (agent NAME) …)`
    pub model: String,
    /// Which method carries out which action.
    #[serde(default)]
    pub methods: Methods,
    /// The state that comes with it.
    #[serde(flatten)]
    pub heartbeat: Heartbeat,
}

/// An actuator's state, complete for what it owns: what it does not say is false.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Heartbeat {
    /// Digest of the model and the methods.
    pub digest: String,
    /// Counts this incarnation's heartbeats, from 1; an older one is not believed after a newer.
    pub sequence: u64,
    /// All PDDL facts it owns now.
    #[serde(default)]
    pub facts: String,
    /// Facts that are known for a while only: each with the time left.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub known_for: BTreeMap<String, Deadline>,
    /// When the next heartbeat is due at the latest.
    pub period: Deadline,
}

/// A change of what the ecosystem can do, or of its state as believed.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct EpochChange {
    /// Counts changes of the set of capabilities.
    pub epoch: u64,
    /// Counts changes of anything; two announcements with a gap between them mean a lost one.
    pub revision: u64,
    /// Agents whose capabilities are there now.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub joined: Vec<AgentId>,
    /// Agents whose capabilities are gone or masked.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left: Vec<AgentId>,
    /// PDDL facts that are believed now.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub believed: String,
    /// PDDL facts that are believed no longer.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// Everything that requests changed and that no heartbeat says: when somebody joined who has not
    /// heard it, and once more a moment after it was news.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested: Option<Requested>,
    /// What of it is news.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub requested_since: Option<RequestedSince>,
}

/// What requests changed, complete: whoever hears it needs nothing that was said before.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Requested {
    /// Facts that are somebody's word and that no heartbeat says.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// PDDL facts of the map that are believed no longer.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
    /// What plans are measured by, if not as the map says.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub metric: Option<String>,
    /// Actions that are withheld.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withheld: Vec<ActionOf>,
}

/// What requests changed since it was told last: as much as is new, however much there was before.
/// It may be taken also by those who missed what was told last; all of it is told soon after.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RequestedSince {
    /// Facts that are somebody's word now, or are known for another time than before.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub facts: Vec<RequestedFact>,
    /// Facts that are somebody's word no longer; of a number, whatever its value.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub withdrawn: Vec<RequestedFact>,
    /// PDDL facts of the map that are believed no longer.
    #[serde(default, skip_serializing_if = "String::is_empty")]
    pub retracted: String,
}

/// A fact, and whose word it is.
#[cfg_attr(test, derive(schemars::JsonSchema))]
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct RequestedFact {
    /// The PDDL fact.
    pub fact: String,
    /// Whose word it is.
    pub owner: AgentId,
    /// How long it is still known; `None` means until further notice.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub known_for: Option<Deadline>,
}
