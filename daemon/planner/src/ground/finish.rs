//! From raw facts to the task: what never changes is folded away, what cannot matter to the goal is
//! left out, and the rest is numbered without gaps.

use super::instantiate::Raw;
use super::relation::Relation;
use super::values::Values;
use crate::normalize::lifted::Lifted;
use crate::task::{Axiom, Changes, FactId, Literal, Operator, Operators, Task};

/// The task; `None` if the goal cannot hold.
pub(super) fn finish(
    lifted: &Lifted,
    relations: &[Relation],
    values: &Values,
    mut raw: Raw,
) -> Option<Task> {
    let facts = Facts::new(lifted, relations, &raw);
    let goal = facts.fold(raw.goal.as_deref()?)?;
    let costs = fold_operators(&facts, &mut raw);
    let relevance = Relevance::compute(&facts, &raw, &goal);
    let numbering = Numbering::new(&facts, &relevance);
    let mut task = Task {
        fact_count: numbering.fact_count,
        basic_count: numbering.basic_count,
        goal: numbering.literals(&facts, &goal),
        values: values.fluents.clone(),
        schema_names: lifted.schemas.iter().map(|schema| schema.name.clone()).collect(),
        object_names: lifted.objects.clone(),
        ..Task::default()
    };
    for (index, comparison) in raw.comparisons.iter().enumerate() {
        if numbering.ids[facts.basic_end + index].is_some() {
            task.comparisons.push(comparison.clone());
        }
    }
    let initial = (0..facts.basic_end).filter(|index| facts.initial[*index]);
    task.initial = initial.filter_map(|index| numbering.ids[index]).collect();
    for axiom in &raw.axioms {
        if let Some(head) = numbering.fact(&facts, axiom.head) {
            let body = numbering.literals(&facts, &axiom.body).into_boxed_slice();
            task.axioms.push(Axiom { head, body, stratum: axiom.stratum as u32 });
        }
    }
    task.axioms.sort_by_key(|axiom| axiom.stratum);
    let mut kept = Vec::new();
    for (operator, cost) in raw.operators.iter().zip(costs) {
        if numbering.operator(&facts, operator, &mut task.operators) {
            kept.push(cost);
        }
    }
    task.operators.shrink();
    set_costs(&mut task, &kept, lifted.costs.weights.is_none());
    Some(task)
}

/// Costs as whole numbers of the largest unit that fits all, down to a millionth.
fn set_costs(task: &mut Task, costs: &[f64], is_unit: bool) {
    task.cost_unit = 1.0;
    task.costs_exact = true;
    if is_unit {
        task.operators.costs_mut().fill(1);
        task.costs_equal = true;
        return;
    }
    let is_whole = |value: f64| (value - value.round()).abs() < 1e-9 * value.abs().max(1.0);
    let scales = [1.0, 10.0, 100.0, 1e3, 1e4, 1e5, 1e6];
    let fits = |scale: &&f64| costs.iter().all(|cost| is_whole(cost * **scale));
    let scale = scales.iter().find(fits).copied();
    task.costs_exact = scale.is_some();
    let scale = scale.unwrap_or(1e6);
    task.cost_unit = 1.0 / scale;
    for (unit, cost) in task.operators.costs_mut().iter_mut().zip(costs) {
        // Negative costs were refused; the conversion saturates.
        *unit = (cost * scale).round() as u64;
    }
    let costs = task.operators.costs();
    let first = costs.first().copied().unwrap_or(1);
    task.costs_equal = first > 0 && costs.iter().all(|cost| *cost == first);
}

/// What is known of every raw fact, by its dense index: rows of relations, comparisons, auxiliaries.
struct Facts {
    /// One past the rows of relations.
    basic_end: usize,
    comparison_end: usize,
    end: usize,
    auxiliary_offset: usize,
    derived: Vec<bool>,
    initial: Vec<bool>,
    /// True in every state.
    always: Vec<bool>,
}

// === impl Facts ===

impl Facts {
    fn new(lifted: &Lifted, relations: &[Relation], raw: &Raw) -> Facts {
        let layout = &raw.layout;
        let basic_end = layout.comparison_offset;
        let comparison_end = basic_end + raw.comparisons.len();
        let end = comparison_end + (layout.end - layout.auxiliary_offset);
        let mut facts = Facts {
            basic_end,
            comparison_end,
            end,
            auxiliary_offset: layout.auxiliary_offset,
            derived: vec![false; end],
            initial: vec![false; end],
            always: vec![false; end],
        };
        facts.derived[comparison_end..].fill(true);
        for (index, predicate) in lifted.predicates.iter().enumerate() {
            let start = layout.offsets[index];
            facts.initial[start..start + relations[index].initial].fill(true);
            facts.derived[start..layout.offsets[index + 1]].fill(predicate.derived);
        }
        facts.find_constant(raw);
        facts
    }

    /// A basic fact that holds at first and that no operator deletes holds for ever.
    fn find_constant(&mut self, raw: &Raw) {
        let candidates = (0..self.end).map(|index| self.initial[index] && !self.derived[index]);
        self.always = candidates.collect();
        for changes in raw.operators.iter().flat_map(all_changes) {
            for fact in changes.deletes {
                self.always[fact.index()] = false;
            }
        }
    }

    fn dense(&self, fact: FactId) -> usize {
        let index = fact.index();
        if index < self.auxiliary_offset {
            index
        } else {
            index - self.auxiliary_offset + self.comparison_end
        }
    }

    /// Without literals that hold in every state; `None` if one holds in none.
    fn fold(&self, literals: &[Literal]) -> Option<Vec<Literal>> {
        let mut kept = Vec::with_capacity(literals.len());
        for &literal in literals {
            match (self.always[self.dense(literal.fact())], literal.is_positive()) {
                (true, true) => (),
                (true, false) => return None,
                (false, _) => kept.push(literal),
            }
        }
        Some(kept)
    }
}

/// What an operator changes, whatever the condition.
fn all_changes(operator: Operator<'_>) -> impl Iterator<Item = Changes<'_>> {
    std::iter::once(operator.effect).chain(operator.conditional.iter().map(|one| one.effect))
}

/// Folds all conditions; returns the costs of the operators left.
fn fold_operators(facts: &Facts, raw: &mut Raw) -> Vec<f64> {
    let mut costs = Vec::new();
    let operators = std::mem::take(&mut raw.operators);
    for (operator, cost) in operators.iter().zip(&raw.costs) {
        let Some(preconditions) = facts.fold(operator.preconditions) else { continue };
        let arguments = operator.arguments.iter().copied();
        raw.operators.push(operator.schema, arguments, preconditions);
        for one in operator.conditional.iter() {
            let Some(conditions) = facts.fold(one.conditions) else { continue };
            let Changes { adds, deletes, numeric } = one.effect;
            let (adds, deletes) = (adds.iter().copied(), deletes.iter().copied());
            let numeric = numeric.iter().cloned();
            raw.operators.push_conditional(conditions, adds, deletes, numeric);
        }
        let Changes { adds, deletes, numeric } = operator.effect;
        let (adds, deletes) = (adds.iter().copied(), deletes.iter().copied());
        raw.operators.set_effect(adds, deletes, numeric.iter().cloned());
        costs.push(*cost);
    }
    raw.axioms.retain_mut(|axiom| match facts.fold(&axiom.body) {
        Some(body) => {
            axiom.body = body;
            true
        }
        None => false,
    });
    costs
}

/// What can matter to the goal: facts, by dense index, and operators that change one of them.
struct Relevance {
    facts: Vec<bool>,
    waiting: Vec<usize>,
}

// === impl Relevance ===

impl Relevance {
    fn compute(facts: &Facts, raw: &Raw, goal: &[Literal]) -> Relevance {
        let mut relevance = Relevance { facts: vec![false; facts.end], waiting: Vec::new() };
        let changers = Changers::new(facts, raw);
        let mut operators = vec![false; raw.operators.len()];
        relevance.want(facts, goal);
        while let Some(fact) = relevance.waiting.pop() {
            for &axiom in changers.axioms.row(fact) {
                relevance.want(facts, &raw.axioms[axiom as usize].body);
            }
            for &operator in changers.operators.row(fact) {
                if !std::mem::replace(&mut operators[operator as usize], true) {
                    let operator = raw.operators.get(operator as usize);
                    relevance.want(facts, operator.preconditions);
                    for one in operator.conditional.iter() {
                        relevance.want(facts, one.conditions);
                    }
                }
            }
        }
        relevance
    }

    fn want(&mut self, facts: &Facts, literals: &[Literal]) {
        for literal in literals {
            let index = facts.dense(literal.fact());
            if !std::mem::replace(&mut self.facts[index], true) {
                self.waiting.push(index);
            }
        }
    }
}

/// Which axioms and operators can change a fact; of a comparison: a number it depends on.
struct Changers {
    axioms: Rows,
    operators: Rows,
}

/// Lists of numbers in one array.
struct Rows {
    starts: Vec<u32>,
    items: Vec<u32>,
}

// === impl Changers ===

impl Changers {
    fn new(facts: &Facts, raw: &Raw) -> Changers {
        let mut axioms = Vec::new();
        for (index, axiom) in raw.axioms.iter().enumerate() {
            axioms.push((facts.dense(axiom.head) as u32, index as u32));
        }
        let readers = readers(facts, raw);
        let mut operators = Vec::new();
        for (index, operator) in raw.operators.iter().enumerate() {
            for changes in all_changes(operator) {
                for fact in changes.adds.iter().chain(changes.deletes) {
                    operators.push((fact.0, index as u32));
                }
                for change in changes.numeric {
                    let mut comparisons = readers[change.fluent as usize].clone();
                    // What other fluents are set to from this one matters as well; being lavish
                    // here costs little, so every comparison counts as depending on it.
                    if comparisons.is_empty() {
                        comparisons = (facts.basic_end..facts.comparison_end).collect();
                    }
                    operators.extend(comparisons.iter().map(|one| (*one as u32, index as u32)));
                }
            }
        }
        Changers {
            axioms: Rows::new(axioms, facts.end),
            operators: Rows::new(operators, facts.end),
        }
    }
}

/// The comparisons that read each numeric fluent.
fn readers(facts: &Facts, raw: &Raw) -> Vec<Vec<usize>> {
    let mut readers: Vec<Vec<usize>> = Vec::new();
    let mut note = |fluent: u32, comparison: Option<usize>| {
        let needed = (fluent as usize + 1).max(readers.len());
        readers.resize(needed, Vec::new());
        readers[fluent as usize].extend(comparison);
    };
    for changes in raw.operators.iter().flat_map(all_changes) {
        changes.numeric.iter().for_each(|change| note(change.fluent, None));
    }
    for (index, comparison) in raw.comparisons.iter().enumerate() {
        let mut visit = |fluent| note(fluent, Some(facts.basic_end + index));
        comparison.left.fluents(&mut visit);
        comparison.right.fluents(&mut visit);
    }
    readers
}

// === impl Rows ===

impl Rows {
    fn new(mut pairs: Vec<(u32, u32)>, count: usize) -> Rows {
        pairs.sort_unstable();
        pairs.dedup();
        let mut starts = vec![0; count + 1];
        for (key, _) in &pairs {
            starts[*key as usize + 1] += 1;
        }
        for index in 0..count {
            starts[index + 1] += starts[index];
        }
        Rows { starts, items: pairs.into_iter().map(|(_, item)| item).collect() }
    }

    fn row(&self, key: usize) -> &[u32] {
        &self.items[self.starts[key] as usize..self.starts[key + 1] as usize]
    }
}

/// New numbers: basic facts, then comparisons, then derived facts.
struct Numbering {
    fact_count: usize,
    basic_count: usize,
    /// By dense index.
    ids: Vec<Option<FactId>>,
}

// === impl Numbering ===

impl Numbering {
    fn new(facts: &Facts, relevance: &Relevance) -> Numbering {
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
        Numbering { fact_count, basic_count, ids }
    }

    fn fact(&self, facts: &Facts, fact: FactId) -> Option<FactId> {
        self.ids[facts.dense(fact)]
    }

    /// Literals of relevant facts.
    fn literals(&self, facts: &Facts, literals: &[Literal]) -> Vec<Literal> {
        let new = |literal: &Literal| {
            Some(Literal::new(self.fact(facts, literal.fact())?, literal.is_positive()))
        };
        literals.iter().filter_map(new).collect()
    }

    fn facts<'f>(
        &'f self,
        facts: &'f Facts,
        all: &'f [FactId],
    ) -> impl Iterator<Item = FactId> + 'f {
        all.iter().filter_map(|fact| self.fact(facts, *fact))
    }

    /// Adds the operator over new numbers; `false` if it changes nothing that matters.
    fn operator(&self, facts: &Facts, operator: Operator<'_>, into: &mut Operators) -> bool {
        let preconditions = self.literals(facts, operator.preconditions);
        into.push(operator.schema, operator.arguments.iter().copied(), preconditions);
        let mut matters = false;
        let matter = |changes: Changes<'_>| {
            let mut all = changes.adds.iter().chain(changes.deletes);
            !changes.numeric.is_empty() || all.any(|fact| self.fact(facts, *fact).is_some())
        };
        for one in operator.conditional.iter().filter(|one| matter(one.effect)) {
            matters = true;
            let conditions = self.literals(facts, one.conditions);
            let (adds, deletes) =
                (self.facts(facts, one.effect.adds), self.facts(facts, one.effect.deletes));
            into.push_conditional(conditions, adds, deletes, one.effect.numeric.iter().cloned());
        }
        matters |= matter(operator.effect);
        let Changes { adds, deletes, numeric } = operator.effect;
        let (adds, deletes) = (self.facts(facts, adds), self.facts(facts, deletes));
        into.set_effect(adds, deletes, numeric.iter().cloned());
        if !matters {
            into.pop();
        }
        matters
    }
}
