//! The action model of an agent with secrets in a running ecosystem: what the agent announces in place
//! of it, and how the agent fills what it is asked for with its private steps.
//!
//! The announced model is a projection in the form of an action model. Public actions keep their names
//! and their agent, so that Domain Maintainers, planners and people use it like any other model.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::content::PartStep;
use pddl::factored::AgentFiles;
use pddl::knowledge::Knowledge;
use pddl::{
    ActionModel, ActionSchema, Condition, Domain, Effect, FunctionDeclaration, InitElement, Name,
    ObjectDeclaration, PredicateDeclaration, Privacy, Problem, Span, Term, Typed,
};
use planner::{Cancel, Options};

use crate::fill::{FillRefusal, FillTask, FilledPart};
use crate::opaque_names::ActionNaming;
use crate::partner::Partner;
use crate::private_symbols::PrivateSymbols;
use crate::projection::ProjectedTask;

/// An agent's own action model, and what it announces of it.
#[derive(Clone)]
pub struct ConfidentialModel {
    own: ActionModel,
    partner: Partner,
    announced: ActionModel,
}

/// What an agent knows at one moment.
#[derive(Clone, Copy)]
pub struct KnownWorld<'k> {
    /// A domain with everything public.
    pub domain: &'k Domain,
    /// A problem of this domain with the known state.
    pub problem: &'k Problem,
    /// How the domain represents unknown facts.
    pub knowledge: &'k Knowledge,
    /// The facts of the agent itself, also the private ones.
    pub own_facts: &'k [InitElement],
}

// === impl ConfidentialModel ===

impl ConfidentialModel {
    /// Returns the confidential model of an agent; `None` if nothing in its action model is private.
    /// What had an opaque name or was announced in `former`, the former one of this agent, keeps that.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the model declares something `:private`, and has
    /// something that cannot be used together with it.
    pub fn new(
        model: &ActionModel,
        ontology: &Domain,
        map: &Problem,
        former: Option<&ConfidentialModel>,
    ) -> Result<Option<ConfidentialModel>, String> {
        let task = task_of(model, ontology, map);
        if !PrivateSymbols::of(&task).are_any() {
            return Ok(None);
        }
        let unsupported = match model {
            _ if !model.durative_actions.is_empty() => Some("durative actions"),
            _ if !model.derived.is_empty() => Some("axioms"),
            _ if model.actions.iter().any(|action| !action.partners.is_empty()) => {
                Some("actions of several agents at once")
            }
            _ => None,
        };
        if let Some(unsupported) = unsupported {
            let agent = &model.agent;
            return Err(format!(
                "the model of `{agent}` declares something `:private`, and has {unsupported}"
            ));
        }
        let former = former.map(|it| &it.partner);
        let partner = Partner::with_naming(task, ActionNaming::OfModel, former)?;
        let announced = announced(model, &partner);
        Ok(Some(ConfidentialModel { own: model.clone(), partner, announced }))
    }

    /// Returns the agent's own action model.
    #[must_use]
    pub fn own(&self) -> &ActionModel {
        &self.own
    }

    /// Returns the action model that the agent announces.
    #[must_use]
    pub fn announced(&self) -> &ActionModel {
        &self.announced
    }

    /// Returns a fact of the agent as it announces it; `None` if it announces nothing of it. `knows` says
    /// whether another agent declares an object. An object that no other agent declares may be private,
    /// so a private fact about it is not announced.
    #[must_use]
    pub fn announced_fact(
        &self,
        fact: &InitElement,
        knows: &dyn Fn(&Name) -> bool,
    ) -> Option<InitElement> {
        let ProjectedTask { domain, problem, .. } = &self.partner.projected;
        let told = self.partner.projector().element(fact)?;
        let is_private = self.partner.symbols.concern(fact);
        let is_declared = |term: &Term| {
            let name = term.name();
            let is_opaque = self.partner.names.is_opaque(name);
            problem.objects.iter().any(|declared| declared.object.name == *name)
                || domain.constants.iter().any(|constant| constant.name == *name)
                || !is_opaque && (!is_private || knows(name))
        };
        let is_told = match &told {
            InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom) => {
                atom.arguments.iter().all(is_declared)
            }
            InitElement::Assign(fluent, _) => {
                let is_private = self.partner.names.is_opaque(&fluent.function);
                let mut functions = domain.functions.iter();
                fluent.arguments.iter().all(is_declared)
                    && (!is_private || functions.any(|it| it.name == fluent.function))
            }
            InitElement::At(..) => false,
        };
        is_told.then_some(told)
    }

    /// Whether a condition is about something private.
    #[must_use]
    pub fn is_about_private(&self, condition: &Condition) -> bool {
        self.partner.symbols.concern_condition(condition)
    }

    /// Fills a part of a plan over announced models with the agent's private steps.
    ///
    /// # Errors
    ///
    /// Returns a refusal if the agent cannot do the part.
    pub fn fill(
        &self,
        part: &[PartStep],
        known: &KnownWorld<'_>,
        options: &Options,
        cancel: &Cancel,
    ) -> Result<FilledPart, FillRefusal> {
        let Partner { symbols, names, projected, .. } = &self.partner;
        let task = self.task_in(known);
        let objects = task.problem.objects.iter().map(|it| it.object.name.clone());
        let constants = task.domain.constants.iter().map(|it| it.name.clone());
        let symbols = symbols.with_objects(objects.chain(constants));
        FillTask::new(&task, &symbols, names, &projected.actions, part)?.fill(options, cancel)
    }

    /// Announces more of the model after a proved refusal. Returns `false` if that is not possible.
    pub fn sharpen(&mut self, refusal: &FillRefusal) -> bool {
        let is_sharper = self.partner.sharpen(refusal);
        if is_sharper {
            self.announced = announced(&self.own, &self.partner);
        }
        is_sharper
    }

    /// Returns the agent's own task in the known world: its own actions, everything public, and its own
    /// private facts. What others call like something private of this agent is left out.
    fn task_in(&self, known: &KnownWorld<'_>) -> AgentFiles {
        let Partner { task, symbols, names, .. } = &self.partner;
        let is_private = |name: &Name| {
            symbols.is_private_predicate(name)
                || symbols.is_private_function(name)
                || symbols.is_private_object(name)
                || names.is_opaque(name)
        };
        let mut domain = known.domain.clone();
        domain.predicates.retain(|it| !is_private(&it.name));
        domain.functions.retain(|it| !is_private(&it.name));
        domain.constants.retain(|it| !is_private(&it.name));
        domain.derived.retain(|axiom| {
            !is_private(&axiom.predicate) && !predicates_of(&axiom.condition).any(is_private)
        });
        domain.durative_actions.clear();
        domain.actions = task
            .domain
            .actions
            .iter()
            .map(|it| known.knowledge.action(&self.with_own(it)))
            .collect();
        let predicates = task.domain.predicates.iter().filter(|it| is_private(&it.name));
        domain.predicates.extend(predicates.cloned());
        let functions = task.domain.functions.iter().filter(|it| is_private(&it.name));
        domain.functions.extend(functions.cloned());
        let mut objects = Vec::clone(&known.problem.objects);
        objects.retain(|it| !is_private(&it.object.name));
        let is_new = |declared: &&ObjectDeclaration| {
            let name = &declared.object.name;
            !objects.iter().any(|it| it.object.name == *name)
                && !domain.constants.iter().any(|it| it.name == *name)
        };
        let further: Vec<_> = task.problem.objects.iter().filter(is_new).cloned().collect();
        objects.extend(further);
        let is_public = |element: &&InitElement| !names_of(element).into_iter().any(is_private);
        let mut init: Vec<_> = known.problem.init.iter().filter(is_public).cloned().collect();
        let is_object = |name: &&Name| {
            objects.iter().any(|it| it.object.name == **name)
                || domain.constants.iter().any(|it| it.name == **name)
        };
        let own = self.private_state(known.own_facts).into_iter();
        let own: Vec<_> = own.filter(|it| names_of(it)[1..].iter().all(is_object)).collect();
        let unknown = self.unknown_facts(&domain, &own);
        unknown.compile(&mut domain);
        init.extend(own.iter().filter_map(|element| match element {
            InitElement::Unknown(fact) => unknown.unknown(fact).map(InitElement::Atom),
            InitElement::Atom(_) | InitElement::Assign(..) => Some(element.clone()),
            InitElement::Not(_) | InitElement::At(..) => None,
        }));
        let problem = Problem {
            objects: Arc::new(objects),
            init,
            goal: Condition::And(Vec::new()),
            ..known.problem.clone()
        };
        AgentFiles { agent: task.agent.clone(), domain, problem }
    }

    /// Returns what the agent knows of its private state: its facts, and those of its model that no
    /// action changes and no fact is about.
    fn private_state(&self, own_facts: &[InitElement]) -> Vec<InitElement> {
        let symbols = &self.partner.symbols;
        let changed: BTreeSet<&Name> =
            self.own.actions.iter().flat_map(|action| changed_names(&action.effect)).collect();
        let told: BTreeSet<String> = own_facts.iter().map(subject).collect();
        let lasting = self.own.init.iter().filter(|element| {
            let is_changed = names_of(element).first().is_some_and(|name| changed.contains(name));
            !is_changed && !told.contains(&subject(element))
        });
        let all = lasting.chain(own_facts);
        all.filter(|element| symbols.concern(element)).cloned().collect()
    }

    /// Returns the knowledge of the private predicates that have unknown facts.
    fn unknown_facts(&self, domain: &Domain, own: &[InitElement]) -> Knowledge {
        let unknown = own.iter().filter_map(|element| match element {
            InitElement::Unknown(fact) => Some(fact.predicate.clone()),
            _ => None,
        });
        let unknown: BTreeSet<Name> = unknown.collect();
        let mut knowledge = Knowledge::of(domain, &unknown);
        // Everything else is that of the known world.
        knowledge.symbols.retain(|name, _| unknown.contains(name));
        knowledge
    }

    /// Returns an action in which no other agent can act, and in which things of others do not take
    /// the place of private ones.
    fn with_own(&self, action: &ActionSchema) -> ActionSchema {
        let is = |variable: &Typed, object: Name| {
            let variable = Term::Variable(variable.name.clone());
            Condition::Equal(variable, Term::Object(object), Span::default())
        };
        let own = action.agent.iter().map(|agent| is(agent, self.own.agent.clone()));
        let mut conditions: Vec<Condition> = own.collect();
        for parameter in &action.parameters {
            let choices = self.partner.symbols.private_choices(&parameter.ty);
            match choices.unwrap_or_default().as_slice() {
                [] => (),
                [one] => conditions.push(is(parameter, one.clone())),
                several => conditions.push(Condition::Or(
                    several.iter().map(|object| is(parameter, object.clone())).collect(),
                )),
            }
        }
        conditions.push(action.precondition.clone());
        ActionSchema { precondition: Condition::And(conditions), ..action.clone() }
    }
}

/// Returns the predicates in a condition.
fn predicates_of(condition: &Condition) -> impl Iterator<Item = &Name> {
    condition.parts().filter_map(|part| match part {
        Condition::Atom(atom) => Some(&atom.predicate),
        _ => None,
    })
}

/// Returns the predicates and functions that an effect changes.
fn changed_names(effect: &Effect) -> impl Iterator<Item = &Name> {
    effect.parts().filter_map(|part| match part {
        Effect::Add(atom) | Effect::Delete(atom) => Some(&atom.predicate),
        Effect::Assign(assign) => Some(&assign.fluent.function),
        Effect::And(_) | Effect::Forall(..) | Effect::When(..) => None,
    })
}

/// Returns what an element of a state is about, without its value.
fn subject(element: &InitElement) -> String {
    names_of(element).into_iter().map(|name| format!("{name} ")).collect()
}

/// Returns the names of the symbol and of the objects in an element of a state.
fn names_of(element: &InitElement) -> Vec<&Name> {
    let (symbol, arguments) = match element {
        InitElement::Atom(atom) | InitElement::Not(atom) | InitElement::Unknown(atom) => {
            (&atom.predicate, &atom.arguments)
        }
        InitElement::Assign(fluent, _) => (&fluent.function, &fluent.arguments),
        InitElement::At(_, inner) => return names_of(inner),
    };
    std::iter::once(symbol).chain(arguments.iter().map(Term::name)).collect()
}

/// Returns the task of an agent with an action model and the shared ontology and map.
fn task_of(model: &ActionModel, ontology: &Domain, map: &Problem) -> AgentFiles {
    // What is private in the ontology and in the map is private to the ecosystem.
    let public = Privacy::Public;
    let predicates = ontology.predicates.iter();
    let functions = ontology.functions.iter();
    let mut domain = Domain {
        predicates: predicates
            .map(|it| PredicateDeclaration { privacy: public.clone(), ..it.clone() })
            .collect(),
        functions: functions
            .map(|it| FunctionDeclaration { privacy: public.clone(), ..it.clone() })
            .collect(),
        derived: Vec::new(),
        actions: model.actions.clone(),
        durative_actions: Vec::new(),
        ..ontology.clone()
    };
    let known: BTreeSet<&Name> = ontology.types.iter().map(|it| &it.name).collect();
    domain.types.extend(model.types.iter().filter(|it| !known.contains(&it.name)).cloned());
    let own: BTreeSet<&Name> = model.predicates.iter().map(|it| &it.name).collect();
    domain.predicates.retain(|it| !own.contains(&it.name));
    domain.predicates.extend(model.predicates.iter().cloned());
    let own: BTreeSet<&Name> = model.functions.iter().map(|it| &it.name).collect();
    domain.functions.retain(|it| !own.contains(&it.name));
    domain.functions.extend(model.functions.iter().cloned());
    let own: BTreeSet<&Name> = model.objects.iter().map(|it| &it.object.name).collect();
    let of_map = map.objects.iter().filter(|it| !own.contains(&it.object.name));
    let of_map = of_map.map(|it| ObjectDeclaration { privacy: public.clone(), ..it.clone() });
    domain.constants.retain(|it| !own.contains(&it.name));
    let problem = Problem {
        objects: Arc::new(of_map.chain(model.objects.iter().cloned()).collect()),
        init: model.init.clone(),
        ..Problem::named(map.name.clone(), domain.name.clone())
    };
    AgentFiles { agent: model.agent.as_str().to_owned(), domain, problem }
}

/// Returns the projection of a model in the form of a model.
fn announced(model: &ActionModel, partner: &Partner) -> ActionModel {
    let ProjectedTask { domain, problem, .. } = &partner.projected;
    let names = &partner.names;
    let hidden = |name: &Name| match names.is_opaque(name) {
        true => Privacy::Private(None),
        false => Privacy::Public,
    };
    // The public declarations of the ontology and the map are not the agent's.
    let predicates = domain.predicates.iter().filter(|it| {
        names.is_opaque(&it.name) || model.predicates.iter().any(|own| own.name == it.name)
    });
    let predicates =
        predicates.map(|it| PredicateDeclaration { privacy: hidden(&it.name), ..it.clone() });
    let functions = domain.functions.iter().filter(|it| {
        names.is_opaque(&it.name) || model.functions.iter().any(|own| own.name == it.name)
    });
    let functions =
        functions.map(|it| FunctionDeclaration { privacy: hidden(&it.name), ..it.clone() });
    let objects = problem.objects.iter().filter(|it| {
        let name = &it.object.name;
        names.is_opaque(name) || model.objects.iter().any(|own| own.object.name == *name)
    });
    let objects =
        objects.map(|it| ObjectDeclaration { privacy: hidden(&it.object.name), ..it.clone() });
    ActionModel {
        agent: model.agent.clone(),
        domain: model.domain.clone(),
        requirements: model.requirements.clone(),
        types: model.types.clone(),
        predicates: predicates.collect(),
        functions: functions.collect(),
        objects: objects.collect(),
        init: problem.init.clone(),
        derived: Vec::new(),
        actions: domain.actions.clone(),
        durative_actions: Vec::new(),
    }
}
