//! The composite: one domain made of many models, and the actions that each agent offers in this
//! domain.
//!
//! [`compose`](crate::compose) makes a composite. Each snapshot keeps the composite of its time,
//! and snapshots of the same time share it.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::{Arc, OnceLock};

use acl::AgentId;
use pddl::knowledge::Knowledge;
use pddl::{
    ActionSchema, Atom, Domain, Effect, InitElement, Name, ObjectDeclaration, Span, TOTAL_COST,
    Term,
};

use crate::canonical::CanonicalText;
use crate::digest::text_digest;
use crate::fact::{FactKey, FactValue, Owner};
use crate::vocabulary::DomainVocabulary;

/// The domain that is composed of the ontology, the map and the models of agents.
#[derive(Clone, Debug)]
pub(crate) struct Composite {
    pub(crate) domain: Arc<Domain>,
    digest: OnceLock<String>,
    pub(crate) vocabulary: DomainVocabulary,
    /// The objects of the composite problem: first those of the map, then those of the agents.
    pub(crate) objects: Arc<Vec<ObjectDeclaration>>,
    /// Number of objects in `objects` that the map declares. The objects of agents follow, sorted
    /// by name.
    pub(crate) of_map: usize,
    /// The selected actions, by the agents' own names for them.
    pub(crate) schemas: BTreeMap<Name, Vec<SelectedAction>>,
    /// The actions that each agent offers.
    pub(crate) offers: BTreeMap<AgentId, Vec<OfferedAction>>,
    /// Actions that are renamed in the composite domain: from the name there to the agents' own
    /// name.
    pub(crate) qualified: BTreeMap<Name, Name>,
    pub(crate) secrets: PrivateFacts,
    /// The symbols of the domain that describe unknown facts.
    pub(crate) knowledge: Arc<Knowledge>,
    /// The functions that determine the costs of actions; collected at the first use.
    costs: OnceLock<BTreeSet<Name>>,
}

/// An action as one agent offers it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct OfferedAction {
    /// The agent's own name for the action.
    pub(crate) outside: Name,
    /// Name of the action in the composite domain.
    pub(crate) inside: Name,
    /// Name of the guard predicate, which holds for the agents that offer the action.
    pub(crate) guard: Name,
    /// Number of agents that act in the action.
    pub(crate) agents: usize,
}

/// A selected action with the first offering agent in the order of names.
#[derive(Clone, Debug)]
pub(crate) struct SelectedAction {
    /// Canonical text of the action.
    pub(crate) key: CanonicalText,
    /// The action as written by the first offering agent in the order of names.
    pub(crate) tree: Arc<ActionSchema>,
    pub(crate) first: AgentId,
    pub(crate) offered: OfferedAction,
}

/// Offered actions, collected while a composite is made.
#[derive(Debug, Default)]
pub(crate) struct CollectedOffers {
    by_agent: BTreeMap<AgentId, Vec<OfferedAction>>,
    schemas: BTreeMap<Name, Vec<SelectedAction>>,
    qualified: BTreeMap<Name, Name>,
}

/// Private symbols and objects, and the agents with private facts that are visible in the composite
/// nevertheless.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(crate) struct PrivateFacts {
    /// Agents with private facts that are visible in this composite; `None` means all agents.
    pub(crate) trusted: Option<BTreeSet<AgentId>>,
    /// Predicates and functions that the ontology declares private to each agent.
    pub(crate) symbols: BTreeSet<Name>,
    /// Predicates, functions and objects that each agent declares private.
    pub(crate) of_agents: BTreeMap<AgentId, BTreeSet<Name>>,
}

// === impl Composite ===

impl Composite {
    /// Creates a composite. `of_map` is the number of objects that the map declares; they must come
    /// first.
    pub(crate) fn new(
        domain: Domain,
        vocabulary: DomainVocabulary,
        (objects, of_map): (Vec<ObjectDeclaration>, usize),
        offers: CollectedOffers,
        secrets: PrivateFacts,
        knowledge: Knowledge,
    ) -> Composite {
        let CollectedOffers { by_agent: offers, schemas, qualified } = offers;
        Composite {
            domain: Arc::new(domain),
            digest: OnceLock::new(),
            vocabulary,
            objects: Arc::new(objects),
            of_map,
            schemas,
            offers,
            qualified,
            secrets,
            knowledge: Arc::new(knowledge),
            costs: OnceLock::new(),
        }
    }

    /// Whether axioms derive the predicate of `fact`.
    pub(crate) fn derives(&self, fact: &InitElement) -> bool {
        let (InitElement::Atom(atom) | InitElement::Unknown(atom)) = fact else { return false };
        self.vocabulary.predicates.get(&atom.predicate).is_some_and(|signature| signature.derived)
    }

    /// Returns the reason, as text for a person, why a claim that `fact` has this value cannot take
    /// effect in this composite; `None` if it can.
    pub(crate) fn misfit(&self, fact: &FactKey, value: FactValue) -> Option<String> {
        if self.is_negative_cost(fact, value) {
            return Some(format!(
                "actions cost `{}`, and nothing costs less than 0",
                fact.symbol()
            ));
        }
        self.vocabulary.fact_misfit(fact, value)
    }

    /// Whether a claim that `fact` has this value would give an action a negative cost.
    pub(crate) fn is_negative_cost(&self, fact: &FactKey, value: FactValue) -> bool {
        matches!(value, FactValue::Number(number) if number.0 < 0.0)
            && self.costs().contains(fact.symbol())
    }

    /// Returns the functions that determine the costs of actions.
    fn costs(&self) -> &BTreeSet<Name> {
        self.costs.get_or_init(|| {
            let effects = self.domain.actions.iter().flat_map(|action| action.effect.parts());
            let added = effects.filter_map(|part| match part {
                Effect::Assign(assign) if assign.fluent.function == TOTAL_COST => Some(assign),
                _ => None,
            });
            let fluents = added.flat_map(|assign| assign.value.fluents());
            fluents.map(|fluent| fluent.function.clone()).collect()
        })
    }

    /// Returns the digest of the domain's text; computed at the first use.
    pub(crate) fn digest(&self) -> &str {
        self.digest.get_or_init(|| text_digest(&self.domain.to_string()))
    }

    /// Shares the memory of the domain of `other`, if the two domains have the same text.
    pub(crate) fn share_domain(&mut self, other: &Composite) {
        if self.domain == other.domain && self.digest() == other.digest() {
            self.domain = Arc::clone(&other.domain);
        }
    }

    /// Whether planning with this composite gives the same plans as with `other`. Domains that do
    /// not share their memory (see [`Composite::share_domain`]) count as different.
    pub(crate) fn is_as(&self, other: &Composite) -> bool {
        Arc::ptr_eq(&self.domain, &other.domain)
            && self.objects == other.objects
            && self.offers == other.offers
            && self.qualified == other.qualified
    }
}

// === impl CollectedOffers ===

impl CollectedOffers {
    /// Adds a selected action and the agents that offer it, which must be sorted by name.
    pub(crate) fn add(
        &mut self,
        key: CanonicalText,
        tree: Arc<ActionSchema>,
        offered: OfferedAction,
        offerers: &[&AgentId],
    ) {
        let OfferedAction { outside, inside, .. } = &offered;
        if inside != outside {
            self.qualified.insert(inside.clone(), outside.clone());
        }
        for offerer in offerers {
            self.by_agent.entry((*offerer).clone()).or_default().push(offered.clone());
        }
        if let Some(first) = offerers.first() {
            let standing = self.schemas.entry(outside.clone()).or_default();
            standing.push(SelectedAction { key, tree, first: (*first).clone(), offered });
        }
    }
}

// === impl PrivateFacts ===

impl PrivateFacts {
    /// Whether a claim of `owner` about `fact` is visible in this composite.
    pub(crate) fn sees(&self, owner: &Owner, fact: &FactKey) -> bool {
        let (Owner::Agent(agent), Some(trusted)) = (owner, &self.trusted) else { return true };
        if trusted.contains(agent) {
            return true;
        }
        let hidden = self.of_agents.get(agent);
        let is_hidden = |name: &Name| hidden.is_some_and(|names| names.contains(name));
        !self.symbols.contains(fact.symbol())
            && !is_hidden(fact.symbol())
            && !fact.arguments().iter().any(is_hidden)
    }
}

// === impl OfferedAction ===

impl OfferedAction {
    /// Returns the guard: the fact that lets `agent` use this action.
    pub(crate) fn guard_fact(&self, agent: &AgentId) -> Atom {
        let object = Term::Object(Name::new(agent.as_str()));
        Atom { predicate: self.guard.clone(), arguments: vec![object], span: Span::default() }
    }
}
