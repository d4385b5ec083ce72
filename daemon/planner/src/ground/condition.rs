//! Conditions, split into literals that are ground directly and parts that are ground as a tree.
//!
//! Most conditions are conjunctions of literals: those go straight into an array. Only disjunctions,
//! quantifiers and comparisons of numbers become a [`Tree`].

use super::join::{Catalog, is_static};
use super::node::{Grounder, Node, Truth};
use super::tree::Tree;
use super::work::Work;
use crate::normalize::lifted::{Formula, LiftedAtom, LiftedTerm, TypeIndex};
use crate::outcome::StopReason;
use crate::task::{Literal, ObjectId};

/// A conjunction ready for grounding.
#[derive(Debug, Default)]
pub(super) struct Condition {
    equalities: Vec<(bool, LiftedTerm, LiftedTerm)>,
    literals: Vec<(bool, LiftedAtom)>,
    rest: Vec<Node>,
}

// === impl Condition ===

impl Condition {
    /// Compiles a formula. `is_joined` means that a join has already tested its equalities and static
    /// literals.
    pub(super) fn compile(
        catalog: &mut Catalog<'_>,
        frame: &[TypeIndex],
        formula: &Formula,
        bound: &mut [bool],
        is_joined: bool,
    ) -> Condition {
        let mut condition = Condition::default();
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
            other => self.rest.push(Node::compile(catalog, frame, other, bound)),
        }
    }

    /// Appends the literals under a binding to `literals`, sorted, and returns the parts that are not
    /// literals. Returns [`Tree::False`] if the condition can never hold.
    #[inline]
    pub(super) fn ground(
        &self,
        grounder: &mut Grounder<'_>,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut Work<'_>,
        literals: &mut Vec<Literal>,
    ) -> Result<Tree, StopReason> {
        let differs = |(positive, left, right): &(bool, LiftedTerm, LiftedTerm)| {
            (left.object(binding) == right.object(binding)) != *positive
        };
        if self.equalities.iter().any(differs) {
            return Ok(Tree::False);
        }
        for (positive, atom) in &self.literals {
            match grounder.literal(*positive, atom, binding) {
                Truth::True => (),
                Truth::False => return Ok(Tree::False),
                Truth::Open(literal) => literals.push(literal),
            }
        }
        let mut rest = Vec::new();
        for node in &self.rest {
            match grounder.tree(node, frame, binding, work)? {
                Tree::True => (),
                Tree::False => return Ok(Tree::False),
                Tree::Literal(literal) => literals.push(literal),
                Tree::And(parts) => {
                    for part in parts {
                        match part {
                            Tree::Literal(literal) => literals.push(literal),
                            other => rest.push(other),
                        }
                    }
                }
                or => rest.push(or),
            }
        }
        if !tidy(literals) {
            return Ok(Tree::False);
        }
        Ok(if rest.is_empty() { Tree::True } else { Tree::and(rest) })
    }
}

/// Sorts literals and removes duplicates. Returns `false` if two of them contradict each other.
pub(super) fn tidy(literals: &mut Vec<Literal>) -> bool {
    literals.sort_unstable();
    literals.dedup();
    // The literals of one fact are adjacent, the positive one first.
    !literals.windows(2).any(|pair| pair[0].negated() == pair[1])
}
