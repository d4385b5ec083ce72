//! Axioms as rules, and their fixpoint: what a component of derived predicates comes to in a state.
//!
//! Semi-naive: after a first round over everything, a rule is asked again only for what follows from
//! facts that are new. A rule that reads its own component deeper inside, under a `forall`, say, is
//! asked again in full.

use std::ops::Range;

use super::compile::Scope;
use super::compiled::{Node, Query, Slot, Variable};
use super::model::Model;
use super::query::{ARITY_MAX, View};
use super::symbols::{Object, Relation};
use super::table::Table;
use super::world::World;

/// Up to so many rules an axiom is taken apart over `or`; past it, an `or` is looked at as a whole.
const ALTERNATIVES_MAX: usize = 64;

/// One way to derive a predicate: a conjunction.
#[derive(Debug)]
pub(super) struct Rule {
    relation: Relation,
    /// The relation's position in its component.
    head: usize,
    arguments: Box<[Slot]>,
    query: Query,
    /// The parts that are facts of the same component, with the predicate's position there.
    recursive: Vec<(usize, usize)>,
    /// Whether the component is read anywhere else.
    is_nested: bool,
    slot_count: usize,
}

/// Variables, and what must hold of them.
type Alternative = (Vec<Variable>, Vec<Node>);

// === impl Rule ===

impl Rule {
    /// The rules of an axiom of a component.
    fn of(model: &Model, component: usize, axiom: usize) -> Vec<Rule> {
        let axiom = &model.derived[axiom];
        let mut scope = Scope::new(model);
        let variables = scope.declare(&axiom.parameters);
        // Of two parameters with one name, the second is meant, as everywhere.
        let slot_of = |parameter: &pddl::Typed| {
            let same = axiom.parameters.iter().rposition(|other| other.name == parameter.name);
            same.map_or(variables[0].slot, |position| variables[position].slot)
        };
        let arguments: Box<[Slot]> = axiom.parameters.iter().map(slot_of).collect();
        let node = scope.node(&axiom.condition, true);
        let relation = model.predicates.find(&axiom.predicate, arguments.len());
        let relation = relation.expect("invariant: the model numbers what axioms derive");
        let head = model.axioms.place(relation).map_or(0, |(_, at)| at);
        let rule = |(more, nodes): Alternative| {
            let query = Query::new([variables.clone(), more].concat(), nodes);
            let (recursive, is_nested) = recursion(model, component, &query);
            let (arguments, slot_count) = (arguments.clone(), scope.slot_count());
            Rule { relation, head, arguments, query, recursive, is_nested, slot_count }
        };
        alternatives(node).into_iter().map(rule).collect()
    }
}

/// The parts of a query that are facts of a component, and whether others read it too.
fn recursion(model: &Model, component: usize, query: &Query) -> (Vec<(usize, usize)>, bool) {
    let (mut recursive, mut is_nested) = (Vec::new(), false);
    for (index, part) in query.parts.iter().enumerate() {
        let place = |relation| model.axioms.place(relation).filter(|(own, _)| *own == component);
        if let Node::Fact(fact, true) = &part.node
            && fact.arguments.len() <= ARITY_MAX
        {
            recursive.extend(place(fact.relation).map(|(_, at)| (index, at)));
        } else {
            part.node.relations(&mut |relation| is_nested |= place(relation).is_some());
        }
    }
    (recursive, is_nested)
}

/// The disjunctive form of a node, with the variables of what exists inside taken in.
fn alternatives(node: Node) -> Vec<Alternative> {
    match node {
        Node::Constant(false) => Vec::new(),
        Node::Any(parts) => parts.into_iter().flat_map(alternatives).collect(),
        Node::Exists(query, true) => {
            let parts = query.parts.into_iter().map(|part| part.node);
            let mut found = alternatives(Node::all(parts));
            for (variables, _) in &mut found {
                variables.splice(0..0, query.variables.iter().cloned());
            }
            found
        }
        Node::All(parts) => {
            let mut product = vec![Alternative::default()];
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

/// Adds to every alternative what a factor says.
fn extend(alternatives: &mut [Alternative], (variables, nodes): &Alternative) {
    for (own_variables, own_nodes) in alternatives {
        own_variables.extend_from_slice(variables);
        own_nodes.extend_from_slice(nodes);
    }
}

// === impl World ===

impl World {
    /// The tables of a component, settled.
    pub(super) fn derived(&self, component: usize) -> &[Table] {
        if let Some(tables) = self.derived[component].get() {
            return tables;
        }
        // What it rests on first, deepest first; without recursion, because the domain may come from
        // anywhere.
        let mut open = vec![component];
        while let Some(&top) = open.last() {
            let below = self.model.axioms.components[top].below.iter();
            let unsettled = below.copied().find(|below| self.derived[*below].get().is_none());
            match unsettled {
                Some(below) => open.push(below),
                None => {
                    self.derived[top].get_or_init(|| self.settled(top));
                    open.pop();
                }
            }
        }
        self.derived[component].get_or_init(|| self.settled(component))
    }

    /// Forgets what components came to, and what rests on them.
    pub(super) fn unsettle(&mut self, components: &[usize]) {
        let mut open = components.to_vec();
        while let Some(component) = open.pop() {
            // Nothing is settled that rests on something unsettled.
            if self.derived[component].take().is_some() {
                open.extend(&self.model.axioms.components[component].above);
            }
        }
    }

    /// What a component comes to, by its fixpoint.
    fn settled(&self, index: usize) -> Vec<Table> {
        let component = &self.model.axioms.components[index];
        let rules = component.rules.get_or_init(|| {
            let rules = |axiom: &usize| Rule::of(&self.model, index, *axiom);
            component.axioms.iter().flat_map(rules).collect()
        });
        let claimed = |relation: &Relation| {
            let mut table = Table::new(self.model.predicates.arity(*relation));
            self.facts[relation.index()].tuples().for_each(|tuple| _ = table.insert(tuple));
            table
        };
        let mut tables: Vec<Table> = component.relations.iter().map(claimed).collect();
        let counts = |tables: &[Table]| tables.iter().map(Table::len).collect::<Vec<_>>();
        let mut seen = counts(&tables);
        for rule in rules {
            let found = rule.follow(View::growing(self, index, &tables), None);
            insert_all(&mut tables[rule.head], found);
        }
        loop {
            let now = counts(&tables);
            if now == seen {
                return tables;
            }
            for rule in rules {
                for from in rule.sources(&seen, &now) {
                    let found = rule.follow(View::growing(self, index, &tables), from);
                    insert_all(&mut tables[rule.head], found);
                }
            }
            seen = now;
        }
    }
}

/// The part of a rule that a new fact is put in for, and which tuples are new: while a component
/// settles nothing is taken out, so they come last.
type Source = (usize, Range<usize>);

/// Tuples one after the other, and how many they are.
type Tuples = (Vec<Object>, usize);

impl Rule {
    /// Where to start from, given the rows that each predicate had before the last round and has
    /// now; `None` stands for everything.
    fn sources(&self, seen: &[usize], now: &[usize]) -> Vec<Option<Source>> {
        if self.is_nested {
            return vec![None];
        }
        let source = |(part, at): &(usize, usize)| Some((*part, seen[*at]..now[*at]));
        self.recursive.iter().map(source).collect()
    }

    /// What follows and is not known yet.
    fn follow(&self, view: View<'_>, from: Option<Source>) -> Tuples {
        let known = view.table(self.relation);
        let mut frame = vec![Object::UNBOUND; self.slot_count];
        let (mut found, mut count) = (Vec::new(), 0);
        let mut visit = |frame: &mut [Object]| {
            if !known.contains(|column| frame[self.arguments[column].index()]) {
                found.extend(self.arguments.iter().map(|slot| frame[slot.index()]));
                count += 1;
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

fn insert_all(table: &mut Table, (objects, count): Tuples) {
    let arity = objects.len().checked_div(count).unwrap_or(0);
    for index in 0..count {
        table.insert(&objects[index * arity..(index + 1) * arity]);
    }
}
