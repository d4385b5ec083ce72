//! Where an ecosystem meets another, as its file means it. Whoever reads that file holds the words of
//! both against each other before anything is opened.

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use acl::{AgentId, DaemonId, Performative};

/// What can be let through: news, calls for proposals, requests, and taking them back. An answer
/// passes where what it answers did.
pub const PASSING: [Performative; 4] =
    [Performative::Inform, Performative::Cfp, Performative::Request, Performative::Cancel];

/// One `[[interface]]`.
#[derive(Clone, Debug)]
pub struct InterfaceEntry {
    /// The other ecosystem's file.
    pub file: PathBuf,
    /// Which of our daemons joins both; none where whoever runs alone does.
    pub daemon: Option<DaemonId>,
    /// What it is called over there: the daemon, and the agent that speaks for us.
    pub called: AgentId,
    /// Messages a second that pass, each way.
    pub rate: f64,
    /// Ours = theirs, of each sort; what is not here does not pass.
    pub types: BTreeMap<String, String>,
    /// Predicates.
    pub predicates: BTreeMap<String, String>,
    /// Functions.
    pub functions: BTreeMap<String, String>,
    /// Objects.
    pub objects: BTreeMap<String, String>,
    /// What of theirs is here.
    pub imports: Vec<RuleEntry>,
    /// What of ours is there.
    pub exports: Vec<RuleEntry>,
}

/// One `[[interface.import]]` or `[[interface.export]]`.
#[derive(Clone, Debug)]
pub struct RuleEntry {
    /// The agent it lets through under its own name; none where it lets goals through.
    pub agent: Option<AgentId>,
    /// What the agent, or whoever takes the goals, is called on the other side.
    pub called: AgentId,
    /// What passes.
    pub performatives: BTreeSet<Performative>,
    /// Its actions: ours = theirs.
    pub actions: BTreeMap<String, String>,
    /// What its actions cost plans where it is seen, under the names they have there.
    pub costs: BTreeMap<String, f64>,
    /// Our predicates that goals may be made of.
    pub goals: BTreeSet<String>,
}
