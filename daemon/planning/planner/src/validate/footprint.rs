//! Footprint of a step: the facts and numbers that the step may read or write in any state.
//!
//! - Every conditional part counts, no matter whether its condition holds.
//! - A step that reads a derived fact counts as reading all facts of the predicates on which the
//!   derived fact may depend.
//! - `total-cost` does not count: almost all steps increase it, and must not wait for each other
//!   because of that.
//! - A quantifier with too many bindings counts as reading or writing every fact of the predicates
//!   in it. This bounds the work of computing a footprint.

use std::collections::BTreeSet;

use pddl::{Atom, Condition, Derived, Effect, Expression, FluentTerm, Name, PlanStep, Typed};

use super::bindings::Bindings;
use super::model::Model;
use super::steps::schema_of;
use super::world::World;

/// Maximum number of bindings of quantified variables that are enumerated for one footprint. Beyond
/// it, the footprint contains whole predicates and functions instead of single facts and fluents.
const BINDINGS_MAX: usize = 100_000;

/// A fact or a fluent: the name of the predicate or function, and the objects.
type Cell = (Name, Vec<Name>);

/// Facts and numbers that a step may read and write.
#[derive(Clone, Debug, Default)]
pub(crate) struct Footprint {
    /// Number of bindings enumerated so far.
    bindings: usize,
    facts_read: BTreeSet<Cell>,
    facts_written: BTreeSet<Cell>,
    fluents_read: BTreeSet<Cell>,
    fluents_written: BTreeSet<Cell>,
    /// Predicates of which the step may read any fact: an axiom depends on them, or a quantifier
    /// over them has too many bindings.
    predicates_read: BTreeSet<Name>,
    functions_read: BTreeSet<Name>,
    /// Predicates of which the step may write any fact, because a quantifier has too many bindings.
    predicates_written: BTreeSet<Name>,
    functions_written: BTreeSet<Name>,
    /// Agents of the step; empty if the action declares none.
    agents: Vec<Name>,
}

// === impl Footprint ===

impl Footprint {
    /// Whether this step must wait for the `earlier` one: their order may matter, or the same agent
    /// executes both.
    pub(crate) fn must_wait_for(&self, earlier: &Footprint) -> bool {
        let same_agent = self.agents.iter().any(|agent| earlier.agents.contains(agent));
        same_agent || self.conflicts(earlier)
    }

    /// Whether the order of two steps may matter: one step may write a fact or number that the
    /// other step reads or writes.
    fn conflicts(&self, other: &Footprint) -> bool {
        self.overwrites(other) || other.overwrites(self)
    }

    /// Whether this step may write a fact or number that the step `other` reads or writes.
    fn overwrites(&self, other: &Footprint) -> bool {
        let touched =
            |written: &BTreeSet<Cell>, sets: [&BTreeSet<Cell>; 2], whole: &BTreeSet<Name>| {
                written.iter().any(|cell| {
                    sets.iter().any(|set| set.contains(cell)) || whole.contains(&cell.0)
                })
            };
        let facts = [&other.facts_read, &other.facts_written];
        let fluents = [&other.fluents_read, &other.fluents_written];
        let touched_whole =
            |written: &BTreeSet<Name>, sets: [&BTreeSet<Cell>; 2], wholes: [&BTreeSet<Name>; 2]| {
                let is_written = |cell: &Cell| written.contains(&cell.0);
                !written.is_empty()
                    && (sets.iter().any(|set| set.iter().any(is_written))
                        || wholes.iter().any(|whole| !whole.is_disjoint(written)))
            };
        let predicates = [&other.predicates_read, &other.predicates_written];
        let functions = [&other.functions_read, &other.functions_written];
        touched(&self.facts_written, facts, &other.predicates_read)
            || touched(&self.fluents_written, fluents, &other.functions_read)
            || touched_whole(&self.predicates_written, facts, predicates)
            || touched_whole(&self.functions_written, fluents, functions)
    }

    /// Counts one binding. Returns `false` if the limit is exceeded.
    fn spend(&mut self) -> bool {
        self.bindings += 1;
        self.bindings <= BINDINGS_MAX
    }

    /// Marks all predicates and functions of a condition as read as a whole.
    fn reads_whole(&mut self, condition: &Condition, axioms: &[Derived]) {
        for atom in condition.atoms() {
            let (predicates, functions) = sources(axioms, &atom.predicate);
            self.predicates_read.extend(predicates);
            self.functions_read.extend(functions);
        }
        self.functions_read.extend(condition.fluents().map(|fluent| fluent.function.clone()));
    }

    /// Marks all predicates and functions that an effect changes as written as a whole, and those
    /// of its conditions and values as read as a whole.
    fn touches_whole(&mut self, effect: &Effect, axioms: &[Derived]) {
        for part in effect.parts() {
            match part {
                Effect::Add(atom) | Effect::Delete(atom) => {
                    self.predicates_written.insert(atom.predicate.clone());
                }
                Effect::Assign(assign) => {
                    let read = assign.value.fluents().map(|fluent| fluent.function.clone());
                    self.functions_read.extend(read);
                    if !is_total_cost(&assign.fluent) {
                        self.functions_written.insert(assign.fluent.function.clone());
                    }
                }
                Effect::When(condition, _) => self.reads_whole(condition, axioms),
                Effect::And(_) | Effect::Forall(..) => (),
            }
        }
    }
}

// === impl World ===

impl World {
    /// Returns the footprint of a step; an empty one if no action fits the step.
    pub(crate) fn footprint(&self, step: &PlanStep) -> Footprint {
        let mut footprint = Footprint::default();
        let Some(schema) = schema_of(&self.model, step) else { return footprint };
        let mut bindings = Bindings::default();
        for (parameter, object) in schema.all_parameters().zip(&step.arguments) {
            bindings.bind(&parameter.name, object.clone());
        }
        footprint.agents = step.arguments.iter().take(schema.agents().count()).cloned().collect();
        self.reads(&schema.precondition, &mut bindings, &mut footprint);
        self.touches(&schema.effect, &mut bindings, &mut footprint);
        footprint
    }

    fn reads(&self, condition: &Condition, bindings: &mut Bindings, found: &mut Footprint) {
        match condition {
            Condition::Atom(atom) => self.reads_atom(atom, bindings, found),
            Condition::Equal(..) => (),
            Condition::Compare(compare) => {
                reads_numbers(&compare.left, bindings, found);
                reads_numbers(&compare.right, bindings, found);
            }
            Condition::Not(inner) => self.reads(inner, bindings, found),
            Condition::And(parts) | Condition::Or(parts) => {
                parts.iter().for_each(|part| self.reads(part, bindings, found));
            }
            Condition::Imply(left, right) => {
                self.reads(left, bindings, found);
                self.reads(right, bindings, found);
            }
            Condition::Exists(variables, inner) | Condition::Forall(variables, inner) => {
                let is_whole = every(&self.model, variables, bindings, &mut |bindings| {
                    self.reads(inner, bindings, found);
                    found.spend()
                });
                if !is_whole {
                    found.reads_whole(inner, &self.model.derived);
                }
            }
        }
    }

    fn reads_atom(&self, atom: &Atom, bindings: &Bindings, found: &mut Footprint) {
        let is_derived = self.model.derived.iter().any(|axiom| axiom.predicate == atom.predicate);
        if is_derived {
            let (predicates, functions) = sources(&self.model.derived, &atom.predicate);
            found.predicates_read.extend(predicates);
            found.functions_read.extend(functions);
        } else {
            found.facts_read.insert((atom.predicate.clone(), bindings.objects(&atom.arguments)));
        }
    }

    fn touches(&self, effect: &Effect, bindings: &mut Bindings, found: &mut Footprint) {
        match effect {
            Effect::And(parts) => {
                parts.iter().for_each(|part| self.touches(part, bindings, found));
            }
            Effect::Add(atom) | Effect::Delete(atom) => {
                let cell = (atom.predicate.clone(), bindings.objects(&atom.arguments));
                found.facts_written.insert(cell);
            }
            Effect::Assign(assign) => {
                reads_numbers(&assign.value, bindings, found);
                if !is_total_cost(&assign.fluent) {
                    found.fluents_written.insert(cell(&assign.fluent, bindings));
                }
            }
            Effect::When(condition, inner) => {
                self.reads(condition, bindings, found);
                self.touches(inner, bindings, found);
            }
            Effect::Forall(variables, inner) => {
                let is_whole = every(&self.model, variables, bindings, &mut |bindings| {
                    self.touches(inner, bindings, found);
                    found.spend()
                });
                if !is_whole {
                    found.touches_whole(inner, &self.model.derived);
                }
            }
        }
    }
}

/// Calls `visit` for every binding of the variables to objects, until `visit` returns `false`.
/// Returns whether `visit` always returned `true`.
fn every(
    model: &Model,
    variables: &[Typed],
    bindings: &mut Bindings,
    visit: &mut dyn FnMut(&mut Bindings) -> bool,
) -> bool {
    let Some((first, rest)) = variables.split_first() else { return visit(bindings) };
    for object in model.members(&first.ty) {
        bindings.bind(&first.name, object);
        let goes_on = every(model, rest, bindings, visit);
        bindings.unbind();
        if !goes_on {
            return false;
        }
    }
    true
}

fn cell(fluent: &FluentTerm, bindings: &Bindings) -> Cell {
    (fluent.function.clone(), bindings.objects(&fluent.arguments))
}

fn is_total_cost(fluent: &FluentTerm) -> bool {
    fluent.function == pddl::TOTAL_COST && fluent.arguments.is_empty()
}

fn reads_numbers(expression: &Expression, bindings: &Bindings, found: &mut Footprint) {
    found.fluents_read.extend(expression.fluents().map(|fluent| cell(fluent, bindings)));
}

/// Returns the predicates and the functions on which the facts of a derived predicate may depend.
/// The predicates include the derived predicate itself.
fn sources(axioms: &[Derived], derived: &Name) -> (Vec<Name>, Vec<Name>) {
    let (mut predicates, mut functions) = (vec![derived.clone()], Vec::new());
    let mut next = 0;
    while let Some(predicate) = predicates.get(next).cloned() {
        next += 1;
        for axiom in axioms.iter().filter(|axiom| axiom.predicate == predicate) {
            for used in axiom.condition.atoms().map(|atom| &atom.predicate) {
                if !predicates.contains(used) {
                    predicates.push(used.clone());
                }
            }
            functions.extend(axiom.condition.fluents().map(|fluent| fluent.function.clone()));
        }
    }
    (predicates, functions)
}
