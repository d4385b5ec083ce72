//! Builds the task from raw facts. Constant facts are removed from all conditions, facts and
//! operators that are irrelevant to the goal are dropped, and the remaining facts are numbered
//! without gaps.

use super::ground_fluents::GroundFluents;
use super::grounding_meter::GroundingMeter;
use super::raw_instances::{FactLayout, RawTask};
use super::relation::Relation;
use crate::heuristic::STEPS_PER_COST;
use crate::normalize::lifted::Lifted;
use crate::operators::{OperatorTable, Renumbering};
use crate::outcome::{StopReason, Unprovable};
use crate::task::{Changes, FactId, GroundAxiom, GroundOperator, Literal, Task};

/// Greatest cost that is represented exactly. The bound allows searches to multiply costs by
/// [`STEPS_PER_COST`] and add them up.
const COST_MAX: f64 = (u64::MAX / STEPS_PER_COST / 2) as f64;

/// Value to which the greatest cost is scaled down if a cost exceeds [`COST_MAX`]. The sum of a
/// million costs of this value is still representable.
const COST_ROUNDED_MAX: f64 = COST_MAX / 1e6;

/// Initial state of the task, with raw fact numbers.
pub(super) struct RawInitialState {
    /// Per row of a relation: whether the fact is true in the initial state.
    pub(super) initial: Vec<bool>,
    /// Per dense index: whether the fact is known to be false in every reachable state.
    pub(super) never: Vec<bool>,
    /// Initial values of the numeric fluents; NaN for an undefined fluent.
    pub(super) values: Vec<f64>,
}

/// Builds the task from raw facts and operators. Returns `None` if the goal can never hold.
pub(super) fn finish(
    lifted: &Lifted,
    relations: &[Relation],
    start: RawInitialState,
    mut raw: RawTask,
    work: &mut GroundingMeter<'_>,
) -> Result<Option<Task>, StopReason> {
    let RawInitialState { initial, never, values } = start;
    let facts = RawFacts::new(lifted, &raw.layout, &raw.operators, initial, never);
    let Some(goal) = raw.goal.as_deref().and_then(|goal| facts.fold(goal)) else {
        return Ok(None);
    };
    raw.axioms.retain_mut(|axiom| match facts.fold(&axiom.body) {
        Some(body) => {
            axiom.body = body;
            true
        }
        None => false,
    });
    let relevance = Relevance::compute(&facts, &raw, &goal, work)?;
    let numbering = Numbering::new(&facts, &relevance);
    let mut task = Task {
        fact_count: numbering.fact_count,
        basic_count: numbering.basic_count,
        goal: numbering.literals(&goal),
        values,
        schema_names: lifted.schemas.iter().map(|schema| schema.name.clone()).collect(),
        object_names: lifted.objects.clone(),
        ..Task::default()
    };
    for (predicate, relation) in relations[..lifted.predicates.len()].iter().enumerate() {
        for row in 0..relation.len() {
            let index = raw.layout.offsets[predicate] + row;
            if numbering.ids[index].is_some() && !facts.derived[index] {
                task.atoms.push(predicate as u32, relation.row(row));
            }
        }
    }
    for (index, comparison) in raw.comparisons.iter().enumerate() {
        if numbering.ids[facts.basic_end + index].is_some() {
            task.comparisons.push(comparison.clone());
        }
    }
    let initial = (0..facts.basic_end).filter(|index| facts.initial[*index]);
    task.initial = initial.filter_map(|index| numbering.ids[index]).collect();
    for axiom in &raw.axioms {
        if let Some(head) = numbering.fact(axiom.head) {
            let body = numbering.literals(&axiom.body).into_boxed_slice();
            task.axioms.push(GroundAxiom { head, body, stratum: axiom.stratum as u32 });
        }
    }
    task.axioms.sort_by_key(|axiom| axiom.stratum);
    // An operator with a negative cost may improve the metric even if it is irrelevant to the goal.
    let pays = raw.has_negative_cost || facts.pays(&raw.operators);
    raw.operators.renumber(&numbering);
    task.operators = raw.operators;
    set_costs(&mut task, lifted.costs.weights.is_none());
    if pays {
        task.unprovable = Some(Unprovable::NegativeCosts);
    }
    if lifted.costs.varies {
        task.costs_equal = false;
        let is_sum = lifted.costs.is_sum;
        task.unprovable = Some(if is_sum { Unprovable::Varies } else { Unprovable::NoSum });
    }
    Ok(Some(task))
}

/// Converts the costs, which are stored as the bits of `f64` values, to whole multiples of one
/// unit. The unit is the largest power of ten, from one down to a millionth, that divides all
/// costs.
fn set_costs(task: &mut Task, is_unit: bool) {
    task.cost_unit = 1.0;
    let all = task.operators.costs_mut();
    if is_unit {
        all.fill(1);
        task.costs_equal = true;
        return;
    }
    // Only rounding errors are tolerated, because a very small cost must not become zero.
    let is_whole = |value: f64| (value - value.round()).abs() <= 4.0 * f64::EPSILON * value.abs();
    let scales = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6];
    let fits = |scale: &&f64| all.iter().all(|cost| is_whole(f64::from_bits(*cost) * **scale));
    let scale = scales.iter().find(fits).copied();
    // If some costs are negative, all costs are raised by the same amount so that none is negative.
    // Steps with the lowest costs are still preferred, but no plan can be proved to be optimal.
    let lowest = all.iter().map(|cost| f64::from_bits(*cost)).fold(0.0, f64::min);
    let has_negative = lowest < 0.0;
    if has_negative {
        all.iter_mut().for_each(|cost| *cost = (f64::from_bits(*cost) - lowest).to_bits());
    }
    let (scale, unprovable) = countable(scale, all);
    task.unprovable = unprovable;
    task.cost_unit = 1.0 / scale;
    for cost in all.iter_mut() {
        // The conversion to `u64` saturates.
        *cost = (f64::from_bits(*cost) * scale).round() as u64;
    }
    let first = all.first().copied().unwrap_or(1);
    task.costs_equal = first > 0 && !has_negative && all.iter().all(|cost| *cost == first);
}

/// Returns the factor by which costs are multiplied to make them whole numbers, and the reason for
/// a loss of precision, if there is one. `exact` is a factor that makes all costs whole numbers, if
/// one exists.
fn countable(exact: Option<f64>, costs: &[u64]) -> (f64, Option<Unprovable>) {
    let largest = costs.iter().map(|cost| f64::from_bits(*cost)).fold(0.0, f64::max);
    let scale = exact.unwrap_or(1e6);
    if largest * scale > COST_MAX {
        let scale = if largest.is_finite() { COST_ROUNDED_MAX / largest } else { 1.0 };
        return (scale, Some(Unprovable::TooLarge));
    }
    (scale, exact.is_none().then_some(Unprovable::TooFine))
}

/// Properties of every raw fact. The dense indices begin with the rows of relations, followed by
/// comparisons and auxiliary facts.
struct RawFacts<'l> {
    layout: &'l FactLayout,
    /// Dense index after the last row of a relation.
    basic_end: usize,
    comparison_end: usize,
    end: usize,
    derived: Vec<bool>,
    /// Per row of a relation: whether the fact is true in the initial state.
    initial: Vec<bool>,
    /// Per dense index: whether the fact is true in every state.
    always: Vec<bool>,
    /// Per dense index: whether the fact is false in every state.
    never: Vec<bool>,
}

// === impl RawInitialState ===

impl RawInitialState {
    /// Returns the initial state that the relations were filled from.
    pub(super) fn initial(
        lifted: &Lifted,
        relations: &[Relation],
        values: &GroundFluents,
        raw: &RawTask,
    ) -> RawInitialState {
        let mut initial = vec![false; raw.layout.comparison_offset];
        for (index, start) in raw.layout.offsets[..lifted.predicates.len()].iter().enumerate() {
            initial[*start..*start + relations[index].initial].fill(true);
        }
        let never = vec![false; raw.layout.dense_end()];
        RawInitialState { initial, never, values: values.fluents.clone() }
    }
}

// === impl RawFacts ===

impl<'l> RawFacts<'l> {
    fn new(
        lifted: &Lifted,
        layout: &'l FactLayout,
        operators: &OperatorTable,
        initial: Vec<bool>,
        never: Vec<bool>,
    ) -> RawFacts<'l> {
        let basic_end = layout.comparison_offset;
        let (comparison_end, end) = (layout.comparison_end(), layout.dense_end());
        let mut facts = RawFacts {
            basic_end,
            comparison_end,
            end,
            layout,
            derived: vec![false; end],
            initial,
            always: Vec::new(),
            never,
        };
        facts.derived[comparison_end..].fill(true);
        for (index, predicate) in lifted.predicates.iter().enumerate() {
            facts.derived[layout.offsets[index]..layout.offsets[index + 1]].fill(predicate.derived);
        }
        facts.find_constant(operators);
        facts
    }

    /// Finds the constant facts: basic facts that are true in the initial state and never deleted
    /// by an operator.
    fn find_constant(&mut self, operators: &OperatorTable) {
        let holds = self.initial.iter().zip(&self.derived);
        self.always = holds.map(|(initial, derived)| *initial && !derived).collect();
        self.always.resize(self.end, false);
        for changes in operators.iter().flat_map(all_changes) {
            for fact in changes.deletes {
                self.always[fact.index()] = false;
            }
        }
    }

    fn never_applies(&self, operator: GroundOperator<'_>) -> bool {
        operator.preconditions.iter().any(|literal| self.is_impossible(*literal))
    }

    /// Whether an operator that may be applicable has a negative cost.
    fn pays(&self, operators: &OperatorTable) -> bool {
        let mut paying = operators.iter().filter(|one| f64::from_bits(one.cost) < 0.0);
        paying.any(|operator| !self.never_applies(operator))
    }

    /// Whether a literal is false in every state.
    fn is_impossible(&self, literal: Literal) -> bool {
        let index = self.layout.dense(literal.fact());
        if literal.is_positive() { self.never[index] } else { self.always[index] }
    }

    /// Whether a fact has the same truth value in every state.
    fn is_constant(&self, index: usize) -> bool {
        self.always[index] || self.never[index]
    }

    /// Removes the literals that hold in every state. Returns `None` if a literal is false in every
    /// state.
    fn fold(&self, literals: &[Literal]) -> Option<Vec<Literal>> {
        let mut kept = Vec::with_capacity(literals.len());
        for &literal in literals {
            if self.is_impossible(literal) {
                return None;
            }
            if !self.is_impossible(literal.negated()) {
                kept.push(literal);
            }
        }
        Some(kept)
    }
}

/// Returns the unconditional effect and all conditional effects of an operator.
fn all_changes(operator: GroundOperator<'_>) -> impl Iterator<Item = Changes<'_>> {
    std::iter::once(operator.effect).chain(operator.conditional.iter().map(|one| one.effect))
}

/// Relevance analysis, backwards from the goal. Relevant facts are marked by dense index.
struct Relevance {
    facts: Vec<bool>,
    waiting: Vec<usize>,
}

// === impl Relevance ===

impl Relevance {
    fn compute(
        facts: &RawFacts<'_>,
        raw: &RawTask,
        goal: &[Literal],
        work: &mut GroundingMeter<'_>,
    ) -> Result<Relevance, StopReason> {
        let mut relevance = Relevance { facts: vec![false; facts.end], waiting: Vec::new() };
        let changers = Changers::new(facts, raw);
        let mut operators = vec![false; raw.operators.len()];
        relevance.want(facts, goal);
        // Operators that change numbers are always relevant, and so are their conditions.
        for (index, operator) in raw.operators.iter().enumerate() {
            if all_changes(operator).any(|changes| !changes.numeric.is_empty()) {
                operators[index] = true;
                relevance.want_of(facts, operator);
            }
        }
        while let Some(fact) = relevance.waiting.pop() {
            for &axiom in changers.axioms.row(fact) {
                relevance.want(facts, &raw.axioms[axiom as usize].body);
            }
            for &operator in changers.operators.row(fact) {
                if !std::mem::replace(&mut operators[operator as usize], true) {
                    work.count_unit()?;
                    relevance.want_of(facts, raw.operators.get(operator as usize));
                }
            }
        }
        Ok(relevance)
    }

    /// Marks the facts in all conditions of an operator as relevant, unless the operator is never
    /// applicable.
    fn want_of(&mut self, facts: &RawFacts<'_>, operator: GroundOperator<'_>) {
        if facts.never_applies(operator) {
            return;
        }
        self.want(facts, operator.preconditions);
        for one in operator.conditional.iter() {
            if !one.conditions.iter().any(|literal| facts.is_impossible(*literal)) {
                self.want(facts, one.conditions);
            }
        }
    }

    fn want(&mut self, facts: &RawFacts<'_>, literals: &[Literal]) {
        for literal in literals {
            let index = facts.layout.dense(literal.fact());
            if !self.facts[index] && !facts.is_constant(index) {
                self.facts[index] = true;
                self.waiting.push(index);
            }
        }
    }
}

/// Per fact: the axioms and operators that can change it. Comparisons have no entries, because all
/// operators that change numbers are relevant anyway.
struct Changers {
    axioms: ChangerRows,
    operators: ChangerRows,
}

/// Lists of `u32` in one array, one list per fact.
struct ChangerRows {
    starts: Vec<u32>,
    items: Vec<u32>,
}

// === impl Changers ===

impl Changers {
    fn new(facts: &RawFacts<'_>, raw: &RawTask) -> Changers {
        let axioms = |visit: &mut dyn FnMut(usize, u32)| {
            for (index, axiom) in raw.axioms.iter().enumerate() {
                visit(facts.layout.dense(axiom.head), index as u32);
            }
        };
        let operators = |visit: &mut dyn FnMut(usize, u32)| {
            for (index, operator) in raw.operators.iter().enumerate() {
                for changes in all_changes(operator) {
                    for fact in changes.adds.iter().chain(changes.deletes) {
                        visit(fact.index(), index as u32);
                    }
                }
            }
        };
        Changers {
            axioms: ChangerRows::new(facts.end, axioms),
            operators: ChangerRows::new(facts.end, operators),
        }
    }
}

// === impl ChangerRows ===

impl ChangerRows {
    /// Builds the lists from pairs of list index and item. `each` passes all pairs to its argument,
    /// one by one. It is called twice and must pass the same pairs each time.
    fn new(count: usize, each: impl Fn(&mut dyn FnMut(usize, u32))) -> ChangerRows {
        let mut starts = vec![0u32; count + 1];
        each(&mut |key, _| starts[key] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let mut items = vec![0; sum as usize];
        // Each list is filled from its end, so that `starts` has the starts of the lists at the
        // end.
        each(&mut |key, item| {
            starts[key] -= 1;
            items[starts[key] as usize] = item;
        });
        ChangerRows { starts, items }
    }

    fn row(&self, key: usize) -> &[u32] {
        &self.items[self.starts[key] as usize..self.starts[key + 1] as usize]
    }
}

/// New numbers of the kept facts: basic facts first, then comparisons, then derived facts.
struct Numbering<'f> {
    facts: &'f RawFacts<'f>,
    fact_count: usize,
    basic_count: usize,
    /// Per dense index: the new number of the fact; `None` for dropped facts.
    ids: Vec<Option<FactId>>,
}

// === impl Numbering ===

impl<'f> Numbering<'f> {
    fn new(facts: &'f RawFacts<'f>, relevance: &Relevance) -> Numbering<'f> {
        let is_comparison = |index: usize| (facts.basic_end..facts.comparison_end).contains(&index);
        let mut ids = vec![None; facts.end];
        let mut next = 0;
        let mut number = |kind: &dyn Fn(usize) -> bool| {
            for index in (0..facts.end).filter(|index| relevance.facts[*index] && kind(*index)) {
                ids[index] = Some(FactId::from_index(next));
                next += 1;
            }
            next
        };
        let basic_count = number(&|index| !facts.derived[index] && !is_comparison(index));
        number(&is_comparison);
        let fact_count = number(&|index| facts.derived[index]);
        Numbering { facts, fact_count, basic_count, ids }
    }

    /// Renumbers literals, without those of irrelevant facts.
    fn literals(&self, literals: &[Literal]) -> Vec<Literal> {
        literals.iter().filter_map(|literal| self.literal(*literal)).collect()
    }

    fn matters(&self, changes: Changes<'_>) -> bool {
        let mut all = changes.adds.iter().chain(changes.deletes);
        !changes.numeric.is_empty() || all.any(|fact| self.fact(*fact).is_some())
    }
}

impl Renumbering for Numbering<'_> {
    /// Whether an operator is kept: it may be applicable and changes a relevant fact or number.
    fn keeps(&self, operator: GroundOperator<'_>) -> bool {
        let mut conditional = operator.conditional.iter();
        (self.matters(operator.effect)
            || conditional.any(|one| self.keeps_effect(one.conditions, one.effect)))
            && !self.facts.never_applies(operator)
    }

    fn keeps_effect(&self, conditions: &[Literal], effect: Changes<'_>) -> bool {
        self.matters(effect) && !conditions.iter().any(|literal| self.facts.is_impossible(*literal))
    }

    fn literal(&self, literal: Literal) -> Option<Literal> {
        Some(Literal::new(self.fact(literal.fact())?, literal.is_positive()))
    }

    #[inline]
    fn fact(&self, fact: FactId) -> Option<FactId> {
        self.ids[self.facts.layout.dense(fact)]
    }
}
