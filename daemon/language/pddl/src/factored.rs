//! Factored tasks (MA-PDDL): a domain and a problem for each agent, as in CoDMAP, merged into one
//! task that plans for all agents.
//!
//! - What is public under one name is the same for all agents.
//! - What is `:private` to an agent stays its own: if others use the name, too, it is renamed, and
//!   [`FactoredTask::original`] gives the steps of a plan their names back.
//! - Each agent keeps its own copy of its actions, which apply only to the objects in its own files:
//!   no agent can use a private object of another one.
//!
//! Quantified conditions and effects are refused if an agent does not know all objects, because they
//! would range over the objects of others. Axioms and durative actions are refused.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::Arc;

use crate::tree::{
    ActionSchema, Assign, Atom, Compare, Condition, Domain, Effect, Expression, FluentTerm,
    FunctionDeclaration, InitElement, Name, ObjectDeclaration, Plan, PlanStep,
    PredicateDeclaration, Privacy, Problem, Span, Term, TypeExpr, Typed,
};

/// The files of one agent.
#[derive(Clone, Debug)]
pub struct AgentFiles {
    /// Name of the agent.
    pub agent: String,
    /// The agent's domain.
    pub domain: Domain,
    /// The agent's problem.
    pub problem: Problem,
}

/// The merged task of all agents.
#[derive(Clone, Debug)]
pub struct FactoredTask {
    /// The domain with the actions of all agents.
    pub domain: Domain,
    /// The problem with the objects, the facts and the goals of all agents.
    pub problem: Problem,
    /// The names of actions and objects that were renamed, by their new names.
    originals: BTreeMap<Name, Name>,
}

/// What an agent's names become in the merged task.
struct Renaming {
    predicates: BTreeMap<Name, Name>,
    functions: BTreeMap<Name, Name>,
    objects: BTreeMap<Name, Name>,
}

/// Merges the files of all agents.
///
/// # Errors
///
/// Returns the reason, as text for a person, if the files contradict each other or use something that
/// is not supported.
pub fn merge_factored(agents: &[AgentFiles]) -> Result<FactoredTask, String> {
    let Some(first) = agents.first() else { return Err("there is no agent".to_owned()) };
    agents.iter().try_for_each(refuse_unsupported)?;
    let shared = NameCounts::of(agents);
    let mut merged = Merger {
        domain: Domain { requirements: Vec::new(), ..Domain::clone(&first.domain) },
        objects: Vec::new(),
        constants: BTreeSet::new(),
        init: Vec::new(),
        seen: BTreeSet::new(),
        values: BTreeMap::new(),
        goals: Vec::new(),
        metric: None,
        originals: BTreeMap::new(),
    };
    merged.clear();
    // By the names of the merged task: private things of two agents may have one name.
    let renamed = |task: &AgentFiles| -> Vec<Name> {
        let names = shared.renaming(task, &mut BTreeMap::new());
        objects_of(task).map(|it| names.object(&it.name)).collect()
    };
    let all: BTreeSet<Name> = agents.iter().flat_map(renamed).collect();
    for task in agents {
        let renaming = shared.renaming(task, &mut merged.originals);
        merged.add_declarations(task, &renaming)?;
        merged.add_actions(task, &renaming, &shared, all.len())?;
        merged.add_state(task, &renaming)?;
    }
    let Merger { mut domain, objects, constants, init, goals, metric, originals, .. } = merged;
    let (constants, objects): (Vec<_>, Vec<_>) =
        objects.into_iter().partition(|declared| constants.contains(&declared.object.name));
    domain.constants = constants.into_iter().map(|declared| declared.object).collect();
    let problem = Problem {
        name: first.problem.name.clone(),
        domain: domain.name.clone(),
        requirements: Vec::new(),
        objects: Arc::new(objects),
        init,
        goal: Condition::And(goals),
        metric,
    };
    Ok(FactoredTask { domain, problem, originals })
}

fn refuse_unsupported(task: &AgentFiles) -> Result<(), String> {
    let AgentFiles { agent, domain, .. } = task;
    if !domain.durative_actions.is_empty() {
        return Err(format!("the domain of `{agent}` has durative actions"));
    }
    if !domain.derived.is_empty() {
        return Err(format!("the domain of `{agent}` has axioms: not supported in factored tasks"));
    }
    Ok(())
}

/// Returns the constants and objects in an agent's files.
fn objects_of(task: &AgentFiles) -> impl Iterator<Item = &Typed> {
    let objects = task.problem.objects.iter().map(|declared| &declared.object);
    task.domain.constants.iter().chain(objects)
}

// === impl FactoredTask ===

impl FactoredTask {
    /// Returns a plan with the names of actions and objects that the files of the agents have.
    #[must_use]
    pub fn original(&self, plan: &Plan) -> Plan {
        let name = |name: &Name| self.originals.get(name).unwrap_or(name).clone();
        let step = |step: &PlanStep| PlanStep {
            action: name(&step.action),
            arguments: step.arguments.iter().map(name).collect(),
            ..step.clone()
        };
        Plan { steps: plan.steps.iter().map(step).collect(), cost: plan.cost }
    }

    /// Returns a step in the names of one agent's files with the names of the merged task.
    #[must_use]
    pub fn merged(&self, agent: &str, step: &PlanStep) -> PlanStep {
        let name = |name: &Name| {
            let own = own_name(name, agent);
            if self.originals.contains_key(&own) { own } else { name.clone() }
        };
        PlanStep {
            action: name(&step.action),
            arguments: step.arguments.iter().map(name).collect(),
            ..step.clone()
        }
    }
}

// === which names several agents use ===

/// Number of agents that use each name in a role.
struct NameCounts {
    actions: BTreeMap<Name, usize>,
    predicates: BTreeMap<Name, usize>,
    functions: BTreeMap<Name, usize>,
    objects: BTreeMap<Name, usize>,
}

impl NameCounts {
    fn of(agents: &[AgentFiles]) -> NameCounts {
        let count = |names: &dyn Fn(&AgentFiles) -> Vec<Name>| {
            let mut counts = BTreeMap::new();
            for task in agents {
                let unique: BTreeSet<Name> = names(task).into_iter().collect();
                unique.into_iter().for_each(|name| *counts.entry(name).or_default() += 1);
            }
            counts
        };
        NameCounts {
            actions: count(&|task| task.domain.actions.iter().map(|it| it.name.clone()).collect()),
            predicates: count(&|task| {
                task.domain.predicates.iter().map(|it| it.name.clone()).collect()
            }),
            functions: count(&|task| {
                task.domain.functions.iter().map(|it| it.name.clone()).collect()
            }),
            objects: count(&|task| objects_of(task).map(|it| it.name.clone()).collect()),
        }
    }

    /// Returns the new names of what is private to an agent under a name that others use, too.
    fn renaming(&self, task: &AgentFiles, originals: &mut BTreeMap<Name, Name>) -> Renaming {
        let AgentFiles { agent, domain, problem } = task;
        let is_shared = |counts: &BTreeMap<Name, usize>, name: &Name| {
            counts.get(name).is_some_and(|count| *count > 1)
        };
        let renamed = |counts: &BTreeMap<Name, usize>, name: &Name, privacy: &Privacy| {
            let is_own = *privacy != Privacy::Public && is_shared(counts, name);
            is_own.then(|| (name.clone(), own_name(name, agent)))
        };
        let predicates = domain.predicates.iter();
        let functions = domain.functions.iter();
        let objects: BTreeMap<Name, Name> = { problem.objects.iter() }
            .filter_map(|it| renamed(&self.objects, &it.object.name, &it.privacy))
            .collect();
        originals.extend(objects.iter().map(|(old, new)| (new.clone(), old.clone())));
        Renaming {
            predicates: predicates
                .filter_map(|it| renamed(&self.predicates, &it.name, &it.privacy))
                .collect(),
            functions: functions
                .filter_map(|it| renamed(&self.functions, &it.name, &it.privacy))
                .collect(),
            objects,
        }
    }
}

/// Returns the name that something private to an agent gets in the merged task.
fn own_name(name: &Name, agent: &str) -> Name {
    Name::new(&format!("{name}--{agent}"))
}

// === merging ===

/// The merged task, as far as it has been merged.
struct Merger {
    domain: Domain,
    objects: Vec<ObjectDeclaration>,
    /// Names of the objects that are constants of a domain.
    constants: BTreeSet<Name>,
    init: Vec<InitElement>,
    /// Texts of the facts that the initial state has already.
    seen: BTreeSet<String>,
    /// Initial values of functions, with the agent that states each of them.
    values: BTreeMap<String, (f64, String)>,
    goals: Vec<Condition>,
    metric: Option<crate::tree::Metric>,
    originals: BTreeMap<Name, Name>,
}

impl Merger {
    /// Removes the contents of the first agent's domain, of which only the name is used.
    fn clear(&mut self) {
        let Domain { types, constants, predicates, functions, actions, .. } = &mut self.domain;
        types.clear();
        constants.clear();
        predicates.clear();
        functions.clear();
        actions.clear();
    }

    fn add_declarations(&mut self, task: &AgentFiles, names: &Renaming) -> Result<(), String> {
        let AgentFiles { agent, domain, .. } = task;
        for requirement in &domain.requirements {
            let is_privacy = requirement.as_str().ends_with("-privacy");
            if !is_privacy && !self.domain.requirements.contains(requirement) {
                self.domain.requirements.push(requirement.clone());
            }
        }
        for ty in &domain.types {
            match self.domain.types.iter().find(|known| known.name == ty.name) {
                Some(known) if known.ty == ty.ty => (),
                Some(known) => {
                    let (name, own, other) = (&ty.name, &ty.ty, &known.ty);
                    return Err(format!(
                        "the type `{name}` is `{own}` for `{agent}`, and `{other}` for another agent"
                    ));
                }
                None => self.domain.types.push(ty.clone()),
            }
        }
        for declared in &domain.predicates {
            let name = names.predicate(&declared.name);
            let known = self.domain.predicates.iter().find(|known| known.name == name);
            refuse_other_arity(&name, agent, known.map(|it| &it.parameters), &declared.parameters)?;
            if known.is_none() {
                let (parameters, privacy) = (declared.parameters.clone(), Privacy::Public);
                let declared = PredicateDeclaration { name, parameters, privacy };
                self.domain.predicates.push(declared);
            }
        }
        for declared in &domain.functions {
            let name = names.function(&declared.name);
            let known = self.domain.functions.iter().find(|known| known.name == name);
            refuse_other_arity(&name, agent, known.map(|it| &it.parameters), &declared.parameters)?;
            if known.is_none() {
                let (parameters, privacy) = (declared.parameters.clone(), Privacy::Public);
                self.domain.functions.push(FunctionDeclaration { name, parameters, privacy });
            }
        }
        let constants = domain.constants.iter().map(|constant| names.object(&constant.name));
        self.constants.extend(constants);
        for object in objects_of(task) {
            let object = Typed { name: names.object(&object.name), ty: object.ty.clone() };
            match self.objects.iter().find(|known| known.object.name == object.name) {
                Some(known) if known.object.ty == object.ty => (),
                Some(known) => {
                    let (name, own, other) = (&object.name, &object.ty, &known.object.ty);
                    return Err(format!(
                        "`{name}` is a `{own}` for `{agent}`, and a `{other}` for another agent"
                    ));
                }
                None => self.objects.push(ObjectDeclaration { object, privacy: Privacy::Public }),
            }
        }
        Ok(())
    }

    fn add_actions(
        &mut self,
        task: &AgentFiles,
        names: &Renaming,
        shared: &NameCounts,
        objects: usize,
    ) -> Result<(), String> {
        let AgentFiles { agent, domain, .. } = task;
        let own: BTreeSet<Name> = objects_of(task).map(|it| names.object(&it.name)).collect();
        let guard = (own.len() < objects).then(|| Name::new(&format!("known-to--{agent}")));
        if let Some(guard) = &guard {
            let known = |object: Name| {
                let arguments = vec![Term::Object(object)];
                InitElement::Atom(Atom {
                    predicate: guard.clone(),
                    arguments,
                    span: Span::default(),
                })
            };
            self.init.extend(own.into_iter().map(known));
            let object = Typed { name: Name::new("x"), ty: TypeExpr::default() };
            let (name, parameters) = (guard.clone(), vec![object]);
            let declared = PredicateDeclaration { name, parameters, privacy: Privacy::Public };
            self.domain.predicates.push(declared);
        }
        if guard.is_some() && has_quantifier(&task.problem.goal) {
            return Err(format!(
                "the goal of `{agent}` has a quantifier, and `{agent}` does not know all objects: \
                 not supported in factored tasks"
            ));
        }
        for action in &domain.actions {
            let is_quantified = has_quantifier(&action.precondition)
                || action.effect.parts().any(|part| match part {
                    Effect::Forall(..) => true,
                    Effect::When(condition, _) => has_quantifier(condition),
                    _ => false,
                });
            if guard.is_some() && is_quantified {
                return Err(format!(
                    "`{}` of `{agent}` has a quantifier, and `{agent}` does not know all objects: \
                     not supported in factored tasks",
                    action.name
                ));
            }
            let mut action = names.action(action);
            if let Some(guard) = &guard {
                guard_parameters(&mut action, guard);
            }
            if shared.actions.get(&action.name).is_some_and(|count| *count > 1) {
                let own = own_name(&action.name, agent);
                self.originals.insert(own.clone(), action.name.clone());
                action.name = own;
            }
            self.domain.actions.push(action);
        }
        Ok(())
    }

    fn add_state(&mut self, task: &AgentFiles, names: &Renaming) -> Result<(), String> {
        let AgentFiles { agent, problem, .. } = task;
        for element in &problem.init {
            let element = names.element(element);
            match &element {
                InitElement::Assign(fluent, number) => {
                    let fluent = fluent.to_string();
                    if let Some((other, by)) = self.values.get(&fluent) {
                        if *other == number.0 {
                            continue;
                        }
                        let own = number.0;
                        return Err(format!(
                            "`{fluent}` is {own} for `{agent}`, and {other} for `{by}`"
                        ));
                    }
                    self.values.insert(fluent, (number.0, agent.clone()));
                }
                _ if !self.seen.insert(element.to_string()) => continue,
                _ => (),
            }
            self.init.push(element);
        }
        let goal = names.condition(&problem.goal);
        let conjuncts = match goal {
            Condition::And(conjuncts) => conjuncts,
            other => vec![other],
        };
        for conjunct in conjuncts {
            if !self.goals.contains(&conjunct) {
                self.goals.push(conjunct);
            }
        }
        match (&self.metric, &problem.metric) {
            (Some(known), Some(own)) if known != own => {
                return Err(format!("`{agent}` has another metric than the agents before it"));
            }
            (None, Some(own)) => self.metric = Some(own.clone()),
            _ => (),
        }
        Ok(())
    }
}

fn refuse_other_arity(
    name: &Name,
    agent: &str,
    known: Option<&Vec<Typed>>,
    own: &[Typed],
) -> Result<(), String> {
    match known {
        Some(known) if known.len() != own.len() => Err(format!(
            "`{name}` takes {} for `{agent}`, and {} for another agent",
            crate::check::count(own.len(), "argument"),
            known.len()
        )),
        _ => Ok(()),
    }
}

/// Restricts an action to the objects that its agent knows.
fn guard_parameters(action: &mut ActionSchema, guard: &Name) {
    let known = |parameter: &Typed| {
        let arguments = vec![Term::Variable(parameter.name.clone())];
        Condition::Atom(Atom { predicate: guard.clone(), arguments, span: Span::default() })
    };
    let mut conjuncts: Vec<Condition> = action.all_parameters().map(known).collect();
    conjuncts.push(std::mem::replace(&mut action.precondition, Condition::And(Vec::new())));
    action.precondition = Condition::And(conjuncts);
}

fn has_quantifier(condition: &Condition) -> bool {
    match condition {
        Condition::Exists(..) | Condition::Forall(..) => true,
        Condition::Not(inner) => has_quantifier(inner),
        Condition::And(parts) | Condition::Or(parts) => parts.iter().any(has_quantifier),
        Condition::Imply(left, right) => has_quantifier(left) || has_quantifier(right),
        Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => false,
    }
}

// === impl Renaming ===

impl Renaming {
    fn predicate(&self, name: &Name) -> Name {
        self.predicates.get(name).unwrap_or(name).clone()
    }

    fn function(&self, name: &Name) -> Name {
        self.functions.get(name).unwrap_or(name).clone()
    }

    fn object(&self, name: &Name) -> Name {
        self.objects.get(name).unwrap_or(name).clone()
    }

    fn term(&self, term: &Term) -> Term {
        match term {
            Term::Object(name) => Term::Object(self.object(name)),
            Term::Variable(_) => term.clone(),
        }
    }

    fn atom(&self, atom: &Atom) -> Atom {
        let arguments = atom.arguments.iter().map(|term| self.term(term)).collect();
        Atom { predicate: self.predicate(&atom.predicate), arguments, span: atom.span }
    }

    fn fluent(&self, fluent: &FluentTerm) -> FluentTerm {
        let arguments = fluent.arguments.iter().map(|term| self.term(term)).collect();
        FluentTerm { function: self.function(&fluent.function), arguments, span: fluent.span }
    }

    fn element(&self, element: &InitElement) -> InitElement {
        match element {
            InitElement::Atom(atom) => InitElement::Atom(self.atom(atom)),
            InitElement::Not(atom) => InitElement::Not(self.atom(atom)),
            InitElement::Unknown(atom) => InitElement::Unknown(self.atom(atom)),
            InitElement::Assign(fluent, value) => InitElement::Assign(self.fluent(fluent), *value),
            InitElement::At(time, later) => InitElement::At(*time, Box::new(self.element(later))),
        }
    }

    fn expression(&self, expression: &Expression) -> Expression {
        expression.map_fluents(&mut |fluent| self.fluent(fluent))
    }

    fn condition(&self, condition: &Condition) -> Condition {
        let all = |parts: &[Condition]| parts.iter().map(|part| self.condition(part)).collect();
        match condition {
            Condition::Atom(atom) => Condition::Atom(self.atom(atom)),
            Condition::Equal(left, right, span) => {
                Condition::Equal(self.term(left), self.term(right), *span)
            }
            Condition::Compare(compare) => Condition::Compare(Box::new(Compare {
                left: self.expression(&compare.left),
                right: self.expression(&compare.right),
                ..Compare::clone(compare)
            })),
            Condition::Not(inner) => Condition::Not(Box::new(self.condition(inner))),
            Condition::And(parts) => Condition::And(all(parts)),
            Condition::Or(parts) => Condition::Or(all(parts)),
            Condition::Imply(left, right) => {
                Condition::Imply(Box::new(self.condition(left)), Box::new(self.condition(right)))
            }
            Condition::Exists(variables, inner) => {
                Condition::Exists(variables.clone(), Box::new(self.condition(inner)))
            }
            Condition::Forall(variables, inner) => {
                Condition::Forall(variables.clone(), Box::new(self.condition(inner)))
            }
        }
    }

    fn effect(&self, effect: &Effect) -> Effect {
        match effect {
            Effect::And(parts) => Effect::And(parts.iter().map(|part| self.effect(part)).collect()),
            Effect::Add(atom) => Effect::Add(self.atom(atom)),
            Effect::Delete(atom) => Effect::Delete(self.atom(atom)),
            Effect::Assign(assign) => Effect::Assign(Box::new(Assign {
                fluent: self.fluent(&assign.fluent),
                value: self.expression(&assign.value),
                ..Assign::clone(assign)
            })),
            Effect::Forall(variables, inner) => {
                Effect::Forall(variables.clone(), Box::new(self.effect(inner)))
            }
            Effect::When(condition, inner) => {
                Effect::When(Box::new(self.condition(condition)), Box::new(self.effect(inner)))
            }
        }
    }

    fn action(&self, action: &ActionSchema) -> ActionSchema {
        ActionSchema {
            precondition: self.condition(&action.precondition),
            effect: self.effect(&action.effect),
            ..action.clone()
        }
    }
}
