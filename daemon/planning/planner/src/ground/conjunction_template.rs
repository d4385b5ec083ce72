//! Conditions, split into literals, which are grounded directly, and other parts, which are
//! grounded as trees.
//!
//! Most conditions are conjunctions of literals, and their ground literals are written directly
//! into an array. Only disjunctions, quantifiers and numeric comparisons become a
//! [`GroundFormula`].

use super::formula_template::{FormulaGrounder, FormulaTemplate, LiteralTruth};
use super::ground_formula::GroundFormula;
use super::grounding_meter::GroundingMeter;
use super::join::{Catalog, is_static};
use crate::normalize::lifted::{Formula, LiftedAtom, LiftedTerm, TypeIndex};
use crate::outcome::StopReason;
use crate::task::{Literal, ObjectId};

/// A condition that is prepared for grounding: its literals and its other parts.
#[derive(Debug, Default)]
pub(super) struct ConjunctionTemplate {
    equalities: Vec<(bool, LiftedTerm, LiftedTerm)>,
    literals: Vec<(bool, LiftedAtom)>,
    rest: Vec<FormulaTemplate>,
}

// === impl ConjunctionTemplate ===

impl ConjunctionTemplate {
    /// Prepares a formula for grounding. If `is_joined` is true, a join has already tested the
    /// equalities and static literals in the formula.
    pub(super) fn compile(
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        formula: &Formula,
        bound: &mut [bool],
        is_joined: bool,
    ) -> ConjunctionTemplate {
        let mut condition = ConjunctionTemplate::default();
        condition.add(catalog, frame, formula, bound, is_joined);
        condition
    }

    fn add(
        &mut self,
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        formula: &Formula,
        bound: &mut [bool],
        is_joined: bool,
    ) {
        match formula {
            Formula::Constant(true) => (),
            Formula::And(parts) => {
                parts.iter().for_each(|part| self.add(catalog, frame, part, bound, is_joined));
            }
            Formula::Literal { atom, .. }
                if is_joined && is_static(catalog.lifted, atom.predicate) => {}
            Formula::Literal { positive, atom } => self.literals.push((*positive, atom.clone())),
            Formula::Equal { .. } if is_joined => (),
            Formula::Equal { positive, left, right } => {
                self.equalities.push((*positive, *left, *right));
            }
            other => self.rest.push(FormulaTemplate::compile(catalog, frame, other, bound)),
        }
    }

    /// Grounds the condition under a binding. Writes its sorted literals to `literals`, and returns
    /// the other parts. Returns [`GroundFormula::False`] if the condition can never hold.
    #[inline]
    pub(super) fn ground(
        &self,
        grounder: &mut FormulaGrounder<'_>,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut GroundingMeter<'_>,
        literals: &mut Vec<Literal>,
    ) -> Result<GroundFormula, StopReason> {
        let differs = |(positive, left, right): &(bool, LiftedTerm, LiftedTerm)| {
            (left.object(binding) == right.object(binding)) != *positive
        };
        if self.equalities.iter().any(differs) {
            return Ok(GroundFormula::False);
        }
        for (positive, atom) in &self.literals {
            match grounder.literal(*positive, atom, binding) {
                LiteralTruth::True => (),
                LiteralTruth::False => return Ok(GroundFormula::False),
                LiteralTruth::Open(literal) => literals.push(literal),
            }
        }
        let mut rest = Vec::new();
        for node in &self.rest {
            match grounder.tree(node, frame, binding, work)? {
                GroundFormula::True => (),
                GroundFormula::False => return Ok(GroundFormula::False),
                GroundFormula::Literal(literal) => literals.push(literal),
                GroundFormula::And(parts) => {
                    for part in parts {
                        match part {
                            GroundFormula::Literal(literal) => literals.push(literal),
                            other => rest.push(other),
                        }
                    }
                }
                or => rest.push(or),
            }
        }
        if !tidy(literals) {
            return Ok(GroundFormula::False);
        }
        Ok(if rest.is_empty() { GroundFormula::True } else { GroundFormula::and(rest) })
    }
}

/// Sorts literals and removes duplicates. Returns `false` if two of the literals contradict each
/// other.
pub(super) fn tidy(literals: &mut Vec<Literal>) -> bool {
    literals.sort_unstable();
    literals.dedup();
    // The literals of one fact are next to each other, the positive one first.
    !literals.windows(2).any(|pair| pair[0].negated() == pair[1])
}
