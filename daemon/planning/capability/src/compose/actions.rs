//! Selects the actions of the composite. Equal actions of several agents become one schema that all
//! these agents offer.

use std::collections::BTreeMap;
use std::sync::Arc;

use acl::AgentId;
use pddl::{ActionSchema, Name, TypeExpr};

use super::declarations::SelectedDeclarations;
use super::{ConflictReport, Contribution, SharedModel};
use crate::canonical::{CanonicalText, UsedSymbols};
use crate::conflict::{ModelPart, ModelPartKind};
use crate::model_summary::ModelAction;
use crate::names::{ActionNames, ActionVariants};
use crate::vocabulary::DomainVocabulary;

/// The selected action schemas. The key is the agents' own name for the action and the canonical
/// text of the schema.
pub(super) type SelectedSchemas<'a> = BTreeMap<(&'a Name, &'a CanonicalText), SelectedSchema<'a>>;

/// A selected action schema, with the agents that offer it.
pub(super) struct SelectedSchema<'a> {
    /// The action schema as written by the first offering agent in the order of names.
    pub(super) tree: &'a Arc<ActionSchema>,
    pub(super) uses: &'a UsedSymbols,
    /// The agents that offer the action, sorted by name.
    pub(super) offerers: Vec<&'a AgentId>,
}

pub(super) fn gather<'a>(
    shared: &'a SharedModel,
    parties: &[Contribution<'a>],
    standing: &SelectedDeclarations<'a>,
    report: &mut ConflictReport<'a>,
) -> SelectedSchemas<'a> {
    let ours: BTreeMap<&Name, &ModelAction> =
        shared.manifest.offers.iter().map(|offer| (&offer.schema.name, offer)).collect();
    let mut misfits: BTreeMap<(&Name, &CanonicalText), Option<String>> = BTreeMap::new();
    let mut schemas = SelectedSchemas::new();
    for party in parties.iter().filter(|party| party.trusted) {
        for offer in &party.manifest.offers {
            let at = (&offer.schema.name, &offer.key);
            let misfit =
                misfits.entry(at).or_insert_with(|| standing.vocabulary.misfit(&offer.uses));
            let fault = differs_from_ontology(&ours, offer)
                .or_else(|| lost_declaration(party, offer, report))
                .or_else(|| misfit.clone())
                .or_else(|| wrong_agent(party, offer, standing));
            match fault {
                Some(detail) => {
                    let subject = ModelPart::new(ModelPartKind::Action, &offer.schema.name);
                    report.leave_out(party.agent, subject, detail);
                }
                None => {
                    schemas.entry(at).or_insert_with(|| SelectedSchema::new(offer)).add(party.agent)
                }
            }
        }
    }
    schemas
}

fn differs_from_ontology(
    ours: &BTreeMap<&Name, &ModelAction>,
    offer: &ModelAction,
) -> Option<String> {
    let declared = ours.get(&offer.schema.name)?;
    (declared.key != offer.key).then(|| {
        "the ontology declares it differently, which is used; copy it or rename it".to_owned()
    })
}

fn lost_declaration(
    party: &Contribution<'_>,
    offer: &ModelAction,
    report: &ConflictReport<'_>,
) -> Option<String> {
    if report.lost.is_empty() {
        return None;
    }
    let UsedSymbols { predicates, functions, types, objects, .. } = &offer.uses;
    let used = predicates
        .iter()
        .map(|(name, _)| (ModelPartKind::Predicate, name))
        .chain(functions.iter().map(|(name, _)| (ModelPartKind::Function, name)))
        .chain(types.iter().map(|name| (ModelPartKind::Type, name)))
        .chain(objects.iter().map(|name| (ModelPartKind::Object, name)));
    let (kind, name) =
        { used }.find(|(kind, name)| report.lost.contains(&(party.agent, *kind, *name)))?;
    let subject = ModelPart::new(kind, name);
    Some(format!("it uses the {subject}, which another agent declares differently"))
}

/// Checks that an agent is an object of a type that `:agent` requires. Returns the mistake as
/// text for a person; `None` if the agent has this type.
fn wrong_agent(
    party: &Contribution<'_>,
    offer: &ModelAction,
    standing: &SelectedDeclarations<'_>,
) -> Option<String> {
    let agent = offer.schema.agent.as_ref()?;
    let name = party.agent.as_str();
    let Some(ty) = standing.vocabulary.objects.get(name) else {
        return Some(format!("`{name}` is no object; write `(:objects {name} - {})`", agent.ty));
    };
    let types: Vec<String> =
        offer.schema.agents().map(|agent| format!("a `{}`", agent.ty)).collect();
    (!may_act(&standing.vocabulary, &offer.schema, ty)).then(|| match types.as_slice() {
        [one] => format!("its agent is {one}, and `{name}` is a `{ty}`"),
        several => {
            format!("its agents are {}, and `{name}` is a `{ty}`", several.join(" and "))
        }
    })
}

/// Whether an object of the type `ty` may be one of the agents of an action.
pub(super) fn may_act(vocabulary: &DomainVocabulary, schema: &ActionSchema, ty: &TypeExpr) -> bool {
    schema.agents().any(|agent| vocabulary.types.holds(&agent.ty, ty))
}

/// Returns the name in the composite domain for each selected schema. The key is the agents' own
/// name for the action and the canonical text of the schema.
pub(super) fn name<'a>(
    schemas: &SelectedSchemas<'a>,
    parties: &[Contribution<'a>],
    names: &mut ActionNames,
) -> BTreeMap<(&'a Name, &'a CanonicalText), Name> {
    let arrivals: BTreeMap<&AgentId, u64> =
        parties.iter().map(|party| (party.agent, party.arrival)).collect();
    let mut variants = ActionVariants::new();
    for ((outside, key), schema) in schemas {
        let longest_here = schema.offerers.iter().min_by_key(|agent| arrivals.get(**agent));
        if let Some(introducer) = longest_here {
            variants.entry(outside).or_default().insert(key, introducer);
        }
    }
    names.assign(&variants)
}

// === impl SelectedSchema ===

impl<'a> SelectedSchema<'a> {
    fn new(offer: &'a ModelAction) -> SelectedSchema<'a> {
        SelectedSchema { tree: &offer.schema, uses: &offer.uses, offerers: Vec::new() }
    }

    fn add(&mut self, agent: &'a AgentId) {
        self.offerers.push(agent);
    }
}
