//! Plan repair: finds plans that return to the rest of an old plan as soon as possible.
//!
//! Each suffix of the rest has a macro operator, which represents all steps of the suffix. Its
//! precondition is the goal, regressed through these steps (Fritz and McIlraith, 2007; Muise,
//! McIlraith and Beck, 2011). Its cost is the total cost of the steps, and its effect is the goal.
//! A search with these operators finds both repairs and new plans, and returns the cheaper plan.

use pddl::{Plan, PlanStep};
use rustc_hash::FxHashMap;

use crate::task::{FactId, GroundOperator, Literal, OperatorId, Task};

/// A task with additional macro operators for suffixes of an old plan. They follow all other
/// operators.
pub(super) struct ResumableTask<'r> {
    pub(super) task: Task,
    /// Index of the first macro operator.
    first: usize,
    /// Position in `rest` at which the suffix of each macro operator begins.
    starts: Vec<usize>,
    rest: &'r [PlanStep],
}

// === impl ResumableTask ===

impl<'r> ResumableTask<'r> {
    /// Returns the task with additional macro operators, one for each suffix of `rest` through
    /// which the goal can be regressed. `rest` consists of the steps of the old plan that are not
    /// done. Only suffixes of operators of the task without conditional effects can be regressed.
    /// Returns `None` if there is no such suffix.
    pub(super) fn new(task: &Task, rest: &'r [PlanStep]) -> Option<ResumableTask<'r>> {
        let suffixes = suffixes(task, rest);
        if suffixes.is_empty() {
            return None;
        }
        let mut operators = task.operators.clone();
        let goal = |positive| {
            let literals = task.goal.iter().filter(move |one| one.is_positive() == positive);
            literals.map(|literal| literal.fact())
        };
        let schema = task.schema_names.len() as u32;
        for suffix in &suffixes {
            operators.push(schema, [], suffix.asked.iter().copied());
            let is_asked = |fact: &FactId, positive| {
                suffix.asked.binary_search(&Literal::new(*fact, positive)).is_ok()
            };
            let adds = goal(true).filter(|fact| !is_asked(fact, true));
            let deletes = goal(false).filter(|fact| !is_asked(fact, false));
            operators.set_effect(adds.collect::<Vec<_>>(), deletes.collect::<Vec<_>>(), []);
            operators.set_cost(suffix.cost);
        }
        let first = task.operator_count();
        let starts = suffixes.iter().map(|suffix| suffix.start).collect();
        let task = Task { costs_equal: false, ..task.with_operators(operators) };
        Some(ResumableTask { task, first, starts, rest })
    }

    /// Converts operators to a plan, in which the steps of its suffix replace each macro operator.
    /// Also returns whether the operators contain a macro operator.
    pub(super) fn plan(&self, operators: &[OperatorId]) -> (Plan, bool) {
        let (mut steps, mut resumes) = (Vec::new(), false);
        for id in operators {
            match id.index().checked_sub(self.first) {
                None => steps.push(self.task.step(*id)),
                Some(suffix) => {
                    resumes = true;
                    steps.extend_from_slice(&self.rest[self.starts[suffix]..]);
                }
            }
        }
        (Plan { steps, cost: None }, resumes)
    }
}

/// Precondition and cost of a suffix of the old plan.
struct Suffix {
    start: usize,
    /// Literals that must hold before the suffix, sorted.
    asked: Vec<Literal>,
    cost: u64,
}

/// Returns the suffixes of `rest` through which the goal can be regressed, from the shortest to the
/// longest.
fn suffixes(task: &Task, rest: &[PlanStep]) -> Vec<Suffix> {
    let first_derived = task.basic_count;
    if task.goal.iter().any(|literal| literal.fact().index() >= first_derived) {
        return Vec::new();
    }
    let operators = operators(task, rest);
    let (mut asked, mut cost) = (task.goal.clone(), 0u64);
    asked.sort_unstable();
    let mut suffixes = Vec::new();
    for (start, id) in operators.into_iter().enumerate().rev() {
        let Some(operator) = id.map(|id| task.operator(id)) else { break };
        let Some(before) = regressed(task, &asked, operator) else { break };
        asked = before;
        cost = cost.saturating_add(operator.cost);
        suffixes.push(Suffix { start, asked: asked.clone(), cost });
    }
    suffixes
}

/// Returns the operator of each step in `rest`; `None` if the task has no such operator any more.
fn operators(task: &Task, rest: &[PlanStep]) -> Vec<Option<OperatorId>> {
    let mut wanted: FxHashMap<&PlanStep, Option<OperatorId>> =
        rest.iter().map(|step| (step, None)).collect();
    let names: Vec<bool> = { task.schema_names.iter() }
        .map(|name| rest.iter().any(|step| step.action == *name))
        .collect();
    for (index, operator) in task.operators.iter().enumerate() {
        if !names[operator.schema as usize] {
            continue;
        }
        let id = OperatorId(index as u32);
        if let Some(found) = wanted.get_mut(&task.step(id)) {
            // A precondition with alternatives gives several operators for one step; any of them is
            // enough.
            found.get_or_insert(id);
        }
    }
    rest.iter().map(|step| wanted.get(step).copied().flatten()).collect()
}

/// Regresses the literals `asked` through an operator: returns the literals that must hold before
/// the operator, so that `asked` holds after it. Returns `None` if they cannot be computed, or if
/// `asked` cannot hold after the operator.
fn regressed(task: &Task, asked: &[Literal], operator: GroundOperator<'_>) -> Option<Vec<Literal>> {
    let is_basic = |literal: &Literal| literal.fact().index() < task.basic_count;
    let comparisons = task.basic_count..task.basic_count + task.comparisons.len();
    let depends_on_facts = |literal: &Literal| literal.fact().index() >= comparisons.end;
    let changes_numbers = !operator.effect.numeric.is_empty();
    if operator.conditional.iter().len() > 0
        || asked.iter().any(depends_on_facts)
        || changes_numbers && !asked.iter().all(is_basic)
    {
        return None;
    }
    let mut before = operator.preconditions.to_vec();
    for literal in asked {
        let is_in = |facts: &[FactId]| facts.contains(&literal.fact());
        let (made, unmade) = match literal.is_positive() {
            true => (is_in(operator.effect.adds), is_in(operator.effect.deletes)),
            false => (is_in(operator.effect.deletes), is_in(operator.effect.adds)),
        };
        match (made, unmade) {
            (true, _) => (),
            (false, true) => return None,
            (false, false) => before.push(*literal),
        }
    }
    before.sort_unstable();
    before.dedup();
    // The literals of one fact are next to each other, the positive one first.
    let contradicts = before.windows(2).any(|pair| pair[0].negated() == pair[1]);
    (!contradicts).then_some(before)
}
