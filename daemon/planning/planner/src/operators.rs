//! Ground actions in flat arrays, which are read through small structs of references.
//!
//! A task may have millions of operators. Each occupies a few numbers here, without an allocation
//! of its own. `ground` first fills an operator table over raw facts, and then the operator table
//! of the task.

use crate::ground_terms::{FactId, Literal, NumericChange, ObjectId};

/// An operator: a ground action, read from the arrays of an [`OperatorTable`].
#[derive(Clone, Copy, Debug)]
pub(crate) struct GroundOperator<'t> {
    /// Index of the operator's action schema.
    pub(crate) schema: u32,
    /// Objects for the parameters of the schema. If the action has an agent, it comes first.
    pub(crate) arguments: &'t [ObjectId],
    /// Literals of the precondition, sorted.
    pub(crate) preconditions: &'t [Literal],
    /// The unconditional effect of the operator.
    pub(crate) effect: Changes<'t>,
    /// Conditional effects of the operator. All their conditions are evaluated in the state before
    /// the operator.
    pub(crate) conditional: ConditionalEffects<'t>,
    /// Cost of the operator, in units of [`Task::cost_unit`](crate::task::Task::cost_unit).
    pub(crate) cost: u64,
}

/// An effect: changes of facts and numbers that occur together. A fact that is both deleted and
/// added becomes true.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(crate) struct Changes<'t> {
    pub(crate) adds: &'t [FactId],
    pub(crate) deletes: &'t [FactId],
    pub(crate) numeric: &'t [NumericChange],
}

/// A conditional effect: changes that occur if the conditions hold in the state before the
/// operator.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ConditionalEffect<'t> {
    pub(crate) conditions: &'t [Literal],
    pub(crate) effect: Changes<'t>,
}

/// The conditional effects of one operator.
#[derive(Clone, Copy, Debug)]
pub(crate) struct ConditionalEffects<'t> {
    table: &'t ConditionalTable,
    start: u32,
    end: u32,
}

/// All operators of a task.
#[derive(Clone, Debug)]
pub(crate) struct OperatorTable {
    /// Per operator: the end of its entries in each array. The first row contains zeros, as the
    /// start of the first operator.
    rows: Vec<OperatorRow>,
    arguments: Vec<ObjectId>,
    preconditions: Vec<Literal>,
    effects: ChangesTable,
    conditional: ConditionalTable,
    costs: Vec<u64>,
}

#[derive(Clone, Copy, Debug, Default)]
struct OperatorRow {
    schema: u32,
    arguments: u32,
    preconditions: u32,
    conditional: u32,
}

#[derive(Clone, Debug)]
struct ChangesTable {
    /// Per effect: the end of its entries in each array. The first row contains zeros, as the start
    /// of the first effect.
    rows: Vec<ChangesRow>,
    /// Per effect: the facts that it adds, followed by the facts that it deletes.
    facts: Vec<FactId>,
    numeric: Vec<NumericChange>,
}

#[derive(Clone, Copy, Debug, Default)]
struct ChangesRow {
    adds: u32,
    deletes: u32,
    numeric: u32,
}

#[derive(Clone, Debug)]
struct ConditionalTable {
    /// Per conditional effect: the end of its conditions. The first entry is zero, the start of the
    /// first effect.
    ends: Vec<u32>,
    conditions: Vec<Literal>,
    effects: ChangesTable,
}

/// Policy for [`OperatorTable::renumber`]: the operators, effects and facts to keep, and the new
/// number of each fact.
pub(crate) trait Renumbering {
    /// Whether an operator is kept. Its facts still have their old numbers.
    fn keeps(&self, operator: GroundOperator<'_>) -> bool;

    /// Whether a conditional effect of a kept operator is kept.
    fn keeps_effect(&self, conditions: &[Literal], effect: Changes<'_>) -> bool;

    /// Returns the literal with its new fact number; `None` if the literal is dropped because it is
    /// always true.
    fn literal(&self, literal: Literal) -> Option<Literal>;

    /// Returns the new number of a fact; `None` if the fact is dropped because it is irrelevant.
    fn fact(&self, fact: FactId) -> Option<FactId>;
}

/// Progress of compacting a [`ChangesTable`]: the parts that are kept so far.
#[derive(Debug)]
struct CompactionProgress {
    rows: Vec<ChangesRow>,
    facts: usize,
    numeric: usize,
}

impl Default for CompactionProgress {
    fn default() -> CompactionProgress {
        CompactionProgress { rows: vec![ChangesRow::default()], facts: 0, numeric: 0 }
    }
}

/// Renumbers literals in place, moves them behind the already kept literals, and sorts them.
fn renumber_literals(
    all: &mut [Literal],
    read: std::ops::Range<usize>,
    kept: &mut usize,
    by: &impl Renumbering,
) {
    let start = *kept;
    for read in read {
        if let Some(literal) = by.literal(all[read]) {
            all[*kept] = literal;
            *kept += 1;
        }
    }
    all[start..*kept].sort_unstable();
}

/// Returns a length as the end of a row. The limits on memory keep lengths within the range of
/// `u32`.
fn end(length: usize) -> u32 {
    u32::try_from(length).unwrap_or(u32::MAX)
}

// === impl OperatorTable ===

impl Default for OperatorTable {
    fn default() -> OperatorTable {
        OperatorTable {
            rows: vec![OperatorRow::default()],
            arguments: Vec::new(),
            preconditions: Vec::new(),
            effects: ChangesTable::default(),
            conditional: ConditionalTable::default(),
            costs: Vec::new(),
        }
    }
}

impl OperatorTable {
    pub(crate) fn len(&self) -> usize {
        self.costs.len()
    }

    /// Returns the operator at `index`, which must be below [`OperatorTable::len`].
    #[inline]
    pub(crate) fn get(&self, index: usize) -> GroundOperator<'_> {
        let (from, to) = (&self.rows[index], &self.rows[index + 1]);
        GroundOperator {
            schema: to.schema,
            arguments: &self.arguments[from.arguments as usize..to.arguments as usize],
            preconditions: &self.preconditions
                [from.preconditions as usize..to.preconditions as usize],
            effect: self.effects.get(index),
            conditional: ConditionalEffects {
                table: &self.conditional,
                start: from.conditional,
                end: to.conditional,
            },
            cost: self.costs[index],
        }
    }

    pub(crate) fn iter(&self) -> impl ExactSizeIterator<Item = GroundOperator<'_>> {
        (0..self.len()).map(|index| self.get(index))
    }

    /// Adds an operator without effects and with the cost zero.
    pub(crate) fn push(
        &mut self,
        schema: u32,
        arguments: impl IntoIterator<Item = ObjectId>,
        preconditions: impl IntoIterator<Item = Literal>,
    ) {
        self.arguments.extend(arguments);
        self.preconditions.extend(preconditions);
        self.rows.push(OperatorRow {
            schema,
            arguments: end(self.arguments.len()),
            preconditions: end(self.preconditions.len()),
            conditional: end(self.conditional.len()),
        });
        self.effects.push([], [], []);
        self.costs.push(0);
    }

    /// Adds a copy of another table's operator, with `preconditions` instead of its own
    /// preconditions.
    pub(crate) fn push_with(
        &mut self,
        operator: GroundOperator<'_>,
        preconditions: impl IntoIterator<Item = Literal>,
    ) {
        self.push(operator.schema, operator.arguments.iter().copied(), preconditions);
        let Changes { adds, deletes, numeric } = operator.effect;
        let (adds, deletes) = (adds.iter().copied(), deletes.iter().copied());
        self.set_effect(adds, deletes, numeric.iter().cloned());
        for one in operator.conditional.iter() {
            let Changes { adds, deletes, numeric } = one.effect;
            self.push_conditional(
                one.conditions.iter().copied(),
                adds.iter().copied(),
                deletes.iter().copied(),
                numeric.iter().cloned(),
            );
        }
        self.set_cost(operator.cost);
    }

    /// Sets the unconditional effect of the last operator. Must be called once for each operator.
    pub(crate) fn set_effect(
        &mut self,
        adds: impl IntoIterator<Item = FactId>,
        deletes: impl IntoIterator<Item = FactId>,
        numeric: impl IntoIterator<Item = NumericChange>,
    ) {
        self.effects.rows.pop();
        self.effects.push(adds, deletes, numeric);
    }

    /// Adds a conditional effect to the last operator.
    pub(crate) fn push_conditional(
        &mut self,
        conditions: impl IntoIterator<Item = Literal>,
        adds: impl IntoIterator<Item = FactId>,
        deletes: impl IntoIterator<Item = FactId>,
        numeric: impl IntoIterator<Item = NumericChange>,
    ) {
        let ConditionalTable { ends, conditions: all, effects } = &mut self.conditional;
        all.extend(conditions);
        ends.push(end(all.len()));
        effects.push(adds, deletes, numeric);
        let count = end(self.conditional.len());
        if let Some(row) = self.rows.last_mut() {
            row.conditional = count;
        }
    }

    /// Sets the cost of the last operator.
    pub(crate) fn set_cost(&mut self, cost: u64) {
        if let Some(last) = self.costs.last_mut() {
            *last = cost;
        }
    }

    pub(crate) fn costs_mut(&mut self) -> &mut [u64] {
        &mut self.costs
    }

    /// Drops and renumbers operators, effects and facts according to `by`. The long arrays are
    /// compacted in place, because the write position never overtakes the read position.
    pub(crate) fn renumber(&mut self, by: &impl Renumbering) {
        let mut rows = vec![OperatorRow::default()];
        let (mut effects, mut conditional) =
            (CompactionProgress::default(), CompactionProgress::default());
        let (mut ends, mut conditions) = (vec![0], 0);
        let (mut arguments, mut preconditions) = (0, 0);
        for index in 0..self.len() {
            if !by.keeps(self.get(index)) {
                continue;
            }
            let (from, to) = (self.rows[index], self.rows[index + 1]);
            self.arguments.copy_within(from.arguments as usize..to.arguments as usize, arguments);
            arguments += (to.arguments - from.arguments) as usize;
            let read = from.preconditions as usize..to.preconditions as usize;
            renumber_literals(&mut self.preconditions, read, &mut preconditions, by);
            self.effects.keep(index, &mut effects, by);
            for one in from.conditional as usize..to.conditional as usize {
                let ConditionalTable { ends: old, conditions: all, effects } =
                    &mut self.conditional;
                let read = old[one] as usize..old[one + 1] as usize;
                if by.keeps_effect(&all[read.clone()], effects.get(one)) {
                    renumber_literals(all, read, &mut conditions, by);
                    ends.push(end(conditions));
                    effects.keep(one, &mut conditional, by);
                }
            }
            self.costs[rows.len() - 1] = self.costs[index];
            rows.push(OperatorRow {
                schema: to.schema,
                arguments: end(arguments),
                preconditions: end(preconditions),
                conditional: end(ends.len() - 1),
            });
        }
        self.costs.truncate(rows.len() - 1);
        self.rows = rows;
        self.arguments.truncate(arguments);
        self.preconditions.truncate(preconditions);
        self.effects.finish(effects);
        self.conditional.ends = ends;
        self.conditional.conditions.truncate(conditions);
        self.conditional.effects.finish(conditional);
        self.shrink();
    }

    /// Returns the number of bytes of the table.
    pub(crate) fn bytes(&self) -> usize {
        let rows = self.rows.capacity() * size_of::<OperatorRow>() + self.costs.capacity() * 8;
        let pools = (self.arguments.capacity() + self.preconditions.capacity()) * 4;
        rows + pools + self.effects.bytes() + self.conditional.bytes()
    }

    /// Returns spare capacity to the allocator.
    fn shrink(&mut self) {
        self.rows.shrink_to_fit();
        self.arguments.shrink_to_fit();
        self.preconditions.shrink_to_fit();
        self.effects.shrink();
        self.conditional.ends.shrink_to_fit();
        self.conditional.conditions.shrink_to_fit();
        self.conditional.effects.shrink();
        self.costs.shrink_to_fit();
    }
}

// === impl ConditionalEffects ===

impl<'t> ConditionalEffects<'t> {
    pub(crate) fn iter(self) -> impl ExactSizeIterator<Item = ConditionalEffect<'t>> + Clone {
        (self.start as usize..self.end as usize).map(move |index| self.table.get(index))
    }
}

// === impl ConditionalTable ===

impl Default for ConditionalTable {
    fn default() -> ConditionalTable {
        ConditionalTable { ends: vec![0], conditions: Vec::new(), effects: ChangesTable::default() }
    }
}

impl ConditionalTable {
    fn len(&self) -> usize {
        self.ends.len() - 1
    }

    fn get(&self, index: usize) -> ConditionalEffect<'_> {
        let (start, end) = (self.ends[index] as usize, self.ends[index + 1] as usize);
        ConditionalEffect {
            conditions: &self.conditions[start..end],
            effect: self.effects.get(index),
        }
    }

    fn bytes(&self) -> usize {
        (self.ends.capacity() + self.conditions.capacity()) * 4 + self.effects.bytes()
    }
}

// === impl ChangesTable ===

impl Default for ChangesTable {
    fn default() -> ChangesTable {
        ChangesTable { rows: vec![ChangesRow::default()], facts: Vec::new(), numeric: Vec::new() }
    }
}

impl ChangesTable {
    #[inline]
    fn get(&self, index: usize) -> Changes<'_> {
        let (from, to) = (&self.rows[index], &self.rows[index + 1]);
        Changes {
            adds: &self.facts[from.deletes as usize..to.adds as usize],
            deletes: &self.facts[to.adds as usize..to.deletes as usize],
            numeric: &self.numeric[from.numeric as usize..to.numeric as usize],
        }
    }

    fn push(
        &mut self,
        adds: impl IntoIterator<Item = FactId>,
        deletes: impl IntoIterator<Item = FactId>,
        numeric: impl IntoIterator<Item = NumericChange>,
    ) {
        self.facts.extend(adds);
        let adds = end(self.facts.len());
        self.facts.extend(deletes);
        self.numeric.extend(numeric);
        let (deletes, numeric) = (end(self.facts.len()), end(self.numeric.len()));
        self.rows.push(ChangesRow { adds, deletes, numeric });
    }

    /// Renumbers the effect at `index` and moves it behind the already kept effects.
    fn keep(&mut self, index: usize, kept: &mut CompactionProgress, by: &impl Renumbering) {
        let (from, to) = (self.rows[index], self.rows[index + 1]);
        let mut keep = |read: std::ops::Range<u32>| {
            for read in read.start as usize..read.end as usize {
                if let Some(fact) = by.fact(self.facts[read]) {
                    self.facts[kept.facts] = fact;
                    kept.facts += 1;
                }
            }
            end(kept.facts)
        };
        let adds = keep(from.deletes..to.adds);
        let deletes = keep(to.adds..to.deletes);
        for read in from.numeric as usize..to.numeric as usize {
            self.numeric.swap(kept.numeric, read);
            kept.numeric += 1;
        }
        kept.rows.push(ChangesRow { adds, deletes, numeric: end(kept.numeric) });
    }

    fn finish(&mut self, kept: CompactionProgress) {
        self.rows = kept.rows;
        self.facts.truncate(kept.facts);
        self.numeric.truncate(kept.numeric);
    }

    fn bytes(&self) -> usize {
        self.rows.capacity() * size_of::<ChangesRow>()
            + self.facts.capacity() * 4
            + self.numeric.capacity() * size_of::<NumericChange>()
    }

    fn shrink(&mut self) {
        self.rows.shrink_to_fit();
        self.facts.shrink_to_fit();
        self.numeric.shrink_to_fit();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn facts(indices: &[usize]) -> Vec<FactId> {
        indices.iter().map(|index| FactId::from_index(*index)).collect()
    }

    fn literals(indices: &[usize]) -> Vec<Literal> {
        facts(indices).into_iter().map(|fact| Literal::new(fact, true)).collect()
    }

    fn table() -> OperatorTable {
        let mut operators = OperatorTable::default();
        operators.push(0, [ObjectId::from_index(5)], literals(&[1, 2]));
        operators.set_effect(facts(&[3]), facts(&[1]), []);
        operators.set_cost(7);
        operators.push(2, [], literals(&[4]));
        operators.set_effect([], facts(&[4, 5]), []);
        operators.push_conditional(literals(&[6]), facts(&[7]), facts(&[8]), []);
        operators.push_conditional([], [], facts(&[9]), []);
        operators.push(3, [ObjectId::from_index(6)], literals(&[2, 9]));
        operators.set_effect(facts(&[1, 9]), facts(&[2]), []);
        operators.set_cost(8);
        operators
    }

    #[test]
    fn pushed_operators_are_read_back() {
        let operators = table();
        assert_eq!(operators.len(), 3);
        let first = operators.get(0);
        assert_eq!((first.schema, first.preconditions), (0, literals(&[1, 2]).as_slice()));
        assert_eq!((first.effect.adds, first.effect.deletes), (&facts(&[3])[..], &facts(&[1])[..]));
        assert_eq!(first.conditional.iter().len(), 0);
        let second = operators.get(1);
        assert_eq!(second.effect.deletes, facts(&[4, 5]));
        let conditional: Vec<_> = second.conditional.iter().collect();
        assert_eq!(conditional[0].conditions, literals(&[6]));
        assert_eq!(conditional[0].effect.adds, facts(&[7]));
        assert_eq!(conditional[1].effect.deletes, facts(&[9]));
    }

    /// A renumbering that drops the first operator, effects without adds, and fact 9, and that adds
    /// 10 to the numbers of all other facts.
    struct Shift;

    impl Renumbering for Shift {
        fn keeps(&self, operator: GroundOperator<'_>) -> bool {
            operator.schema > 0
        }

        fn keeps_effect(&self, _: &[Literal], effect: Changes<'_>) -> bool {
            !effect.adds.is_empty()
        }

        fn literal(&self, literal: Literal) -> Option<Literal> {
            Some(Literal::new(self.fact(literal.fact())?, literal.is_positive()))
        }

        fn fact(&self, fact: FactId) -> Option<FactId> {
            (fact.0 != 9).then_some(FactId(fact.0 + 10))
        }
    }

    #[test]
    fn renumbering_keeps_the_order_of_operators() {
        let mut operators = table();
        operators.renumber(&Shift);
        assert_eq!(operators.len(), 2);
        let first = operators.get(0);
        assert_eq!((first.schema, first.preconditions), (2, literals(&[14]).as_slice()));
        let conditional: Vec<_> = first.conditional.iter().collect();
        assert_eq!(conditional.len(), 1);
        assert_eq!(conditional[0].conditions, literals(&[16]));
        assert_eq!(conditional[0].effect.deletes, facts(&[18]));
        let last = operators.get(1);
        assert_eq!((last.arguments, last.cost), (&[ObjectId::from_index(6)][..], 8));
        assert_eq!(last.preconditions, literals(&[12]));
        assert_eq!((last.effect.adds, last.effect.deletes), (&facts(&[11])[..], &facts(&[12])[..]));
    }
}
