//! Interfacing nodes (the paper, “Interfacing Node”; docs/design.md, “Between ecosystems”): a daemon that
//! takes part in two ecosystems, and passes on exactly what its rules export.
//!
//! - No message crosses; agents are represented. On the *far* side, where an agent runs, an
//!   `agent::Observer` watches it. On the *near* side a proxy agent (`mirror`) stands for it: an actuator
//!   of its own, with the agent's model translated into the near vocabulary (`words`, `translate`,
//!   `export`). A request to the proxy agent is sent to the real agent by a Keyboard Agent on the far side
//!   (`voice`), as a person would. So tokens, receipts, incarnations and conversations belong to one
//!   ecosystem each, and no identifier of one ever appears in the other.
//! - `desk` accepts goals for the other side. `crossing` starts and stops a proxy agent with the real one,
//!   and rejects agents that would return to the ecosystem they come from. `bucket` limits the rate.
//!
//! This crate leaves to others: the behaviour of a proxy agent as an actuator (`actuator`); reading the
//! rules, checking them against both ecosystems' vocabularies, and both substrates (`althing`).

mod bucket;
mod crossing;
mod desk;
mod entry;
pub mod export;
mod mirror;
pub mod translate;
pub mod voice;
pub mod words;

use std::collections::BTreeMap;
use std::sync::Arc;

use acl::{AgentId, EcosystemId, Performative};
use agent::{Landing, Launch, Observer, Sight};
use keyboard::Keyboard;
use pddl::{Domain, Problem};

use bucket::Bucket;
use desk::Desk;
pub use entry::{InterfaceEntry, PASSING, RuleEntry};
pub use mirror::Counters;
use mirror::Crossing;
use voice::Voice;
use words::{Passage, Way, Words};

/// One of the two ecosystems, and where this daemon's agents are started in it.
#[derive(Clone)]
pub struct Shore {
    /// The ecosystem.
    pub name: EcosystemId,
    /// Its ontology.
    pub domain: Arc<Domain>,
    /// Its map.
    pub problem: Arc<Problem>,
    /// Where agents are started.
    pub landing: Landing,
}

/// Counters of a running interface.
pub struct Interface {
    /// From the other ecosystem to this one.
    pub imported: Arc<Counters>,
    /// From this ecosystem to the other.
    pub exported: Arc<Counters>,
}

/// Why an interface cannot work. Completes “failed to …”.
#[derive(Debug, thiserror::Error)]
pub enum InterfaceError {
    /// The name of an agent cannot be formed.
    #[error("join `{far}`: {source}")]
    Name {
        /// The other ecosystem.
        far: EcosystemId,
        /// Why the name is not valid.
        #[source]
        source: acl::InvalidName,
    },
}

/// Starts an interface, which runs until its daemon drains: `home` is this ecosystem, `away` the other.
///
/// # Errors
///
/// Returns an error if no valid name can be formed for an agent of the interface.
pub fn connect(
    entry: &InterfaceEntry,
    home: &Shore,
    away: &Shore,
) -> Result<Interface, InterfaceError> {
    let (outward, inward) = (Bucket::new(entry.rate), Bucket::new(entry.rate));
    let (outward, inward) = (Arc::new(outward), Arc::new(inward));
    let interface = Interface { imported: Arc::default(), exported: Arc::default() };
    let name = |text: &str| {
        let far = away.name.clone();
        AgentId::new(text).map_err(|source| InterfaceError::Name { far, source })
    };
    let imports = Bridge {
        entry,
        way: Way::Import,
        near: home.clone(),
        far: away.clone(),
        called: entry.called.clone(),
        outward: Arc::clone(&outward),
        inward: Arc::clone(&inward),
        counters: Arc::clone(&interface.imported),
    };
    imports.build(&entry.imports, &name(&format!("{}-watch", entry.called))?);
    let theirs = away.name.as_str();
    let exports = Bridge {
        entry,
        way: Way::Export,
        near: away.clone(),
        far: home.clone(),
        called: name(theirs)?,
        outward: inward,
        inward: outward,
        counters: Arc::clone(&interface.exported),
    };
    exports.build(&entry.exports, &name(&format!("{theirs}-watch"))?);
    Ok(interface)
}

/// One direction of an interface: agents of `far` are represented in `near`.
struct Bridge<'b> {
    entry: &'b InterfaceEntry,
    way: Way,
    near: Shore,
    far: Shore,
    /// Name in `far` of the agent that makes requests for `near`.
    called: AgentId,
    /// Rate limits to `far`, and from it.
    outward: Arc<Bucket>,
    inward: Arc<Bucket>,
    counters: Arc<Counters>,
}

impl Bridge<'_> {
    fn build(&self, rules: &[RuleEntry], watcher: &AgentId) {
        if rules.is_empty() {
            return;
        }
        let voice = self.speak();
        let watched = rules.iter().filter_map(|rule| rule.agent.clone());
        let (observer, sights) = Observer::of(watched);
        if !sights.is_empty() {
            self.launch(&self.far.landing, watcher, observer, self.speaking_for());
        }
        for rule in rules {
            match Passage::of(rule, &self.far.name, self.way) {
                Some(passage) => self.mirror(rule, passage, &sights, &voice),
                None => self.desk(rule, &voice),
            }
        }
    }

    /// The route of the agents that act for `near` in `far`: they come from `near`.
    fn speaking_for(&self) -> Vec<EcosystemId> {
        vec![self.near.name.clone()]
    }

    fn speak(&self) -> Voice {
        let (keyboard, terminal) = Keyboard::with_terminal();
        let (voice, speaking) = Voice::new(terminal);
        self.launch(&self.far.landing, &self.called, keyboard, self.speaking_for());
        self.far.landing.tasks.spawn(speaking);
        voice
    }

    fn mirror(
        &self,
        rule: &RuleEntry,
        passage: Passage,
        sights: &BTreeMap<AgentId, Sight>,
        voice: &Voice,
    ) {
        let Some(sight) = sights.get(&passage.agent).cloned() else { return };
        let files = |shore: &Shore| (Arc::clone(&shore.domain), Arc::clone(&shore.problem));
        let crossing = Crossing {
            passage,
            performatives: rule.performatives.clone(),
            words: Words::of(self.entry, self.way),
            far: self.far.name.clone(),
            far_files: files(&self.far),
            near_files: files(&self.near),
            voice: voice.clone(),
            outward: Arc::clone(&self.outward),
            inward: Arc::clone(&self.inward),
            counters: Arc::clone(&self.counters),
        };
        let near = self.near.landing.clone();
        self.near.landing.tasks.spawn(crossing::mirror(Arc::new(crossing), sight, near));
    }

    fn desk(&self, rule: &RuleEntry, voice: &Voice) {
        // Rules name goals in this ecosystem's vocabulary; a rule of exports lets the other ecosystem
        // request them in its own.
        let words = Words::of(self.entry, self.way).reversed();
        let goals = match self.way {
            Way::Import => rule.goals.clone(),
            Way::Export => { rule.goals.iter() }
                .filter_map(|goal| self.entry.predicates.get(goal).cloned())
                .collect(),
        };
        let desk = Desk {
            far: self.far.name.clone(),
            goals,
            words,
            near: (Arc::clone(&self.near.domain), Arc::clone(&self.near.problem)),
            revocable: rule.performatives.contains(&Performative::Cancel),
            voice: voice.clone(),
            outward: Arc::clone(&self.outward),
            counters: Arc::clone(&self.counters),
            open: BTreeMap::new(),
        };
        let via = vec![self.far.name.clone()];
        self.launch(&self.near.landing, &rule.called, desk, via);
    }

    fn launch(
        &self,
        landing: &Landing,
        id: &AgentId,
        agent: impl agent::Agent,
        via: Vec<EcosystemId>,
    ) {
        let life = Box::new(agent).launch(landing.berth(id, via, &landing.stopping));
        let id = id.clone();
        landing.tasks.spawn(async move {
            match life.await {
                Ok(Ok(())) => (),
                Ok(Err(error)) => tracing::error!(%id, "failed to {error}"),
                Err(error) => tracing::error!(%id, %error, "the agent broke"),
            }
        });
    }
}
