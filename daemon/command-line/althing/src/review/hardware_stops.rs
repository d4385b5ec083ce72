//! Checks the facts by which hardware stops count as pressed against the ontology, the map, and the
//! action models of their agents.

use agent::PressedWhen;
use pddl::Diagnostic;

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
            if let Some(Diagnostic { message, help, .. }) = found.into_iter().next() {
                let mut found = Diagnostic::error(Default::default(), message);
                found.help = help;
                self.report_value(&format!("hardware-stops.{agent}.pressed"), found);
            }
        }
    }
}
