//! Views of operators for the forward and the backward analysis: the literals of basic facts before
//! and after each operator.

use crate::task::{FactId, GroundOperator, Literal, Task};

/// Views of all operators of a task, in one array.
#[derive(Debug)]
pub(super) struct OperatorViews {
    fact_count: usize,
    literals: Vec<Literal>,
    /// Per operator: the ends of its lists of literals. The first row contains zeros, as the start
    /// of the first operator.
    rows: Vec<ViewRow>,
    pub(super) initial: Vec<Literal>,
    pub(super) goal: Vec<Literal>,
}

#[derive(Clone, Copy, Debug, Default)]
struct ViewRow {
    preconditions: usize,
    sure: usize,
    possible: usize,
    after: usize,
    free: usize,
}

/// View of one operator: lists of literals of basic facts.
#[derive(Clone, Copy, Debug)]
pub(super) struct OperatorView<'v> {
    /// Literals of the precondition.
    pub(super) preconditions: &'v [Literal],
    /// Literals that every application of the operator makes true.
    pub(super) sure: &'v [Literal],
    /// Literals that conditional effects of the operator may make true.
    pub(super) possible: &'v [Literal],
    /// Literals that hold after the operator: those in `sure`, and the preconditions that it does
    /// not change.
    pub(super) after: &'v [Literal],
    /// Positive and negative literals of all facts that the operator may change and that are not in
    /// its precondition. Either literal of such a fact may hold before the operator.
    pub(super) free: &'v [Literal],
}

// === impl OperatorViews ===

impl OperatorViews {
    pub(super) fn of(task: &Task) -> OperatorViews {
        let is_basic = |literal: &Literal| literal.fact().index() < task.basic_count;
        let mut is_true = vec![false; task.basic_count];
        task.initial.iter().for_each(|fact| is_true[fact.index()] = true);
        let literal =
            |(index, truth): (usize, &bool)| Literal::new(FactId::from_index(index), *truth);
        let initial = is_true.iter().enumerate().map(literal).collect();
        let mut view = OperatorViews {
            fact_count: task.basic_count,
            literals: Vec::new(),
            rows: vec![ViewRow::default()],
            initial,
            goal: task.goal.iter().copied().filter(is_basic).collect(),
        };
        task.operators.iter().for_each(|operator| view.push(operator));
        view
    }

    fn push(&mut self, operator: GroundOperator<'_>) {
        let basic = self.fact_count;
        let is_basic = |literal: &Literal| literal.fact().index() < basic;
        let preconditions: Vec<Literal> =
            operator.preconditions.iter().copied().filter(is_basic).collect();
        let (sure, possible) = outcomes(operator);
        let speak_of = |sorted: &[Literal], literal: &Literal| {
            sorted.binary_search_by_key(&literal.fact(), |one| one.fact()).is_ok()
        };
        let is_kept = |one: &Literal| !speak_of(&sure, one) && !speak_of(&possible, one);
        let kept = preconditions.iter().copied().filter(is_kept);
        let after: Vec<Literal> = sure.iter().copied().chain(kept).collect();
        let unasked = sure.iter().chain(&possible).filter(|one| !speak_of(&preconditions, one));
        let free: Vec<Literal> = unasked.flat_map(|one| [*one, one.negated()]).collect();
        let mut end = |list: &[Literal]| {
            self.literals.extend_from_slice(list);
            self.literals.len()
        };
        self.rows.push(ViewRow {
            preconditions: end(&preconditions),
            sure: end(&sure),
            possible: end(&possible),
            after: end(&after),
            free: end(&free),
        });
    }

    pub(super) fn operator(&self, index: usize) -> OperatorView<'_> {
        let (from, to) = (&self.rows[index], &self.rows[index + 1]);
        OperatorView {
            preconditions: &self.literals[from.free..to.preconditions],
            sure: &self.literals[to.preconditions..to.sure],
            possible: &self.literals[to.sure..to.possible],
            after: &self.literals[to.possible..to.after],
            free: &self.literals[to.after..to.free],
        }
    }
}

/// Returns two sorted lists of literals: those that every application of an operator makes true,
/// and those that some application may make true.
fn outcomes(operator: GroundOperator<'_>) -> (Vec<Literal>, Vec<Literal>) {
    let literals = |facts: &[FactId], positive| -> Vec<Literal> {
        facts.iter().map(|fact| Literal::new(*fact, positive)).collect()
    };
    let tidy = |literals: &mut Vec<Literal>| {
        literals.sort_unstable();
        literals.dedup();
    };
    let mut sure = literals(operator.effect.adds, true);
    tidy(&mut sure);
    let mut possible = Vec::new();
    for one in operator.conditional.iter() {
        possible.extend(literals(one.effect.adds, true));
        possible.extend(literals(one.effect.deletes, false));
    }
    tidy(&mut possible);
    // Adds take precedence over deletes.
    possible.retain(|one| sure.binary_search(&Literal::new(one.fact(), true)).is_err());
    let mut deletes = literals(operator.effect.deletes, false);
    deletes.retain(|delete| sure.binary_search(&delete.negated()).is_err());
    let (uncertain, certain): (Vec<_>, Vec<_>) =
        deletes.into_iter().partition(|delete| possible.binary_search(&delete.negated()).is_ok());
    possible.retain(|one| certain.binary_search(one).is_err());
    possible.extend(uncertain);
    sure.extend(certain);
    tidy(&mut sure);
    tidy(&mut possible);
    (sure, possible)
}

// === impl OperatorView ===

impl OperatorView<'_> {
    /// Returns the approximate number of rows of pairs that one application of the operator reads
    /// and writes.
    pub(super) fn size(&self) -> usize {
        self.preconditions.len() + self.after.len() + self.possible.len() + self.free.len() + 2
    }
}
