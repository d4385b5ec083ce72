//! Execution state of one plan: the order of its steps, their phases, and the state of the world
//! that follows from the confirmed steps. There is no I/O here.

use acl::AgentId;
use acl::content::{ChangeState, Execute, Offer, Offers, Snapshot};
use pddl::knowledge::Knowledge;
use pddl::{Atom, Domain, Plan, PlanStep, Problem};
use planner::order::{PartialOrder, deorder};
use planner::validate::{Fault, World, cost_from, rest_reaches};

use crate::translate::{ActionRequest, actors, translate};

/// Limit on the work of evaluating conditions for one plan, in the validator's steps. After it is
/// reached, no condition holds, so the plan cannot be validated. Plans of the largest buildings
/// need some thousands of steps; this limit takes some seconds to reach.
const EVALUATION_STEPS_MAX: u64 = 20_000_000;

/// A plan that is being executed.
pub(crate) struct Execution {
    domain_text: String,
    domain: Domain,
    problem: Problem,
    steps: Vec<PlanStep>,
    order: PartialOrder,
    offers: Offers,
    /// The predicates that the domain uses for unknown facts.
    knowledge: Knowledge,
    phases: Vec<StepPhase>,
    /// State of the world that follows from the confirmed steps.
    world: World,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum StepPhase {
    Waiting,
    Acting,
    Done,
}

impl Execution {
    /// Parses and validates a plan, and computes which of its steps may run side by side.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if a part of the request cannot be parsed or the
    /// plan does not reach the goal.
    pub(crate) fn new(execute: &Execute, knowledge: Knowledge) -> Result<Execution, String> {
        let domain = pddl::parse_domain(&execute.domain).into_result().map_err(first_diagnostic)?;
        let problem =
            pddl::parse_problem(&execute.problem).into_result().map_err(first_diagnostic)?;
        let plan: Plan = pddl::parse_plan(&execute.plan).into_result().map_err(first_diagnostic)?;
        let world = initial(&domain, &problem)?;
        cost_from(&world, &plan.steps, &problem.goal).map_err(|fault| {
            format!("the plan is not valid: {}", plain_fault(*fault, &knowledge))
        })?;
        let order = deorder(&world, &plan.steps);
        let phases = vec![StepPhase::Waiting; plan.steps.len()];
        let offers = execute.offers.clone();
        let (domain_text, steps) = (execute.domain.clone(), plan.steps);
        let mut execution = Execution {
            domain_text,
            domain,
            problem,
            steps,
            order,
            offers,
            knowledge,
            phases,
            world,
        };
        for step in execute.done.iter().filter_map(|step| usize::try_from(*step).ok()) {
            execution.take_over(step)?;
        }
        Ok(execution)
    }

    /// Marks a step as done, because an earlier Plan Executor completed it before this one took the
    /// plan over.
    fn take_over(&mut self, step: usize) -> Result<(), String> {
        match self.phases.get(step) {
            Some(StepPhase::Waiting) => self.finish(step).map(drop),
            Some(_) => Ok(()),
            None => Err(format!("the plan has no step {step}")),
        }
    }

    /// Returns the steps that are done. Each entry is the number of the step, from 0, and its
    /// ground action under the agent's own name for it.
    pub(crate) fn done(&self) -> Vec<(usize, String)> {
        let is_done = |step: &usize| self.phases[*step] == StepPhase::Done;
        (0..self.steps.len()).filter(is_done).map(|step| (step, self.outside(step))).collect()
    }

    /// Returns the steps that can start: they have not begun, and all steps that they depend on are
    /// done.
    pub(crate) fn ready(&self) -> Vec<usize> {
        let is_done = |step: &usize| self.phases[*step] == StepPhase::Done;
        (0..self.steps.len())
            .filter(|step| self.phases[*step] == StepPhase::Waiting)
            .filter(|step| self.order.predecessors[*step].iter().all(is_done))
            .collect()
    }

    /// Begins a step and returns the requests to its actuators, in the order of its agents.
    ///
    /// # Errors
    ///
    /// Returns an error if an agent of the step does not offer the action, or offers it without a
    /// usable method.
    pub(crate) fn start(&mut self, step: usize) -> Result<Vec<ActionRequest>, String> {
        let requests = translate(&self.steps[step], &self.domain, &self.offers)
            .map_err(|problem| format!("{}: {problem}", self.step_text(step)))?;
        self.phases[step] = StepPhase::Acting;
        Ok(requests)
    }

    /// Returns the agents that act in a step.
    pub(crate) fn actors(&self, step: usize) -> Vec<AgentId> {
        actors(&self.steps[step], &self.offers)
    }

    /// Applies the effects of a confirmed step. Returns the facts that these effects changed.
    ///
    /// # Errors
    ///
    /// Returns an error if the step is not applicable in the known state.
    pub(crate) fn finish(&mut self, step: usize) -> Result<ChangeState, String> {
        let before = self.world.clone();
        self.world.apply(&self.steps[step]).map_err(|fault| {
            let fault = plain_fault(*fault, &self.knowledge);
            format!("{} was confirmed, yet {fault}", self.step_text(step))
        })?;
        self.phases[step] = StepPhase::Done;
        Ok(ChangeState {
            believe: text(&self.world.facts_missing_in(&before)),
            retract: text(&before.facts_missing_in(&self.world)),
            owner: None,
        })
    }

    /// Whether every step is done.
    pub(crate) fn is_complete(&self) -> bool {
        self.phases.iter().all(|phase| *phase == StepPhase::Done)
    }

    /// Returns the part of the goal that does not hold in the state after the confirmed steps;
    /// `None` if the whole goal holds in that state.
    pub(crate) fn unmet_goal(&self) -> Option<String> {
        let unmet = self.world.failing(&self.problem.goal)?;
        Some(format!("{} does not hold", self.knowledge.original_condition(&unmet)))
    }

    /// Checks whether the remaining steps still reach the goal, from the Domain Maintainer's state
    /// and with the present action models. If they do and the domain has changed, execution
    /// continues with the new domain and state. A running step counts as remaining, because its
    /// effects are not confirmed.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the remaining steps do not reach the goal.
    pub(crate) fn revalidate(
        &mut self,
        snapshot: &Snapshot,
        knowledge: Knowledge,
    ) -> Result<(), String> {
        let known =
            pddl::parse_problem(&snapshot.problem).into_result().map_err(first_diagnostic)?;
        let problem = Problem { goal: self.problem.goal.clone(), ..known };
        let left = self.remaining_steps();
        let steps: Result<Vec<_>, _> =
            left.iter().map(|step| self.renamed(&self.steps[*step], &snapshot.offers)).collect();
        let steps = steps?;
        let is_new = snapshot.domain != self.domain_text;
        let parsed = is_new.then(|| pddl::parse_domain(&snapshot.domain).into_result());
        let domain = parsed.transpose().map_err(first_diagnostic)?;
        let read = domain.as_ref().unwrap_or(&self.domain);
        let world = initial(read, &problem)?;
        rest_reaches(&world, &steps, &problem.goal)
            .map_err(|fault| plain_fault(*fault, &self.knowledge).to_string())?;
        if let Some(domain) = domain {
            let order = deorder(&world, &steps);
            for ((step, renamed), before) in left.iter().zip(steps).zip(order.predecessors) {
                self.steps[*step] = renamed;
                self.order.predecessors[*step] = before.into_iter().map(|at| left[at]).collect();
            }
            self.offers.extend(snapshot.offers.clone());
            self.knowledge = knowledge;
            self.domain_text.clone_from(&snapshot.domain);
            (self.domain, self.problem, self.world) = (domain, problem, world);
        }
        Ok(())
    }

    /// Returns a step with the action name that the composite domain now has for the step's action.
    fn renamed(&self, step: &PlanStep, offers: &Offers) -> Result<PlanStep, String> {
        let agents = actors(step, &self.offers);
        let agent = agents.first().ok_or("no agent acts in it")?;
        let is_it = |(_, offer): &(&String, &Offer)| step.action == *offer.schema.as_str();
        let known = self.offers.get(agent).and_then(|actions| actions.iter().find(is_it));
        let outside = known.map_or(step.action.as_str(), |(outside, _)| outside.as_str());
        let offer = |agent: &AgentId| {
            let offer = offers.get(agent).and_then(|actions| actions.get(outside));
            offer.ok_or_else(|| format!("`{agent}` does not offer `{outside}` any more"))
        };
        let schema = offer(agent)?.schema.as_str();
        if let Some(other) =
            agents.iter().find(|agent| offer(agent).map_or(true, |offer| offer.schema != schema))
        {
            return Err(format!("`{other}` does not offer `{outside}` any more"));
        }
        Ok(PlanStep { action: schema.into(), ..step.clone() })
    }

    /// Returns the change after a step with an uncertain result: every fact that the step would
    /// have made true or false becomes unknown.
    pub(crate) fn uncertain(&self, step: usize) -> ChangeState {
        let mut after = self.world.clone();
        // A step that is not applicable has changed nothing.
        if after.apply(&self.steps[step]).is_err() {
            return ChangeState::default();
        }
        let (lost, made) =
            (self.world.facts_missing_in(&after), after.facts_missing_in(&self.world));
        let unknown = lost.iter().chain(&made).map(|fact| format!("(unknown {fact})"));
        let believe = unknown.collect::<Vec<_>>().join(" ");
        ChangeState { believe, retract: text(&lost), owner: None }
    }

    /// Returns the steps that are not done, including the running ones.
    fn remaining_steps(&self) -> Vec<usize> {
        let is_left = |step: &usize| self.phases[*step] != StepPhase::Done;
        (0..self.steps.len()).filter(is_left).collect()
    }

    /// Whether an agent acts in a step that is not done.
    pub(crate) fn needs(&self, agent: &AgentId) -> bool {
        let left = self.remaining_steps();
        left.into_iter().any(|step| self.actors(step).contains(agent))
    }

    /// Returns the agents that act in steps that are not done.
    pub(crate) fn needed(&self) -> impl Iterator<Item = AgentId> + '_ {
        self.remaining_steps().into_iter().flat_map(|step| self.actors(step))
    }

    /// Returns a step as text for a person, with the agent's own name for the action.
    pub(crate) fn step_text(&self, step: usize) -> String {
        format!("`{}`", self.outside(step))
    }

    fn outside(&self, step: usize) -> String {
        let requests = translate(&self.steps[step], &self.domain, &self.offers).ok();
        let first = requests.and_then(|requests| requests.into_iter().next());
        first.map_or_else(|| self.steps[step].to_string(), |request| request.action)
    }
}

/// Translates the conditions in a fault of a plan back to the predicates that the goal uses.
fn plain_fault(fault: Fault, knowledge: &Knowledge) -> Fault {
    fault.map(|part| knowledge.original_condition(part))
}

fn text(facts: &[Atom]) -> String {
    facts.iter().map(ToString::to_string).collect::<Vec<_>>().join(" ")
}

/// Returns the initial state of a problem, with a limit on the work of evaluating conditions in it.
fn initial(domain: &Domain, problem: &Problem) -> Result<World, String> {
    let world = World::initial(domain, problem).map_err(first_diagnostic)?;
    Ok(world.limit_work(EVALUATION_STEPS_MAX, None))
}

fn first_diagnostic(diagnostics: Vec<pddl::Diagnostic>) -> String {
    diagnostics.first().map_or_else(|| "unreadable".to_owned(), ToString::to_string)
}
