//! Actions that agents offered in the past. Only explanations use them, never plans.
//!
//! An action schema is kept with the declarations of its model, because these leave the domain with
//! the agent. If several agents offered the same schema, the model of one of them is kept.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use pddl::{ActionModel, Name};

use crate::canonical::CanonicalText;
use crate::limits;
use crate::model_summary::ModelSummary;

/// Action schemas that were offered in the past, by name and canonical text.
#[derive(Clone, Debug, Default)]
pub(crate) struct FormerActions {
    schemas: BTreeMap<(Name, CanonicalText), FormerSchema>,
    stamps: u64,
}

#[derive(Clone, Debug)]
struct FormerSchema {
    /// Number of the latest model that contains this schema. If there are too many schemas, the
    /// schema with the smallest number is dropped first.
    stamp: u64,
    /// The model that contained the schema, reduced to this action and without facts.
    model: Arc<ActionModel>,
}

// === impl FormerActions ===

impl FormerActions {
    /// Adds the actions of a model. `frame` is the model without facts and actions; `manifest` is
    /// the summary of the model, with the actions.
    pub(crate) fn record(&mut self, frame: &ActionModel, manifest: &ModelSummary) {
        self.stamps += 1;
        let stamp = self.stamps;
        for offer in &manifest.offers {
            let at = (offer.schema.name.clone(), offer.key.clone());
            if let Some(known) = self.schemas.get_mut(&at) {
                known.stamp = stamp;
                continue;
            }
            let objects = frame.objects.iter();
            let objects = objects.filter(|one| offer.uses.objects.contains(&one.object.name));
            let model = ActionModel {
                objects: objects.cloned().collect(),
                actions: vec![(*offer.schema).clone()],
                ..frame.clone()
            };
            self.schemas.insert(at, FormerSchema { stamp, model: Arc::new(model) });
        }
        while self.schemas.len() > limits::REMEMBERED_MAX {
            let oldest = self.schemas.iter().min_by_key(|(_, schema)| schema.stamp);
            let Some(oldest) = oldest.map(|(at, _)| at.clone()) else { return };
            self.schemas.remove(&oldest);
        }
    }

    /// Returns the schemas that no model in `living` contains, in a fixed order. Each is returned
    /// as a model with one action.
    pub(crate) fn not_offered_by<'a>(
        &self,
        living: impl Iterator<Item = &'a ModelSummary>,
    ) -> Vec<Arc<ActionModel>> {
        let offered: BTreeSet<(&Name, &CanonicalText)> = living
            .flat_map(|manifest| &manifest.offers)
            .map(|offer| (&offer.schema.name, &offer.key))
            .collect();
        { self.schemas.iter() }
            .filter(|((name, key), _)| !offered.contains(&(name, key)))
            .map(|(_, schema)| Arc::clone(&schema.model))
            .collect()
    }
}
