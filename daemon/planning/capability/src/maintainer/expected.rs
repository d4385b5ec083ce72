//! Facts of agents that the ecosystem file names but that have not joined yet.
//!
//! Such an agent may be a lamp that is on: its daemon starts later, or died before the Domain
//! Maintainer was restarted. The agent's model determines the facts that it will be responsible
//! for: states that its actions observe or can make both true and false, and facts that axioms
//! derive from them. Until the agent joins, these facts are unknown, unless they are about the
//! agent's own objects.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use pddl::{ActionModel, ActionSchema, Atom, Condition, Derived, Effect, Name, Term};

use super::Maintainer;
use super::departure::heads;
use crate::belief::FactClaim;
use crate::change::DomainChange;
use crate::conflict::{ModelPart, ModelPartKind};
use crate::fact::{ClaimSource, FactKey, FactSymbolKind, FactValue, Owner};
use crate::limits;
use crate::model_summary::ModelSummary;
use crate::timestamp::Timestamp;

/// Objects for the variables of an action.
type Binding = BTreeMap<Name, Name>;

impl Maintainer {
    /// Marks facts as unknown if an agent that has not joined yet will be responsible for them.
    /// `models` are the models of such agents, as far as the ecosystem file determines them. Agents
    /// that have joined already, and models that exceed a limit, are skipped. The marks of an agent
    /// end when the agent joins.
    pub fn expect_agents(
        &mut self,
        models: impl IntoIterator<Item = ActionModel>,
        now: Timestamp,
    ) -> DomainChange {
        // The leader decides which marks are still in force. On a standby, the marks therefore
        // count as announced by the leader.
        let source = match self.follows {
            true => ClaimSource::Announced,
            false => ClaimSource::Departure,
        };
        for mut model in models {
            let Ok(agent) = AgentId::new(model.agent.as_str()) else { continue };
            if self.roster.get(&agent).is_some() {
                continue;
            }
            let Ok(manifest) = ModelSummary::of_model(&mut model) else { continue };
            let owner = Owner::Agent(agent);
            for fact in self.answers_of(&manifest) {
                if self.beliefs.has_room(&owner, 1).is_err() {
                    break;
                }
                self.expected.insert((fact.clone(), owner.clone()));
                self.beliefs.claim(fact, &owner, FactClaim::new(FactValue::Unknown, source, now));
            }
        }
        self.take_change(now)
    }

    /// Whether any change by a request, an observation or a departure is in force. The marks of
    /// [`expect_agents`](Maintainer::expect_agents) do not count, because they follow from the
    /// ecosystem file.
    pub fn has_requests(&self, now: Timestamp) -> bool {
        let is_request = |of: &&(FactKey, Owner)| match (&of.1, self.beliefs.claim_of(&of.0, &of.1))
        {
            (Owner::Agent(agent), Some(claim)) if !self.expected.contains(*of) => {
                self.announced_claim(agent, &of.0, claim, now).is_some()
            }
            _ => false,
        };
        let is_gone =
            |fact: &(FactKey, FactValue)| self.beliefs.claim_of(&fact.0, &Owner::Map).is_none();
        self.metric.is_some()
            || !self.withheld.is_empty()
            || self.beliefs.all_requested().any(|of| is_request(&of))
            || self.shared.manifest.init.iter().any(is_gone)
    }

    /// Returns the facts about remaining objects that an agent with this model will be responsible
    /// for.
    fn answers_of(&self, manifest: &ModelSummary) -> BTreeSet<FactKey> {
        let states = states_of(manifest, |name| self.is_function(manifest, name));
        let told = manifest.init.iter().map(|(fact, _)| fact);
        let told = told.filter(|fact| fact.space() == FactSymbolKind::Predicate);
        let mut known: BTreeSet<FactKey> = told.cloned().collect();
        for offer in &manifest.offers {
            let ground = instances(&offer.schema, &known, &states);
            known.extend(ground);
        }
        let own = manifest.declarations.iter().flat_map(|declared| &declared.axioms);
        let own = own.chain(&manifest.loose_axioms).map(|axiom| &axiom.tree);
        let mut answers: BTreeSet<FactKey> =
            known.iter().filter(|fact| states.contains(fact.symbol())).cloned().collect();
        for axiom in own.chain(&self.composite.domain.derived) {
            if !self.composite.knowledge.is_auxiliary(&axiom.predicate) && rests_on(axiom, &states)
            {
                answers.extend(known.iter().flat_map(|fact| heads(axiom, fact)));
            }
        }
        let objects = &self.composite.vocabulary.objects;
        let stays = |name: &Name| objects.contains_key(name) && !manifest.objects.contains(name);
        answers.retain(|fact| fact.arguments().iter().all(stays));
        answers
    }

    fn is_function(&self, manifest: &ModelSummary, name: &Name) -> bool {
        let is_it = |part: &ModelPart| part.kind == ModelPartKind::Function && part.name == *name;
        self.composite.vocabulary.functions.contains_key(name)
            || manifest.declarations.iter().any(|declared| is_it(&declared.subject))
    }
}

/// Returns the predicates of the states that an agent with this model is responsible for. Its
/// actions observe these states or can make them both true and false, or the model contains an
/// unknown fact of the predicate. A predicate that actions only make true, such as
/// `known-temperature`, is excluded: it records a past action, and is false before.
fn states_of(manifest: &ModelSummary, is_function: impl Fn(&Name) -> bool) -> BTreeSet<Name> {
    let schemas = || manifest.offers.iter().map(|offer| &*offer.schema);
    let observed = schemas().flat_map(|schema| &schema.observe).map(|atom| &atom.predicate);
    let added = schemas().flat_map(|schema| schema.effect.added()).map(|atom| &atom.predicate);
    let added: BTreeSet<&Name> = added.collect();
    let deleted = schemas().flat_map(|schema| deleted(&schema.effect)).map(|atom| &atom.predicate);
    let unknown = manifest.init.iter().filter(|(_, value)| *value == FactValue::Unknown);
    let mut states: BTreeSet<Name> = observed.filter(|name| !is_function(name)).cloned().collect();
    states.extend(deleted.filter(|name| added.contains(name)).cloned());
    states.extend(unknown.map(|(fact, _)| fact.symbol().clone()));
    states
}

fn deleted(effect: &Effect) -> impl Iterator<Item = &Atom> {
    effect.parts().filter_map(|part| match part {
        Effect::Delete(atom) => Some(atom),
        _ => None,
    })
}

/// Returns the facts of `states` that an action observes or changes. The objects are determined by
/// the facts `told` of the model, which no action changes.
fn instances(
    schema: &ActionSchema,
    told: &BTreeSet<FactKey>,
    states: &BTreeSet<Name>,
) -> Vec<FactKey> {
    let mut bindings = vec![Binding::new()];
    for atom in required(&schema.precondition) {
        let alike = || told.iter().filter(|fact| fact.symbol() == &atom.predicate);
        if states.contains(&atom.predicate) || alike().next().is_none() {
            continue;
        }
        let extended = bindings.iter().flat_map(|binding| {
            alike().filter_map(move |fact| matched(atom, fact, binding.clone()))
        });
        bindings = extended.take(limits::FACTS_PER_OWNER_MAX).collect();
    }
    let atoms = schema.observe.iter().chain(schema.effect.added()).chain(deleted(&schema.effect));
    let atoms: Vec<&Atom> = atoms.filter(|atom| states.contains(&atom.predicate)).collect();
    let ground = |binding: &Binding, atom: &Atom| {
        let arguments: Option<Vec<Term>> = { atom.arguments.iter() }
            .map(|term| match term {
                Term::Object(_) => Some(term.clone()),
                Term::Variable(name) => binding.get(name).cloned().map(Term::Object),
            })
            .collect();
        FactKey::of_predicate(&atom.predicate, &arguments?)
    };
    let all = bindings.iter().flat_map(|binding| atoms.iter().map(move |atom| (binding, *atom)));
    all.filter_map(|(binding, atom)| ground(binding, atom))
        .take(limits::FACTS_PER_OWNER_MAX)
        .collect()
}

/// Returns atoms that a condition requires: the atom itself, or the atoms of a conjunction.
fn required(condition: &Condition) -> Vec<&Atom> {
    match condition {
        Condition::Atom(atom) => vec![atom],
        Condition::And(parts) => parts.iter().flat_map(required).collect(),
        _ => Vec::new(),
    }
}

/// Returns `binding`, extended so that `atom` becomes `fact`; `None` if the two do not match.
fn matched(atom: &Atom, fact: &FactKey, mut binding: Binding) -> Option<Binding> {
    if atom.arguments.len() != fact.arguments().len() {
        return None;
    }
    for (term, object) in atom.arguments.iter().zip(fact.arguments()) {
        match term {
            Term::Object(name) if name == object => (),
            Term::Object(_) => return None,
            Term::Variable(name) => {
                if binding.insert(name.clone(), object.clone()).is_some_and(|old| old != *object) {
                    return None;
                }
            }
        }
    }
    Some(binding)
}

fn rests_on(axiom: &Derived, states: &BTreeSet<Name>) -> bool {
    axiom.condition.atoms().any(|atom| states.contains(&atom.predicate))
}
