//! Operators as both directions read them: literals of basic facts, and what becomes of them.

use crate::task::{FactId, Literal, Operator, Task};

use super::pairs;

/// All operators of a task.
#[derive(Debug)]
pub(super) struct View {
    fact_count: usize,
    literals: Vec<Literal>,
    /// Where the parts of each operator end; the first row ends nothing.
    rows: Vec<Row>,
    pub(super) initial: Vec<Literal>,
    pub(super) goal: Vec<Literal>,
}

#[derive(Clone, Copy, Debug, Default)]
struct Row {
    preconditions: usize,
    sure: usize,
    possible: usize,
    after: usize,
    free: usize,
}

/// One operator.
#[derive(Clone, Copy, Debug)]
pub(super) struct OperatorView<'v> {
    /// What must hold before.
    pub(super) preconditions: &'v [Literal],
    /// What it makes true in any case.
    pub(super) sure: &'v [Literal],
    /// What it may make true.
    pub(super) possible: &'v [Literal],
    /// What holds after it: what it makes true, and preconditions that it does not touch.
    pub(super) after: &'v [Literal],
    /// Literals of facts that it may change and does not ask for: they may have been so before.
    pub(super) free: &'v [Literal],
}

// === impl View ===

impl View {
    pub(super) fn of(task: &Task) -> View {
        let is_basic = |literal: &Literal| literal.fact().index() < task.basic_count;
        let mut is_true = vec![false; task.basic_count];
        task.initial.iter().for_each(|fact| is_true[fact.index()] = true);
        let initial = pairs::facts(task.basic_count)
            .map(|fact| if is_true[fact.fact().index()] { fact } else { fact.negated() })
            .collect();
        let mut view = View {
            fact_count: task.basic_count,
            literals: Vec::new(),
            rows: vec![Row::default()],
            initial,
            goal: task.goal.iter().copied().filter(is_basic).collect(),
        };
        task.operators.iter().for_each(|operator| view.push(operator));
        view
    }

    fn push(&mut self, operator: Operator<'_>) {
        let basic = self.fact_count;
        let is_basic = |literal: &Literal| literal.fact().index() < basic;
        let preconditions: Vec<Literal> =
            operator.preconditions.iter().copied().filter(is_basic).collect();
        let conditional = || operator.conditional.iter().map(|one| one.effect);
        let is_added = |fact: &FactId| operator.effect.adds.contains(fact);
        let may_add: Vec<FactId> =
            conditional().flat_map(|effect| effect.adds.iter().copied()).collect();
        let deletes = operator.effect.deletes.iter().filter(|fact| !is_added(fact));
        let (mut sure, mut possible) = (Vec::new(), Vec::new());
        sure.extend(operator.effect.adds.iter().map(|fact| Literal::new(*fact, true)));
        for fact in deletes {
            let list = if may_add.contains(fact) { &mut possible } else { &mut sure };
            list.push(Literal::new(*fact, false));
        }
        possible.extend(
            may_add.iter().filter(|fact| !is_added(fact)).map(|fact| Literal::new(*fact, true)),
        );
        let may_delete = conditional().flat_map(|effect| effect.deletes.iter());
        possible.extend(
            may_delete.filter(|fact| !is_added(fact)).map(|fact| Literal::new(*fact, false)),
        );
        possible.retain(|literal| !sure.contains(literal));
        for list in [&mut sure, &mut possible] {
            list.sort_unstable();
            list.dedup();
        }
        let is_touched = |literal: &Literal| {
            sure.iter().chain(&possible).any(|one| one.fact() == literal.fact())
        };
        let kept = preconditions.iter().copied().filter(|literal| !is_touched(literal));
        let after: Vec<Literal> = sure.iter().copied().chain(kept).collect();
        let is_asked =
            |literal: &&Literal| preconditions.iter().any(|one| one.fact() == literal.fact());
        let unasked = sure.iter().chain(&possible).filter(|literal| !is_asked(literal));
        let free: Vec<Literal> = unasked.flat_map(|one| [*one, one.negated()]).collect();
        let mut end = |list: &[Literal]| {
            self.literals.extend_from_slice(list);
            self.literals.len()
        };
        self.rows.push(Row {
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

// === impl OperatorView ===

impl OperatorView<'_> {
    /// How many rows of pairs one look at it reads and writes, roughly.
    pub(super) fn size(&self) -> usize {
        self.preconditions.len() + self.after.len() + self.possible.len() + self.free.len() + 2
    }
}
