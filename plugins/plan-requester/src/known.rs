//! The domain and the state as the Domain Maintainer knows them, read once for a round of
//! planning: “the plan request compiles all the state and domain information that may be required
//! to solve a planning problem” (the paper, “Plan Requester”).

use std::collections::{BTreeMap, BTreeSet, HashSet};
use std::sync::OnceLock;

use acl::AgentId;
use acl::content::{self, Offers, Proposal, Snapshot};
use pddl::knowledge::Knowledge;
use pddl::{
    ActionModel, Condition, Domain, Effect, FluentTerm, InitElement, Name, Plan, PlanStep, Problem,
};
use planner::explain::{self, Explanation, Guard};
use planner::goal::conjuncts_but;
use planner::order::interference;
use planner::validate::{Fault, World, cost_from};
use planner::{Budget, Cancel, Options, StopReason};

/// Candidates that grounding may look at for an explanation: a second, for the largest buildings.
const EXPLAINING_STEPS_MAX: u64 = 20_000_000;

/// States that may be looked at for one: some seconds in the largest buildings.
const EXPLAINING_EXPANSIONS_MAX: u64 = 50_000;

/// What is known, to plan in.
#[derive(Clone, Debug)]
pub(crate) struct Known {
    pub(crate) epoch: u64,
    pub(crate) domain: Domain,
    pub(crate) problem: Problem,
    /// The state that the problem begins in, or why there is none; for whoever asks first.
    world: OnceLock<Result<World, String>>,
    pub(crate) domain_text: String,
    pub(crate) offers: Offers,
    /// What everyone offers, planned with or not.
    pub(crate) all_offers: Offers,
    /// The problem with everyone, planned with or not.
    whole: Problem,
    /// What lets agents act by each schema.
    pub(crate) guards: BTreeMap<Name, Guard>,
    /// What agents could do that offer it no longer.
    former: Vec<ActionModel>,
    /// The words of the domain for what is unknown.
    knowledge: Knowledge,
    /// The same as they travel.
    pub(crate) words: BTreeMap<String, content::Auxiliary>,
    pub(crate) avoided: Avoided,
    /// Agents that other goals needed, and that are not planned with.
    pub(crate) spared: BTreeSet<AgentId>,
}

/// Actions that a goal's earlier plans failed with: they are not asked for again for a while.
pub(crate) type Avoided = BTreeMap<(AgentId, String), Held>;

/// What is held against an action.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Held {
    /// For a person.
    pub(crate) why: String,
    /// Whether it is not tried again for this goal.
    pub(crate) is_for_good: bool,
    /// Whether its agent does not offer it any more.
    pub(crate) is_withdrawn: bool,
}

impl Known {
    /// Reads a snapshot.
    ///
    /// # Errors
    ///
    /// If it is no PDDL, for a person.
    pub(crate) fn read(snapshot: Snapshot) -> Result<Known, String> {
        let Snapshot { epoch, domain, problem, offers, guards, former, knowledge, .. } = snapshot;
        let domain_text = domain;
        let domain = pddl::parse_domain(&domain_text).into_result().map_err(first)?;
        let problem = pddl::parse_problem(&problem).into_result().map_err(first)?;
        let guard = |(inside, guard): (String, acl::content::Guard)| {
            let (outside, predicate) = (Name::new(&guard.outside), Name::new(&guard.predicate));
            (Name::new(&inside), Guard { outside, predicate })
        };
        let guards = guards.into_iter().map(guard).collect();
        // What cannot be read explains nothing.
        let read = |text: &String| pddl::parse_action_model(text).into_result().ok();
        let former = former.iter().filter_map(read).collect();
        let (all_offers, whole, avoided) = (offers.clone(), problem.clone(), Avoided::new());
        Ok(Known {
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
            spared: BTreeSet::new(),
        })
    }

    /// The same without the actions that failed a moment ago.
    pub(crate) fn avoiding(mut self, avoided: Avoided) -> Known {
        let guards = take_avoided(&mut self.offers, &avoided);
        if !guards.is_empty() {
            self.leave_out(&guards);
            self.whole = self.problem.clone();
        }
        self.avoided = avoided;
        self
    }

    /// The same without the agents that other goals need.
    pub(crate) fn sparing(mut self, reserved: &BTreeSet<AgentId>) -> Known {
        let taken = reserved.iter().filter_map(|agent| self.offers.remove(agent));
        let guards = taken.flat_map(BTreeMap::into_values).map(|offer| offer.guard).collect();
        self.leave_out(&guards);
        self.spared.clone_from(reserved);
        self
    }

    /// Takes out of the problem that agents can act by these guards, as offers tell them.
    fn leave_out(&mut self, guards: &BTreeSet<String>) {
        // Ours to read: a Domain Maintainer prints them.
        let read = |guard: &String| pddl::parse_init_elements(guard).into_result().ok();
        let guards: HashSet<InitElement> = guards.iter().filter_map(read).flatten().collect();
        self.problem.init.retain(|fact| !guards.contains(fact));
        self.world = OnceLock::new();
    }

    fn world(&self) -> Result<&World, &str> {
        let world =
            self.world.get_or_init(|| World::initial(&self.domain, &self.problem).map_err(first));
        world.as_ref().map_err(String::as_str)
    }

    /// A condition in the words of the domain: that it is known to hold.
    pub(crate) fn sure(&self, condition: &Condition) -> Condition {
        self.knowledge.sure(condition)
    }

    /// The problem of reaching `goal` for sure from here.
    pub(crate) fn problem_of(&self, goal: &Condition) -> Problem {
        Problem { goal: self.knowledge.sure(goal), ..self.problem.clone() }
    }

    /// What of a goal is not known to hold: ground conjuncts.
    pub(crate) fn open_conjuncts(&self, goal: &Condition) -> Result<Vec<Condition>, String> {
        let world = self.world()?;
        let conjuncts = self.conjuncts(world, goal).into_iter();
        Ok(conjuncts.filter(|conjunct| !self.holds_in(world, conjunct)).collect())
    }

    /// The parts of a goal, in the words of who asked for it; itself, if it cannot be taken apart.
    pub(crate) fn parts(&self, goal: &Condition) -> Vec<Condition> {
        self.world().map_or_else(|_| vec![goal.clone()], |world| self.conjuncts(world, goal))
    }

    /// The same of a state.
    fn conjuncts(&self, world: &World, goal: &Condition) -> Vec<Condition> {
        // A device that has left may have said of a room what no device derives there now.
        let is_unknown = |atom: &pddl::Atom| {
            let unknown = self.knowledge.unknown(atom);
            unknown.is_some_and(|unknown| world.holds(&Condition::Atom(unknown)))
        };
        let parts = conjuncts_but(world, goal, &is_unknown);
        parts.iter().map(|part| self.knowledge.plain(part)).collect()
    }

    fn holds_in(&self, world: &World, condition: &Condition) -> bool {
        world.holds(&self.knowledge.sure(condition))
    }

    /// A conjunct of a goal that the goal also wants not to hold.
    pub(crate) fn contradiction(&self, goal: &Condition) -> Option<Condition> {
        let conjuncts = self.conjuncts(self.world().ok()?, goal);
        let denied = conjuncts.iter().filter_map(|conjunct| match conjunct {
            Condition::Not(inner) => Some(&**inner),
            _ => None,
        });
        let denied: Vec<_> = denied.collect();
        conjuncts.iter().find(|conjunct| denied.contains(conjunct)).cloned()
    }

    /// Whether not even the relaxation reaches a condition, with everyone's actions.
    pub(crate) fn is_hopeless(&self, condition: &Condition, cancel: &Cancel) -> bool {
        let Ok(open) = self.open_conjuncts(condition) else { return true };
        let open: Vec<_> = open.iter().map(|part| self.knowledge.sure(part)).collect();
        planner::goal::unreachable(&self.domain, &self.whole, &open, &bounded(), cancel)
            .is_ok_and(|unreachable| !unreachable.is_empty())
    }

    /// How a ground condition that is not known to hold stands, for a person.
    pub(crate) fn standing(&self, condition: &Condition) -> String {
        let denied = Condition::Not(Box::new(condition.clone()));
        match self.holds(&denied) {
            true => format!("`{condition}` does not hold"),
            false => format!("nobody knows whether `{condition}` holds"),
        }
    }

    /// Why a ground condition does not hold, where what is known says all: it is unknown, or a number is
    /// other than it should be and no action changes it.
    pub(crate) fn plain_reason(&self, condition: &Condition) -> Option<String> {
        let standing = self.standing(condition);
        let denied = Condition::Not(Box::new(condition.clone()));
        if !self.holds(&denied) {
            return Some(format!("{standing}, and nobody here can find out"));
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
            None => format!("nobody knows `{fluent}`"),
        };
        let values: Vec<String> = fluents.iter().map(value).collect();
        Some(format!("{standing}: {}, and no action here changes it", values.join(", ")))
    }

    /// Whether a condition is known to hold.
    pub(crate) fn holds(&self, condition: &Condition) -> bool {
        self.world().is_ok_and(|world| self.holds_in(world, condition))
    }

    /// Whether a plan can run beside steps of others, and leaves what they have reached of their
    /// goals; the steps are told under the names of their agents.
    pub(crate) fn can_run_beside<'g>(
        &self,
        plan: &Plan,
        steps: impl IntoIterator<Item = &'g PlanStep>,
        goals: impl IntoIterator<Item = &'g Condition>,
    ) -> bool {
        // A step that nobody offers any more fails by itself.
        let named = |step: &PlanStep| self.named(step, &self.all_offers).ok();
        let theirs: Vec<_> = steps.into_iter().filter_map(named).collect();
        self.world().is_ok_and(|now| {
            interference(now, &plan.steps, &theirs).is_none() && self.leaves(now, plan, goals)
        })
    }

    /// Whether what holds now of some goals holds at the end of a plan.
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
        let mut reached = goals.into_iter().flat_map(|goal| self.conjuncts(now, goal));
        reached.all(|conjunct| !self.holds_in(now, &conjunct) || self.holds_in(&end, &conjunct))
    }

    /// What it costs to do the rest of a plan from here; `None` if it does not reach its goal.
    pub(crate) fn cost_of_rest(&self, steps: &[PlanStep], goal: &Condition) -> Option<f64> {
        let steps = steps.iter().map(|step| self.named(step, &self.all_offers));
        let plan = Plan { steps: steps.collect::<Result<_, _>>().ok()?, cost: None };
        self.validate(&plan, goal).ok()
    }

    /// The steps of a plan from the first on after which all agents are there, under the names of
    /// the composite domain; `None` if there are none.
    pub(crate) fn nameable(&self, steps: &[PlanStep]) -> Option<Plan> {
        let named = steps.iter().rev().map_while(|step| self.named(step, &self.all_offers).ok());
        let mut steps: Vec<_> = named.collect();
        steps.reverse();
        (!steps.is_empty()).then_some(Plan { steps, cost: None })
    }

    /// A plan of everybody for parts of a goal, within the bounds of an explanation, and why planning
    /// ended; `None` if nothing can be planned.
    pub(crate) fn plan_for(
        &self,
        parts: &[Condition],
        cancel: &Cancel,
    ) -> Option<(Option<Plan>, StopReason)> {
        let goal = self.knowledge.sure(&Condition::And(parts.to_vec()));
        let problem = Problem { goal, ..self.whole.clone() };
        let outcome = planner::plan(&self.domain, &problem, &looking(), cancel).ok()?;
        Some((outcome.plan, outcome.stop_reason))
    }

    /// Which of these not even the relaxation reaches, where no action undoes another, and what is
    /// missing.
    pub(crate) fn explain(&self, conjuncts: &[Condition], cancel: &Cancel) -> Option<Explanation> {
        let Known { domain, whole: problem, guards, former, .. } = self;
        let known = explain::Known { domain, problem, guards, former };
        // What cannot be analyzed explains nothing.
        explain::explain(known, conjuncts, &bounded(), cancel).ok()
    }

    /// One plan of several agents' plans, under the names of the composite domain.
    pub(crate) fn combine(&self, plans: &[&str]) -> Result<Plan, String> {
        let mut steps = Vec::new();
        for text in plans {
            let plan = pddl::parse_plan(text).into_result().map_err(first)?;
            for step in plan.steps {
                steps.push(self.inside(step)?);
            }
        }
        Ok(Plan { steps, cost: None })
    }

    /// The cost of a plan that reaches `goal`, or why it does not.
    pub(crate) fn validate(&self, plan: &Plan, goal: &Condition) -> Result<f64, String> {
        let goal = self.knowledge.sure(goal);
        let fault = |fault: Box<Fault>| fault.map(|part| self.knowledge.plain(part)).to_string();
        cost_from(self.world()?, &plan.steps, &goal).map_err(fault)
    }

    /// Whether a plan of an agent's own has steps, nothing is held against any of them, and all are
    /// offered.
    pub(crate) fn admits(&self, plan: &str) -> bool {
        self.combine(&[plan]).is_ok_and(|plan| !plan.steps.is_empty())
    }

    /// Whether a plan has a step that its agent is not known to offer, though the agent itself is known: it
    /// has announced a newer action model, which the Domain Maintainer has not heard yet.
    pub(crate) fn is_behind(&self, plan: &str) -> bool {
        let is_newer = |step: &PlanStep| {
            let agent = step.arguments.first().map_or("", |agent| agent.as_str());
            let known = self.all_offers.get(agent);
            known.is_some_and(|actions| !actions.contains_key(step.action.as_str()))
        };
        pddl::parse_plan(plan).into_result().is_ok_and(|plan| plan.steps.iter().any(is_newer))
    }

    /// Whether an agent's plan alone reaches all that it is proposed for.
    pub(crate) fn is_sound(&self, proposal: &Proposal) -> bool {
        let read = |text: &String| pddl::parse_condition(text).into_result().ok();
        let covered: Option<Vec<_>> = proposal.covers.iter().map(read).collect();
        let plan = self.combine(&[&proposal.plan]);
        let (Some(covered), Ok(plan)) = (covered, plan) else { return false };
        self.validate(&plan, &Condition::And(covered)).is_ok()
    }

    fn inside(&self, step: PlanStep) -> Result<PlanStep, String> {
        let agent = step.arguments.first().and_then(|agent| AgentId::new(agent.as_str()).ok());
        let is_avoided =
            |agent| self.avoided.contains_key(&(agent, step.action.as_str().to_owned()));
        if agent.is_some_and(is_avoided) {
            return Err(format!("`{step}` failed a moment ago"));
        }
        self.named(&step, &self.offers)
    }

    /// A step of an agent's own naming, under the names of the composite domain.
    fn named(&self, step: &PlanStep, offers: &Offers) -> Result<PlanStep, String> {
        let offer = step
            .arguments
            .first()
            .and_then(|agent| offers.get(agent.as_str()))
            .and_then(|actions| actions.get(step.action.as_str()))
            .ok_or_else(|| format!("nobody offers `{step}`"))?;
        Ok(PlanStep { action: offer.inside.as_str().into(), ..step.clone() })
    }

    /// A plan for people: every action under the name its agent knows.
    pub(crate) fn outside(&self, plan: &Plan) -> Plan {
        let steps = plan.steps.iter().map(|step| outside(step, &self.offers));
        Plan { steps: steps.collect(), cost: plan.cost }
    }

    /// The offers of the agents that act in a plan.
    pub(crate) fn offers_of(&self, plan: &Plan) -> Offers {
        let acting: BTreeSet<&str> = plan
            .steps
            .iter()
            .filter_map(|step| step.arguments.first())
            .map(|agent| agent.as_str())
            .collect();
        let is_acting = |agent: &AgentId| acting.contains(agent.as_str());
        let offers = self.offers.iter().filter(|(agent, _)| is_acting(agent));
        offers.map(|(agent, actions)| (agent.clone(), actions.clone())).collect()
    }
}

/// A step under the name that its agent knows the action by.
pub(crate) fn outside(step: &PlanStep, offers: &Offers) -> PlanStep {
    let agent = step.arguments.first().map_or("", |agent| agent.as_str());
    let offered = offers.get(agent).into_iter().flatten();
    let named = { offered }.find(|(_, offer)| step.action == *offer.inside.as_str());
    let action = named.map_or(step.action.as_str(), |(outside, _)| outside.as_str());
    PlanStep { action: action.into(), ..step.clone() }
}

/// What looking for a reason may take.
fn bounded() -> Options {
    let budget = Budget {
        join_steps_max: EXPLAINING_STEPS_MAX,
        memory_max_bytes: agent::computation_bytes_max(),
        ..Budget::default()
    };
    Options { budget, ..Options::default() }
}

/// What looking for a plan of several agents may take: it is for a sentence.
fn looking() -> Options {
    let budget = Budget { expansions_max: EXPLAINING_EXPANSIONS_MAX, ..bounded().budget };
    Options { budget, ..Options::default() }
}

/// Takes the avoided actions out of the offers; yields the facts that stood for them.
fn take_avoided(offers: &mut Offers, avoided: &Avoided) -> BTreeSet<String> {
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
