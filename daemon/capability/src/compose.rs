//! Composing: the shared ontology and many models → one [`Composite`], and what was left out.
//!
//! Pure, and as if from the start each time: the result depends on who is here, on who was here first
//! where two disagree, and on names given before; on nothing else. Linear in the text of the
//! models. Three steps, each a file: which declarations stand, which actions, and the domain
//! that is written from both. Where nobody looks yet, only [whose declaration stands](incumbents)
//! is kept; who is the next of its kind is [added](joining) to what was composed.

mod actions;
mod assemble;
mod declarations;
mod incumbents;
mod joining;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::AgentId;
use pddl::{Domain, Name, Privacy, Problem};

use self::incumbents::Incumbents;
pub(crate) use self::joining::join;
use crate::composite::{Composite, Secrets};
use crate::conflict::{Conflict, Kind, Subject};
use crate::manifest::{Declaration, Manifest};
use crate::names::ActionNames;

/// What everyone shares.
#[derive(Clone, Debug)]
pub(crate) struct Shared {
    pub(crate) ontology: Arc<Domain>,
    pub(crate) map: Arc<Problem>,
    pub(crate) manifest: Manifest,
    /// Where a subject is declared in the manifest.
    places: BTreeMap<Subject, usize>,
}

/// One agent's part in a composition.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Party<'a> {
    pub(crate) agent: &'a AgentId,
    /// Counts arrivals: of two that disagree, the one here first is believed.
    pub(crate) arrival: u64,
    pub(crate) manifest: &'a Manifest,
    /// Whether its whole model is known here, or its public face only.
    pub(crate) trusted: bool,
}

/// What is remembered from one composition to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct Memory {
    /// Whose declaration stood: it goes on standing while anyone makes it.
    incumbents: Incumbents,
    /// Predicates whose facts may be unknown.
    pub(crate) unknowable: BTreeSet<Name>,
    names: ActionNames,
}

/// Composes `parties`, which are in the order of their names.
///
/// `everything` tells whether private facts of all may be known.
pub(crate) fn compose(
    shared: &Shared,
    parties: &[Party<'_>],
    everything: bool,
    memory: &mut Memory,
) -> (Composite, Vec<Conflict>) {
    let mut report = Report::default();
    for party in parties.iter().filter(|party| party.trusted) {
        for flaw in &party.manifest.flaws {
            report.leave_out(party.agent, flaw.subject.clone(), flaw.detail.clone());
        }
    }
    let standing = declarations::settle(shared, parties, &mut memory.incumbents, &mut report);
    let schemas = actions::gather(shared, parties, &standing, &mut report);
    let inside = actions::name(&schemas, parties, &mut memory.names);
    let secrets = secrets(shared, parties, everything);
    let context = (secrets, &memory.unknowable);
    let composite = assemble::assemble(shared, parties, standing, &schemas, &inside, context);
    (composite, report.conflicts.into_iter().collect())
}

impl Shared {
    pub(crate) fn new(ontology: Arc<Domain>, map: Arc<Problem>) -> Shared {
        let manifest = Manifest::of_ontology(&ontology, &map);
        let subjects = manifest.declarations.iter().map(|declared| declared.subject.clone());
        let places = subjects.zip(0..).collect();
        Shared { ontology, map, manifest, places }
    }

    /// What the ontology or the map declares of a subject.
    fn declared(&self, subject: &Subject) -> Option<&Declaration> {
        self.places.get(subject).and_then(|place| self.manifest.declarations.get(*place))
    }
}

impl Memory {
    /// Remembers whose declarations stand, without composing, now that a party says what is in `now`
    /// in place of what was in `former`. `parties` are all who are here now, and all trusted or none.
    pub(crate) fn keep_standing<'a, P: Iterator<Item = Party<'a>>>(
        &mut self,
        former: Option<&Manifest>,
        now: Option<&Manifest>,
        trusted: bool,
        parties: impl Fn() -> P,
    ) {
        incumbents::keep(&mut self.incumbents, former, now, trusted, parties);
    }
}

fn secrets(shared: &Shared, parties: &[Party<'_>], everything: bool) -> Secrets {
    if everything {
        return Secrets::default();
    }
    let trusted = parties.iter().filter(|party| party.trusted).map(|party| party.agent.clone());
    let of_agents = parties.iter().filter(|party| !party.trusted).filter_map(|party| {
        let hidden = private_names(party.manifest.declarations.iter());
        (!hidden.is_empty()).then(|| (party.agent.clone(), hidden))
    });
    let symbols = &shared.ontology;
    let predicates = symbols.predicates.iter().map(|declared| (&declared.name, &declared.privacy));
    let functions = symbols.functions.iter().map(|declared| (&declared.name, &declared.privacy));
    Secrets {
        trusted: Some(trusted.collect()),
        symbols: predicates
            .chain(functions)
            .filter(|(_, privacy)| **privacy != Privacy::Public)
            .map(|(name, _)| name.clone())
            .collect(),
        of_agents: of_agents.collect(),
    }
}

fn private_names<'a>(declarations: impl Iterator<Item = &'a Declaration>) -> BTreeSet<Name> {
    let private = declarations.filter(|declaration| declaration.private);
    private.map(|declaration| declaration.subject.name.clone()).collect()
}

/// What was left out so far.
#[derive(Default)]
struct Report<'a> {
    conflicts: BTreeSet<Conflict>,
    /// Declarations that another agent's stand in the place of.
    lost: BTreeSet<(&'a AgentId, Kind, &'a Name)>,
}

// === impl Report ===

impl<'a> Report<'a> {
    fn leave_out(&mut self, agent: &AgentId, subject: Subject, detail: String) {
        self.conflicts.insert(Conflict { agents: vec![agent.clone()], subject, detail });
    }

    /// `loser`'s declaration is left out, because `keeper` makes another.
    fn lose(&mut self, keeper: &AgentId, loser: &'a AgentId, subject: &'a Subject, detail: String) {
        self.lost.insert((loser, subject.kind, &subject.name));
        let agents = vec![keeper.clone(), loser.clone()];
        self.conflicts.insert(Conflict { agents, subject: subject.clone(), detail });
    }
}
