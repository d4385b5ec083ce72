//! Snapshots: the domain and problem that a planner needs, at one moment, and the mapping between the
//! names of actions inside the domain and those that agents gave them.

use std::collections::{BTreeMap, HashSet};
use std::sync::Arc;

use acl::AgentId;
use acl::content::{self, Guard, Methods, Offer, Offers};
use pddl::knowledge::{AuxiliaryPredicates, Knowledge};
use pddl::{ActionModel, Atom, Condition, Domain, InitElement, Metric, Name, PlanStep, Problem};

use crate::composite::{Composite, OfferedAction};

/// The composite domain and problem at one moment.
#[derive(Clone, Debug)]
pub struct DomainSnapshot {
    /// The epoch: the number of changes of the set of capabilities. Plans made in another epoch may not
    /// be possible now.
    pub epoch: u64,
    /// The revision: the number of changes of any kind.
    pub revision: u64,
    /// The composite domain. Snapshots share its allocation for as long as it does not change.
    pub domain: Arc<Domain>,
    /// The objects and the state as known; the goal is empty.
    pub problem: Problem,
    /// For actions that are renamed in the domain: the name inside the domain → the name that the agents
    /// gave.
    pub qualified: BTreeMap<Name, Name>,
    /// The methods of each agent with known actions.
    pub methods: BTreeMap<AgentId, Methods>,
    /// Action schemas that no present agent offers, but that an agent offered in the past or the ontology
    /// describes. Each is in a model of its own. They are used for explanations, never for plans.
    pub former: Vec<Arc<ActionModel>>,
    composite: Arc<Composite>,
}

// === impl Snapshot ===

impl DomainSnapshot {
    pub(crate) fn new(
        epoch: u64,
        revision: u64,
        composite: Arc<Composite>,
        problem: Problem,
        methods: BTreeMap<AgentId, Methods>,
        former: Vec<Arc<ActionModel>>,
    ) -> DomainSnapshot {
        let (domain, qualified) = (Arc::clone(&composite.domain), composite.qualified.clone());
        DomainSnapshot { epoch, revision, domain, problem, qualified, methods, former, composite }
    }

    /// Returns the digest of the domain's text.
    pub fn digest(&self) -> &str {
        self.composite.digest()
    }

    /// Returns the problem of reaching `goal` with certainty, with plans compared by `metric`. If
    /// `metric` is `None`, the metric of the maintainer is used.
    pub fn with_goal(&self, goal: &Condition, metric: Option<Metric>) -> Problem {
        let metric = metric.or_else(|| self.problem.metric.clone());
        Problem { goal: self.known_to_hold(goal), metric, ..self.problem.clone() }
    }

    /// Returns the condition that is true if `condition` is known to hold, in the symbols of the domain.
    pub fn known_to_hold(&self, condition: &Condition) -> Condition {
        self.composite.knowledge.known_to_hold(condition)
    }

    /// Returns the step with the name that its action has inside the domain. In `step`, the action has
    /// the name that its agent gave it.
    #[must_use]
    pub fn inside(&self, step: &PlanStep) -> PlanStep {
        let offers =
            step.arguments.first().and_then(|name| self.composite.offers.get(name.as_str()));
        let offered = offers.into_iter().flatten().find(|offer| offer.outside == step.action);
        let action = offered.map_or(&step.action, |offered| &offered.inside);
        PlanStep { action: action.clone(), ..step.clone() }
    }

    /// Returns the step with the name that its agent gave the action. In `step`, the action has its name
    /// inside the domain.
    #[must_use]
    pub fn outside(&self, step: &PlanStep) -> PlanStep {
        let action = self.qualified.get(&step.action).unwrap_or(&step.action);
        PlanStep { action: action.clone(), ..step.clone() }
    }

    /// Returns the actions that each agent can carry out now, under the agent's own names for them.
    pub fn offers(&self) -> Offers {
        // A hash set is safe here: only membership is tested, its order is never seen.
        let facts: HashSet<&Atom> = { self.problem.init.iter() }
            .filter_map(|element| match element {
                InitElement::Atom(atom) => Some(atom),
                _ => None,
            })
            .collect();
        let mut offers = Offers::new();
        for (agent, offered) in &self.composite.offers {
            for action in offered {
                let guard = action.guard_fact(agent);
                if facts.contains(&guard) {
                    let (outside, offer) = self.offer(agent, action, &guard);
                    offers.entry(agent.clone()).or_default().insert(outside, offer);
                }
            }
        }
        offers
    }

    /// Returns the guard of each schema of the domain, whether or not the action can be used now.
    pub fn guards(&self) -> BTreeMap<String, Guard> {
        let offered = self.composite.offers.values().flatten();
        let guard = |action: &OfferedAction| {
            let (action_name, predicate) = (action.outside.to_string(), action.guard.to_string());
            (action.inside.as_str().to_owned(), Guard { action: action_name, predicate })
        };
        offered.map(guard).collect()
    }

    fn offer(&self, agent: &AgentId, action: &OfferedAction, guard: &Atom) -> (String, Offer) {
        let outside = action.outside.as_str().to_owned();
        let methods = self.methods.get(agent);
        let offer = Offer {
            schema: action.inside.as_str().to_owned(),
            guard: guard.to_string(),
            method: methods.and_then(|methods| methods.get(&outside)).cloned(),
        };
        (outside, offer)
    }

    /// Returns the symbols of the domain that describe what is unknown.
    pub fn knowledge(&self) -> &Knowledge {
        &self.composite.knowledge
    }

    fn auxiliary_symbols(&self) -> BTreeMap<String, content::Auxiliary> {
        let text = ToString::to_string;
        let auxiliary = |auxiliary: &AuxiliaryPredicates| match auxiliary {
            AuxiliaryPredicates::Predicate { unknown, found } => content::Auxiliary::Predicate {
                unknown: text(unknown),
                found: found.as_ref().map(text),
            },
            AuxiliaryPredicates::Function { defined, found } => content::Auxiliary::Function {
                defined: text(defined),
                found: found.as_ref().map(text),
            },
            AuxiliaryPredicates::Derived { maybe, unknown } => {
                content::Auxiliary::Derived { maybe: text(maybe), unknown: text(unknown) }
            }
        };
        let symbols = self.composite.knowledge.symbols.iter();
        symbols.map(|(symbol, words)| (symbol.as_str().to_owned(), auxiliary(words))).collect()
    }

    /// Converts the snapshot to the content of a message, as PDDL text.
    pub fn to_content(&self) -> content::Snapshot {
        content::Snapshot {
            epoch: self.epoch,
            revision: self.revision,
            domain: self.domain.to_string(),
            digest: self.digest().to_owned(),
            problem: self.problem.to_string(),
            offers: self.offers(),
            guards: self.guards(),
            former: self.former.iter().map(ToString::to_string).collect(),
            knowledge: self.auxiliary_symbols(),
            conflicts: BTreeMap::new(),
        }
    }
}
