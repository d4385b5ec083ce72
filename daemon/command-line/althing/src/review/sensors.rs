//! Finds sensors that no goal of the file asks for. Such a sensor is no mistake: people may ask for
//! its values at any time.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use pddl::{ActionModel, Diagnostic, Span};

use super::Reviewer;
use crate::config::AgentEntry;

/// Plugins with agents that only measure.
pub(super) const SENSORS: &[&str] = &["temperature-sensor", "sensor", "ir-temperature-sensor"];

/// Words of PDDL effects that are no predicates, and the function of the cost.
const STRUCTURE: &[&str] =
    &["and", "not", "when", "forall", "increase", "decrease", "assign", "total-cost"];

impl Reviewer<'_> {
    /// Notes each sensor with values that no named goal of the file needs. Nothing is said of a file
    /// without goals.
    pub(super) fn sensors(&mut self, models: &BTreeMap<AgentId, ActionModel>) {
        let ecosystem = self.ecosystem;
        if ecosystem.goals.is_empty() || !self.is_complete {
            return;
        }
        let needed = self.names_in_conditions(models);
        let mut idle = Vec::new();
        for entry in &ecosystem.agents {
            let is_sensor = entry.is_built_in() && SENSORS.contains(&entry.plugin.as_str());
            let Some(model) = models.get(&entry.name).filter(|_| is_sensor) else { continue };
            let told = told_names(model);
            let is_needed = told.is_empty()
                || told.iter().any(|name| needed.contains(name))
                || ecosystem.hardware_stops.contains_key(&entry.name)
                || self.is_asked_for(entry, &told);
            if !is_needed {
                let known = told.into_iter().find(|name| name.starts_with("known-"));
                idle.push((entry, known));
            }
        }
        for (entry, known) in idle {
            let message = format!("no goal of this file asks for what `{}` measures", entry.name);
            let help = match (known, entry.config["location"].as_str()) {
                (Some(known), Some(place)) => format!(
                    "to keep it known, write under [goals]: NAME = {{ goal = \"({known} {place})\", \
                     keep = \"maintain\" }}"
                ),
                _ => "people may ask for it all the same, by `althing goal`".to_owned(),
            };
            let found = Diagnostic::hint(Span::default(), message).with_help(help);
            self.report_value(&format!("{}.name", entry.path), found);
        }
    }

    /// Whether a named goal of the file contains one of the names in `told`, about the place of the
    /// sensor or about all places.
    fn is_asked_for(&self, entry: &AgentEntry, told: &BTreeSet<String>) -> bool {
        let place = entry.config["location"].as_str().map(str::to_lowercase);
        self.ecosystem.goals.values().any(|wish| {
            let goal = wish.goal.to_lowercase();
            let about = |word: &str| {
                let is_part = |c: char| c.is_alphanumeric() || c == '-' || c == '_';
                goal.split(|c: char| !is_part(c)).any(|part| part == word)
            };
            let is_here = goal.contains('?')
                || place.as_deref().is_none_or(about)
                || about(entry.name.as_str());
            is_here && names_in(&goal).iter().any(|name| told.contains(name))
        })
    }

    /// Returns the names of the predicates and functions in the conditions of actions and in
    /// axioms: what a sensor measures may be needed there.
    fn names_in_conditions(&self, models: &BTreeMap<AgentId, ActionModel>) -> BTreeSet<String> {
        let axioms = self.ecosystem.domain.derived.iter();
        let axioms = axioms.chain(models.values().flat_map(|model| &model.derived));
        let actions = models.values().flat_map(|model| &model.actions);
        let conditions = axioms
            .map(|axiom| axiom.condition.to_string())
            .chain(actions.map(|action| action.precondition.to_string()));
        conditions.flat_map(|condition| names_in(&condition)).collect()
    }
}

/// Returns the words of a PDDL text that stand after an opening parenthesis.
fn names_in(text: &str) -> BTreeSet<String> {
    let name = |part: &str| {
        let end = part.find([' ', '(', ')', '\n', '\t']).unwrap_or(part.len());
        part[..end].to_lowercase()
    };
    text.split('(').skip(1).map(name).filter(|name| !name.is_empty()).collect()
}

/// Returns the predicates and functions that a model's actions make true or known, apart from the
/// cost.
fn told_names(model: &ActionModel) -> BTreeSet<String> {
    let mut told = BTreeSet::new();
    for action in &model.actions {
        told.extend(names_in(&action.effect.to_string()));
        told.extend(action.observe.iter().map(|atom| atom.predicate.as_str().to_lowercase()));
    }
    told.retain(|name| !STRUCTURE.contains(&name.as_str()));
    told
}
