//! An interface between two ecosystems, as the ecosystem file of one of them declares it. The
//! reader of that file has checked the interface against the vocabularies of both ecosystems.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use acl::{AgentId, DaemonId, Performative};

/// Performatives that a rule can let pass: reports, calls for proposals, requests, and
/// cancellations. An answer passes if the message that it answers has passed.
pub const PASSABLE_PERFORMATIVES: [Performative; 4] =
    [Performative::Inform, Performative::Cfp, Performative::Request, Performative::Cancel];

/// One `[[interface]]` table of an ecosystem file: the interface to one other ecosystem.
#[derive(Clone, Debug)]
pub struct InterfaceEntry {
    /// Path of the other ecosystem's file.
    pub file: PathBuf,
    /// The daemon of this ecosystem that takes part in both ecosystems; `None` if this ecosystem
    /// has only one daemon.
    pub daemon: Option<DaemonId>,
    /// Name in the other ecosystem, both of the daemon that joins the two ecosystems, and of the
    /// agent that makes requests there for this ecosystem.
    pub remote_name: AgentId,
    /// Maximum number of messages per second in each direction. Further requests are refused, and
    /// further news of an agent waits.
    pub rate: f64,
    /// Types that may pass: name in this ecosystem = name in the other. Types without an entry do
    /// not pass.
    pub types: BTreeMap<String, String>,
    /// Predicates that may pass: name in this ecosystem = name in the other.
    pub predicates: BTreeMap<String, String>,
    /// Functions that may pass: name in this ecosystem = name in the other.
    pub functions: BTreeMap<String, String>,
    /// Objects that may pass: name in this ecosystem = name in the other.
    pub objects: BTreeMap<String, String>,
    /// Rules for agents and goals of the other ecosystem that are available in this one.
    pub imports: Vec<RuleEntry>,
    /// Rules for agents and goals of this ecosystem that are available in the other.
    pub exports: Vec<RuleEntry>,
}

/// One rule of an interface: an `[[interface.import]]` or `[[interface.export]]` table.
#[derive(Clone, Debug)]
pub struct RuleEntry {
    /// The agent to represent, by its name in its own ecosystem; `None` if the rule is about goals.
    pub agent: Option<AgentId>,
    /// Name of the proxy agent, or of the goal gateway, in the ecosystem where it runs.
    pub proxy_name: AgentId,
    /// Performatives of messages that may pass under the rule.
    pub performatives: BTreeSet<Performative>,
    /// Actions of the agent that may pass: name in this ecosystem = name in the other.
    pub actions: BTreeMap<String, String>,
    /// Costs of the agent's actions in plans of the ecosystem with the proxy agent, by the names of
    /// the actions in that ecosystem.
    pub costs: BTreeMap<String, f64>,
    /// Predicates that goals may contain, by their names in this ecosystem.
    pub goals: BTreeSet<String>,
}
