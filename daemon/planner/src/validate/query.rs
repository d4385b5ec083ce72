//! Whether a compiled condition holds in a world, and for which bindings.
//!
//! A query goes on with whatever leaves the fewest choices: the fact of which the fewest tuples fit
//! what is bound already; all objects of a type only where no fact speaks of a variable.

use std::ops::Range;

use super::compiled::{Argument, Fact, Node, Query, Slot, Variable};
use super::symbols::{Extension, Object, Relation};
use super::table::{SCANNED_MAX, Table};
use super::world::World;

/// A world as it is read; while a component of axioms settles, with what it has come to so far.
#[derive(Clone, Copy)]
pub(super) struct View<'w> {
    pub(super) world: &'w World,
    growing: Option<(usize, &'w [Table])>,
}

/// Called for every binding; answers whether to go on. What it changes in the frame it puts back.
pub(super) type Visit<'v> = dyn FnMut(&mut [Object]) -> bool + 'v;

/// Facts with more arguments are only looked up, not walked through: the arguments that a walk has
/// bound are kept in as many bits.
pub(super) const ARITY_MAX: usize = 64;

/// How a query goes on.
enum Step<'w, 'q> {
    /// With a choice.
    Choose(Choices<'w, 'q>),
    /// All variables are bound, and everything holds.
    Found,
    /// There is no such binding.
    Stuck,
}

/// What variables can be bound to next.
enum Choices<'w, 'q> {
    /// The arguments of a fact, to these rows.
    Rows(&'w Table, &'w [u32], &'q Fact),
    /// A variable, to one object.
    One(Slot, Object),
    /// A variable, to all objects of its type.
    Members(Slot, &'q Extension),
}

/// A choice that is being tried. The levels stand on a list and not on the stack, because a text
/// from anywhere may have any number of variables.
struct Level<'w, 'q> {
    choices: Choices<'w, 'q>,
    /// How many have been tried.
    tried: usize,
    /// What the last one has bound: arguments of the fact, or the variable.
    bound: u64,
    /// The parts of the query that have not been looked at.
    open: u64,
}

// === impl View ===

impl<'w> View<'w> {
    pub(super) fn of(world: &'w World) -> View<'w> {
        View { world, growing: None }
    }

    pub(super) fn growing(world: &'w World, component: usize, tables: &'w [Table]) -> View<'w> {
        View { world, growing: Some((component, tables)) }
    }

    /// The facts of a predicate.
    pub(super) fn table(self, relation: Relation) -> &'w Table {
        match (self.world.model.axioms.place(relation), self.growing) {
            (None, _) => &self.world.facts[relation.index()],
            (Some((component, at)), Some((growing, tables))) if component == growing => &tables[at],
            (Some((component, at)), _) => &self.world.derived(component)[at],
        }
    }

    /// Whether a condition holds, whose variables are all bound.
    pub(super) fn holds(self, node: &Node, frame: &mut [Object]) -> bool {
        match node {
            Node::Constant(value) => *value,
            Node::Fact(fact, positive) => {
                let table = self.table(fact.relation);
                table.contains(|column| fact.arguments[column].value(frame)) == *positive
            }
            Node::Equal(left, right, positive) => {
                (left.value(frame) == right.value(frame)) == *positive
            }
            Node::Compare(compare, positive) => self.compares(compare, frame) == *positive,
            Node::All(parts) => parts.iter().all(|part| self.holds(part, frame)),
            Node::Any(parts) => parts.iter().any(|part| self.holds(part, frame)),
            Node::Exists(query, positive) => self.each(query, frame, &mut |_| false) != *positive,
        }
    }

    /// Calls `visit` once for every binding of a query's variables under which all its parts hold,
    /// until it answers `false`. Whether it always answered `true`.
    pub(super) fn each(self, query: &Query, frame: &mut [Object], visit: &mut Visit<'_>) -> bool {
        let mut open = all_parts(query);
        match self.next_step(query, &mut open, frame) {
            Step::Stuck => true,
            Step::Found => visit(frame),
            Step::Choose(choices) => self.search(query, Level::of(choices, open), frame, visit),
        }
    }

    /// Like [`View::each`], with only some rows for one part, which is a fact.
    pub(super) fn each_from(
        self,
        query: &Query,
        part: usize,
        rows: Range<usize>,
        frame: &mut [Object],
        visit: &mut Visit<'_>,
    ) -> bool {
        let Node::Fact(fact, true) = &query.parts[part].node else { return true };
        let table = self.table(fact.relation);
        let choices = Choices::Rows(table, &table.rows()[rows], fact);
        let open = all_parts(query) & !(1 << part);
        self.search(query, Level::of(choices, open), frame, visit)
    }

    /// Tries all choices, and after each of them what can be chosen then.
    fn search<'q>(
        self,
        query: &'q Query,
        first: Level<'w, 'q>,
        frame: &mut [Object],
        visit: &mut Visit<'_>,
    ) -> bool {
        let mut levels = vec![first];
        while let Some(level) = levels.last_mut() {
            if !level.advance(query, frame) {
                levels.pop();
                continue;
            }
            let mut open = level.open;
            match self.next_step(query, &mut open, frame) {
                Step::Stuck => (),
                Step::Choose(choices) => levels.push(Level::of(choices, open)),
                Step::Found => {
                    if !visit(frame) {
                        levels.iter_mut().for_each(|level| level.unbind(frame));
                        return false;
                    }
                }
            }
        }
        true
    }

    /// Looks at every part whose variables are bound, and chooses what to bind next.
    fn next_step<'q>(self, query: &'q Query, open: &mut u64, frame: &mut [Object]) -> Step<'w, 'q> {
        // The part whose choices are fewest, and how many they are.
        let (mut best, mut fewest) = (None, usize::MAX);
        let mut left = *open;
        while left != 0 {
            let index = left.trailing_zeros() as usize;
            left &= left - 1;
            let part = &query.parts[index];
            if part.slots.iter().all(|slot| frame[slot.index()] != Object::UNBOUND) {
                if !self.holds(&part.node, frame) {
                    return Step::Stuck;
                }
                *open &= !(1 << index);
                continue;
            }
            match &part.node {
                Node::Fact(fact, true) if fewest > 0 && fact.arguments.len() <= ARITY_MAX => {
                    let table = self.table(fact.relation);
                    let rows = fitting(table, fact, frame);
                    if rows.len() < fewest {
                        fewest = rows.len();
                        best = Some((Choices::Rows(table, rows, fact), index));
                    }
                }
                Node::Equal(left, right, true) if fewest > 1 => {
                    if let Some((slot, object)) = one_side(*left, *right, frame) {
                        fewest = 1;
                        best = Some((Choices::One(slot, object), index));
                    }
                }
                _ => (),
            }
        }
        match best {
            Some((choices, part)) => {
                *open &= !(1 << part);
                Step::Choose(choices)
            }
            None => match smallest(query, frame) {
                Some(variable) => {
                    Step::Choose(Choices::Members(variable.slot, &variable.extension))
                }
                None => Step::Found,
            },
        }
    }
}

// === impl Level ===

impl<'w, 'q> Level<'w, 'q> {
    fn of(choices: Choices<'w, 'q>, open: u64) -> Level<'w, 'q> {
        Level { choices, tried: 0, bound: 0, open }
    }

    /// Takes the next choice that fits; whether there is one.
    fn advance(&mut self, query: &Query, frame: &mut [Object]) -> bool {
        loop {
            self.unbind(frame);
            let index = self.tried;
            self.tried += 1;
            let fits = match &self.choices {
                Choices::Rows(table, rows, fact) => { rows.get(index) }
                    .map(|row| bind(query, fact, table.tuple(*row), frame, &mut self.bound)),
                Choices::One(slot, object) => {
                    let fits = index == 0 && query.accepts(*slot, *object);
                    fits.then(|| self.bound = bind_one(*slot, *object, frame)).map(|()| true)
                }
                Choices::Members(slot, extension) => { extension.get(index) }
                    .map(|object| self.bound = bind_one(*slot, object, frame))
                    .map(|()| true),
            };
            match fits {
                Some(true) => return true,
                Some(false) => (),
                None => return false,
            }
        }
    }

    fn unbind(&mut self, frame: &mut [Object]) {
        let mut bound = std::mem::take(&mut self.bound);
        match &self.choices {
            Choices::Rows(.., fact) => {
                while bound != 0 {
                    let argument = fact.arguments[bound.trailing_zeros() as usize];
                    if let Argument::Slot(slot) = argument {
                        frame[slot.index()] = Object::UNBOUND;
                    }
                    bound &= bound - 1;
                }
            }
            Choices::One(slot, _) | Choices::Members(slot, _) => {
                if bound != 0 {
                    frame[slot.index()] = Object::UNBOUND;
                }
            }
        }
    }
}

/// Binds a variable; what to note as bound.
fn bind_one(slot: Slot, object: Object, frame: &mut [Object]) -> u64 {
    frame[slot.index()] = object;
    1
}

/// Binds the arguments of a fact to a tuple, as far as they are not bound, and notes which in
/// `bound`. Whether they fit.
fn bind(
    query: &Query,
    fact: &Fact,
    tuple: &[Object],
    frame: &mut [Object],
    bound: &mut u64,
) -> bool {
    let mut pairs = fact.arguments.iter().zip(tuple).enumerate();
    pairs.all(|(index, (argument, object))| match argument {
        Argument::Slot(slot) if frame[slot.index()] == Object::UNBOUND => {
            frame[slot.index()] = *object;
            *bound |= 1 << index;
            query.accepts(*slot, *object)
        }
        argument => argument.value(frame) == *object,
    })
}

/// All parts of a query, as bits.
fn all_parts(query: &Query) -> u64 {
    match query.parts.len() {
        0 => 0,
        count => u64::MAX >> (64 - count),
    }
}

/// Rows among which are all that fit a fact's arguments, few if that is cheap to tell.
fn fitting<'w>(table: &'w Table, fact: &Fact, frame: &[Object]) -> &'w [u32] {
    let mut fewest = table.rows();
    for (column, argument) in fact.arguments.iter().enumerate() {
        if fewest.len() <= SCANNED_MAX {
            break;
        }
        let object = argument.value(frame);
        if object != Object::UNBOUND {
            let rows = table.matching(column, object);
            if rows.len() < fewest.len() {
                fewest = rows;
            }
        }
    }
    fewest
}

/// The variable of an equation and the object it must be, if one side is bound.
fn one_side(left: Argument, right: Argument, frame: &[Object]) -> Option<(Slot, Object)> {
    match (left, right) {
        (Argument::Slot(slot), other) if frame[slot.index()] == Object::UNBOUND => {
            let object = other.value(frame);
            (object != Object::UNBOUND).then_some((slot, object))
        }
        (other, Argument::Slot(slot)) => Some((slot, other.value(frame))),
        _ => None,
    }
}

/// The variable with the fewest objects among those that are not bound.
fn smallest<'q>(query: &'q Query, frame: &[Object]) -> Option<&'q Variable> {
    let is_unbound = |variable: &&Variable| frame[variable.slot.index()] == Object::UNBOUND;
    query.variables.iter().filter(is_unbound).min_by_key(|variable| variable.extension.len())
}
