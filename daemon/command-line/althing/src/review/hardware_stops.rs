//! Checks the facts by which hardware stops count as pressed against the ontology, the map, and the
//! action models of their agents.

use agent::PressedWhen;
use pddl::{Diagnostic, InitElement};
use serde_json::Value;

use super::Reviewer;
use crate::hosting;

impl Reviewer<'_> {
    /// Reports facts that no agent can report: a misspelled fact would never stop anything.
    pub(super) fn hardware_stops(&mut self) {
        let told = |rule: &PressedWhen| match rule {
            PressedWhen::FactHolds(fact) | PressedWhen::FactFails(fact) => Some(fact.clone()),
            PressedWhen::ContactOpen | PressedWhen::ContactClosed => None,
        };
        let ecosystem = self.ecosystem;
        let stops = ecosystem.hardware_stops.iter();
        let facts = stops.filter_map(|(agent, stop)| Some((agent, told(&stop.pressed)?)));
        let facts: Vec<_> = facts.collect();
        if facts.is_empty() {
            return;
        }
        let models = hosting::models(ecosystem);
        let (domain, problem) = self.widened(&models);
        // The facts of an agent without a known model, such as one of a package, are not known.
        for (agent, fact) in facts.into_iter().filter(|(agent, _)| models.contains_key(*agent)) {
            let Some(condition) = pddl::parse_condition(&fact).value else { continue };
            let found = pddl::check_condition(&domain, &problem, &condition);
            let path = format!("hardware-stops.{agent}.pressed");
            if let Some(Diagnostic { message, help, .. }) = found.into_iter().next() {
                let mut found = Diagnostic::error(Default::default(), message);
                found.help = help;
                self.report_value(&path, found);
                continue;
            }
            let entry = ecosystem.agents.iter().find(|entry| entry.name == *agent);
            let told = entry.filter(|entry| entry.plugin == ROS).map(|entry| &entry.config);
            let Some(told) = told.and_then(|config| told_by_topics(config)) else { continue };
            if !told.contains(&fact) {
                let message = format!("no topic of `{agent}` tells `{fact}`");
                let help = match told.as_slice() {
                    [] => "write facts = [{ fact = \"…\", when = \"…\" }] for a topic".to_owned(),
                    told => format!("its topics tell `{}`", told.join("`, `")),
                };
                let found = Diagnostic::error(Default::default(), message).with_help(help);
                self.report_value(&path, found);
            }
        }
    }
}

/// The plugin whose config names all facts that its agent reports.
const ROS: &str = "ros2";

/// Returns the facts that the topics of an entry tell; `None` if one of them has a part that a message
/// fills, or cannot be parsed.
fn told_by_topics(config: &Value) -> Option<Vec<String>> {
    let topics = config["topics"].as_array().into_iter().flatten();
    let facts = topics.flat_map(|topic| topic["facts"].as_array().into_iter().flatten());
    let told = facts.map(|fact| {
        let text = fact.as_str().or_else(|| fact["fact"].as_str())?;
        match pddl::parse_init_elements(text).into_result().ok()?.as_slice() {
            [InitElement::Atom(atom) | InitElement::Not(atom)] => Some(atom.to_string()),
            _ => None,
        }
    });
    told.collect()
}
