//! Converts axioms to rules, and computes the facts of a component of derived predicates in a state
//! as the fixpoint of these rules.
//!
//! The evaluation is semi-naive: after a first round over all facts, a rule is applied only to new
//! facts. A rule that uses its own component inside a nested condition, such as a `forall`, is
//! applied to all facts in every round.

use std::ops::Range;

use super::compile::CompilationScope;
use super::compiled::{CompiledCondition, FrameSlot, Query, Variable};
use super::model::Model;
use super::query::{ARITY_MAX, WorldView};
use super::symbols::{Object, RelationId};
use super::tuple_table::TupleTable;
use super::world::World;

/// Maximum number of rules that an axiom is split into at `or`. If there would be more, an `or` is
/// evaluated as a whole.
const ALTERNATIVES_MAX: usize = 64;

/// A rule that derives facts of a predicate: a conjunction of conditions.
#[derive(Debug)]
pub(super) struct AxiomRule {
    relation: RelationId,
    /// Position of the derived predicate in its component.
    head: usize,
    arguments: Box<[FrameSlot]>,
    query: Query,
    /// Parts of the rule that are facts of the rule's own component. Each entry is the position of
    /// the part in the query, and the position of its predicate in the component.
    recursive: Vec<(usize, usize)>,
    /// Whether any part of the rule that is not in `recursive` uses the component.
    is_nested: bool,
    slot_count: usize,
}

/// One alternative of a disjunction: variables, and the conditions that must hold for them.
type RuleAlternative = (Vec<Variable>, Vec<CompiledCondition>);

// === impl AxiomRule ===

impl AxiomRule {
    /// Returns the rules of one axiom of the given component.
    fn of(model: &Model, component: usize, axiom: usize) -> Vec<AxiomRule> {
        let axiom = &model.derived[axiom];
        let mut scope = CompilationScope::new(model);
        let variables = scope.declare(&axiom.parameters);
        // If two parameters have the same name, the later one is used, as in all other places.
        let slot_of = |parameter: &pddl::Typed| {
            let same = axiom.parameters.iter().rposition(|other| other.name == parameter.name);
            same.map_or(variables[0].slot, |position| variables[position].slot)
        };
        let arguments: Box<[FrameSlot]> = axiom.parameters.iter().map(slot_of).collect();
        let node = scope.node(&axiom.condition, true);
        let relation = model.predicates.find(&axiom.predicate, arguments.len());
        let relation = relation.expect("invariant: the model numbers what axioms derive");
        let head = model.axioms.place(relation).map_or(0, |(_, at)| at);
        let rule = |(more, nodes): RuleAlternative| {
            let query = Query::new([variables.clone(), more].concat(), nodes);
            let (recursive, is_nested) = recursion(model, component, &query);
            let (arguments, slot_count) = (arguments.clone(), scope.slot_count());
            AxiomRule { relation, head, arguments, query, recursive, is_nested, slot_count }
        };
        alternatives(node).into_iter().map(rule).collect()
    }
}

/// Returns the parts of a query that are facts of a component. Each entry is the position of the
/// part in the query, and the position of its predicate in the component. The flag tells whether
/// any other part of the query uses the component.
fn recursion(model: &Model, component: usize, query: &Query) -> (Vec<(usize, usize)>, bool) {
    let (mut recursive, mut is_nested) = (Vec::new(), false);
    for (index, part) in query.parts.iter().enumerate() {
        let place = |relation| model.axioms.place(relation).filter(|(own, _)| *own == component);
        if let CompiledCondition::Fact(fact, true) = &part.node
            && fact.arguments.len() <= ARITY_MAX
        {
            recursive.extend(place(fact.relation).map(|(_, at)| (index, at)));
        } else {
            part.node.relations(&mut |relation| is_nested |= place(relation).is_some());
        }
    }
    (recursive, is_nested)
}

/// Returns the disjunctive normal form of a condition. Variables of inner existential quantifiers
/// become variables of the alternatives.
fn alternatives(node: CompiledCondition) -> Vec<RuleAlternative> {
    match node {
        CompiledCondition::Constant(false) => Vec::new(),
        CompiledCondition::Any(parts) => parts.into_iter().flat_map(alternatives).collect(),
        CompiledCondition::Exists(query, true) => {
            let parts = query.parts.into_iter().map(|part| part.node);
            let mut found = alternatives(CompiledCondition::all(parts));
            for (variables, _) in &mut found {
                variables.splice(0..0, query.variables.iter().cloned());
            }
            found
        }
        CompiledCondition::All(parts) => {
            let mut product = vec![RuleAlternative::default()];
            let mut shared = Vec::new();
            for part in parts {
                let whole = part.clone();
                let factors = alternatives(part);
                match factors.as_slice() {
                    [factor] => extend(&mut product, factor),
                    _ if product.len() * factors.len() > ALTERNATIVES_MAX => shared.push(whole),
                    _ => {
                        product = factors
                            .iter()
                            .flat_map(|factor| {
                                let mut extended = product.clone();
                                extend(&mut extended, factor);
                                extended
                            })
                            .collect()
                    }
                }
            }
            extend(&mut product, &(Vec::new(), shared));
            product
        }
        other => vec![(Vec::new(), other.into_parts())],
    }
}

/// Adds the given variables and conditions to every alternative.
fn extend(alternatives: &mut [RuleAlternative], (variables, nodes): &RuleAlternative) {
    for (own_variables, own_nodes) in alternatives {
        own_variables.extend_from_slice(variables);
        own_nodes.extend_from_slice(nodes);
    }
}

// === impl World ===

impl World {
    /// Returns the facts of a component, which is evaluated at the first use.
    pub(super) fn derived(&self, component: usize) -> &[TupleTable] {
        if let Some(tables) = self.derived[component].get() {
            return tables;
        }
        // The components that it depends on are evaluated first, the deepest first. An explicit
        // stack replaces recursion, because dependencies may be of any depth.
        let mut open = vec![component];
        while let Some(&top) = open.last() {
            let below = self.model.axioms.components[top].below.iter();
            let unsettled = below.copied().find(|below| self.derived[*below].get().is_none());
            match unsettled {
                Some(below) => open.push(below),
                None => {
                    self.derived[top].get_or_init(|| self.evaluate_apart(top));
                    open.pop();
                }
            }
        }
        self.derived[component].get_or_init(|| self.evaluate_apart(component))
    }

    fn evaluate_apart(&self, index: usize) -> Vec<TupleTable> {
        self.work.apart(|| self.evaluate_component(index))
    }

    /// Drops the results of the given components, and of all components that depend on them.
    pub(super) fn invalidate(&mut self, components: &[usize]) {
        let mut open = components.to_vec();
        while let Some(component) = open.pop() {
            // If a component has no result, no component that depends on it has a result.
            if self.derived[component].take().is_some() {
                open.extend(&self.model.axioms.components[component].above);
            }
        }
    }

    /// Computes the facts of the component with this index, by a fixpoint.
    fn evaluate_component(&self, index: usize) -> Vec<TupleTable> {
        let component = &self.model.axioms.components[index];
        let rules = component.rules.get_or_init(|| {
            let rules = |axiom: &usize| AxiomRule::of(&self.model, index, *axiom);
            component.axioms.iter().flat_map(rules).collect()
        });
        let claimed = |relation: &RelationId| {
            let mut table = TupleTable::new(self.model.predicates.arity(*relation));
            self.facts[relation.index()].tuples().for_each(|tuple| _ = table.insert(tuple));
            table
        };
        let mut tables: Vec<TupleTable> = component.relations.iter().map(claimed).collect();
        let counts = |tables: &[TupleTable]| tables.iter().map(TupleTable::len).collect::<Vec<_>>();
        let mut seen = counts(&tables);
        for rule in rules {
            let found = rule.follow(WorldView::growing(self, index, &tables), None);
            insert_all(&mut tables[rule.head], found);
        }
        loop {
            let now = counts(&tables);
            if now == seen {
                return tables;
            }
            for rule in rules {
                for from in rule.sources(&seen, &now) {
                    let found = rule.follow(WorldView::growing(self, index, &tables), from);
                    insert_all(&mut tables[rule.head], found);
                }
            }
            seen = now;
        }
    }
}

/// Position of a part in the query of a rule, and the rows of the part's new facts in their table.
/// New facts have the last rows, because no tuple is removed during the evaluation of a component.
type DeltaRows = (usize, Range<usize>);

/// Derived tuples, one after the other in one array, and the number of tuples.
type DerivedTuples = (Vec<Object>, usize);

impl AxiomRule {
    /// Returns the parts of the rule with new facts. `seen` and `now` are the numbers of rows of
    /// each predicate before the last round and now. `None` in the result means that the rule must
    /// be applied to all facts.
    fn sources(&self, seen: &[usize], now: &[usize]) -> Vec<Option<DeltaRows>> {
        if self.is_nested {
            return vec![None];
        }
        let source = |(part, at): &(usize, usize)| Some((*part, seen[*at]..now[*at]));
        self.recursive.iter().map(source).collect()
    }

    /// Returns the new tuples that the rule derives.
    fn follow(&self, view: WorldView<'_>, from: Option<DeltaRows>) -> DerivedTuples {
        let known = view.table(self.relation);
        let mut frame = vec![Object::UNBOUND; self.slot_count];
        let (mut found, mut count) = (Vec::new(), 0);
        let mut visit = |frame: &mut [Object]| {
            if !known.contains(|column| frame[self.arguments[column].index()]) {
                found.extend(self.arguments.iter().map(|slot| frame[slot.index()]));
                count += 1;
                // A tuple needs memory for each of its objects.
                return view.world.work.spend(self.arguments.len() as u64);
            }
            true
        };
        match from {
            None => view.each(&self.query, &mut frame, &mut visit),
            Some((part, rows)) => view.each_from(&self.query, part, rows, &mut frame, &mut visit),
        };
        (found, count)
    }
}

fn insert_all(table: &mut TupleTable, (objects, count): DerivedTuples) {
    let arity = objects.len().checked_div(count).unwrap_or(0);
    for index in 0..count {
        table.insert(&objects[index * arity..(index + 1) * arity]);
    }
}
