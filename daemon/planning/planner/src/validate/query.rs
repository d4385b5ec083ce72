//! Evaluates compiled conditions in a state of the world, and finds the bindings for which they
//! hold.
//!
//! The search always continues where there are the fewest choices: with the fact that has the
//! fewest tuples matching the arguments bound so far. The objects of a type are enumerated only if
//! no fact and no equation determines the variable.

use std::ops::Range;

use super::compiled::{Argument, CompiledCondition, Fact, FrameSlot, Query, Variable};
use super::symbols::{Extension, Object, RelationId};
use super::tuple_table::{SCANNED_MAX, TupleTable};
use super::world::World;

/// Read access to the facts and values of a world. While a component of axioms is being evaluated,
/// the facts of the component that are derived so far are included.
#[derive(Clone, Copy)]
pub(super) struct WorldView<'w> {
    pub(super) world: &'w World,
    growing: Option<(usize, &'w [TupleTable])>,
}

/// Callback that is called for every binding. It returns whether to continue. A callback that
/// changes the frame must restore it before returning.
pub(super) type BindingVisitor<'v> = dyn FnMut(&mut [Object]) -> bool + 'v;

/// Maximum number of arguments of a fact up to which its tuples are enumerated. The set of
/// arguments bound by an enumeration is represented as the bits of one `u64`. A fact with more
/// arguments is only tested once all its arguments are bound.
pub(super) const ARITY_MAX: usize = 64;

/// Next step of the search for bindings of a query.
enum QueryStep<'w, 'q> {
    /// Bind further variables, by trying each of the listed choices.
    Choose(Choices<'w, 'q>),
    /// All variables are bound, and all parts of the query hold.
    Found,
    /// A part of the query does not hold under the choices made so far.
    Stuck,
}

/// Choices for binding the next variables.
enum Choices<'w, 'q> {
    /// Bind the unbound arguments of the fact in turn to the objects of each of the listed rows of
    /// the table.
    Rows(&'w TupleTable, &'w [u32], &'q Fact),
    /// Bind the variable in the slot to the object.
    One(FrameSlot, Object),
    /// Bind the variable in the slot in turn to each object of its type.
    Members(FrameSlot, &'q Extension),
}

/// A choice point of the search. Choice points are stored in a list instead of the call stack,
/// because a text may have any number of variables.
struct ChoicePoint<'w, 'q> {
    choices: Choices<'w, 'q>,
    /// Number of choices tried at this point.
    tried: usize,
    /// Arguments of the fact that the current choice has bound, as bits; bit 0 if the current
    /// choice has bound a variable.
    bound: u64,
    /// Parts of the query that have not been evaluated yet, as bits.
    open: u64,
}

// === impl WorldView ===

impl<'w> WorldView<'w> {
    pub(super) fn of(world: &'w World) -> WorldView<'w> {
        WorldView { world, growing: None }
    }

    pub(super) fn growing(
        world: &'w World,
        component: usize,
        tables: &'w [TupleTable],
    ) -> WorldView<'w> {
        WorldView { world, growing: Some((component, tables)) }
    }

    /// Returns the facts of a predicate.
    pub(super) fn table(self, relation: RelationId) -> &'w TupleTable {
        match (self.world.model.axioms.place(relation), self.growing) {
            (None, _) => &self.world.facts[relation.index()],
            (Some((component, at)), Some((growing, tables))) if component == growing => &tables[at],
            (Some((component, at)), _) => &self.world.derived(component)[at],
        }
    }

    /// Whether a condition holds. All its free variables must be bound in the frame.
    pub(super) fn holds(self, node: &CompiledCondition, frame: &mut [Object]) -> bool {
        match node {
            CompiledCondition::Constant(value) => *value,
            CompiledCondition::Fact(fact, positive) => {
                let table = self.table(fact.relation);
                table.contains(|column| fact.arguments[column].value(frame)) == *positive
            }
            CompiledCondition::Equal(left, right, positive) => {
                (left.value(frame) == right.value(frame)) == *positive
            }
            CompiledCondition::Compare(compare, positive) => {
                self.compares(compare, frame) == *positive
            }
            CompiledCondition::All(parts) => parts.iter().all(|part| self.holds(part, frame)),
            CompiledCondition::Any(parts) => parts.iter().any(|part| self.holds(part, frame)),
            CompiledCondition::Exists(query, positive) => {
                self.each(query, frame, &mut |_| false) != *positive
            }
        }
    }

    /// Calls `visit` once for every binding of a query's variables under which all parts of the
    /// query hold. Stops when `visit` returns `false`, or when the work limit of the world is
    /// reached. Returns whether the search was complete.
    pub(super) fn each(
        self,
        query: &Query,
        frame: &mut [Object],
        visit: &mut BindingVisitor<'_>,
    ) -> bool {
        let mut open = all_parts(query);
        match self.next_step(query, &mut open, frame) {
            QueryStep::Stuck => true,
            QueryStep::Found => visit(frame),
            QueryStep::Choose(choices) => {
                self.search(query, ChoicePoint::of(choices, open), frame, visit)
            }
        }
    }

    /// As [`WorldView::each`], but uses only the given rows for one part, which must be a fact.
    pub(super) fn each_from(
        self,
        query: &Query,
        part: usize,
        rows: Range<usize>,
        frame: &mut [Object],
        visit: &mut BindingVisitor<'_>,
    ) -> bool {
        let CompiledCondition::Fact(fact, true) = &query.parts[part].node else { return true };
        let table = self.table(fact.relation);
        let choices = Choices::Rows(table, &table.rows()[rows], fact);
        let open = all_parts(query) & !(1 << part);
        self.search(query, ChoicePoint::of(choices, open), frame, visit)
    }

    /// Searches all choices for bindings of a query, depth first. Returns whether the search was
    /// complete.
    fn search<'q>(
        self,
        query: &'q Query,
        first: ChoicePoint<'w, 'q>,
        frame: &mut [Object],
        visit: &mut BindingVisitor<'_>,
    ) -> bool {
        let mut levels = vec![first];
        while let Some(level) = levels.last_mut() {
            if !self.world.work.spend(1) {
                levels.iter_mut().for_each(|level| level.unbind(frame));
                return false;
            }
            if !level.advance(query, frame) {
                levels.pop();
                continue;
            }
            let mut open = level.open;
            match self.next_step(query, &mut open, frame) {
                QueryStep::Stuck => (),
                QueryStep::Choose(choices) => levels.push(ChoicePoint::of(choices, open)),
                QueryStep::Found => {
                    if !visit(frame) {
                        levels.iter_mut().for_each(|level| level.unbind(frame));
                        return false;
                    }
                }
            }
        }
        true
    }

    /// Evaluates every open part that has all its variables bound, and selects the variables to
    /// bind next.
    fn next_step<'q>(
        self,
        query: &'q Query,
        open: &mut u64,
        frame: &mut [Object],
    ) -> QueryStep<'w, 'q> {
        // The part with the fewest choices, and their number.
        let (mut best, mut fewest) = (None, usize::MAX);
        let mut left = *open;
        while left != 0 {
            let index = left.trailing_zeros() as usize;
            left &= left - 1;
            let part = &query.parts[index];
            if part.slots.iter().all(|slot| frame[slot.index()] != Object::UNBOUND) {
                if !self.holds(&part.node, frame) {
                    return QueryStep::Stuck;
                }
                *open &= !(1 << index);
                continue;
            }
            match &part.node {
                CompiledCondition::Fact(fact, true)
                    if fewest > 0 && fact.arguments.len() <= ARITY_MAX =>
                {
                    let table = self.table(fact.relation);
                    let rows = fitting(table, fact, frame);
                    if rows.len() < fewest {
                        fewest = rows.len();
                        best = Some((Choices::Rows(table, rows, fact), index));
                    }
                }
                CompiledCondition::Equal(left, right, true) if fewest > 1 => {
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
                QueryStep::Choose(choices)
            }
            None => match smallest(query, frame) {
                Some(variable) => {
                    QueryStep::Choose(Choices::Members(variable.slot, &variable.extension))
                }
                None => QueryStep::Found,
            },
        }
    }
}

// === impl ChoicePoint ===

impl<'w, 'q> ChoicePoint<'w, 'q> {
    fn of(choices: Choices<'w, 'q>, open: u64) -> ChoicePoint<'w, 'q> {
        ChoicePoint { choices, tried: 0, bound: 0, open }
    }

    /// Binds variables by the next choice that matches. Returns `false` if there is no further
    /// choice.
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

/// Binds the variable with this slot to an object. Returns the bits for [`ChoicePoint::bound`].
fn bind_one(slot: FrameSlot, object: Object, frame: &mut [Object]) -> u64 {
    frame[slot.index()] = object;
    1
}

/// Binds the unbound arguments of a fact to the objects of a tuple, and marks these arguments in
/// `bound`. Returns whether the tuple matches the arguments that were already bound.
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

/// Returns the set of all parts of a query, as bits.
fn all_parts(query: &Query) -> u64 {
    match query.parts.len() {
        0 => 0,
        count => u64::MAX >> (64 - count),
    }
}

/// Returns the rows of the table that may match the bound arguments of a fact: those of the most
/// selective column index. The result contains all matching rows, and may contain others.
fn fitting<'w>(table: &'w TupleTable, fact: &Fact, frame: &[Object]) -> &'w [u32] {
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

/// Returns the unbound variable of an equation, and the object to which it must be bound. Returns
/// `None` unless exactly one side is bound.
fn one_side(left: Argument, right: Argument, frame: &[Object]) -> Option<(FrameSlot, Object)> {
    match (left, right) {
        (Argument::Slot(slot), other) if frame[slot.index()] == Object::UNBOUND => {
            let object = other.value(frame);
            (object != Object::UNBOUND).then_some((slot, object))
        }
        (other, Argument::Slot(slot)) => Some((slot, other.value(frame))),
        _ => None,
    }
}

/// Returns the unbound variable of a query with the fewest objects in its type; `None` if all
/// variables are bound.
fn smallest<'q>(query: &'q Query, frame: &[Object]) -> Option<&'q Variable> {
    let is_unbound = |variable: &&Variable| frame[variable.slot.index()] == Object::UNBOUND;
    query.variables.iter().filter(is_unbound).min_by_key(|variable| variable.extension.len())
}
