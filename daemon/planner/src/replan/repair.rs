//! Plans that go back to the rest of an old one as soon as they can.
//!
//! For each suffix of the rest there is an operator that stands for all its steps: it asks for what
//! they need (the goal, regressed through them: Fritz and McIlraith, 2007; Muise, McIlraith and
//! Beck, 2011), costs what they cost, and reaches the goal. A search with these finds repairs and new
//! plans alike, and takes the cheaper.

use pddl::{Plan, PlanStep};
use rustc_hash::FxHashMap;

use crate::task::{FactId, Literal, Operator, OperatorId, Task};

/// A task whose last operators stand for suffixes of an old plan.
pub(super) struct Resumable<'r> {
    pub(super) task: Task,
    /// The first operator that is a suffix.
    first: usize,
    /// Where each suffix starts.
    starts: Vec<usize>,
    rest: &'r [PlanStep],
}

// === impl Resumable ===

impl<'r> Resumable<'r> {
    /// The task with an operator for each suffix of `rest` that can be regressed: of steps that are
    /// known, whose effects are facts that change in any case.
    pub(super) fn new(task: &Task, rest: &'r [PlanStep]) -> Option<Resumable<'r>> {
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
        Some(Resumable { task, first, starts, rest })
    }

    /// The plan that operators stand for, and whether one of them is a suffix.
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

/// What a suffix asks for, and what it costs.
struct Suffix {
    start: usize,
    /// Sorted.
    asked: Vec<Literal>,
    cost: u64,
}

/// The suffixes of the rest from the shortest on, as far back as regression goes.
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

/// The operator of each step, where there still is one.
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
            // Several stand for one step where its precondition has alternatives; one is enough.
            found.get_or_insert(id);
        }
    }
    rest.iter().map(|step| wanted.get(step).copied().flatten()).collect()
}

/// What must hold before an operator so that `asked` holds after it; `None` if it cannot be told, or
/// never does.
fn regressed(task: &Task, asked: &[Literal], operator: Operator<'_>) -> Option<Vec<Literal>> {
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
    // Literals of one fact are neighbors, the positive one first.
    let contradicts = before.windows(2).any(|pair| pair[0].negated() == pair[1]);
    (!contradicts).then_some(before)
}
