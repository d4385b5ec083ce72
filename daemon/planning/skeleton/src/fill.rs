//! Fills an agent's part of a skeleton: plans the private steps between the agent's steps of the
//! skeleton, while others change what the part says.
//!
//! The part becomes a planning task of the agent's own: its private actions, and an action for each
//! element of the part, which is possible only in its turn.

use std::collections::BTreeMap;
use std::sync::Arc;

use acl::content::PartStep;
use pddl::factored::AgentFiles;
use pddl::{
    ActionSchema, Atom, Condition, Domain, Effect, InitElement, Name, Plan, PlanStep,
    PredicateDeclaration, Privacy, Problem, Span, TOTAL_COST, Term, TypeExpr, Typed,
};
use planner::{Cancel, Options, StopReason};

use crate::opaque_names::OpaqueNames;
use crate::private_symbols::{PrivateSymbols, Scope};
use crate::projection::ProjectedAction;

/// Predicate that holds if its arguments are the same object.
const SAME: &str = "skeleton--same";

/// Prefix of the names of the actions that stand for elements of a part.
const ELEMENT: &str = "skeleton--element-";

/// The agent's part with its private steps.
#[derive(Clone, Debug, PartialEq)]
pub struct FilledPart {
    /// First, the private steps before anything else; then, for each of the agent's steps in the
    /// skeleton, the private steps just before it, the step itself, and those just after it, before
    /// others change something; last, the private steps after everything else.
    pub steps: Vec<Vec<PlanStep>>,
    /// For each of the agent's steps in the skeleton, its position in its group.
    pub positions: Vec<usize>,
    /// The cost of all these steps.
    pub cost: f64,
}

/// An agent's refusal of its part.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FillRefusal {
    /// The reason, as text for a person. It names nothing private.
    pub why: String,
    /// What the agent may write into its own log: it can name what is private.
    pub private_detail: Option<String>,
    /// What is proved to be impossible; `None` if the refusal is no proof, such as that of a part
    /// that cannot be read or was not planned in time.
    pub(crate) proved: Option<ProvedRefusal>,
}

/// What an agent has proved of its part.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ProvedRefusal {
    /// It cannot reach the action of one of its steps, with this index in its domain.
    Step { schema: usize },
    /// It can carry out its steps, but not reach its own goals besides.
    Goals,
}

/// An element of a part, parsed.
enum FillElement {
    /// The agent's own step: the action schema, and the arguments that the skeleton gives, by the
    /// index of their parameter.
    Own { schema: usize, given: BTreeMap<usize, Name> },
    /// What others change.
    Others(Vec<InitElement>),
}

/// A part of a skeleton and the task of its agent.
pub(crate) struct FillTask<'t> {
    task: &'t AgentFiles,
    symbols: &'t PrivateSymbols,
    elements: Vec<FillElement>,
}

// === impl FillTask ===

impl<'t> FillTask<'t> {
    /// Parses the part of an agent.
    ///
    /// # Errors
    ///
    /// Returns a refusal if the part cannot be parsed, or does not fit the agent's projection.
    pub(crate) fn new(
        task: &'t AgentFiles,
        symbols: &'t PrivateSymbols,
        names: &OpaqueNames,
        projected: &BTreeMap<Name, ProjectedAction>,
        part: &[PartStep],
    ) -> Result<FillTask<'t>, FillRefusal> {
        let mut elements = Vec::new();
        for element in part {
            elements.push(match element {
                PartStep::Own(text) => own_step(symbols, names, projected, text)?,
                PartStep::Others(text) => others(task, symbols, text)?,
            });
        }
        Ok(FillTask { task, symbols, elements })
    }

    /// Plans the private steps.
    ///
    /// # Errors
    ///
    /// Returns a refusal with the first step that the agent cannot reach.
    pub(crate) fn fill(
        &self,
        options: &Options,
        cancel: &Cancel,
    ) -> Result<FilledPart, FillRefusal> {
        let all = self.elements.len();
        if all == 0 {
            return Err(refused("its part is empty"));
        }
        if let Some(plan) = self.plan(all, true, options, cancel)? {
            return self.filled(&plan);
        }
        if self.plan(all, false, options, cancel)?.is_some() {
            let why = "it cannot reach what is wanted of it besides its steps".to_owned();
            let proved = Some(ProvedRefusal::Goals);
            return Err(FillRefusal { why, private_detail: None, proved });
        }
        // The least number of elements that cannot be reached: all before it can.
        let (mut possible, mut failing) = (0, all);
        while failing - possible > 1 {
            let middle = usize::midpoint(possible, failing);
            match self.plan(middle, false, options, cancel)? {
                Some(_) => possible = middle,
                None => failing = middle,
            }
        }
        let is_own = |element: &&FillElement| matches!(element, FillElement::Own { .. });
        let number = self.elements[..failing].iter().filter(is_own).count();
        let why = format!("it cannot carry out its step {number} of the plan");
        let proved = match &self.elements[possible] {
            FillElement::Own { schema, .. } => Some(ProvedRefusal::Step { schema: *schema }),
            FillElement::Others(_) => None,
        };
        Err(FillRefusal { why, private_detail: None, proved })
    }

    /// Plans up to the element `end`, and for the agent's own goals if `with_goals`. Returns `None` if
    /// it is proved that there is no plan.
    ///
    /// # Errors
    ///
    /// Returns a refusal without a proof if the search ends at a limit.
    fn plan(
        &self,
        end: usize,
        with_goals: bool,
        options: &Options,
        cancel: &Cancel,
    ) -> Result<Option<Plan>, FillRefusal> {
        let (domain, problem) = (self.domain(end), self.problem(end, with_goals));
        let outcome = planner::plan(&domain, &problem, options, cancel).map_err(|error| {
            let private_detail = Some(error.to_string());
            FillRefusal { private_detail, ..refused("its own task cannot be planned for") }
        })?;
        match (outcome.plan, outcome.stop_reason) {
            (Some(plan), _) => Ok(Some(plan)),
            (None, StopReason::Unsolvable { .. }) => Ok(None),
            (None, limit) => Err(refused(&format!("it has not planned its part: {limit}"))),
        }
    }

    fn domain(&self, end: usize) -> Domain {
        let own = &self.task.domain;
        let mut domain = own.clone();
        let is_private = |action: &&ActionSchema| !self.symbols.changed_by(action).1;
        domain.actions = own.actions.iter().filter(is_private).cloned().collect();
        let elements = self.elements[..end].iter().enumerate();
        domain.actions.extend(elements.map(|(place, element)| self.action(place, element)));
        // The actions for elements name objects, and a domain may name only its constants.
        let objects = self.task.problem.objects.iter().map(|declared| declared.object.clone());
        domain.constants.extend(objects);
        let declared = |name: Name, arity: usize| PredicateDeclaration {
            name,
            parameters: (0..arity)
                .map(|place| Typed {
                    name: Name::new(&format!("x{place}")),
                    ty: TypeExpr::default(),
                })
                .collect(),
            privacy: Privacy::Public,
        };
        domain.predicates.push(declared(Name::new(SAME), 2));
        domain.predicates.extend((0..=end).map(|place| declared(turn_name(place), 0)));
        domain
    }

    /// Returns the action that stands for an element of the part.
    fn action(&self, place: usize, element: &FillElement) -> ActionSchema {
        let name = Name::new(&format!("{ELEMENT}{place}"));
        let mut effects = vec![Effect::Delete(turn(place)), Effect::Add(turn(place + 1))];
        let mut conditions = vec![Condition::Atom(turn(place))];
        match element {
            FillElement::Own { schema, given } => {
                let own = &self.task.domain.actions[*schema];
                let all: Vec<Typed> = own.all_parameters().cloned().collect();
                for (parameter, object) in given {
                    let variable = Term::Variable(all[*parameter].name.clone());
                    let arguments = vec![variable, Term::Object(object.clone())];
                    conditions.push(Condition::Atom(atom(Name::new(SAME), arguments)));
                }
                conditions.push(own.precondition.clone());
                effects.push(own.effect.clone());
                ActionSchema {
                    name,
                    agent: None,
                    partners: Vec::new(),
                    parameters: all,
                    precondition: Condition::And(conditions),
                    effect: Effect::And(effects),
                    observe: Vec::new(),
                    span: own.span,
                }
            }
            FillElement::Others(changes) => {
                effects.extend(changes.iter().filter_map(effect_of));
                ActionSchema {
                    name,
                    agent: None,
                    partners: Vec::new(),
                    parameters: Vec::new(),
                    precondition: Condition::And(conditions),
                    effect: Effect::And(effects),
                    observe: Vec::new(),
                    span: Span::default(),
                }
            }
        }
    }

    fn problem(&self, end: usize, with_goals: bool) -> Problem {
        let mut problem = self.task.problem.clone();
        problem.objects = Arc::new(Vec::new());
        problem.init.push(InitElement::Atom(turn(0)));
        let given = self.elements.iter().flat_map(|element| match element {
            FillElement::Own { given, .. } => given.values().collect::<Vec<_>>(),
            FillElement::Others(_) => Vec::new(),
        });
        let given: std::collections::BTreeSet<&Name> = given.collect();
        problem.init.extend(given.into_iter().map(|name| {
            let object = Term::Object(name.clone());
            InitElement::Atom(atom(Name::new(SAME), vec![object.clone(), object]))
        }));
        let mut goals = vec![Condition::Atom(turn(end))];
        if let (true, Condition::And(conjuncts)) = (with_goals, &self.task.problem.goal) {
            goals.extend(conjuncts.iter().filter(|it| self.symbols.concern_condition(it)).cloned());
        }
        problem.goal = Condition::And(goals);
        problem
    }

    /// Splits a plan at the agent's steps of the skeleton.
    fn filled(&self, plan: &Plan) -> Result<FilledPart, FillRefusal> {
        let mut steps: Vec<Vec<PlanStep>> = vec![Vec::new()];
        let mut positions = Vec::new();
        // Private steps that others have not changed anything after.
        let mut current = Vec::new();
        let add = |steps: &mut Vec<Vec<PlanStep>>, more: &mut Vec<PlanStep>| {
            if let Some(last) = steps.last_mut() {
                last.append(more);
            }
        };
        for step in &plan.steps {
            let element = step.action.as_str().strip_prefix(ELEMENT);
            let element = element.and_then(|place| place.parse::<usize>().ok());
            match element.and_then(|place| self.elements.get(place)) {
                Some(FillElement::Own { schema, .. }) => {
                    let action = self.task.domain.actions[*schema].name.clone();
                    positions.push(current.len());
                    current.push(PlanStep::new(action, step.arguments.iter().cloned()));
                    steps.push(std::mem::take(&mut current));
                }
                Some(FillElement::Others(_)) => add(&mut steps, &mut current),
                None => current.push(step.clone()),
            }
        }
        steps.push(current);
        let cost = match &self.task.problem.metric {
            Some(_) => plan.cost.map_or(0.0, |cost| cost.0),
            None => steps.iter().map(Vec::len).sum::<usize>() as f64,
        };
        Ok(FilledPart { steps, positions, cost })
    }
}

fn refused(why: &str) -> FillRefusal {
    FillRefusal { why: why.to_owned(), private_detail: None, proved: None }
}

fn atom(predicate: Name, arguments: Vec<Term>) -> Atom {
    Atom { predicate, arguments, span: Span::default() }
}

fn turn_name(place: usize) -> Name {
    Name::new(&format!("skeleton--turn-{place}"))
}

/// Returns the fact that the element at `place` is next.
fn turn(place: usize) -> Atom {
    atom(turn_name(place), Vec::new())
}

fn effect_of(change: &InitElement) -> Option<Effect> {
    match change {
        InitElement::Atom(atom) => Some(Effect::Add(atom.clone())),
        InitElement::Not(atom) => Some(Effect::Delete(atom.clone())),
        InitElement::Assign(fluent, number) => Some(Effect::Assign(Box::new(pddl::Assign {
            assignment: pddl::Assignment::Assign,
            fluent: fluent.clone(),
            value: pddl::Expression::Number(*number),
            span: fluent.span,
        }))),
        InitElement::Unknown(_) | InitElement::At(..) => None,
    }
}

/// Parses a step of the agent in the skeleton.
fn own_step(
    symbols: &PrivateSymbols,
    names: &OpaqueNames,
    projected: &BTreeMap<Name, ProjectedAction>,
    text: &str,
) -> Result<FillElement, FillRefusal> {
    let unknown = || refused("a step in its part is none that it has announced");
    let step = pddl::parse_step(text).into_result().map_err(|_| unknown())?;
    let action = projected.get(&step.action).ok_or_else(unknown)?;
    if step.arguments.len() != action.parameters.len() {
        return Err(unknown());
    }
    // A private object is known to others by its opaque name only.
    let known = |name: &Name| match names.object_of(name) {
        Some(own) => Ok(own.clone()),
        None if symbols.knows_object(name) && !symbols.is_private_object(name) => Ok(name.clone()),
        None => Err(unknown()),
    };
    let mut given = BTreeMap::new();
    for (parameter, argument) in action.parameters.iter().zip(&step.arguments) {
        given.insert(*parameter, known(argument)?);
    }
    Ok(FillElement::Own { schema: action.schema, given })
}

/// Parses what others change. What the agent does not know is left out.
fn others(
    task: &AgentFiles,
    symbols: &PrivateSymbols,
    text: &str,
) -> Result<FillElement, FillRefusal> {
    let changes = pddl::parse_init_elements(text).into_result();
    let changes = changes.map_err(|_| refused("what others change cannot be read"))?;
    let is_public = |name: &Name| symbols.knows_object(name) && !symbols.is_private_object(name);
    // No other agent changes what is private, nor what this agent's steps cost.
    let is_known = |change: &InitElement| match change {
        InitElement::Atom(atom) | InitElement::Not(atom) => {
            task.domain.predicates.iter().any(|it| it.name == atom.predicate)
                && atom.arguments.iter().all(|term| is_public(term.name()))
                && symbols.symbol(atom, &Scope::new()).is_none()
        }
        InitElement::Assign(fluent, _) => {
            task.domain.functions.iter().any(|it| it.name == fluent.function)
                && fluent.arguments.iter().all(|term| is_public(term.name()))
                && !symbols.is_private_function(&fluent.function)
                && fluent.function != *TOTAL_COST
        }
        InitElement::Unknown(_) | InitElement::At(..) => false,
    };
    Ok(FillElement::Others(changes.into_iter().filter(is_known).collect()))
}
