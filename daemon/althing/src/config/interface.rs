//! Where an ecosystem meets another, as its file means it. The words of both are held against
//! each other in `interfacing::check`, which reads the other's file too.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use acl::{AgentId, DaemonId, Performative};

/// One `[[interface]]`.
#[derive(Clone, Debug)]
pub(crate) struct InterfaceEntry {
    /// The other ecosystem's file.
    pub(crate) file: PathBuf,
    /// Which of our daemons joins both; none where whoever runs alone does.
    pub(crate) daemon: Option<DaemonId>,
    /// What it is called over there: the daemon, and the agent that speaks for us.
    pub(crate) called: AgentId,
    /// Messages a second that pass, each way.
    pub(crate) rate: f64,
    /// Ours = theirs, of each sort; what is not here does not pass.
    pub(crate) types: BTreeMap<String, String>,
    pub(crate) predicates: BTreeMap<String, String>,
    pub(crate) functions: BTreeMap<String, String>,
    pub(crate) objects: BTreeMap<String, String>,
    /// What of theirs is here.
    pub(crate) imports: Vec<RuleEntry>,
    /// What of ours is there.
    pub(crate) exports: Vec<RuleEntry>,
}

/// One `[[interface.import]]` or `[[interface.export]]`.
#[derive(Clone, Debug)]
pub(crate) struct RuleEntry {
    /// The agent it lets through under its own name; none where it lets goals through.
    pub(crate) agent: Option<AgentId>,
    /// What the agent, or whoever takes the goals, is called on the other side.
    pub(crate) called: AgentId,
    /// What passes.
    pub(crate) performatives: BTreeSet<Performative>,
    /// Its actions: ours = theirs.
    pub(crate) actions: BTreeMap<String, String>,
    /// What its actions cost plans where it is seen, under the names they have there.
    pub(crate) costs: BTreeMap<String, f64>,
    /// Our predicates that goals may be made of.
    pub(crate) goals: BTreeSet<String>,
}
