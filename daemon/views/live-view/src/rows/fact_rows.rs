//! Facts, with the owner, age and expiry of each.

use serde::Serialize;

/// Whether a fact is true. Unknown is not false.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum FactTruth {
    /// The fact is known to be true, or the function to have the value.
    #[default]
    True,
    /// The fact is known to be false.
    False,
    /// The fact is neither known to be true nor known to be false.
    Unknown,
}

/// How fresh a fact is.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Freshness {
    /// The fact does not expire.
    #[default]
    Lasting,
    /// The fact expires, but not soon.
    Fresh,
    /// More than three quarters of the time for which the fact is known are over.
    Ending,
    /// The fact has expired, or its owner is gone or silent.
    Stale,
}

/// One fact.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct FactRow {
    /// The fact, as PDDL.
    pub fact: String,
    /// The predicate or function.
    pub predicate: String,
    /// The arguments.
    pub arguments: Vec<String>,
    /// The value, if the fact is about a function.
    pub value: Option<f64>,
    /// Whether the fact is true.
    pub truth: FactTruth,
    /// The owners of the fact: agents, `the map`, or `axiom`.
    pub owners: Vec<String>,
    /// Time since the fact was last reported, in milliseconds; `None` if that is not known.
    pub age_ms: Option<u64>,
    /// Time since the fact became what it is, in milliseconds; `None` if that was before it was
    /// observed.
    pub same_for_ms: Option<u64>,
    /// Remaining time for which the fact is known, in milliseconds; `None` if it does not expire.
    pub known_for_ms: Option<u64>,
    /// How fresh the fact is.
    pub freshness: Freshness,
    /// Claims of other owners that contradict the fact.
    pub contradictions: Vec<ClaimRow>,
}

/// The claim of one owner.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ClaimRow {
    /// The owner.
    pub owner: String,
    /// The claimed fact, as PDDL.
    pub fact: String,
    /// Source of the claim, for example `heartbeat` or `request`.
    pub source: String,
    /// Time since the claim was last made, in milliseconds.
    pub age_ms: u64,
}
