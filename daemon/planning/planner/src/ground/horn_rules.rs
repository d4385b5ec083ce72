//! Horn rules of the delete relaxation.
//!
//! - [`rules`] creates one rule per disjunct of a condition. A part of a condition without a Horn
//!   form is assumed to hold. A fact may therefore be called reachable by mistake, but never
//!   unreachable.
//! - [`HornRule::narrow`] uses static facts to restrict the objects of a variable. A variable with
//!   a single possible object is replaced by this object, and atoms that only express the
//!   restriction are dropped.

use super::action_relation;
use super::ground_fluents::GroundFluents;
use super::join::{JoinFilter, is_static};
use super::object_sets::ObjectSets;
use super::relation::Relation;
use crate::normalize::lifted::{Formula, Lifted, LiftedAtom, LiftedTerm, SlotIndex, TypeIndex};
use crate::task::ObjectId;

/// Maximum number of alternatives that one condition is expanded into. If there would be more, a
/// disjunction in the condition is assumed to hold.
const DISJUNCTS_MAX: usize = 8;

/// Limit on the rows of static facts that narrowing reads for all rules together. Atoms with more
/// rows than are left are skipped, so the variables of their rules stay wider. Reading the rows
/// takes about a tenth of a second.
pub(super) const NARROWING_ROWS_MAX: u64 = 20_000_000;

/// Maximum number of narrowing passes over the atoms of a rule. After the last one, the sets of
/// objects stay as they are, even if another pass could narrow them further.
const NARROWING_PASSES_MAX: usize = 4;

/// A Horn rule, `head(terms) :- body`: the head is reachable if the whole body is reachable.
#[derive(Clone, Debug)]
pub(super) struct HornRule {
    pub(super) head: LiftedAtom,
    /// Per slot (variable): the set of objects that it may be bound to.
    pub(super) frame: Vec<TypeIndex>,
    pub(super) body: Conjunct,
    /// Variables that must be bound even if no atom of the body contains them.
    pub(super) wanted: Vec<SlotIndex>,
}

/// Body of a rule: a conjunction of atoms and tests.
#[derive(Clone, Debug, Default)]
pub(super) struct Conjunct {
    pub(super) atoms: Vec<LiftedAtom>,
    pub(super) filters: Vec<JoinFilter>,
}

/// Context for narrowing rules: the input data, and the store for new object sets.
pub(super) struct Narrowing<'g> {
    pub(super) lifted: &'g Lifted,
    pub(super) relations: &'g mut [Relation],
    pub(super) values: &'g GroundFluents,
    pub(super) sets: &'g mut ObjectSets,
    pub(super) rows_left: u64,
}

/// Returns the rules of all schemas, conditional effects and axioms. Unconditional effects need no
/// rules, because their facts follow directly from the tuples of their schema.
pub(super) fn rules(lifted: &Lifted) -> Vec<HornRule> {
    let mut rules = Vec::new();
    for (index, schema) in lifted.schemas.iter().enumerate() {
        let parameters: Vec<SlotIndex> = (0..schema.parameter_count as SlotIndex).collect();
        let arguments = parameters.iter().map(|slot| LiftedTerm::Variable(*slot)).collect();
        let applies = LiftedAtom { predicate: action_relation(lifted, index), arguments };
        for body in relax(lifted, &schema.precondition) {
            let (head, frame) = (applies.clone(), schema.frame.clone());
            rules.push(HornRule { head, frame, body, wanted: parameters.clone() });
        }
        for effect in schema.effects.iter().filter(|one| one.adds && !one.is_unconditional()) {
            for mut body in relax(lifted, &effect.condition) {
                body.atoms.push(applies.clone());
                let (head, frame) = (effect.atom.clone(), schema.frame.clone());
                rules.push(HornRule { head, frame, body, wanted: effect.variables.clone() });
            }
        }
    }
    for axiom in &lifted.axioms {
        let wanted: Vec<SlotIndex> = (0..axiom.parameter_count as SlotIndex).collect();
        let arguments = wanted.iter().map(|slot| LiftedTerm::Variable(*slot)).collect();
        let head = LiftedAtom { predicate: axiom.head, arguments };
        for body in relax(lifted, &axiom.body) {
            let (head, frame, wanted) = (head.clone(), axiom.frame.clone(), wanted.clone());
            rules.push(HornRule { head, frame, body, wanted });
        }
    }
    rules
}

/// Returns rule bodies, at least one of which holds whenever the formula can hold.
pub(super) fn relax(lifted: &Lifted, formula: &Formula) -> Vec<Conjunct> {
    match formula {
        Formula::Constant(true) | Formula::Forall(..) => vec![Conjunct::default()],
        Formula::Constant(false) => Vec::new(),
        Formula::Literal { positive, atom } => vec![relax_literal(lifted, *positive, atom)],
        Formula::Equal { positive, left, right } => {
            vec![Conjunct::of(JoinFilter::Equal {
                positive: *positive,
                left: *left,
                right: *right,
            })]
        }
        Formula::Compare { comparison, sides } => {
            let mut varies = false;
            formula.functions(&mut |one| varies |= lifted.functions[one].is_numeric_fluent());
            if varies {
                return vec![Conjunct::default()];
            }
            let (comparison, sides) = (*comparison, sides.clone());
            vec![Conjunct::of(JoinFilter::Compare { comparison, sides })]
        }
        Formula::And(parts) => relax_all(lifted, parts),
        Formula::Or(parts) => {
            let any: Vec<Conjunct> = parts.iter().flat_map(|part| relax(lifted, part)).collect();
            if any.len() > DISJUNCTS_MAX { vec![Conjunct::default()] } else { any }
        }
        Formula::Exists(_, inner) => relax(lifted, inner),
    }
}

fn relax_literal(lifted: &Lifted, positive: bool, atom: &LiftedAtom) -> Conjunct {
    let predicate = &lifted.predicates[atom.predicate];
    match positive {
        true => Conjunct { atoms: vec![atom.clone()], filters: Vec::new() },
        false if predicate.deleted || predicate.derived => Conjunct::default(),
        false => Conjunct::of(JoinFilter::NotInitially(atom.clone())),
    }
}

fn relax_all(lifted: &Lifted, parts: &[Formula]) -> Vec<Conjunct> {
    let mut whole = vec![Conjunct::default()];
    // Nested conjunctions are flattened. Grounding does not repeat the tests of a join, so such
    // tests must not be dropped together with a disjunction next to them.
    let mut flat = Vec::new();
    flatten(parts, &mut flat);
    for part in flat {
        let alternatives = relax(lifted, part);
        if alternatives.len() > 1 && alternatives.len() * whole.len() > DISJUNCTS_MAX {
            continue;
        }
        if let [only] = alternatives.as_slice() {
            whole.iter_mut().for_each(|left| left.extend(only));
            continue;
        }
        let pairs =
            whole.iter().flat_map(|left| alternatives.iter().map(move |right| left.and(right)));
        whole = pairs.collect();
    }
    whole
}

fn flatten<'f>(parts: &'f [Formula], flat: &mut Vec<&'f Formula>) {
    for part in parts {
        match part {
            Formula::And(inner) => flatten(inner, flat),
            other => flat.push(other),
        }
    }
}

// === impl Conjunct ===

impl Conjunct {
    fn of(filter: JoinFilter) -> Conjunct {
        Conjunct { atoms: Vec::new(), filters: vec![filter] }
    }

    fn extend(&mut self, other: &Conjunct) {
        for atom in &other.atoms {
            if !self.atoms.contains(atom) {
                self.atoms.push(atom.clone());
            }
        }
        self.filters.extend(other.filters.iter().cloned());
    }

    fn and(&self, other: &Conjunct) -> Conjunct {
        let mut both = self.clone();
        both.extend(other);
        both
    }
}

// === impl HornRule ===

impl HornRule {
    /// Narrows the sets of objects for the variables. Returns `false` if the rule can never fire.
    pub(super) fn narrow(&mut self, known: &mut Narrowing<'_>) -> bool {
        self.merge_equal(known);
        for _ in 0..NARROWING_PASSES_MAX {
            let before = self.frame.clone();
            let is_possible = self.narrow_by_atoms(known) && self.narrow_by_filters(known);
            if !is_possible {
                return false;
            }
            self.put_single_objects(known);
            if self.frame == before {
                break;
            }
        }
        true
    }

    /// For each equality between two variables, replaces one of them by the other.
    fn merge_equal(&mut self, known: &mut Narrowing<'_>) {
        let equal = |filter: &JoinFilter| match *filter {
            JoinFilter::Equal {
                positive: true,
                left: LiftedTerm::Variable(left),
                right: LiftedTerm::Variable(right),
            } => Some((left, right)),
            _ => None,
        };
        while let Some(at) = self.body.filters.iter().position(|one| equal(one).is_some()) {
            let Some((left, right)) = equal(&self.body.filters.swap_remove(at)) else { return };
            if left != right {
                let set = known.sets.both(self.frame[left as usize], self.frame[right as usize]);
                self.frame[right as usize] = set;
                self.substitute(left, LiftedTerm::Variable(right));
            }
        }
    }

    /// Replaces the variable `slot` by the term `by` in the whole rule.
    fn substitute(&mut self, slot: SlotIndex, by: LiftedTerm) {
        let mut put = |term: &mut LiftedTerm| {
            if *term == LiftedTerm::Variable(slot) {
                *term = by;
            }
        };
        self.head.arguments.iter_mut().for_each(&mut put);
        self.body.atoms.iter_mut().flat_map(|atom| &mut atom.arguments).for_each(&mut put);
        self.body.filters.iter_mut().for_each(|filter| filter.terms_mut(&mut put));
        let is_wanted = self.wanted.contains(&slot);
        self.wanted.retain(|one| *one != slot);
        if let (true, LiftedTerm::Variable(by)) = (is_wanted, by)
            && !self.wanted.contains(&by)
        {
            self.wanted.push(by);
        }
    }

    /// Replaces variables with a single possible object by that object, and removes atoms that
    /// become duplicates.
    fn put_single_objects(&mut self, known: &Narrowing<'_>) {
        let mut slots = Vec::new();
        self.slots(&mut |slot| {
            if known.sets.get(self.frame[slot as usize]).members.len() == 1 {
                slots.push(slot);
            }
        });
        for slot in slots {
            let object = known.sets.get(self.frame[slot as usize]).members[0];
            self.substitute(slot, LiftedTerm::Object(object));
        }
        let mut seen = Vec::with_capacity(self.body.atoms.len());
        self.body.atoms.retain(|atom| {
            let is_new = !seen.contains(atom);
            seen.push(atom.clone());
            is_new
        });
    }

    /// Calls `visit` for every variable of the head and the body.
    fn slots(&self, visit: &mut dyn FnMut(SlotIndex)) {
        let atoms = self.body.atoms.iter().chain([&self.head]);
        for term in atoms.flat_map(|atom| &atom.arguments) {
            if let LiftedTerm::Variable(slot) = term {
                visit(*slot);
            }
        }
        self.body.filters.iter().for_each(|filter| filter.slots(visit));
        self.wanted.iter().for_each(|slot| visit(*slot));
    }

    /// Narrows the variables by each static atom. Atoms with at most one variable are then
    /// redundant and dropped. Returns `false` if the rule can never fire.
    fn narrow_by_atoms(&mut self, known: &mut Narrowing<'_>) -> bool {
        let mut position = 0;
        while position < self.body.atoms.len() {
            let atom = &self.body.atoms[position];
            if !is_static(known.lifted, atom.predicate) {
                position += 1;
                continue;
            }
            let variables = variables(atom);
            let rows = known.relations[atom.predicate].len() as u64;
            if variables.len() > 1 && rows > known.rows_left {
                position += 1;
                continue;
            }
            let Some(supported) = known.supported(atom, &variables, &self.frame) else {
                return false;
            };
            for (slot, set) in variables.iter().zip(supported) {
                self.frame[*slot as usize] = set;
            }
            if variables.len() > 1 {
                position += 1;
            } else {
                self.want(&variables);
                self.body.atoms.remove(position);
            }
        }
        true
    }

    /// Adds the variables of a dropped atom to `wanted`, if a filter still uses them.
    fn want(&mut self, variables: &[SlotIndex]) {
        for slot in variables {
            let mut is_used = false;
            let mut note = |one: SlotIndex| is_used |= one == *slot;
            self.body.filters.iter().for_each(|filter| filter.slots(&mut note));
            if is_used && !self.wanted.contains(slot) {
                self.wanted.push(*slot);
            }
        }
    }

    /// Narrows the variables by the filters with at most one variable, and drops these filters.
    /// Returns `false` if the rule can never fire.
    fn narrow_by_filters(&mut self, known: &mut Narrowing<'_>) -> bool {
        let mut binding = vec![ObjectId::from_index(0); self.frame.len()];
        let mut position = 0;
        while position < self.body.filters.len() {
            let filter = &self.body.filters[position];
            let mut slots = Vec::new();
            filter.slots(&mut |slot| {
                if !slots.contains(&slot) {
                    slots.push(slot);
                }
            });
            let passes =
                |binding: &[ObjectId]| filter.passes(known.relations, known.values, binding);
            match slots.as_slice() {
                [] if !passes(&binding) => return false,
                [] => (),
                [slot] => {
                    let set = known.sets.get(self.frame[*slot as usize]);
                    let mut bits = set.bits().to_vec();
                    for object in &set.members {
                        binding[*slot as usize] = *object;
                        if !passes(&binding) {
                            bits[object.index() / 64] &= !(1 << (object.index() % 64));
                        }
                    }
                    if bits.iter().all(|word| *word == 0) {
                        return false;
                    }
                    self.frame[*slot as usize] = known.sets.intern(bits);
                }
                _ => {
                    position += 1;
                    continue;
                }
            }
            self.body.filters.remove(position);
        }
        true
    }
}

/// Returns the variables of an atom, without duplicates.
pub(super) fn variables(atom: &LiftedAtom) -> Vec<SlotIndex> {
    let mut all = Vec::new();
    for term in &atom.arguments {
        if let LiftedTerm::Variable(slot) = term
            && !all.contains(slot)
        {
            all.push(*slot);
        }
    }
    all
}

// === impl Narrowing ===

impl Narrowing<'_> {
    /// Returns, per variable of a static atom, the set of objects that the facts of the atom allow.
    /// Returns `None` if a set is empty, or if the atom has no variables and is false.
    fn supported(
        &mut self,
        atom: &LiftedAtom,
        variables: &[SlotIndex],
        frame: &[TypeIndex],
    ) -> Option<Vec<TypeIndex>> {
        let (mut columns, mut key) = (Vec::new(), Vec::new());
        for (column, term) in atom.arguments.iter().enumerate() {
            if matches!(term, LiftedTerm::Object(_)) {
                columns.push(column);
                key.push(*term);
            }
        }
        if variables.is_empty() {
            return self.relations[atom.predicate].find_terms(&key, &[]).map(|_| Vec::new());
        }
        let index = self.relations[atom.predicate].index(&columns);
        let relation = &self.relations[atom.predicate];
        let words = self.sets.get(frame[variables[0] as usize]).bits().len();
        let mut bits = vec![vec![0u64; words]; variables.len()];
        let mut objects = vec![None; variables.len()];
        for row in relation.matching(index, &key, &[]) {
            self.rows_left = self.rows_left.saturating_sub(1);
            objects.fill(None);
            let fits = atom.arguments.iter().zip(relation.row(row)).all(|(term, object)| {
                let LiftedTerm::Variable(slot) = term else { return true };
                let at = variables.iter().position(|one| one == slot).unwrap_or(0);
                let earlier = objects[at].replace(*object);
                self.sets.get(frame[*slot as usize]).contains(*object)
                    && earlier.is_none_or(|earlier| earlier == *object)
            });
            if fits {
                for (bits, object) in bits.iter_mut().zip(objects.iter().flatten()) {
                    bits[object.index() / 64] |= 1 << (object.index() % 64);
                }
            }
        }
        if bits.iter().any(|bits| bits.iter().all(|word| *word == 0)) {
            return None;
        }
        Some(bits.into_iter().map(|bits| self.sets.intern(bits)).collect())
    }
}
