//! Snapshots: the domain and problem of one moment for a planner, and the mapping between the names
//! of actions inside the domain and the agents' own names.

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
    /// The epoch: the number of changes of the set of capabilities. A plan of another epoch may be
    /// impossible now.
    pub epoch: u64,
    /// The revision: the number of changes of any kind.
    pub revision: u64,
    /// The composite domain. Snapshots share its allocation until the domain changes.
    pub domain: Arc<Domain>,
    /// The objects and the known state; the goal is empty.
    pub problem: Problem,
    /// Actions that are renamed in the domain: from the name inside the domain to the agents' own
    /// name.
    pub qualified: BTreeMap<Name, Name>,
    /// The methods of each agent with known actions.
    pub methods: BTreeMap<AgentId, Methods>,
    /// Action schemas that no present agent offers, but that an agent offered in the past or the
    /// ontology describes. Each schema is in a separate model. Only explanations use these models,
    /// never plans.
    pub former: Vec<Arc<ActionModel>>,
    composite: Arc<Composite>,
}

// === impl DomainSnapshot ===

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

    /// Returns the problem of making `goal` known to hold. `metric` compares plans; if it is
    /// `None`, the metric of the maintainer does.
    pub fn with_goal(&self, goal: &Condition, metric: Option<Metric>) -> Problem {
        let metric = metric.or_else(|| self.problem.metric.clone());
        Problem { goal: self.known_to_hold(goal), metric, ..self.problem.clone() }
    }

    /// Returns a condition of the domain that is true exactly if `condition` is known to hold.
    pub fn known_to_hold(&self, condition: &Condition) -> Condition {
        self.composite.knowledge.known_to_hold(condition)
    }

    /// Returns a step with the action's name inside the domain. The action of `step` has the
    /// agent's own name.
    #[must_use]
    pub fn inside(&self, step: &PlanStep) -> PlanStep {
        let offered = step.arguments.iter().enumerate().find_map(|(position, name)| {
            self.offered(step, name.as_str()).filter(|offered| position < offered.agents)
        });
        let action = offered.map_or(&step.action, |offered| &offered.inside);
        PlanStep { action: action.clone(), ..step.clone() }
    }

    /// Returns what `agent` offers of the action of a step, which has the agent's own name.
    fn offered(&self, step: &PlanStep, agent: &str) -> Option<&OfferedAction> {
        let mut offered = self.composite.offers.get(agent)?.iter();
        offered.find(|offer| offer.outside == step.action)
    }

    /// Returns the agents that act in a step, if the action is as `agent` offers it: the first argument,
    /// and in a joint action the next ones.
    pub fn actors<'s>(&self, step: &'s PlanStep, agent: &str) -> &'s [Name] {
        let agents = self.offered(step, agent).map_or(1, |offered| offered.agents);
        step.arguments.get(..agents).unwrap_or(&step.arguments)
    }

    /// Returns the guards of all agents but `agent` that act in a step, as facts. The domain of one
    /// agent does not have them.
    pub fn guards_of_partners(&self, step: &PlanStep, agent: &str) -> Vec<InitElement> {
        let Some(offered) = self.offered(step, agent) else { return Vec::new() };
        let partners = self.actors(step, agent).iter().filter(|actor| **actor != *agent);
        let partners = partners.filter_map(|partner| AgentId::new(partner.as_str()).ok());
        partners.map(|partner| InitElement::Atom(offered.guard_fact(&partner))).collect()
    }

    /// Returns a step with the agent's own name for the action. The action of `step` has its name
    /// inside the domain.
    #[must_use]
    pub fn outside(&self, step: &PlanStep) -> PlanStep {
        let action = self.qualified.get(&step.action).unwrap_or(&step.action);
        PlanStep { action: action.clone(), ..step.clone() }
    }

    /// Returns the actions that each agent can carry out now, under the agent's own names.
    pub fn offers(&self) -> Offers {
        // A hash set is safe here, because its order has no influence: it only answers whether a
        // fact is contained.
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

    /// Returns the guard of each schema of the domain, even if no agent can use the action now.
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
            agents: action.agents,
        };
        (outside, offer)
    }

    /// Returns the symbols of the domain that describe unknown facts.
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
