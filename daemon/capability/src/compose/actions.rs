//! Selects the actions of the composite: equal actions of several agents become one schema with several
//! offerers.

use std::collections::BTreeMap;
use std::sync::Arc;

use acl::AgentId;
use pddl::{ActionSchema, Name};

use super::declarations::Standing;
use super::{Party, Report, Shared};
use crate::canonical::{Key, Uses};
use crate::conflict::{Kind, Subject};
use crate::manifest::Offer;
use crate::names::{ActionNames, Variants};

/// The selected schemas, by name outside (as the agents call them) and canonical text.
pub(super) type Schemas<'a> = BTreeMap<(&'a Name, &'a Key), Schema<'a>>;

/// A selected schema.
pub(super) struct Schema<'a> {
    /// The schema as written by its first offerer, by name.
    pub(super) tree: &'a Arc<ActionSchema>,
    pub(super) uses: &'a Uses,
    /// The agents that offer it, sorted by name.
    pub(super) offerers: Vec<&'a AgentId>,
}

pub(super) fn gather<'a>(
    shared: &'a Shared,
    parties: &[Party<'a>],
    standing: &Standing<'a>,
    report: &mut Report<'a>,
) -> Schemas<'a> {
    let ours: BTreeMap<&Name, &Offer> =
        shared.manifest.offers.iter().map(|offer| (&offer.schema.name, offer)).collect();
    let mut misfits: BTreeMap<(&Name, &Key), Option<String>> = BTreeMap::new();
    let mut schemas = Schemas::new();
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
                    let subject = Subject::new(Kind::Action, &offer.schema.name);
                    report.leave_out(party.agent, subject, detail);
                }
                None => schemas.entry(at).or_insert_with(|| Schema::new(offer)).add(party.agent),
            }
        }
    }
    schemas
}

fn differs_from_ontology(ours: &BTreeMap<&Name, &Offer>, offer: &Offer) -> Option<String> {
    let declared = ours.get(&offer.schema.name)?;
    (declared.key != offer.key).then(|| {
        "the ontology declares it differently, which is used; copy it or rename it".to_owned()
    })
}

fn lost_declaration(party: &Party<'_>, offer: &Offer, report: &Report<'_>) -> Option<String> {
    if report.lost.is_empty() {
        return None;
    }
    let Uses { predicates, functions, types, objects, .. } = &offer.uses;
    let used = predicates
        .iter()
        .map(|(name, _)| (Kind::Predicate, name))
        .chain(functions.iter().map(|(name, _)| (Kind::Function, name)))
        .chain(types.iter().map(|name| (Kind::Type, name)))
        .chain(objects.iter().map(|name| (Kind::Object, name)));
    let (kind, name) =
        { used }.find(|(kind, name)| report.lost.contains(&(party.agent, *kind, *name)))?;
    let subject = Subject::new(kind, name);
    Some(format!("it uses the {subject}, which another agent declares differently"))
}

/// Checks that the agent is itself an object of the type that `:agent` requires. Returns the fault, or
/// `None`.
fn wrong_agent(party: &Party<'_>, offer: &Offer, standing: &Standing<'_>) -> Option<String> {
    let agent = offer.schema.agent.as_ref()?;
    let name = party.agent.as_str();
    let Some(ty) = standing.vocabulary.objects.get(name) else {
        return Some(format!("`{name}` is no object; write `(:objects {name} - {})`", agent.ty));
    };
    (!standing.vocabulary.types.accepts(&agent.ty, ty))
        .then(|| format!("its agent is a `{}`, and `{name}` is a `{ty}`", agent.ty))
}

/// Returns the name of every schema inside the composite domain.
pub(super) fn name<'a>(
    schemas: &Schemas<'a>,
    parties: &[Party<'a>],
    names: &mut ActionNames,
) -> BTreeMap<(&'a Name, &'a Key), Name> {
    let arrivals: BTreeMap<&AgentId, u64> =
        parties.iter().map(|party| (party.agent, party.arrival)).collect();
    let mut variants = Variants::new();
    for ((outside, key), schema) in schemas {
        let longest_here = schema.offerers.iter().min_by_key(|agent| arrivals.get(**agent));
        if let Some(introducer) = longest_here {
            variants.entry(outside).or_default().insert(key, introducer);
        }
    }
    names.assign(&variants)
}

// === impl Schema ===

impl<'a> Schema<'a> {
    fn new(offer: &'a Offer) -> Schema<'a> {
        Schema { tree: &offer.schema, uses: &offer.uses, offerers: Vec::new() }
    }

    fn add(&mut self, agent: &'a AgentId) {
        self.offerers.push(agent);
    }
}
