//! The Domain Maintainer's domain and state, read once per round of planning: “the plan request
//! compiles all the state and domain information that may be required to solve a planning problem”
//! (the paper, “Plan Requester”).

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::OnceLock;

use acl::AgentId;
use acl::content::{self, Offers, Proposal, Snapshot, acting_agents};
use goal_lifecycle::AvoidedActions;
use pddl::knowledge::Knowledge;
use pddl::{
    ActionModel, Atom, Condition, Domain, Effect, FluentTerm, InitElement, Name, Plan, PlanStep,
    Privacy, Problem,
};
use planner::explain::{self, ActionGuard, Explanation};
use planner::goal::{GoalTooLarge, conjuncts_but};
use planner::order::{PartialOrder, deorder, interference};
use planner::validate::{Fault, World, cost_from};
use planner::{Budget, Cancel, Options, StopReason};

/// Maximum number of grounding candidates that are examined for explaining why there is no plan.
/// The limit is reached after about a second in the largest buildings.
const EXPLAINING_STEPS_MAX: u64 = 20_000_000;

/// Maximum number of states that are examined for explaining why there is no plan. The limit is
/// reached after some seconds in the largest buildings.
const EXPLAINING_EXPANSIONS_MAX: u64 = 50_000;

/// Maximum number of steps for evaluating one goal in the state of a snapshot. The goals of the
/// largest buildings take some thousands of steps. The limit is reached after half a second, during
/// which the Plan Requester answers no message.
const EVALUATION_STEPS_MAX: u64 = 3_000_000;

/// The domain and the state for one round of planning.
#[derive(Clone, Debug)]
pub(crate) struct PlanningSnapshot {
    pub(crate) epoch: u64,
    pub(crate) domain: Domain,
    pub(crate) problem: Problem,
    /// The initial state of the problem, computed at the first use. An error is the reason, as text
    /// for a person, why this state cannot be made.
    world: OnceLock<Result<World, String>>,
    pub(crate) domain_text: String,
    pub(crate) offers: Offers,
    /// Actions offered by all agents, including the agents that are left out of planning.
    pub(crate) all_offers: Offers,
    /// The problem with all agents, including the agents that are left out of planning.
    whole: Problem,
    /// The guard of each action schema: the fact that lets one agent use the action.
    pub(crate) guards: BTreeMap<Name, ActionGuard>,
    /// Former action models: models that agents offered earlier and no longer offer.
    former: Vec<ActionModel>,
    /// The predicates that stand for unknown facts in the domain.
    knowledge: Knowledge,
    /// The predicates that stand for unknown facts in the domain, in the form that messages use.
    pub(crate) words: BTreeMap<String, content::Auxiliary>,
    pub(crate) avoided: AvoidedActions,
    /// Actions that the Domain Maintainer left out of the composition, each with the reason, as
    /// text for a person.
    pub(crate) not_composed: BTreeSet<String>,
    /// Agents that are in use by other goals and left out of planning.
    pub(crate) spared: BTreeSet<AgentId>,
}

impl PlanningSnapshot {
    /// Reads a snapshot of the Domain Maintainer.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the snapshot is not valid PDDL.
    pub(crate) fn read(snapshot: Snapshot) -> Result<PlanningSnapshot, String> {
        let Snapshot {
            epoch, domain, problem, offers, guards, former, knowledge, conflicts, ..
        } = snapshot;
        let domain_text = domain;
        let domain = pddl::parse_domain(&domain_text).into_result().map_err(first)?;
        let problem = pddl::parse_problem(&problem).into_result().map_err(first)?;
        let guard = |(inside, guard): (String, acl::content::Guard)| {
            let (outside, predicate) = (Name::new(&guard.action), Name::new(&guard.predicate));
            (Name::new(&inside), ActionGuard { outside, predicate })
        };
        let guards = guards.into_iter().map(guard).collect();
        // A former model that cannot be parsed is left out; only explanations use it.
        let read = |text: &String| pddl::parse_action_model(text).into_result().ok();
        let former = former.iter().filter_map(read).collect();
        let conflicts = conflicts.into_values().flatten();
        let not_composed = conflicts.filter(|conflict| conflict.starts_with("action "));
        let (all_offers, whole, avoided) = (offers.clone(), problem.clone(), AvoidedActions::new());
        Ok(PlanningSnapshot {
            epoch,
            domain,
            problem,
            world: OnceLock::new(),
            domain_text,
            offers,
            all_offers,
            whole,
            guards,
            former,
            knowledge: agent::knowledge(&knowledge),
            words: knowledge,
            avoided,
            not_composed: not_composed.collect(),
            spared: BTreeSet::new(),
        })
    }

    /// Returns the snapshot without the actions `avoided`, which failed recently.
    pub(crate) fn without_avoided(mut self, avoided: AvoidedActions) -> PlanningSnapshot {
        let guards = take_avoided(&mut self.offers, &avoided);
        if !guards.is_empty() {
            self.leave_out(&guards);
            self.whole = self.problem.clone();
        }
        self.avoided = avoided;
        self
    }

    /// Returns the snapshot without the agents `reserved`, which are in use by other goals.
    pub(crate) fn without_agents(mut self, reserved: &BTreeSet<AgentId>) -> PlanningSnapshot {
        self.spared.clone_from(reserved);
        self.without_offers_of(reserved)
    }

    /// Returns the snapshot without the actions of some agents, which have left or have declined
    /// their parts.
    pub(crate) fn without_offers_of(mut self, agents: &BTreeSet<AgentId>) -> PlanningSnapshot {
        let taken = agents.iter().filter_map(|agent| self.offers.remove(agent));
        let guards = taken.flat_map(BTreeMap::into_values).map(|offer| offer.guard).collect();
        self.leave_out(&guards);
        self
    }

    /// Removes the facts `guards` from the problem, so that the agents of these guards cannot act
    /// in plans.
    fn leave_out(&mut self, guards: &BTreeSet<String>) {
        // Parsing cannot fail here, because a Domain Maintainer printed the guards.
        let read = |guard: &String| pddl::parse_init_elements(guard).into_result().ok();
        let guards: HashSet<InitElement> = guards.iter().filter_map(read).flatten().collect();
        self.problem.init.retain(|fact| !guards.contains(fact));
        self.world = OnceLock::new();
    }

    /// Returns the initial state of the problem.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if this state cannot be made.
    pub(crate) fn world(&self) -> Result<&World, &str> {
        let limited = |world: World| world.limit_work(EVALUATION_STEPS_MAX, None);
        let initial = || World::initial(&self.domain, &self.problem).map(limited).map_err(first);
        let world = self.world.get_or_init(initial);
        world.as_ref().map_err(String::as_str)
    }

    /// Returns the condition that `condition` is known to hold. The result uses the predicates that
    /// stand for unknown facts in the domain.
    pub(crate) fn sure(&self, condition: &Condition) -> Condition {
        self.knowledge.known_to_hold(condition)
    }

    /// Returns the problem of reaching, from the present state, a state in which `goal` is known to
    /// hold.
    pub(crate) fn problem_of(&self, goal: &Condition) -> Problem {
        Problem { goal: self.knowledge.known_to_hold(goal), ..self.problem.clone() }
    }

    /// Returns the ground conjuncts of a goal that are not known to hold now.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the state cannot be made, or if the goal is too
    /// large to be split into conjuncts or evaluated.
    pub(crate) fn open_conjuncts(&self, goal: &Condition) -> Result<Vec<Condition>, String> {
        let world = self.world()?;
        world.renew_work();
        let mut open = self.conjuncts(world, goal).map_err(|problem| problem.to_string())?;
        open.retain(|conjunct| !self.holds_in(world, conjunct));
        match world.work_limit_reached() {
            None => Ok(open),
            Some(limit) => Err(format!(
                "the goal is too large: finding out whether it holds takes more than {limit} steps"
            )),
        }
    }

    /// Returns the conjuncts of a goal, without the predicates that stand for unknown facts.
    /// Returns the goal itself as the only part if it cannot be split.
    pub(crate) fn parts(&self, goal: &Condition) -> Vec<Condition> {
        let parts = self.world().ok().and_then(|world| self.conjuncts(world, goal).ok());
        parts.unwrap_or_else(|| vec![goal.clone()])
    }

    /// Splits a goal into its conjuncts. Quantifiers are expanded over the objects in `world`.
    fn conjuncts(&self, world: &World, goal: &Condition) -> Result<Vec<Condition>, GoalTooLarge> {
        // A fact about a room may come from a device that has left, although no present device
        // derives it.
        let is_unknown = |atom: &Atom| {
            let unknown = self.knowledge.unknown(atom);
            unknown.is_some_and(|unknown| world.holds(&Condition::Atom(unknown)))
        };
        let parts = conjuncts_but(world, goal, &is_unknown)?;
        Ok(parts.iter().map(|part| self.knowledge.original_condition(part)).collect())
    }

    fn holds_in(&self, world: &World, condition: &Condition) -> bool {
        world.holds(&self.knowledge.known_to_hold(condition))
    }

    /// Returns a conjunct of the goal if the goal requires both this conjunct and its negation;
    /// `None` if there is no such conjunct.
    pub(crate) fn contradiction(&self, goal: &Condition) -> Option<Condition> {
        let conjuncts = self.conjuncts(self.world().ok()?, goal).ok()?;
        let denied = conjuncts.iter().filter_map(|conjunct| match conjunct {
            Condition::Not(inner) => Some(&**inner),
            _ => None,
        });
        let denied: HashSet<_> = denied.collect();
        conjuncts.iter().find(|conjunct| denied.contains(conjunct)).cloned()
    }

    /// Returns `true` if a condition cannot be reached with the actions of all agents even in the
    /// delete relaxation (planning as if no action undid another).
    pub(crate) fn is_hopeless(&self, condition: &Condition, cancel: &Cancel) -> bool {
        let Ok(open) = self.open_conjuncts(condition) else { return true };
        let open: Vec<_> = open.iter().map(|part| self.knowledge.known_to_hold(part)).collect();
        planner::goal::unreachable(&self.domain, &self.whole, &open, &bounded(), cancel)
            .is_ok_and(|unreachable| !unreachable.is_empty())
    }

    /// Returns the status (false or unknown) of a ground condition that is not known to hold, as
    /// text for a person.
    pub(crate) fn describe_status(&self, condition: &Condition) -> String {
        let denied = Condition::Not(Box::new(condition.clone()));
        match self.holds(&denied) {
            true => format!("`{condition}` does not hold"),
            false => format!("it is unknown whether `{condition}` holds"),
        }
    }

    /// Returns the reason why a ground condition does not hold, if the known facts alone explain
    /// it: the condition is unknown, or it compares numbers that no action changes. Otherwise
    /// returns `None`.
    pub(crate) fn plain_reason(&self, condition: &Condition) -> Option<String> {
        let standing = self.describe_status(condition);
        let denied = Condition::Not(Box::new(condition.clone()));
        if !self.holds(&denied) {
            return Some(format!("{standing}, and no agent here can find out"));
        }
        let world = self.world().ok()?;
        let mut fluents: Vec<&FluentTerm> = Vec::new();
        for fluent in condition.fluents() {
            if !fluents.contains(&fluent) {
                fluents.push(fluent);
            }
        }
        let is_changed = |fluent: &&&FluentTerm| {
            let mut effects = self.domain.actions.iter().flat_map(|action| action.effect.parts());
            effects.any(
                |part| matches!(part, Effect::Assign(it) if it.fluent.function == fluent.function),
            )
        };
        if fluents.is_empty() || fluents.iter().any(|fluent| is_changed(&fluent)) {
            return None;
        }
        let value = |fluent: &&FluentTerm| match world.value(fluent) {
            Some(value) => format!("`{fluent}` is {value}"),
            None => format!("`{fluent}` is unknown"),
        };
        let values: Vec<String> = fluents.iter().map(value).collect();
        Some(format!("{standing}: {}, and no action here changes it", values.join(", ")))
    }

    /// Returns `true` if a condition is known to hold.
    pub(crate) fn holds(&self, condition: &Condition) -> bool {
        self.world().is_ok_and(|world| {
            world.renew_work();
            self.holds_in(world, condition)
        })
    }

    /// Returns `true` if a plan can run at the same time as the remaining steps of other plans,
    /// without undoing the conjuncts of the goals of those plans that hold now. The remaining steps
    /// use the action names of their agents.
    pub(crate) fn can_run_beside<'g>(
        &self,
        plan: &Plan,
        steps: impl IntoIterator<Item = &'g PlanStep>,
        goals: impl IntoIterator<Item = &'g Condition>,
    ) -> bool {
        // A step without an agent that offers its action fails by itself.
        let named = |step: &PlanStep| self.named(step, &self.all_offers).ok();
        let theirs: Vec<_> = steps.into_iter().filter_map(named).collect();
        self.world().is_ok_and(|now| {
            now.renew_work();
            interference(now, &plan.steps, &theirs).is_none() && self.leaves(now, plan, goals)
        })
    }

    /// Returns `true` if every conjunct of `goals` that holds now also holds after a plan.
    fn leaves<'g>(
        &self,
        now: &World,
        plan: &Plan,
        goals: impl IntoIterator<Item = &'g Condition>,
    ) -> bool {
        let mut end = now.clone();
        if plan.steps.iter().try_for_each(|step| end.apply(step)).is_err() {
            return false;
        }
        let mut reached = goals.into_iter().flat_map(|goal| self.parts(goal));
        reached.all(|conjunct| !self.holds_in(now, &conjunct) || self.holds_in(&end, &conjunct))
            && now.work_limit_reached().is_none()
    }

    /// Returns the public facts that hold now and do not hold after a plan, without the predicates
    /// that stand for unknown facts or for the actions of agents.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the state cannot be made, or if a step cannot be
    /// applied.
    pub(crate) fn undone_facts(&self, plan: &Plan) -> Result<Vec<Atom>, String> {
        let now = self.world()?;
        now.renew_work();
        let mut end = now.clone();
        plan.steps
            .iter()
            .try_for_each(|step| end.apply(step))
            .map_err(|fault| fault.to_string())?;
        let public = self.public_predicates();
        let guards: BTreeSet<&Name> = self.guards.values().map(|guard| &guard.predicate).collect();
        let mut undone = now.facts_missing_in(&end);
        undone.retain(|fact| {
            let predicate = &fact.predicate;
            let is_auxiliary = self.knowledge.is_auxiliary(predicate);
            public.contains(predicate) && !guards.contains(predicate) && !is_auxiliary
        });
        Ok(undone)
    }

    /// Returns the names of the predicates that are not private to an agent.
    pub(crate) fn public_predicates(&self) -> BTreeSet<&Name> {
        let declared = self.domain.predicates.iter();
        declared
            .filter(|predicate| predicate.privacy == Privacy::Public)
            .map(|predicate| &predicate.name)
            .collect()
    }

    /// Returns the conjuncts of `goal` that hold now and do not hold after a plan. Returns no
    /// conjunct if the state cannot be made or a step cannot be applied.
    pub(crate) fn undone_conjuncts(&self, plan: &Plan, goal: &Condition) -> Vec<Condition> {
        let Ok(now) = self.world() else { return Vec::new() };
        now.renew_work();
        let mut end = now.clone();
        if plan.steps.iter().try_for_each(|step| end.apply(step)).is_err() {
            return Vec::new();
        }
        let mut parts = self.parts(goal);
        parts.retain(|part| self.holds_in(now, part) && !self.holds_in(&end, part));
        parts
    }

    /// Returns which steps of a plan must wait for which others.
    pub(crate) fn order_of(&self, plan: &Plan) -> PartialOrder {
        self.world().map(|world| deorder(world, &plan.steps)).unwrap_or_default()
    }

    /// Returns the cost of the remaining steps of a plan from the present state; `None` if these
    /// steps do not reach the goal.
    pub(crate) fn cost_of_rest(&self, steps: &[PlanStep], goal: &Condition) -> Option<f64> {
        let steps = steps.iter().map(|step| self.named(step, &self.all_offers));
        let plan = Plan { steps: steps.collect::<Result<_, _>>().ok()?, cost: None };
        self.validate(&plan, goal).ok()
    }

    /// Returns the longest part at the end of a plan in which agents still offer the action of
    /// every step, with the action names of the composite domain. Returns `None` if the action of
    /// the last step is not offered any more.
    pub(crate) fn nameable(&self, steps: &[PlanStep]) -> Option<Plan> {
        let named = steps.iter().rev().map_while(|step| self.named(step, &self.all_offers).ok());
        let mut steps: Vec<_> = named.collect();
        steps.reverse();
        (!steps.is_empty()).then_some(Plan { steps, cost: None })
    }

    /// Plans for some conjuncts of a goal with the actions of all agents, within the limits for
    /// explanations. Returns the plan, if one was found, and the reason why planning ended. Returns
    /// `None` if the domain or the problem cannot be planned with.
    pub(crate) fn plan_for(
        &self,
        parts: &[Condition],
        cancel: &Cancel,
    ) -> Option<(Option<Plan>, StopReason)> {
        let goal = self.knowledge.known_to_hold(&Condition::And(parts.to_vec()));
        let problem = Problem { goal, ..self.whole.clone() };
        let outcome = planner::plan(&self.domain, &problem, &looking(), cancel).ok()?;
        Some((outcome.plan, outcome.stop_reason))
    }

    /// Returns those of `conjuncts` that are unreachable even in the delete relaxation (planning as
    /// if no action undid another), and what is missing for each of them. Returns `None` if the
    /// domain cannot be analysed.
    pub(crate) fn explain(&self, conjuncts: &[Condition], cancel: &Cancel) -> Option<Explanation> {
        let PlanningSnapshot { domain, whole: problem, guards, former, .. } = self;
        let known = explain::ExplanationInput { domain, problem, guards, former };
        // A domain that cannot be analysed gives no explanation.
        explain::explain(known, conjuncts, &bounded(), cancel).ok()
    }

    /// Returns the cost of `plan` if it reaches `goal`.
    ///
    /// # Errors
    ///
    /// Returns the reason, as text for a person, if the plan does not reach the goal or cannot be
    /// evaluated.
    pub(crate) fn validate(&self, plan: &Plan, goal: &Condition) -> Result<f64, String> {
        let goal = self.knowledge.known_to_hold(goal);
        let fault = |fault: Box<Fault>| {
            fault.map(|part| self.knowledge.original_condition(part)).to_string()
        };
        let world = self.world()?;
        world.renew_work();
        cost_from(world, &plan.steps, &goal).map_err(fault)
    }

    /// Returns `true` if an agent's proposed plan has at least one step, and the action of each
    /// step is offered and not avoided.
    pub(crate) fn admits(&self, plan: &str) -> bool {
        self.read_plans(&[plan]).is_ok_and(|plans| plans.iter().any(|steps| !steps.is_empty()))
    }

    /// Returns `true` if a plan has a step with an action that its agent is not known to offer,
    /// although other actions of the agent are known. Such an agent has announced a newer action
    /// model that has not reached this snapshot yet.
    pub(crate) fn uses_newer_model(&self, plan: &str) -> bool {
        let is_newer = |step: &PlanStep| {
            let agent = step.arguments.first().map_or("", |agent| agent.as_str());
            let known = self.all_offers.get(agent);
            known.is_some_and(|actions| !actions.contains_key(step.action.as_str()))
        };
        pddl::parse_plan(plan).into_result().is_ok_and(|plan| plan.steps.iter().any(is_newer))
    }

    /// Returns `true` if the plan of a proposal reaches all conjuncts that the proposal covers,
    /// without steps of other plans.
    pub(crate) fn is_sound(&self, proposal: &Proposal) -> bool {
        let read = |text: &String| pddl::parse_condition(text).into_result().ok();
        let covered: Option<Vec<_>> = proposal.covers.iter().map(read).collect();
        let Some(covered) = covered else { return false };
        self.combine(&[&proposal.plan], &Condition::And(covered)).is_ok()
    }

    /// Returns a step of an agent's proposal with the action name of the composite domain.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the action is avoided or not offered.
    pub(crate) fn inside(&self, step: PlanStep) -> Result<PlanStep, String> {
        let agent = step.arguments.first().and_then(|agent| AgentId::new(agent.as_str()).ok());
        let is_avoided =
            |agent| self.avoided.contains_key(&(agent, step.action.as_str().to_owned()));
        if agent.is_some_and(is_avoided) {
            return Err(format!("`{step}` failed a moment ago"));
        }
        self.named(&step, &self.offers)
    }

    /// Returns a step with the action name of the composite domain in place of the agent's own
    /// action name.
    ///
    /// # Errors
    ///
    /// Returns an error, as text for a person, if the agent does not offer the action in `offers`.
    fn named(&self, step: &PlanStep, offers: &Offers) -> Result<PlanStep, String> {
        let offer = step
            .arguments
            .first()
            .and_then(|agent| offers.get(agent.as_str()))
            .and_then(|actions| actions.get(step.action.as_str()))
            .ok_or_else(|| format!("no agent offers `{step}`"))?;
        Ok(PlanStep { action: offer.schema.as_str().into(), ..step.clone() })
    }

    /// Returns a plan with the agents' own action names, for reports to people.
    pub(crate) fn outside(&self, plan: &Plan) -> Plan {
        let steps = plan.steps.iter().map(|step| outside(step, &self.offers));
        Plan { steps: steps.collect(), cost: plan.cost }
    }

    /// Returns the agents that act in a step of a plan.
    pub(crate) fn actors(&self, step: &PlanStep) -> Vec<AgentId> {
        actors(step, &self.all_offers)
    }

    /// Returns the offers of the agents that act in a plan.
    pub(crate) fn offers_of(&self, plan: &Plan) -> Offers {
        let acting: BTreeSet<AgentId> =
            plan.steps.iter().flat_map(|step| actors(step, &self.offers)).collect();
        let offers = self.offers.iter().filter(|(agent, _)| acting.contains(*agent));
        offers.map(|(agent, actions)| (agent.clone(), actions.clone())).collect()
    }
}

/// Returns the agents that act in a step, with either name of its action.
pub(crate) fn actors(step: &PlanStep, offers: &Offers) -> Vec<AgentId> {
    let arguments = step.arguments.iter().map(|argument| argument.as_str());
    acting_agents(offers, step.action.as_str(), arguments)
}

/// Returns a step with the agent's own action name in place of the name in the composite domain.
pub(crate) fn outside(step: &PlanStep, offers: &Offers) -> PlanStep {
    let agent = step.arguments.first().map_or("", |agent| agent.as_str());
    let offered = offers.get(agent).into_iter().flatten();
    let named = { offered }.find(|(_, offer)| step.action == *offer.schema.as_str());
    let action = named.map_or(step.action.as_str(), |(outside, _)| outside.as_str());
    PlanStep { action: action.into(), ..step.clone() }
}

/// Returns planner options with the limits for explanations.
fn bounded() -> Options {
    let budget = Budget {
        join_steps_max: EXPLAINING_STEPS_MAX,
        memory_max_bytes: agent::computation_bytes_max(),
        ..Budget::default()
    };
    Options { budget, ..Options::default() }
}

/// Returns planner options with the limits for a plan of several agents, which is needed only for
/// one sentence of an explanation.
fn looking() -> Options {
    let budget = Budget { expansions_max: EXPLAINING_EXPANSIONS_MAX, ..bounded().budget };
    Options { budget, ..Options::default() }
}

/// Removes the avoided actions from `offers`, and returns the guards of the removed actions.
fn take_avoided(offers: &mut Offers, avoided: &AvoidedActions) -> BTreeSet<String> {
    let mut guards = BTreeSet::new();
    for (agent, action) in avoided.keys() {
        if let Some(offer) = offers.get_mut(agent).and_then(|actions| actions.remove(action)) {
            guards.insert(offer.guard);
        }
    }
    guards
}

pub(crate) fn first(diagnostics: Vec<pddl::Diagnostic>) -> String {
    diagnostics.first().map_or_else(|| "unreadable".to_owned(), ToString::to_string)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn snapshot() -> PlanningSnapshot {
        let snapshot = serde_json::json!({
            "epoch": 1,
            "revision": 1,
            "digest": "",
            "domain": "(define (domain d) (:types room) (:predicates (open ?r - room)
                (door ?a ?b - room)))",
            "problem": "(define (problem p) (:domain d) (:objects hall lab attic yard - room)
                (:init (open hall) (door hall lab) (door lab hall)) (:goal (and)))",
            "offers": {},
        });
        PlanningSnapshot::read(serde_json::from_value(snapshot).expect("a snapshot")).expect("PDDL")
    }

    fn condition(text: &str) -> Condition {
        pddl::parse_condition(text).into_result().expect("a condition")
    }

    /// Returns a condition with one quantifier over 26 variables of rooms.
    fn quantified(quantifier: &str, body: &str) -> Condition {
        let variables: Vec<String> = ('a'..='z').map(|letter| format!("?{letter}")).collect();
        condition(&format!("({quantifier} ({} - room) {body})", variables.join(" ")))
    }

    #[test]
    fn only_a_goal_that_is_too_large_is_refused() {
        let known = snapshot();
        let body = "(imply (door ?a ?b) (or (door ?b ?a) (door ?c ?d)))";
        for goal in [
            quantified("forall", body),
            condition(&format!("(not {})", quantified("exists", body))),
            Condition::And(vec![condition("(open lab)"), quantified("forall", body)]),
        ] {
            let refused = known.open_conjuncts(&goal).expect_err("it is too large");
            assert!(refused.contains("more than 200000 conditions and terms"), "{refused}");
            assert_eq!(known.contradiction(&goal), None);
            assert_eq!(known.parts(&goal), [goal]);
        }
        let other = known.open_conjuncts(&condition("(and (open hall) (open lab))"));
        assert_eq!(other, Ok(vec![condition("(open lab)")]));
    }

    #[test]
    fn an_evaluation_beyond_the_limit_is_refused_and_never_holds() {
        // The goal does not hold; every combination of rooms must be tested to detect this.
        let goal = condition(&format!("(not (not {}))", quantified("exists", "(not (= ?z ?z))")));
        let goal = Condition::Or(vec![goal.clone(), goal]);
        let known = snapshot();
        let refused = known.open_conjuncts(&goal).expect_err("it takes too long");
        assert!(refused.contains("takes more than 3000000 steps"), "{refused}");
        let known = snapshot();
        assert!(!known.holds(&Condition::Not(Box::new(goal.clone()))), "it is not found out");
        assert!(!known.holds(&goal));
        let none = Plan { steps: Vec::new(), cost: None };
        let fault = known.validate(&none, &goal).expect_err("it is not found out");
        assert!(fault.contains("takes more than 3000000 steps"), "{fault}");
        // Other goals are still evaluated in the same snapshot.
        assert_eq!(known.open_conjuncts(&condition("(open hall)")), Ok(Vec::new()));
        assert!(known.holds(&condition("(door hall lab)")));
        assert!(known.validate(&none, &condition("(open hall)")).is_ok());
    }
}
