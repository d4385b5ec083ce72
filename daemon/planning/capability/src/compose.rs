//! Composes the shared ontology and many models into one [`Composite`], and lists which parts of
//! the models were left out.
//!
//! Composition is a pure function of the whole input. The result depends on three things: the
//! present agents, the order of their arrival if two of them disagree, and the names that actions
//! had before. The cost is linear in the length of the models. There are three steps, each in its
//! own file: selecting declarations (`declarations`), selecting actions (`actions`), and writing
//! the domain (`assemble`).
//!
//! A maintainer of public scope composes only when a snapshot is requested. Until then it only
//! tracks which of several different declarations of a part is in force ([`incumbents`]). An agent
//! of an already known type is added to an existing composite ([`incremental`]).

mod actions;
mod assemble;
mod declarations;
mod incremental;
mod incumbents;

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use acl::AgentId;
use pddl::{Domain, Name, Privacy, Problem};

pub(crate) use self::incremental::join;
use self::incumbents::DeclarationsInForce;
use crate::composite::{Composite, PrivateFacts};
use crate::conflict::{Conflict, ModelPart, ModelPartKind};
use crate::model_summary::{Declaration, ModelSummary};
use crate::names::ActionNames;

/// The ontology and the map, which all agents share.
#[derive(Clone, Debug)]
pub(crate) struct SharedModel {
    pub(crate) ontology: Arc<Domain>,
    pub(crate) map: Arc<Problem>,
    pub(crate) manifest: ModelSummary,
    /// Index in `manifest.declarations` of the declaration of each declared part.
    places: BTreeMap<ModelPart, usize>,
}

/// The contribution of one agent to a composition.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Contribution<'a> {
    pub(crate) agent: &'a AgentId,
    /// Position of the agent in the order of arrival. If two agents disagree, the declaration of
    /// the agent that arrived first is used.
    pub(crate) arrival: u64,
    pub(crate) manifest: &'a ModelSummary,
    /// Whether the agent's whole model is used, or only its public part.
    pub(crate) trusted: bool,
}

/// State that is kept from one composition to the next.
#[derive(Clone, Debug, Default)]
pub(crate) struct CompositionMemory {
    /// The declaration in force for each part. It stays in force as long as any agent makes it.
    incumbents: DeclarationsInForce,
    /// Predicates with facts that may be unknown.
    pub(crate) unknowable: BTreeSet<Name>,
    names: ActionNames,
}

/// Composes the models of `parties`, sorted by the name of the agent, into one domain. Returns the
/// composite, and the parts that were left out of it as conflicts.
///
/// If `everything` is true, the private facts of all agents are visible in the composite.
pub(crate) fn compose(
    shared: &SharedModel,
    parties: &[Contribution<'_>],
    everything: bool,
    memory: &mut CompositionMemory,
) -> (Composite, Vec<Conflict>) {
    let mut report = ConflictReport::default();
    for party in parties.iter().filter(|party| party.trusted) {
        for flaw in &party.manifest.flaws {
            report.leave_out(party.agent, flaw.subject.clone(), flaw.detail.clone());
        }
    }
    let standing =
        declarations::select_declarations(shared, parties, &mut memory.incumbents, &mut report);
    let schemas = actions::gather(shared, parties, &standing, &mut report);
    let inside = actions::name(&schemas, parties, &mut memory.names);
    let secrets = secrets(shared, parties, everything);
    let context = (secrets, &memory.unknowable);
    let composite = assemble::assemble(shared, parties, standing, &schemas, &inside, context);
    (composite, report.conflicts.into_iter().collect())
}

impl SharedModel {
    pub(crate) fn new(ontology: Arc<Domain>, map: Arc<Problem>) -> SharedModel {
        let manifest = ModelSummary::of_ontology(&ontology, &map);
        let subjects = manifest.declarations.iter().map(|declared| declared.subject.clone());
        let places = subjects.zip(0..).collect();
        SharedModel { ontology, map, manifest, places }
    }

    /// Returns the declaration of the part `subject` in the ontology or the map; `None` if neither
    /// declares it.
    fn declared(&self, subject: &ModelPart) -> Option<&Declaration> {
        self.places.get(subject).and_then(|place| self.manifest.declarations.get(*place))
    }
}

impl CompositionMemory {
    /// Updates the declarations in force, without composing, after the model of one agent has
    /// changed from `former` to `now`. `parties` are all present agents. If `trusted` is true,
    /// their whole models are used, and otherwise only the public parts.
    pub(crate) fn keep_standing<'a, P: Iterator<Item = Contribution<'a>>>(
        &mut self,
        former: Option<&ModelSummary>,
        now: Option<&ModelSummary>,
        trusted: bool,
        parties: impl Fn() -> P,
    ) {
        incumbents::update(&mut self.incumbents, former, now, trusted, parties);
    }
}

fn secrets(shared: &SharedModel, parties: &[Contribution<'_>], everything: bool) -> PrivateFacts {
    if everything {
        return PrivateFacts::default();
    }
    let trusted = parties.iter().filter(|party| party.trusted).map(|party| party.agent.clone());
    let of_agents = parties.iter().filter(|party| !party.trusted).filter_map(|party| {
        let hidden = private_names(party.manifest.declarations.iter());
        (!hidden.is_empty()).then(|| (party.agent.clone(), hidden))
    });
    let symbols = &shared.ontology;
    let predicates = symbols.predicates.iter().map(|declared| (&declared.name, &declared.privacy));
    let functions = symbols.functions.iter().map(|declared| (&declared.name, &declared.privacy));
    PrivateFacts {
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

/// Parts of models that the composition has left out so far.
#[derive(Default)]
struct ConflictReport<'a> {
    conflicts: BTreeSet<Conflict>,
    /// Declarations left out because a different declaration of another agent is in force. Each
    /// entry is the agent, the kind of the part and the name of the part.
    lost: BTreeSet<(&'a AgentId, ModelPartKind, &'a Name)>,
}

// === impl ConflictReport ===

impl<'a> ConflictReport<'a> {
    fn leave_out(&mut self, agent: &AgentId, subject: ModelPart, detail: String) {
        self.conflicts.insert(Conflict { agents: vec![agent.clone()], subject, detail });
    }

    /// Records that the declaration of `loser` is left out, because a different declaration of
    /// `keeper` is in force.
    fn lose(
        &mut self,
        keeper: &AgentId,
        loser: &'a AgentId,
        subject: &'a ModelPart,
        detail: String,
    ) {
        self.lost.insert((loser, subject.kind, &subject.name));
        let agents = vec![keeper.clone(), loser.clone()];
        self.conflicts.insert(Conflict { agents, subject: subject.clone(), detail });
    }
}
