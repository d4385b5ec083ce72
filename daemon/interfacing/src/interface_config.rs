//! An interface between two ecosystems as the file of one of them declares it. The reader of that file has
//! checked it against the vocabularies of both.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use acl::{AgentId, DaemonId, Performative};

/// Performatives that a rule can let pass: reports, calls for proposals, requests, and cancellations. An
/// answer passes if the message that it answers did.
pub const PASSABLE_PERFORMATIVES: [Performative; 4] =
    [Performative::Inform, Performative::Cfp, Performative::Request, Performative::Cancel];

/// One `[[interface]]`.
#[derive(Clone, Debug)]
pub struct InterfaceEntry {
    /// File of the other ecosystem.
    pub file: PathBuf,
    /// The daemon of this ecosystem that joins both; `None` if the only daemon does.
    pub daemon: Option<DaemonId>,
    /// Name in the other ecosystem of the daemon, and of the agent that makes requests for this one.
    pub remote_name: AgentId,
    /// Maximum number of messages per second, each way.
    pub rate: f64,
    /// Types, own name = other name. Symbols without an entry do not pass; the same holds for the next
    /// three.
    pub types: BTreeMap<String, String>,
    /// Predicates, own name = other name.
    pub predicates: BTreeMap<String, String>,
    /// Functions, own name = other name.
    pub functions: BTreeMap<String, String>,
    /// Objects, own name = other name.
    pub objects: BTreeMap<String, String>,
    /// Rules for agents and goals of the other ecosystem that are available here.
    pub imports: Vec<RuleEntry>,
    /// Rules for agents and goals of this ecosystem that are available there.
    pub exports: Vec<RuleEntry>,
}

/// One `[[interface.import]]` or `[[interface.export]]`.
#[derive(Clone, Debug)]
pub struct RuleEntry {
    /// The agent to represent, by its own name; `None` if the rule is about goals.
    pub agent: Option<AgentId>,
    /// Name on the other side of the agent, or of the desk that takes the goals.
    pub proxy_name: AgentId,
    /// Performatives that pass.
    pub performatives: BTreeSet<Performative>,
    /// Actions of the agent: own name = other name.
    pub actions: BTreeMap<String, String>,
    /// Costs of its actions in plans of the side where it is represented, under the names there.
    pub costs: BTreeMap<String, f64>,
    /// Predicates of this ecosystem that goals may contain.
    pub goals: BTreeSet<String>,
}
