//! What a request to execute a plan tells an observer that comes late: its domain and its problem
//! have the actions of all agents, and the facts of the map.

use std::collections::{BTreeMap, BTreeSet};

use acl::content::{Auxiliary, Execute, Snapshot};
use pddl::Domain;

use super::LiveView;
use crate::fact_store::GroundFact;
use crate::moment::Moment;
use crate::text::GroundStep;

/// Maximum length of a domain or a problem that is read, in bytes.
const DOCUMENT_BYTES_MAX: usize = 4 << 20;

/// Maximum number of former actions that are read.
const FORMER_MAX: usize = 1_000;

impl LiveView {
    /// Learns the moving actions that no agent offers now: a robot that is stopped offers nothing,
    /// and is still in its place.
    pub(super) fn learn_moves(&mut self, snapshot: &Snapshot) {
        let texts = snapshot.former.iter().filter(|text| text.len() <= DOCUMENT_BYTES_MAX);
        for text in texts.take(FORMER_MAX) {
            if !self.moves.is_empty() {
                return;
            }
            if let Some(model) = pddl::parse_action_model(text).value {
                self.moves.learn(&model.actions, str::to_owned);
            }
        }
    }

    /// Learns the moving actions and the facts that are not known otherwise. Reads the texts once
    /// for each epoch, because they are long.
    pub(super) fn learn_from(&mut self, at: Moment, execute: &Execute) {
        let is_known = !self.moves.is_empty() && self.facts.has_state();
        let is_long = execute.domain.len().max(execute.problem.len()) > DOCUMENT_BYTES_MAX;
        if is_known || is_long || self.learned_epoch == Some(execute.epoch) {
            return;
        }
        self.learned_epoch = Some(execute.epoch);
        let domain = pddl::parse_domain(&execute.domain).value;
        if let Some(domain) = domain.as_ref().filter(|_| self.moves.is_empty()) {
            let offers = execute.offers.values().flatten();
            let own: BTreeMap<_, _> =
                offers.map(|(own, offer)| (offer.schema.as_str(), own.as_str())).collect();
            self.moves.learn(&domain.actions, |name| (*own.get(name).unwrap_or(&name)).to_owned());
        }
        if self.facts.has_state() {
            return;
        }
        let Some(problem) = pddl::parse_problem(&execute.problem).value else { return };
        let added = added_symbols(execute, domain.as_ref());
        let mut facts = GroundFact::of_all(&problem.init);
        facts.retain(|fact| !added.contains(&fact.predicate));
        self.facts.learn(at, facts);
    }
}

/// Returns the predicates of a composite domain that neither an agent nor the map states: the guards
/// of actions, and those that describe unknown facts.
fn added_symbols(execute: &Execute, domain: Option<&Domain>) -> BTreeSet<String> {
    let offers = execute.offers.values().flat_map(|offers| offers.values());
    let mut added: BTreeSet<_> =
        offers.map(|offer| GroundStep::parse(&offer.guard).action).collect();
    // The request names the guards of the agents in its plan only.
    let actions = domain.into_iter().flat_map(|domain| &domain.actions);
    added.extend(actions.map(|action| format!("offers-{}", action.name.as_str())));
    for auxiliary in execute.knowledge.values() {
        let (one, other) = match auxiliary {
            Auxiliary::Predicate { unknown, found } => (unknown, found.as_ref()),
            Auxiliary::Function { defined, found } => (defined, found.as_ref()),
            Auxiliary::Derived { maybe, unknown } => (maybe, Some(unknown)),
        };
        added.extend(std::iter::once(one).chain(other).cloned());
    }
    added
}
