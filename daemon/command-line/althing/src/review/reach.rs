//! Finds goals of the file that no agent of the file could ever reach: no action has the wanted
//! effect and no agent knows the word, or each action that has it needs a fact that the map and the
//! agents' models exclude.
//!
//! The check is optimistic, so that it warns of no goal that can be reached. A fact counts as false
//! for ever only if its predicate is closed: the map or a model gives facts of it, and no action and
//! no axiom changes it. All else, such as the place of a robot, counts as possible. Nothing is said
//! if an agent's actions are unknown before it runs, as those of a device that has not been read yet.

use std::collections::{BTreeMap, BTreeSet};

use acl::AgentId;
use pddl::{
    ActionModel, ActionSchema, Atom, Condition, Derived, Diagnostic, Domain, Effect, InitElement,
    Name, Problem, Span, Term, TypeExpr, Types,
};

use super::Reviewer;
use super::sensors::SENSORS;

/// Plugins without an action model: their agents reach no goal by themselves.
const WITHOUT_ACTIONS: &[&str] = &[
    "domain-maintainer",
    "plan-requester",
    "plan-executor",
    "planning-agent",
    "journal",
    "history",
    "traces",
    "keyboard",
    "notifier",
    "doorkeeper",
    "robot-watchdog",
];

/// Maximum number of facts of a goal with `forall` that are examined, and of its variables.
const FACTS_MAX: usize = 1_000;
const VARIABLES_MAX: usize = 2;

/// Maximum number of axioms of which one needs the next, as far as they are examined.
const DERIVATIONS_MAX: usize = 4;

/// Maximum number of agents that a warning names.
const NAMED_MAX: usize = 3;

/// A fact without variables: the predicate and its objects.
type ConcreteFact = (Name, Vec<Name>);

/// What the actions of all agents can make true, and what is fixed.
struct Possibilities<'m> {
    types: Types,
    /// The type of each object of the map and of the models.
    objects: BTreeMap<Name, TypeExpr>,
    /// The facts of the map and of the models.
    given: BTreeSet<ConcreteFact>,
    /// The axioms of the ontology and of the models.
    axioms: Vec<&'m Derived>,
    /// Predicates of `given` that no action and no axiom changes.
    closed: BTreeSet<Name>,
    /// Predicates in the map, and in the models of the agents apart from their axioms.
    mentioned: BTreeSet<Name>,
    /// Each effect that makes a fact true, with its agent and action.
    makers: Vec<(&'m AgentId, &'m ActionSchema, &'m Atom)>,
}

impl Reviewer<'_> {
    /// Warns of each named goal with a fact that no agent of the file can make true.
    pub(super) fn reach(&mut self, models: &BTreeMap<AgentId, ActionModel>) {
        if self.ecosystem.goals.is_empty() || !self.is_complete || !self.knows_all_actions(models) {
            return;
        }
        let (domain, problem) = self.widened(models);
        let possible = Possibilities::of(&domain, &problem, models);
        let mut found = Vec::new();
        for (name, wish) in self.ecosystem.goals.iter() {
            let Ok(condition) = pddl::parse_condition(&wish.goal).into_result() else { continue };
            let mut facts = Vec::new();
            possible.facts_of(&condition, &mut Vec::new(), &mut facts);
            let lacking = facts.into_iter().find(|fact| !possible.can_be(fact, DERIVATIONS_MAX));
            found.extend(lacking.and_then(|fact| Some((name.clone(), possible.warning(&fact)?))));
        }
        for (name, warning) in found {
            self.report_value(&format!("goals.{name}.goal"), warning);
        }
    }

    /// Whether the models name all actions that the agents of the file will ever offer.
    fn knows_all_actions(&self, models: &BTreeMap<AgentId, ActionModel>) -> bool {
        self.ecosystem.interfaces.is_empty()
            && self.ecosystem.agents.iter().all(|entry| {
                let is_of = |plugins: &[&str]| plugins.contains(&entry.plugin.as_str());
                let offers = |model: &ActionModel| {
                    (!model.actions.is_empty() || is_of(SENSORS))
                        && model.durative_actions.is_empty()
                };
                entry.is_built_in()
                    && (is_of(WITHOUT_ACTIONS) || models.get(&entry.name).is_some_and(offers))
            })
    }
}

/// Whether as many agents declare an action, all in the same way, as act in it.
fn has_all_agents(action: &ActionSchema, models: &BTreeMap<AgentId, ActionModel>) -> bool {
    if action.partners.is_empty() {
        return true;
    }
    let text = action.to_string();
    let declares = |model: &&ActionModel| {
        let mut named = model.actions.iter().filter(|other| other.name == action.name);
        named.any(|other| other.to_string() == text)
    };
    models.values().filter(declares).count() > action.partners.len()
}

// === impl Possibilities ===

impl<'m> Possibilities<'m> {
    fn of(
        domain: &'m Domain,
        problem: &Problem,
        models: &'m BTreeMap<AgentId, ActionModel>,
    ) -> Possibilities<'m> {
        let declared = problem.objects.iter().map(|declaration| &declaration.object);
        let objects = domain.constants.iter().chain(declared);
        let objects = objects.map(|object| (object.name.clone(), object.ty.clone())).collect();
        let inits = models.values().flat_map(|model| &model.init).chain(problem.init.iter());
        let given: BTreeSet<ConcreteFact> = inits.filter_map(ground_fact).collect();
        let axioms = domain.derived.iter().chain(models.values().flat_map(|model| &model.derived));
        let axioms: Vec<&Derived> = axioms.collect();
        let derived: BTreeSet<&Name> = axioms.iter().map(|axiom| &axiom.predicate).collect();
        let (mut makers, mut changed) = (Vec::new(), BTreeSet::new());
        for (agent, model) in models {
            for action in &model.actions {
                let mut added: Vec<&Atom> = action.observe.iter().collect();
                collect_changes(&action.effect, &mut added, &mut changed);
                changed.extend(added.iter().map(|atom| atom.predicate.clone()));
                if !has_all_agents(action, models) {
                    continue;
                }
                makers.extend(added.into_iter().map(|atom| (agent, action, atom)));
            }
        }
        let declared = models.values().flat_map(|model| &model.predicates);
        let mut mentioned: BTreeSet<Name> = declared.map(|each| each.name.clone()).collect();
        let inits = models.values().flat_map(|model| &model.init).chain(problem.init.iter());
        mentioned.extend(inits.filter_map(|init| match init {
            InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom) => {
                Some(atom.predicate.clone())
            }
            _ => None,
        }));
        mentioned.extend(changed.iter().cloned());
        let mut closed: BTreeSet<Name> = given.iter().map(|(name, _)| name.clone()).collect();
        closed.retain(|name| !changed.contains(name) && !derived.contains(name));
        Possibilities {
            types: Types::of(domain),
            objects,
            given,
            axioms,
            closed,
            mentioned,
            makers,
        }
    }

    /// Adds the facts that must hold where `condition` holds, with the objects that `bound` gives to
    /// variables. Alternatives and numbers are passed over.
    fn facts_of(
        &self,
        condition: &Condition,
        bound: &mut Vec<(Name, Name)>,
        facts: &mut Vec<ConcreteFact>,
    ) {
        match condition {
            Condition::And(all) => all.iter().for_each(|each| self.facts_of(each, bound, facts)),
            Condition::Forall(variables, _) if variables.len() > VARIABLES_MAX => (),
            Condition::Forall(variables, body) => match variables.split_first() {
                None => self.facts_of(body, bound, facts),
                Some((first, rest)) => {
                    let rest = Condition::Forall(rest.to_vec(), body.clone());
                    for (object, ty) in &self.objects {
                        if facts.len() < FACTS_MAX && self.is_of(ty, &first.ty) {
                            bound.push((first.name.clone(), object.clone()));
                            self.facts_of(&rest, bound, facts);
                            bound.pop();
                        }
                    }
                }
            },
            Condition::Atom(atom) => facts.extend(grounded(atom, bound)),
            _ => (),
        }
    }

    fn is_of(&self, given: &TypeExpr, wanted: &TypeExpr) -> bool {
        wanted.is_object()
            || wanted.alternatives.iter().any(|sup| {
                let is_sub = |sub: &Name| self.types.is_subtype(sub.as_str(), sup.as_str());
                given.alternatives.iter().any(is_sub)
            })
    }

    /// Whether the fact is given, or some action may make it true, or an axiom may derive it through at
    /// most `depth` others. A fact of a predicate that no action changes may be told by an agent that
    /// runs.
    fn can_be(&self, fact: &ConcreteFact, depth: usize) -> bool {
        let is_made = self.makers.iter().any(|(_, _, atom)| atom.predicate == fact.0);
        let is_told = !is_made && self.mentioned.contains(&fact.0);
        is_told
            || self.given.contains(fact)
            || self.makers.iter().any(|maker| self.can_make(maker, fact))
            || self.can_be_derived(fact, depth)
    }

    fn can_be_derived(&self, fact: &ConcreteFact, depth: usize) -> bool {
        let mut axioms = self.axioms.iter().filter(|axiom| axiom.predicate == fact.0);
        axioms.any(|axiom| {
            let fits = axiom.parameters.iter().zip(&fact.1).all(|(parameter, object)| {
                self.objects.get(object).is_none_or(|ty| self.is_of(ty, &parameter.ty))
            });
            let variables = axiom.parameters.iter().map(|parameter| parameter.name.clone());
            let mut bound: Vec<(Name, Name)> = variables.zip(fact.1.iter().cloned()).collect();
            fits && (depth == 0 || self.can_hold(&axiom.condition, &mut bound, depth - 1))
        })
    }

    /// Whether the condition may hold. What is neither a fact nor made of such conditions may.
    fn can_hold(&self, condition: &Condition, bound: &mut Vec<(Name, Name)>, depth: usize) -> bool {
        match condition {
            Condition::And(all) => all.iter().all(|each| self.can_hold(each, bound, depth)),
            Condition::Or(any) => any.iter().any(|each| self.can_hold(each, bound, depth)),
            Condition::Atom(atom) => {
                grounded(atom, bound).is_none_or(|fact| self.can_be(&fact, depth))
            }
            Condition::Exists(variables, _) if variables.len() > VARIABLES_MAX => true,
            Condition::Exists(variables, body) => match variables.split_first() {
                None => self.can_hold(body, bound, depth),
                Some((first, rest)) => {
                    let rest = Condition::Exists(rest.to_vec(), body.clone());
                    let mut of_type =
                        self.objects.iter().filter(|(_, ty)| self.is_of(ty, &first.ty));
                    of_type.any(|(object, _)| {
                        bound.push((first.name.clone(), object.clone()));
                        let can = self.can_hold(&rest, bound, depth);
                        bound.pop();
                        can
                    })
                }
            },
            _ => true,
        }
    }

    fn can_make(
        &self,
        (agent, action, atom): &(&AgentId, &ActionSchema, &Atom),
        fact: &ConcreteFact,
    ) -> bool {
        if atom.predicate != fact.0 || atom.arguments.len() != fact.1.len() {
            return false;
        }
        let mut bound = Vec::new();
        // In a joint action the agent may be any of those that act.
        let actor = action.agent.iter().filter(|_| action.partners.is_empty());
        bound.extend(actor.map(|actor| (actor.name.clone(), Name::new(agent.as_str()))));
        for (term, object) in atom.arguments.iter().zip(&fact.1) {
            match term {
                Term::Object(name) if name != object => return false,
                Term::Object(_) => (),
                Term::Variable(variable) => match value_of(variable, &bound) {
                    Some(other) if other != object => return false,
                    Some(_) => (),
                    None => bound.push((variable.clone(), object.clone())),
                },
            }
        }
        self.fits_parameters(action, &bound) && self.is_allowed(&action.precondition, &bound)
    }

    fn fits_parameters(&self, action: &ActionSchema, bound: &[(Name, Name)]) -> bool {
        action.parameters.iter().all(|parameter| {
            let object = value_of(&parameter.name, bound);
            let ty = object.and_then(|object| self.objects.get(object));
            ty.is_none_or(|ty| self.is_of(ty, &parameter.ty))
        })
    }

    /// Whether no conjunct of the precondition contradicts the closed predicates.
    fn is_allowed(&self, precondition: &Condition, bound: &[(Name, Name)]) -> bool {
        match precondition {
            Condition::And(all) => all.iter().all(|each| self.is_allowed(each, bound)),
            Condition::Atom(atom) if self.closed.contains(&atom.predicate) => {
                self.given.iter().any(|(predicate, objects)| {
                    *predicate == atom.predicate
                        && objects.len() == atom.arguments.len()
                        && atom.arguments.iter().zip(objects).all(|(term, object)| match term {
                            Term::Object(name) => name == object,
                            Term::Variable(name) => {
                                value_of(name, bound).is_none_or(|value| value == object)
                            }
                        })
                })
            }
            _ => true,
        }
    }

    /// Returns the warning that no agent can make the fact true; `None` if an object of it is unknown,
    /// which is reported already.
    fn warning(&self, fact: &ConcreteFact) -> Option<Diagnostic> {
        if !fact.1.iter().all(|object| self.objects.contains_key(object)) {
            return None;
        }
        let text = format!(
            "({} {})",
            fact.0,
            fact.1.iter().map(Name::as_str).collect::<Vec<_>>().join(" ")
        );
        let makers = self.makers.iter().filter(|(_, _, atom)| atom.predicate == fact.0);
        let agents: BTreeSet<_> = makers.map(|(agent, ..)| format!("`{agent}`")).collect();
        let named = agents.iter().take(NAMED_MAX).cloned().collect::<Vec<_>>().join(", ");
        let (does, more) = match agents.len().saturating_sub(NAMED_MAX) {
            0 if agents.len() == 1 => ("does", String::new()),
            0 => ("do", String::new()),
            more => ("do", format!(" and {more} more")),
        };
        let help = match agents.is_empty() {
            true => "none makes or tells it anywhere; add an agent that does".to_owned(),
            false => {
                format!("{named}{more} {does} this elsewhere; add an agent that does it there")
            }
        };
        let message = format!("no agent of this file can ever make `{text}` true");
        Some(Diagnostic::warning(Span::default(), message).with_help(help))
    }
}

/// Collects the facts that an effect makes true, and the predicates that it makes false.
fn collect_changes<'e>(
    effect: &'e Effect,
    added: &mut Vec<&'e Atom>,
    changed: &mut BTreeSet<Name>,
) {
    match effect {
        Effect::And(all) => all.iter().for_each(|each| collect_changes(each, added, changed)),
        Effect::Add(atom) => added.push(atom),
        Effect::Delete(atom) => {
            changed.insert(atom.predicate.clone());
        }
        Effect::Forall(_, body) | Effect::When(_, body) => collect_changes(body, added, changed),
        Effect::Assign(_) => (),
    }
}

fn ground_fact(init: &InitElement) -> Option<ConcreteFact> {
    match init {
        InitElement::Atom(atom) => grounded(atom, &[]),
        _ => None,
    }
}

fn grounded(atom: &Atom, bound: &[(Name, Name)]) -> Option<ConcreteFact> {
    let object = |term: &Term| match term {
        Term::Object(name) => Some(name.clone()),
        Term::Variable(name) => value_of(name, bound).cloned(),
    };
    let objects: Option<Vec<Name>> = atom.arguments.iter().map(object).collect();
    Some((atom.predicate.clone(), objects?))
}

fn value_of<'b>(variable: &Name, bound: &'b [(Name, Name)]) -> Option<&'b Name> {
    bound.iter().rev().find(|(name, _)| name == variable).map(|(_, object)| object)
}
