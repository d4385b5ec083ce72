//! Writing the domain: the ontology first, then what agents add, in the order of names.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::{
    ActionSchema, Atom, Condition, Domain, Name, ObjectDeclaration, PredicateDeclaration, Privacy,
    Span, Term, Typed,
};

use super::actions::{Schema, Schemas};
use super::declarations::{Kept, Standing};
use super::{Party, Shared};
use crate::canonical::Key;
use crate::composite::{Composite, Offered, Secrets};
use crate::manifest::Item;
use crate::names::unique;
use crate::vocabulary::Signature;

pub(super) fn assemble(
    shared: &Shared,
    parties: &[Party<'_>],
    standing: Standing<'_>,
    schemas: &Schemas<'_>,
    inside: &BTreeMap<(&Name, &Key), Name>,
    secrets: Secrets,
) -> Composite {
    let mut domain = shared.ontology.clone();
    // What the ontology describes and nobody offers, nobody can carry out.
    domain.actions.clear();
    domain.durative_actions.clear();
    require(&mut domain, parties);
    let mut objects = shared.map.objects.clone();
    for kept in &standing.kept {
        declare(&mut domain, &mut objects, kept);
    }
    domain.derived.extend(standing.axioms.iter().map(|axiom| axiom.tree.clone()));
    let objects = name_constants(&mut domain, objects, &standing, schemas);
    let Standing { vocabulary, .. } = standing;
    let mut composite = Composite::new(domain, vocabulary, objects, secrets);
    let mut actions: Vec<(&Name, &Name, &Schema<'_>)> =
        schemas.iter().filter_map(|(at, schema)| Some((inside.get(at)?, at.0, schema))).collect();
    actions.sort_by_key(|(inside, ..)| *inside);
    for (inside, outside, schema) in actions {
        offer(&mut composite, inside, outside, schema);
    }
    composite
}

/// Requirements are gathered: the ontology's as they are, then the agents' by name.
fn require(domain: &mut Domain, parties: &[Party<'_>]) {
    let theirs = parties.iter().filter(|party| party.trusted);
    let theirs: BTreeSet<&Name> = theirs.flat_map(|party| &party.manifest.requirements).collect();
    for requirement in theirs {
        if !domain.requirements.contains(requirement) {
            domain.requirements.push(requirement.clone());
        }
    }
}

fn declare(domain: &mut Domain, objects: &mut Vec<ObjectDeclaration>, kept: &Kept<'_>) {
    let privacy = |written: &Privacy| {
        if kept.private { written.clone() } else { Privacy::Public }
    };
    match &kept.declaration.item {
        Item::Type(typed) => domain.types.push(typed.clone()),
        Item::Predicate(declared) => {
            let privacy = privacy(&declared.privacy);
            domain.predicates.push(PredicateDeclaration { privacy, ..declared.clone() });
        }
        Item::Function(declared) => {
            let privacy = privacy(&declared.privacy);
            domain.functions.push(pddl::FunctionDeclaration { privacy, ..declared.clone() });
        }
        Item::Object(declared) => {
            let privacy = privacy(&declared.privacy);
            objects.push(ObjectDeclaration { privacy, ..declared.clone() });
        }
    }
}

/// An object that a schema names outright must be a constant of the domain.
fn name_constants(
    domain: &mut Domain,
    objects: Vec<ObjectDeclaration>,
    standing: &Standing<'_>,
    schemas: &Schemas<'_>,
) -> Vec<ObjectDeclaration> {
    let in_actions = schemas.values().flat_map(|schema| &schema.uses.objects);
    let in_axioms = standing.axioms.iter().flat_map(|axiom| &axiom.uses.objects);
    let named: BTreeSet<&Name> = in_actions.chain(in_axioms).collect();
    let (constants, objects): (Vec<_>, Vec<_>) =
        objects.into_iter().partition(|declared| named.contains(&declared.object.name));
    domain.constants.extend(constants.into_iter().map(|declared| declared.object));
    objects
}

/// Adds a schema under its name inside, guarded so that it is grounded for its offerers only.
fn offer(composite: &mut Composite, inside: &Name, outside: &Name, schema: &Schema<'_>) {
    let Some(agent) = &schema.tree.agent else { return };
    // Not shared yet, so this clones nothing.
    let domain = Arc::make_mut(&mut composite.domain);
    let vocabulary = &mut composite.vocabulary;
    let guard = unique(&format!("offers-{inside}"), |name| {
        vocabulary.predicates.contains_key(name) || vocabulary.functions.contains_key(name)
    });
    // Nobody can claim it: it is as if derived.
    let signature = Signature { parameters: vec![agent.ty.clone()], derived: true };
    vocabulary.predicates.insert(guard.clone(), signature);
    domain.predicates.push(PredicateDeclaration {
        name: guard.clone(),
        parameters: vec![agent.clone()],
        privacy: Privacy::Public,
    });
    domain.actions.push(ActionSchema {
        name: inside.clone(),
        precondition: guarded(&guard, agent, &schema.tree.precondition),
        ..ActionSchema::clone(schema.tree)
    });
    if inside != outside {
        composite.qualified.insert(inside.clone(), outside.clone());
    }
    for offerer in &schema.offerers {
        let (outside, inside, guard) = (outside.clone(), inside.clone(), guard.clone());
        let offered = Offered { outside, inside, guard };
        composite.offers.entry((*offerer).clone()).or_default().push(offered);
    }
}

fn guarded(guard: &Name, agent: &Typed, precondition: &Condition) -> Condition {
    let guard = Condition::Atom(Atom {
        predicate: guard.clone(),
        arguments: vec![Term::Variable(agent.name.clone())],
        span: Span::default(),
    });
    let rest = match precondition {
        Condition::And(parts) => parts.clone(),
        other => vec![other.clone()],
    };
    if rest.is_empty() {
        return guard;
    }
    Condition::And(std::iter::once(guard).chain(rest).collect())
}
