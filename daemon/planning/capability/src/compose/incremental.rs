//! Adds one agent to an existing composite without a new composition, if the agent adds only
//! objects of its own and offers.
//!
//! Most agents that join are of a known type: they add objects, and offer actions that other agents
//! offer already. All selected declarations and actions then stay the same, and only the new model
//! is read, even beside a thousand others. All other cases are left to [`compose`](super::compose),
//! which gives the same result.

use std::sync::Arc;

use pddl::{Name, ObjectDeclaration};

use super::actions::may_act;
use super::{Contribution, SharedModel};
use crate::composite::{Composite, OfferedAction, SelectedAction};
use crate::model_summary::{Declaration, DeclaredItem, ModelAction, ModelSummary};

/// Objects and offers that an agent adds.
struct AgentAdditions<'p> {
    objects: Vec<(&'p Name, &'p ObjectDeclaration)>,
    /// The action schemas that the agent offers. Each entry is the agent's name for the action, and
    /// the index of the schema among the selected schemas of that name.
    offers: Vec<(&'p Name, usize)>,
}

/// Adds an agent to a composite in which all models are used whole and no part was left out.
/// Returns the objects that were added, or `None` if a new composition is needed.
pub(crate) fn join<'p>(
    shared: &SharedModel,
    composite: &mut Arc<Composite>,
    party: &Contribution<'p>,
) -> Option<Vec<&'p Name>> {
    let AgentAdditions { objects, offers } = additions(shared, composite, party)?;
    if objects.is_empty() && offers.is_empty() {
        return Some(Vec::new());
    }
    let composite = Arc::make_mut(composite);
    let listed = Arc::make_mut(&mut composite.objects);
    for (name, declared) in &objects {
        let theirs = &listed[composite.of_map..];
        let place = theirs.partition_point(|other| other.object.name < **name);
        listed.insert(composite.of_map + place, (*declared).clone());
        composite.vocabulary.objects.insert((*name).clone(), declared.object.ty.clone());
    }
    let mut offered: Vec<OfferedAction> = Vec::new();
    for (outside, place) in offers {
        let stands = composite.schemas.get_mut(outside).and_then(|stands| stands.get_mut(place));
        if let Some(stands) = stands {
            stands.first = std::cmp::min(&stands.first, party.agent).clone();
            offered.push(stands.offered.clone());
        }
    }
    offered.sort_by(|one, other| one.inside.cmp(&other.inside));
    if !offered.is_empty() {
        composite.offers.insert(party.agent.clone(), offered);
    }
    Some(objects.into_iter().map(|(name, _)| name).collect())
}

/// Returns the objects and offers that an agent adds; `None` if the agent changes anything else.
fn additions<'p>(
    shared: &SharedModel,
    composite: &Composite,
    party: &Contribution<'p>,
) -> Option<AgentAdditions<'p>> {
    let ModelSummary { requirements, declarations, loose_axioms, offers, flaws, .. } =
        party.manifest;
    let required = &composite.domain.requirements;
    let is_plain = flaws.is_empty()
        && loose_axioms.is_empty()
        && requirements.iter().all(|requirement| required.contains(requirement));
    if !is_plain {
        return None;
    }
    let mut objects = Vec::new();
    for declaration in declarations {
        match shared.declared(&declaration.subject) {
            Some(declared) if declaration.repeats(declared) => (),
            Some(_) => return None,
            None => objects.push(new_object(composite, declaration)?),
        }
    }
    let offers = { offers.iter() }
        .map(|offer| Some((&offer.schema.name, stands(composite, &objects, party, offer)?)))
        .collect::<Option<_>>()?;
    Some(AgentAdditions { objects, offers })
}

/// Returns the name and the declaration of a new object of a known type; `None` for any other
/// declaration.
fn new_object<'p>(
    composite: &Composite,
    declaration: &'p Declaration,
) -> Option<(&'p Name, &'p ObjectDeclaration)> {
    let DeclaredItem::Object(declared) = &declaration.item else { return None };
    let name = &declared.object.name;
    let is_new = !composite.vocabulary.objects.contains_key(name);
    let types = &composite.vocabulary.types;
    let is_typed = { declared.object.ty.alternatives.iter() }.all(|ty| types.contains(ty.as_str()));
    (is_new && is_typed).then_some((name, declared))
}

/// Returns the index of the offered schema among the selected schemas of the same name. Returns
/// `None` if there is no such schema, if the agent may not offer it, or if the new agent would
/// change the text of the schema.
fn stands(
    composite: &Composite,
    objects: &[(&Name, &ObjectDeclaration)],
    party: &Contribution<'_>,
    offer: &ModelAction,
) -> Option<usize> {
    let standing = composite.schemas.get(&offer.schema.name)?;
    let place = standing.iter().position(|stands| stands.key == offer.key)?;
    let SelectedAction { tree, first, .. } = &standing[place];
    let is_written_so = || **tree == *offer.schema && tree.to_string() == offer.schema.to_string();
    if *party.agent < *first && !is_written_so() {
        return None;
    }
    let own = objects.iter().find(|(name, _)| name.as_str() == party.agent.as_str());
    let ty = match own {
        Some((_, declared)) => &declared.object.ty,
        None => composite.vocabulary.objects.get(party.agent.as_str())?,
    };
    may_act(&composite.vocabulary, &offer.schema, ty).then_some(place)
}
