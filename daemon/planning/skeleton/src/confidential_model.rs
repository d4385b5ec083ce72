//! The action model of an agent with secrets in a running ecosystem: what the agent announces in place
//! of it, and how the agent fills what it is asked for with its private steps.
//!
//! The announced model is a projection in the form of an action model. Public actions keep their names
//! and their agent, so that Domain Maintainers, planners and people use it like any other model.

use std::collections::BTreeSet;
use std::sync::Arc;

use acl::content::PartStep;
use pddl::factored::AgentFiles;
use pddl::{
    ActionModel, ActionSchema, Condition, Domain, FunctionDeclaration, InitElement, Name,
    ObjectDeclaration, PredicateDeclaration, Privacy, Problem, Span, Term,
};
use planner::{Cancel, Options};

use crate::fill::{FillRefusal, FillTask, FilledPart};
use crate::opaque_names::ActionNaming;
use crate::partner::Partner;
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
    /// The facts of the agent itself, also the private ones.
    pub own_facts: &'k [InitElement],
}

// === impl ConfidentialModel ===

impl ConfidentialModel {
    /// Returns the confidential model of an agent; `None` if nothing in its action model is private.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the model has private parts, and something that
    /// cannot be used together with them.
    pub fn new(
        model: &ActionModel,
        ontology: &Domain,
        map: &Problem,
    ) -> Result<Option<ConfidentialModel>, String> {
        let task = task_of(model, ontology, map);
        if !crate::private_symbols::PrivateSymbols::of(&task).are_any() {
            return Ok(None);
        }
        let unsupported = match model {
            _ if !model.durative_actions.is_empty() => Some("durative actions"),
            _ if !model.derived.is_empty() => Some("axioms"),
            _ => None,
        };
        if let Some(unsupported) = unsupported {
            let agent = &model.agent;
            return Err(format!("the model of `{agent}` has private parts and {unsupported}"));
        }
        let partner = Partner::with_naming(task, ActionNaming::OfModel)?;
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

    /// Returns a fact of the agent as it announces it; `None` if it announces nothing of it.
    #[must_use]
    pub fn announced_fact(&self, fact: &InitElement) -> Option<InitElement> {
        let ProjectedTask { domain, problem, .. } = &self.partner.projected;
        let told = self.partner.projector().element(fact)?;
        let is_declared = |term: &Term| {
            let name = term.name();
            !self.partner.names.is_opaque(name)
                || problem.objects.iter().any(|declared| declared.object.name == *name)
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

    /// Announces at least as much as `former`, a former model of the same agent, did.
    pub fn keep_like(&mut self, former: &ConfidentialModel) {
        self.partner.keep(former.partner.kept.clone());
        self.announced = announced(&self.own, &self.partner);
    }

    /// Returns the agent's own task in the known world: its own actions, everything public, and its own
    /// private facts.
    fn task_in(&self, known: &KnownWorld<'_>) -> AgentFiles {
        let Partner { task, symbols, names, .. } = &self.partner;
        let is_private = |name: &Name| {
            symbols.is_private_predicate(name)
                || symbols.is_private_function(name)
                || names.is_opaque(name)
        };
        let mut domain = known.domain.clone();
        domain.predicates.retain(|it| !is_private(&it.name));
        domain.functions.retain(|it| !is_private(&it.name));
        let predicates = task.domain.predicates.iter().filter(|it| is_private(&it.name));
        domain.predicates.extend(predicates.cloned());
        let functions = task.domain.functions.iter().filter(|it| is_private(&it.name));
        domain.functions.extend(functions.cloned());
        domain.durative_actions.clear();
        domain.actions = task.domain.actions.iter().map(|it| self.with_own_agent(it)).collect();
        let mut objects = Vec::clone(&known.problem.objects);
        objects.retain(|it| !names.is_opaque(&it.object.name));
        let is_new = |declared: &&ObjectDeclaration| {
            let name = &declared.object.name;
            !objects.iter().any(|it| it.object.name == *name)
                && !domain.constants.iter().any(|it| it.name == *name)
        };
        let further: Vec<_> = task.problem.objects.iter().filter(is_new).cloned().collect();
        objects.extend(further);
        let is_public = |element: &&InitElement| {
            let used = names_of(element);
            !used.into_iter().any(|name| is_private(name) || symbols.is_private_object(name))
        };
        let mut init: Vec<_> = known.problem.init.iter().filter(is_public).cloned().collect();
        let own = self.own.init.iter().chain(known.own_facts);
        let own = own.filter(|it| matches!(it, InitElement::Atom(_) | InitElement::Assign(..)));
        init.extend(own.filter(|it| symbols.concern(it)).cloned());
        let problem = Problem {
            objects: Arc::new(objects),
            init,
            goal: Condition::And(Vec::new()),
            ..known.problem.clone()
        };
        AgentFiles { agent: task.agent.clone(), domain, problem }
    }

    /// Returns an action in which no other agent can act.
    fn with_own_agent(&self, action: &ActionSchema) -> ActionSchema {
        let Some(agent) = &action.agent else { return action.clone() };
        let own = Condition::Equal(
            Term::Variable(agent.name.clone()),
            Term::Object(self.own.agent.clone()),
            Span::default(),
        );
        let precondition = Condition::And(vec![own, action.precondition.clone()]);
        ActionSchema { precondition, ..action.clone() }
    }
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
    let mut domain = Domain {
        derived: Vec::new(),
        actions: model.actions.clone(),
        durative_actions: Vec::new(),
        ..ontology.clone()
    };
    let known: BTreeSet<&Name> = ontology.types.iter().map(|it| &it.name).collect();
    domain.types.extend(model.types.iter().filter(|it| !known.contains(&it.name)).cloned());
    // What one of the two declares private is private.
    for declared in &model.predicates {
        match domain.predicates.iter_mut().find(|it| it.name == declared.name) {
            Some(known) if known.privacy == Privacy::Public => *known = declared.clone(),
            Some(_) => (),
            None => domain.predicates.push(declared.clone()),
        }
    }
    for declared in &model.functions {
        match domain.functions.iter_mut().find(|it| it.name == declared.name) {
            Some(known) if known.privacy == Privacy::Public => *known = declared.clone(),
            Some(_) => (),
            None => domain.functions.push(declared.clone()),
        }
    }
    let own: BTreeSet<&Name> = model.objects.iter().map(|it| &it.object.name).collect();
    let of_map = map.objects.iter().filter(|it| !own.contains(&it.object.name));
    domain.constants.retain(|it| !own.contains(&it.name));
    let problem = Problem {
        objects: Arc::new(of_map.chain(&model.objects).cloned().collect()),
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
