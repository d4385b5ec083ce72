//! Dry runs: plans for a goal in the present state without requesting it. The domain, the state and
//! the goals are those of a snapshot, so a dry run sends no message to an agent and changes nothing.
//!
//! The checks are those of the Plan Requester: names, contradictions, conjuncts that hold, kept goals
//! that a plan must not undo, and the explanation if there is no plan. The plan is that of the
//! embedded planner with the actions of all agents. In the decentralised flow the actuators bid, and
//! the plan that is carried out may be another one.

use acl::ConversationId;
use acl::content::{GoalStatus, Keep, Snapshot};
use pddl::{Atom, Condition, Plan, PlanStep};
use planner::{Budget, Cancel, Options, StopReason};
use serde::Serialize;

use crate::planning_snapshot::PlanningSnapshot;
use crate::{goal_check, planning};

/// A goal that a dry run plans for, as a person would request it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DryRunRequest {
    /// The goal, in PDDL.
    pub goal: String,
    /// Priority of the goal. A plan must not undo kept goals of at least this priority.
    pub priority: i32,
}

/// The result of a dry run.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct DryRunResult {
    /// The goal, in PDDL.
    pub goal: String,
    /// Whether the goal holds already, so that nothing needs to be done.
    #[serde(rename = "already")]
    pub holds: bool,
    /// The steps of the plan; empty if the goal holds already or there is no plan.
    pub plan: Vec<DryRunStep>,
    /// Cost of the plan; `None` if there is no plan.
    pub cost: Option<f64>,
    /// The public facts that hold now and do not hold after the plan, in PDDL.
    pub undoes: Vec<String>,
    /// The conjuncts of other goals that hold now and do not hold after the plan.
    pub threatens: Vec<ThreatenedGoal>,
    /// The reason why there is no plan, as text for a person; `None` if there is one.
    pub problem: Option<String>,
}

/// A step of the plan of a dry run.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct DryRunStep {
    /// The step, in PDDL, with the agent's own name for the action.
    pub step: String,
    /// Name of the agent that would act.
    pub agent: String,
    /// The steps that must end before this one begins, counted from 0.
    pub after: Vec<usize>,
    /// Longest time that the method of the step may take, in milliseconds; `None` if it is unknown.
    pub limit: Option<u64>,
    /// Expected start of the step in milliseconds from the start of the plan; `None` if the usual
    /// time of a step before it is unknown.
    pub start: Option<u64>,
    /// The usual time of the step in milliseconds; `None` if it is unknown.
    pub duration: Option<u64>,
}

/// A conjunct of a goal that a plan would undo.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct ThreatenedGoal {
    /// Conversation of the goal.
    pub conversation: ConversationId,
    /// The goal, in PDDL.
    pub goal: String,
    /// The conjunct that would not hold any more, in PDDL.
    pub conjunct: String,
}

/// Plans for a goal in the state of `snapshot` without requesting it. `goals` are the goals that are
/// pursued now. A caller with a clock ends the search by `cancel`.
pub fn dry_run(
    snapshot: Snapshot,
    goals: &[GoalStatus],
    request: &DryRunRequest,
    cancel: &Cancel,
) -> DryRunResult {
    let mut result = DryRunResult { goal: request.goal.clone(), ..DryRunResult::default() };
    if let Err(problem) = attempt(snapshot, goals, request, cancel, &mut result) {
        result.problem = Some(problem);
    }
    result
}

/// Fills `result`.
///
/// # Errors
///
/// Returns the reason why there is no plan, as text for a person.
fn attempt(
    snapshot: Snapshot,
    goals: &[GoalStatus],
    request: &DryRunRequest,
    cancel: &Cancel,
    result: &mut DryRunResult,
) -> Result<(), String> {
    let condition = pddl::parse_condition(&request.goal).into_result().map_err(|found| {
        let lines: Vec<_> = found.iter().map(|mistake| mistake.located(&request.goal)).collect();
        lines.join("\n")
    })?;
    result.goal = condition.to_string();
    let known = PlanningSnapshot::read(snapshot)?;
    if let Some(mistakes) = goal_check::mistakes(&condition, &request.goal, &known) {
        return Err(mistakes);
    }
    let open = known.open_conjuncts(&condition)?;
    if open.is_empty() {
        result.holds = true;
        return Ok(());
    }
    let others = readable(goals);
    let kept: Vec<_> = { others.iter() }
        .filter(|(goal, _)| goal.keep == Keep::Maintain && goal.priority >= request.priority)
        .filter(|(_, kept)| known.holds(kept))
        .map(|(goal, kept)| (goal.goal.as_str(), kept.clone()))
        .collect();
    let wanted = match kept.as_slice() {
        [] => condition.clone(),
        kept => {
            let kept = kept.iter().map(|(_, kept)| kept.clone());
            Condition::And(std::iter::once(condition.clone()).chain(kept).collect())
        }
    };
    let plan = match search(&known, &wanted, cancel)? {
        Ok(plan) => plan,
        Err(reason) => {
            return Err(missing(&known, (&condition, &open), &kept, reason, cancel));
        }
    };
    result.cost = Some(known.validate(&plan, &wanted)?);
    result.plan = steps(&known, &plan);
    result.undoes = known.undone_facts(&plan)?.iter().map(Atom::to_string).collect();
    for (goal, condition) in &others {
        let undone = known.undone_conjuncts(&plan, condition);
        result.threatens.extend(undone.iter().map(|conjunct| ThreatenedGoal {
            conversation: goal.conversation.clone(),
            goal: goal.goal.clone(),
            conjunct: conjunct.to_string(),
        }));
    }
    Ok(())
}

/// Returns the goals that can be parsed, each with its condition. The Plan Requester has parsed all
/// of them.
fn readable(goals: &[GoalStatus]) -> Vec<(&GoalStatus, Condition)> {
    let read = |goal: &str| pddl::parse_condition(goal).into_result().ok();
    // A goal that waits for its time is not pursued.
    let pursued = goals.iter().filter(|goal| !goal.waits_for_its_time());
    pursued.filter_map(|goal| Some((goal, read(&goal.goal)?))).collect()
}

/// Plans for `wanted`. Returns the plan, or the reason why the search ended without one.
///
/// # Errors
///
/// Returns an error, as text for a person, if the domain or the problem cannot be planned with.
fn search(
    known: &PlanningSnapshot,
    wanted: &Condition,
    cancel: &Cancel,
) -> Result<Result<Plan, StopReason>, String> {
    let memory_max_bytes = agent::computation_bytes_max();
    let budget = Budget { memory_max_bytes, ..Budget::default() };
    let options = Options { budget, ..Options::default() };
    let outcome = planner::plan(&known.domain, &known.problem_of(wanted), &options, cancel)
        .map_err(|error| format!("the planner cannot plan for it: {error}"))?;
    Ok(outcome.plan.ok_or(outcome.stop_reason))
}

/// Returns the reason why there is no plan for the condition `goal`, of which the conjuncts `open`
/// do not hold, as text for a person. `kept` are the kept goals that the plan had to leave as they
/// are.
fn missing(
    known: &PlanningSnapshot,
    (goal, open): (&Condition, &[Condition]),
    kept: &[(&str, Condition)],
    reason: StopReason,
    cancel: &Cancel,
) -> String {
    if !matches!(reason, StopReason::Unsolvable { .. }) {
        return format!("no plan was found: {reason}");
    }
    if !kept.is_empty()
        && let Ok(Ok(plan)) = search(known, goal, cancel)
    {
        let is_undone = |kept: &Condition| !known.undone_conjuncts(&plan, kept).is_empty();
        let undone = kept.iter().filter(|(_, condition)| is_undone(condition));
        let undone: Vec<_> = undone.map(|(text, _)| format!("`{text}`")).collect();
        return match undone.is_empty() {
            true => "no plan leaves the kept goals as they are".to_owned(),
            false => format!("every plan would undo what is kept: {}", undone.join(", ")),
        };
    }
    let otherwise = |explanation: &planner::explain::Explanation| explanation.to_string();
    planning::explain(known, open, cancel, otherwise)
        .unwrap_or_else(|| "no plan reaches it, and the reason was not found".to_owned())
}

/// Returns the steps of a plan for people and programs.
fn steps(known: &PlanningSnapshot, plan: &Plan) -> Vec<DryRunStep> {
    let order = known.order_of(plan);
    let outside = known.outside(plan).steps;
    let described = |(at, step): (usize, &PlanStep)| {
        let agent = step.arguments.first().map_or("", |agent| agent.as_str());
        let acting = known.actors(step);
        let limits = acting.iter().filter_map(|agent| {
            let offer = known.all_offers.get(agent)?.get(step.action.as_str())?;
            Some(offer.method.as_ref()?.timeout.0.as_millis())
        });
        let limit = limits.max();
        DryRunStep {
            step: step.to_string(),
            agent: agent.to_owned(),
            after: order.predecessors.get(at).cloned().unwrap_or_default(),
            limit: limit.map(|limit| u64::try_from(limit).unwrap_or(u64::MAX)),
            start: None,
            duration: None,
        }
    };
    outside.iter().enumerate().map(described).collect()
}

// === impl DryRunResult ===

impl DryRunResult {
    /// Computes the start of each step from the usual times of the steps, as far as `usual_ms` knows
    /// them. A step begins when all steps that it waits for have ended.
    pub fn add_times(&mut self, usual_ms: impl Fn(&DryRunStep) -> Option<u64>) {
        for step in &mut self.plan {
            step.duration = usual_ms(step);
        }
        for at in 0..self.plan.len() {
            let end = |before: &usize| {
                let before = self.plan.get(*before)?;
                Some(before.start?.saturating_add(before.duration?))
            };
            let ends: Option<Vec<u64>> = self.plan[at].after.iter().map(end).collect();
            self.plan[at].start = ends.map(|ends| ends.into_iter().max().unwrap_or(0));
        }
    }
}

#[cfg(test)]
mod tests {
    use acl::Millis;
    use acl::content::GoalPhase;
    use std::time::Duration;

    use super::*;

    const DOMAIN: &str = "(define (domain office) (:requirements :typing :action-costs)
        (:types room device - object robot - device)
        (:predicates (at ?r - robot ?p - room) (door ?a ?b - room) (lit ?p - room) (dark ?p - room)
            (can-move ?r - robot) (can-dim ?d - device) (:private (docked ?r - robot)))
        (:functions (total-cost) - number)
        (:action move :parameters (?r - robot ?from ?to - room)
            :precondition (and (can-move ?r) (at ?r ?from) (door ?from ?to))
            :effect (and (not (at ?r ?from)) (at ?r ?to) (not (docked ?r))
                (increase (total-cost) 3)))
        (:action dim :parameters (?d - device ?p - room)
            :precondition (and (can-dim ?d) (lit ?p))
            :effect (and (not (lit ?p)) (dark ?p) (increase (total-cost) 1))))";

    const PROBLEM: &str = "(define (problem now) (:domain office)
        (:objects hall lab attic - room r1 - robot lamp - device)
        (:init (at r1 hall) (door hall lab) (lit lab) (can-move r1) (can-dim lamp) (docked r1)
            (= (total-cost) 0))
        (:goal (and)) (:metric minimize (total-cost)))";

    fn snapshot() -> Snapshot {
        let offer = |schema: &str, guard: &str| {
            serde_json::json!({ "schema": schema, "guard": guard, "method":
                { "method": schema, "arguments": {}, "timeout": Millis(Duration::from_secs(7)) } })
        };
        let snapshot = serde_json::json!({
            "epoch": 1, "revision": 1, "domain": DOMAIN, "digest": "", "problem": PROBLEM,
            "offers": { "r1": { "move": offer("move", "(can-move r1)") },
                "lamp": { "dim": offer("dim", "(can-dim lamp)") } },
            "guards": { "move": { "action": "move", "predicate": "can-move" },
                "dim": { "action": "dim", "predicate": "can-dim" } },
        });
        serde_json::from_value(snapshot).expect("a snapshot")
    }

    fn pursued(goal: &str, keep: Keep) -> GoalStatus {
        GoalStatus {
            number: 1,
            conversation: ConversationId::new("g"),
            goal: goal.to_owned(),
            keep,
            priority: 0,
            phase: GoalPhase::Holding,
            waits_because: String::new(),
            rounds: 1,
            history: Vec::new(),
            due: None,
        }
    }

    fn run(goal: &str, goals: &[GoalStatus]) -> DryRunResult {
        let request = DryRunRequest { goal: goal.to_owned(), priority: 0 };
        dry_run(snapshot(), goals, &request, &Cancel::new())
    }

    #[test]
    fn a_plan_is_told_with_its_cost_and_with_what_it_undoes() {
        let found = run("(at r1 lab)", &[]);
        assert_eq!(found.problem, None);
        assert!(!found.holds);
        let [step] = found.plan.as_slice() else { panic!("{found:?}") };
        assert_eq!((step.step.as_str(), step.agent.as_str()), ("(move r1 hall lab)", "r1"));
        assert_eq!((step.limit, &step.after), (Some(7_000), &Vec::new()));
        assert_eq!(found.cost, Some(3.0));
        // A private fact of the robot is not told.
        assert_eq!(found.undoes, ["(at r1 hall)"]);
    }

    #[test]
    fn a_goal_that_holds_needs_no_plan() {
        let found = run("(at r1 hall)", &[]);
        assert!(found.holds && found.plan.is_empty() && found.problem.is_none(), "{found:?}");
    }

    #[test]
    fn a_missing_plan_is_explained() {
        let found = run("(at r1 attic)", &[]);
        assert!(found.plan.is_empty() && found.cost.is_none());
        assert!(found.problem.is_some_and(|why| why.contains("attic")));
        let unknown = run("(at r9 hall)", &[]).problem.expect("a mistake");
        assert!(unknown.contains("`r9`"), "{unknown}");
        let unreadable = run("(at r1 hall", &[]).problem.expect("a mistake");
        assert!(unreadable.contains("unclosed"), "{unreadable}");
    }

    #[test]
    fn a_kept_goal_is_not_undone() {
        let kept = [pursued("(lit lab)", Keep::Maintain)];
        let found = run("(dark lab)", &kept);
        let problem = found.problem.expect("a conflict");
        assert_eq!(problem, "every plan would undo what is kept: `(lit lab)`");
        let once = run("(dark lab)", &[pursued("(lit lab)", Keep::Achieve)]);
        assert_eq!(once.problem, None);
        assert_eq!(once.threatens.len(), 1, "{once:?}");
        assert_eq!(once.threatens[0].conjunct, "(lit lab)");
    }

    #[test]
    fn steps_begin_when_those_before_them_end() {
        let step = |after: &[usize]| DryRunStep {
            step: String::new(),
            agent: String::new(),
            after: after.to_vec(),
            limit: None,
            start: None,
            duration: None,
        };
        let plan = vec![step(&[]), step(&[]), step(&[0, 1]), step(&[2])];
        let mut found = DryRunResult { plan, ..DryRunResult::default() };
        found.add_times(|_| Some(500));
        let starts: Vec<_> = found.plan.iter().map(|step| step.start).collect();
        assert_eq!(starts, [Some(0), Some(0), Some(500), Some(1_000)]);
        found.add_times(|_| None);
        let starts: Vec<_> = found.plan.iter().map(|step| step.start).collect();
        assert_eq!(starts, [Some(0), Some(0), None, None]);
    }
}
