//! One plan under way: its order, its steps, and the state as it follows from what was confirmed.
//! Without I/O.

use std::collections::{BTreeSet, HashSet};

use acl::AgentId;
use acl::content::{ChangeState, Execute, Offers, Snapshot};
use pddl::{Atom, Domain, InitElement, Name, Plan, PlanStep, Problem, Term};
use planner::order::{PartialOrder, deorder};
use planner::validate::{Verdict, World, rest_reaches, validate};

use crate::translate::{Order, acting_agent, translate};

/// One plan under way.
pub(crate) struct Execution {
    domain: Domain,
    problem: Problem,
    steps: Vec<PlanStep>,
    order: PartialOrder,
    offers: Offers,
    phases: Vec<StepPhase>,
    /// The state as it follows from the confirmed steps.
    world: World,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StepPhase {
    Waiting,
    Acting,
    Done,
}

impl Execution {
    /// Reads a plan, validates it, and finds out which of its steps may go side by side.
    ///
    /// # Errors
    ///
    /// If something cannot be read or the plan does not reach the goal; for a person.
    pub(crate) fn new(execute: &Execute) -> Result<Execution, String> {
        let domain = pddl::parse_domain(&execute.domain).into_result().map_err(first)?;
        let problem = pddl::parse_problem(&execute.problem).into_result().map_err(first)?;
        let plan: Plan = pddl::parse_plan(&execute.plan).into_result().map_err(first)?;
        match validate(&domain, &problem, &plan) {
            Verdict::Valid { .. } => (),
            Verdict::Fault(fault) => return Err(format!("the plan is not valid: {fault}")),
            Verdict::BadInput(diagnostics) => return Err(first(diagnostics)),
        }
        let world = World::initial(&domain, &problem).map_err(first)?;
        let order = deorder(&domain, &problem, &plan)
            .map_err(|error| format!("the plan cannot be ordered: {error}"))?;
        let phases = vec![StepPhase::Waiting; plan.steps.len()];
        let offers = execute.offers.clone();
        Ok(Execution { domain, problem, steps: plan.steps, order, offers, phases, world })
    }

    /// The steps that wait for nothing any more.
    pub(crate) fn ready(&self) -> Vec<usize> {
        let is_done = |step: &usize| self.phases[*step] == StepPhase::Done;
        (0..self.steps.len())
            .filter(|step| self.phases[*step] == StepPhase::Waiting)
            .filter(|step| self.order.predecessors[*step].iter().all(is_done))
            .collect()
    }

    /// Begins a step.
    ///
    /// # Errors
    ///
    /// If nobody offers it.
    pub(crate) fn start(&mut self, step: usize) -> Result<Order, String> {
        let order = translate(&self.steps[step], &self.domain, &self.offers)
            .map_err(|problem| format!("{}: {problem}", self.step_text(step)))?;
        self.phases[step] = StepPhase::Acting;
        Ok(order)
    }

    /// A step is confirmed: its effects are believed. Yields what they changed.
    ///
    /// # Errors
    ///
    /// If it could not have happened in the state as known.
    pub(crate) fn finish(&mut self, step: usize) -> Result<ChangeState, String> {
        let before: BTreeSet<String> = self.facts();
        self.world
            .apply(&self.steps[step])
            .map_err(|fault| format!("{} was confirmed, yet {fault}", self.step_text(step)))?;
        self.phases[step] = StepPhase::Done;
        let after = self.facts();
        let difference =
            |a: &BTreeSet<String>, b| a.difference(b).cloned().collect::<Vec<_>>().join(" ");
        Ok(ChangeState {
            believe: difference(&after, &before),
            retract: difference(&before, &after),
            owner: None,
        })
    }

    fn facts(&self) -> BTreeSet<String> {
        self.world.atoms().map(|atom: Atom| atom.to_string()).collect()
    }

    /// Whether every step is done.
    pub(crate) fn is_complete(&self) -> bool {
        self.phases.iter().all(|phase| *phase == StepPhase::Done)
    }

    /// What of the goal does not hold in the state as it follows from the confirmed steps.
    pub(crate) fn unmet_goal(&self) -> Option<String> {
        let unmet = self.world.failing(&self.problem.goal)?;
        Some(format!("{unmet} does not hold"))
    }

    /// Whether the steps that are left reach the goal from the state as the Domain Maintainer
    /// knows it. Steps that are acting count as left: their effects are not confirmed.
    ///
    /// # Errors
    ///
    /// What is in the way, for a person.
    pub(crate) fn still_reaches(&self, snapshot: &Snapshot) -> Result<(), String> {
        let known = pddl::parse_problem(&snapshot.problem).into_result().map_err(first)?;
        let now = Problem { init: self.readable(known.init), ..self.problem.clone() };
        let world = World::initial(&self.domain, &now).map_err(first)?;
        rest_reaches(&world, &self.rest(), &self.problem.goal).map_err(|fault| fault.to_string())
    }

    /// The facts that this plan's domain and objects can speak of; agents that joined since then
    /// brought others, which cannot matter to it.
    fn readable(&self, init: Vec<InitElement>) -> Vec<InitElement> {
        let domain = &self.domain;
        let symbols: HashSet<&Name> = domain
            .predicates
            .iter()
            .map(|predicate| &predicate.name)
            .chain(domain.functions.iter().map(|function| &function.name))
            .collect();
        let objects: HashSet<&Name> = domain
            .constants
            .iter()
            .chain(self.problem.objects.iter().map(|declaration| &declaration.object))
            .map(|object| &object.name)
            .collect();
        let is_readable = |element: &InitElement| {
            let (symbol, arguments) = match element {
                InitElement::Atom(atom) | InitElement::Not(atom) => {
                    (&atom.predicate, &atom.arguments)
                }
                InitElement::Assign(fluent, _) => (&fluent.function, &fluent.arguments),
                InitElement::At(..) => return false,
            };
            let is_known =
                |term: &Term| matches!(term, Term::Object(name) if objects.contains(name));
            symbols.contains(symbol) && arguments.iter().all(is_known)
        };
        init.into_iter().filter(is_readable).collect()
    }

    fn rest(&self) -> Vec<PlanStep> {
        let left = self.steps.iter().zip(&self.phases);
        left.filter(|(_, phase)| **phase != StepPhase::Done).map(|(step, _)| step.clone()).collect()
    }

    /// Whether an agent acts in a step that is not done.
    pub(crate) fn needs(&self, agent: &AgentId) -> bool {
        self.rest().iter().any(|step| acting_agent(step).as_ref() == Some(agent))
    }

    /// A step, for a person: under its agent's name for it.
    pub(crate) fn step_text(&self, step: usize) -> String {
        let order = translate(&self.steps[step], &self.domain, &self.offers);
        let text = order.map_or_else(|_| self.steps[step].to_string(), |order| order.action);
        format!("`{text}`")
    }
}

fn first(diagnostics: Vec<pddl::Diagnostic>) -> String {
    diagnostics.first().map_or_else(|| "unreadable".to_owned(), ToString::to_string)
}
