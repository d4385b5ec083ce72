//! Lifted conditions, compiled for grounding. Every quantifier has a join plan: grounding an
//! `exists` visits only objects for which the required facts can hold, and grounding a `forall`
//! only objects for which its body can fail.

use pddl::Comparison;
use rustc_hash::FxHashMap;

use super::ground_fluents::{ExpressionValue, GroundFluents};
use super::ground_formula::GroundFormula;
use super::grounding_meter::GroundingMeter;
use super::join::{Catalog, Join, JoinAtom, JoinPlan};
use super::object_sets::ObjectSets;
use super::relation::Relation;
use crate::normalize::lifted::{
    Formula, Lifted, LiftedAtom, LiftedExpression, LiftedTerm, SlotIndex, TypeIndex,
};
use crate::outcome::StopReason;
use crate::task::{FactId, GroundComparison, GroundExpression, Literal, ObjectId};

/// A lifted condition that is compiled for grounding.
#[derive(Debug)]
pub(super) enum FormulaTemplate {
    Constant(bool),
    Literal { positive: bool, atom: LiftedAtom },
    Equal { positive: bool, left: LiftedTerm, right: LiftedTerm },
    Compare { comparison: Comparison, sides: Box<(LiftedExpression, LiftedExpression)> },
    And(Vec<FormulaTemplate>),
    Or(Vec<FormulaTemplate>),
    Quantified { existential: bool, plan: JoinPlan, inner: Box<FormulaTemplate> },
}

/// Context for grounding conditions: the input data, and the comparisons found so far.
pub(super) struct FormulaGrounder<'g> {
    pub(super) lifted: &'g Lifted,
    pub(super) relations: &'g [Relation],
    pub(super) sets: &'g ObjectSets,
    /// Per relation: the number of the raw fact of its first row.
    pub(super) offsets: &'g [usize],
    pub(super) values: &'g mut GroundFluents,
    /// Comparisons found so far. Their raw fact numbers begin at `comparison_offset`.
    pub(super) comparisons: &'g mut Comparisons,
    pub(super) comparison_offset: usize,
}

/// Comparisons that depend on the state, without duplicates.
#[derive(Clone, Debug, Default)]
pub(super) struct Comparisons {
    pub(super) all: Vec<GroundComparison>,
    /// Index of each comparison; the key is the comparison's debug text.
    known: FxHashMap<String, usize>,
}

/// Truth value of a literal after its variables are replaced by objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LiteralTruth {
    True,
    False,
    /// The truth value depends on the state.
    Open(Literal),
}

/// Number of raw fact numbers that are reserved for comparisons. More numbers than needed are
/// reserved, because the number of comparisons is not known in advance.
pub(super) const COMPARISONS_MAX: usize = 1 << 24;

// === impl FormulaTemplate ===

impl FormulaTemplate {
    pub(super) fn compile(
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        formula: &Formula,
        bound: &mut [bool],
    ) -> FormulaTemplate {
        match formula {
            Formula::Constant(truth) => FormulaTemplate::Constant(*truth),
            Formula::Literal { positive, atom } => {
                FormulaTemplate::Literal { positive: *positive, atom: atom.clone() }
            }
            Formula::Equal { positive, left, right } => {
                FormulaTemplate::Equal { positive: *positive, left: *left, right: *right }
            }
            Formula::Compare { comparison, sides } => {
                FormulaTemplate::Compare { comparison: *comparison, sides: sides.clone() }
            }
            Formula::And(parts) => {
                FormulaTemplate::And(FormulaTemplate::all(catalog, frame, parts, bound))
            }
            Formula::Or(parts) => {
                FormulaTemplate::Or(FormulaTemplate::all(catalog, frame, parts, bound))
            }
            Formula::Exists(slots, inner) => {
                FormulaTemplate::quantified(catalog, frame, slots, inner, true, bound)
            }
            Formula::Forall(slots, inner) => {
                FormulaTemplate::quantified(catalog, frame, slots, inner, false, bound)
            }
        }
    }

    fn all(
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        parts: &[Formula],
        bound: &mut [bool],
    ) -> Vec<FormulaTemplate> {
        parts.iter().map(|part| FormulaTemplate::compile(catalog, frame, part, bound)).collect()
    }

    fn quantified(
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        slots: &[SlotIndex],
        inner: &Formula,
        existential: bool,
        bound: &mut [bool],
    ) -> FormulaTemplate {
        let decided = match inner {
            Formula::And(parts) if existential => parts.is_empty(),
            Formula::Or(parts) if !existential => parts.is_empty(),
            _ => false,
        };
        if decided {
            let is_empty =
                |slot: &SlotIndex| catalog.sets.get(frame[*slot as usize]).members.is_empty();
            return FormulaTemplate::Constant(slots.iter().any(is_empty) != existential);
        }
        let mut inside = bound.to_vec();
        let plan = enumeration(catalog, frame, slots, inner, existential, &mut inside);
        let inner = Box::new(FormulaTemplate::compile(catalog, frame, inner, &mut inside));
        FormulaTemplate::Quantified { existential, plan, inner }
    }
}

/// Plans a join that binds `slots` to all objects for which the truth of `formula` is open. With
/// `existential` (for an `exists` or a `when`), objects are skipped if the formula is certainly
/// false for them. Otherwise (for a `forall`), they are skipped if it is certainly true.
pub(super) fn enumeration(
    catalog: &mut Catalog<'_>,
    frame: &[TypeIndex],
    slots: &[SlotIndex],
    formula: &Formula,
    existential: bool,
    bound: &mut [bool],
) -> JoinPlan {
    let mut atoms = Vec::new();
    collect_guards(formula, existential, slots, bound, &mut atoms);
    let parts = atoms.iter().map(|atom| JoinAtom { atom, is_new_to: false });
    JoinPlan::compile(catalog, frame, parts, &[], slots, bound)
}

/// Collects atoms that restrict the objects to visit. With `existential`, these are atoms that must
/// be true for a conjunction to be true. Otherwise (for a `forall`), they are atoms that must be
/// true for a disjunction to be false.
fn collect_guards(
    formula: &Formula,
    existential: bool,
    slots: &[SlotIndex],
    bound: &[bool],
    atoms: &mut Vec<LiftedAtom>,
) {
    match formula {
        Formula::Literal { positive, atom } if *positive == existential => {
            let known = |term: &LiftedTerm| match term {
                LiftedTerm::Variable(slot) => bound[*slot as usize] || slots.contains(slot),
                LiftedTerm::Object(_) => true,
            };
            if atom.arguments.iter().all(known) {
                atoms.push(atom.clone());
            }
        }
        Formula::And(parts) if existential => {
            parts.iter().for_each(|part| collect_guards(part, existential, slots, bound, atoms));
        }
        Formula::Or(parts) if !existential => {
            parts.iter().for_each(|part| collect_guards(part, existential, slots, bound, atoms));
        }
        _ => (),
    }
}

// === impl FormulaGrounder ===

impl FormulaGrounder<'_> {
    /// Grounds a condition under a binding, and returns it as a tree.
    pub(super) fn tree(
        &mut self,
        node: &FormulaTemplate,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut GroundingMeter<'_>,
    ) -> Result<GroundFormula, StopReason> {
        work.step()?;
        Ok(match node {
            FormulaTemplate::Constant(truth) => truth_value(*truth),
            FormulaTemplate::Literal { positive, atom } => {
                match self.literal(*positive, atom, binding) {
                    LiteralTruth::True => GroundFormula::True,
                    LiteralTruth::False => GroundFormula::False,
                    LiteralTruth::Open(literal) => GroundFormula::Literal(literal),
                }
            }
            FormulaTemplate::Equal { positive, left, right } => {
                truth_value((left.object(binding) == right.object(binding)) == *positive)
            }
            FormulaTemplate::Compare { comparison, sides } => {
                self.compare(*comparison, sides, binding)
            }
            FormulaTemplate::And(parts) => {
                let mut trees = Vec::with_capacity(parts.len());
                for part in parts {
                    let tree = self.tree(part, frame, binding, work)?;
                    if tree == GroundFormula::False {
                        return Ok(tree);
                    }
                    trees.push(tree);
                }
                GroundFormula::and(trees)
            }
            FormulaTemplate::Or(parts) => {
                let mut trees = Vec::with_capacity(parts.len());
                for part in parts {
                    trees.push(self.tree(part, frame, binding, work)?);
                }
                GroundFormula::or(trees)
            }
            FormulaTemplate::Quantified { existential, plan, inner } => {
                let instances = self.instances(plan, inner, frame, binding, work)?;
                if *existential {
                    GroundFormula::or(instances)
                } else {
                    GroundFormula::and(instances)
                }
            }
        })
    }

    /// Grounds a condition under each binding that a join returns.
    fn instances(
        &mut self,
        plan: &JoinPlan,
        inner: &FormulaTemplate,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut GroundingMeter<'_>,
    ) -> Result<Vec<GroundFormula>, StopReason> {
        let mut bindings = Vec::new();
        self.bindings(plan, frame, binding, work, &mut bindings)?;
        let mut trees = Vec::new();
        for inside in bindings.chunks_exact_mut(binding.len()) {
            trees.push(self.tree(inner, frame, inside, work)?);
        }
        Ok(trees)
    }

    /// Appends all bindings that a join finds to `found`, one after the other. `binding` must have
    /// at least one entry, even without variables.
    pub(super) fn bindings(
        &self,
        plan: &JoinPlan,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut GroundingMeter<'_>,
        found: &mut Vec<ObjectId>,
    ) -> Result<(), StopReason> {
        let FormulaGrounder { relations, sets, values, .. } = self;
        let join = Join { relations, sets, values, frame, cause: None };
        join.run(plan, binding, work, &mut |binding, work| {
            found.extend_from_slice(binding);
            work.check_memory(found.len() * size_of::<ObjectId>())
        })
    }

    /// Returns the raw fact of an atom under a binding; `None` if the atom is unreachable.
    #[inline]
    pub(super) fn fact(&self, atom: &LiftedAtom, binding: &[ObjectId]) -> Option<FactId> {
        let row = self.relations[atom.predicate].find_terms(&atom.arguments, binding)?;
        Some(FactId::from_index(self.offsets[atom.predicate] + row))
    }

    /// Grounds a literal under a binding.
    #[inline]
    pub(super) fn literal(
        &self,
        positive: bool,
        atom: &LiftedAtom,
        binding: &[ObjectId],
    ) -> LiteralTruth {
        let truth = |truth: bool| if truth { LiteralTruth::True } else { LiteralTruth::False };
        let predicate = &self.lifted.predicates[atom.predicate];
        let relation = &self.relations[atom.predicate];
        let Some(row) = relation.find_terms(&atom.arguments, binding) else {
            return truth(!positive);
        };
        if row < relation.initial && !predicate.deleted && !predicate.derived {
            return truth(positive);
        }
        let fact = FactId::from_index(self.offsets[atom.predicate] + row);
        LiteralTruth::Open(Literal::new(fact, positive))
    }

    fn compare(
        &mut self,
        comparison: Comparison,
        sides: &(LiftedExpression, LiftedExpression),
        binding: &[ObjectId],
    ) -> GroundFormula {
        let left = self.values.ground(&sides.0, binding);
        let right = self.values.ground(&sides.1, binding);
        let expression = |side| match side {
            ExpressionValue::Undefined => None,
            ExpressionValue::Fixed(number) => Some(GroundExpression::Number(number)),
            ExpressionValue::Varying(expression) => Some(expression),
        };
        match (left, right) {
            (ExpressionValue::Fixed(left), ExpressionValue::Fixed(right)) => {
                truth_value(comparison.holds(left, right))
            }
            (left, right) => match (expression(left), expression(right)) {
                (Some(left), Some(right)) => {
                    self.comparison(GroundComparison { comparison, left, right })
                }
                _ => GroundFormula::False,
            },
        }
    }

    fn comparison(&mut self, comparison: GroundComparison) -> GroundFormula {
        let index = self.comparisons.index(comparison);
        GroundFormula::Literal(Literal::new(
            FactId::from_index(self.comparison_offset + index),
            true,
        ))
    }
}

// === impl Comparisons ===

impl Comparisons {
    /// Returns the index of a comparison, which is added if it is new.
    fn index(&mut self, comparison: GroundComparison) -> usize {
        let Comparisons { all, known } = self;
        *known.entry(format!("{comparison:?}")).or_insert_with(|| {
            all.push(comparison);
            all.len() - 1
        })
    }
}

fn truth_value(truth: bool) -> GroundFormula {
    if truth { GroundFormula::True } else { GroundFormula::False }
}
