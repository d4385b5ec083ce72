//! Writes the composite domain: first the ontology, then the additions of agents, sorted by name.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::knowledge::Knowledge;
use pddl::{
    ActionSchema, Atom, Condition, Domain, Name, ObjectDeclaration, PredicateDeclaration, Privacy,
    Span, Term, TypeExpr, Typed,
};

use super::actions::{SelectedSchema, SelectedSchemas};
use super::declarations::{SelectedDeclaration, SelectedDeclarations};
use super::{Contribution, SharedModel};
use crate::canonical::CanonicalText;
use crate::composite::{CollectedOffers, Composite, OfferedAction, PrivateFacts};
use crate::model_summary::DeclaredItem;
use crate::names::unique;

pub(super) fn assemble(
    shared: &SharedModel,
    parties: &[Contribution<'_>],
    standing: SelectedDeclarations<'_>,
    schemas: &SelectedSchemas<'_>,
    inside: &BTreeMap<(&Name, &CanonicalText), Name>,
    (secrets, unknowable): (PrivateFacts, &BTreeSet<Name>),
) -> Composite {
    let mut domain = Domain::clone(&shared.ontology);
    // No agent offers the actions of the ontology itself.
    domain.actions.clear();
    domain.durative_actions.clear();
    require(&mut domain, parties);
    let mut objects = shared.map.objects.to_vec();
    for kept in &standing.kept {
        declare(&mut domain, &mut objects, kept);
    }
    domain.derived.extend(standing.axioms.iter().map(|axiom| axiom.tree.clone()));
    let named = named_objects(&standing, schemas);
    let is_named = |declared: &ObjectDeclaration| named.contains(&declared.object.name);
    let of_map = shared.map.objects.iter().filter(|declared| !is_named(declared)).count();
    let (constants, objects): (Vec<_>, Vec<_>) = objects.into_iter().partition(is_named);
    domain.constants.extend(constants.into_iter().map(|declared| declared.object));
    let vocabulary = standing.vocabulary;
    let (mut offers, mut guards) = (CollectedOffers::default(), BTreeSet::new());
    for (inside, ((outside, key), schema)) in by_name_inside(schemas, inside) {
        let guard = unique(&format!("offers-{inside}"), |name| {
            guards.contains(name) || vocabulary.declares(name)
        });
        guards.insert(guard.clone());
        write(&mut domain, inside, &guard, schema);
        let (outside, inside) = (outside.clone(), inside.clone());
        let (key, tree) = (key.clone(), Arc::clone(schema.tree));
        let agents = tree.agents().count();
        offers.add(key, tree, OfferedAction { outside, inside, guard, agents }, &schema.offerers);
    }
    let knowledge = Knowledge::of(&domain, unknowable);
    knowledge.compile(&mut domain);
    Composite::new(domain, vocabulary, (objects, of_map), offers, secrets, knowledge)
}

fn by_name_inside<'a>(
    schemas: &'a SelectedSchemas<'a>,
    inside: &'a BTreeMap<(&Name, &CanonicalText), Name>,
) -> BTreeMap<&'a Name, ((&'a Name, &'a CanonicalText), &'a SelectedSchema<'a>)> {
    { schemas.iter() }.filter_map(|(at, schema)| Some((inside.get(at)?, (*at, schema)))).collect()
}

/// Adds the PDDL requirements of the agents to those of the ontology, in the order of their names.
fn require(domain: &mut Domain, parties: &[Contribution<'_>]) {
    let theirs = parties.iter().filter(|party| party.trusted);
    let theirs: BTreeSet<&Name> = theirs.flat_map(|party| &party.manifest.requirements).collect();
    for requirement in theirs {
        if !domain.requirements.contains(requirement) {
            domain.requirements.push(requirement.clone());
        }
    }
}

fn declare(
    domain: &mut Domain,
    objects: &mut Vec<ObjectDeclaration>,
    kept: &SelectedDeclaration<'_>,
) {
    let privacy = |written: &Privacy| {
        if kept.private { written.clone() } else { Privacy::Public }
    };
    match &kept.declaration.item {
        DeclaredItem::Type(typed) => domain.types.push(typed.clone()),
        DeclaredItem::Predicate(declared) => {
            let privacy = privacy(&declared.privacy);
            domain.predicates.push(PredicateDeclaration { privacy, ..declared.clone() });
        }
        DeclaredItem::Function(declared) => {
            let privacy = privacy(&declared.privacy);
            domain.functions.push(pddl::FunctionDeclaration { privacy, ..declared.clone() });
        }
        DeclaredItem::Object(declared) => {
            let privacy = privacy(&declared.privacy);
            objects.push(ObjectDeclaration { privacy, ..declared.clone() });
        }
    }
}

/// Returns the objects that selected schemas mention directly. These objects must be constants of
/// the domain.
fn named_objects<'a>(
    standing: &SelectedDeclarations<'a>,
    schemas: &SelectedSchemas<'a>,
) -> BTreeSet<&'a Name> {
    let in_actions = schemas.values().flat_map(|schema| &schema.uses.objects);
    let in_axioms = standing.axioms.iter().flat_map(|axiom| &axiom.uses.objects);
    in_actions.chain(in_axioms).collect()
}

/// Writes an action schema into the domain under the name `inside`. The guard is added to the
/// precondition, so that the action is grounded only for the agents that offer it. The agents of a
/// joint action all offer it, and no two of them are the same.
fn write(domain: &mut Domain, inside: &Name, guard: &Name, schema: &SelectedSchema<'_>) {
    let tree = &**schema.tree;
    let Some(agent) = &tree.agent else { return };
    domain.predicates.push(PredicateDeclaration {
        name: guard.clone(),
        parameters: vec![Typed { name: agent.name.clone(), ty: agent_type(tree) }],
        privacy: Privacy::Public,
    });
    if !tree.partners.is_empty() {
        for requirement in [":equality", ":negative-preconditions"].map(Name::new) {
            if !domain.requirements.contains(&requirement) {
                domain.requirements.push(requirement);
            }
        }
    }
    domain.actions.push(ActionSchema {
        name: inside.clone(),
        precondition: guarded(guard, tree),
        ..tree.clone()
    });
}

/// Returns the type that has all the agents of an action.
fn agent_type(schema: &ActionSchema) -> TypeExpr {
    let mut alternatives: Vec<Name> = Vec::new();
    for agent in schema.agents() {
        if agent.ty.is_object() {
            return agent.ty.clone();
        }
        let new = agent.ty.alternatives.iter().filter(|ty| !alternatives.contains(ty));
        alternatives.extend(new.cloned().collect::<Vec<_>>());
    }
    TypeExpr { alternatives }
}

fn guarded(guard: &Name, schema: &ActionSchema) -> Condition {
    let variable = |agent: &Typed| Term::Variable(agent.name.clone());
    let mut parts: Vec<Condition> = Vec::new();
    for (position, agent) in schema.agents().enumerate() {
        parts.push(Condition::Atom(Atom {
            predicate: guard.clone(),
            arguments: vec![variable(agent)],
            span: Span::default(),
        }));
        for other in schema.agents().take(position) {
            let same = Condition::Equal(variable(other), variable(agent), Span::default());
            parts.push(Condition::Not(Box::new(same)));
        }
    }
    match &schema.precondition {
        Condition::And(rest) => parts.extend(rest.iter().cloned()),
        other => parts.push(other.clone()),
    }
    match parts.len() {
        1 => parts.remove(0),
        _ => Condition::And(parts),
    }
}
