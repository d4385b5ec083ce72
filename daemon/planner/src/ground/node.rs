//! Lifted conditions made ready for grounding: every quantifier knows its join.
//!
//! An `exists` only visits objects for which the facts it asks for can hold, a `forall` only those
//! for which its exceptions can.

use pddl::Comparison;
use rustc_hash::FxHashMap;

use super::join::{Join, JoinPlan, Work};
use super::relation::Relation;
use super::tree::Tree;
use super::values::{Grounded, Values, compares};
use crate::normalize::lifted::{
    Formula, Lifted, LiftedAtom, LiftedExpression, LiftedTerm, Slot, TypeIndex, objects,
};
use crate::outcome::StopReason;
use crate::task::{FactId, GroundComparison, GroundExpression, Literal, ObjectId};

/// A condition ready for grounding.
#[derive(Debug)]
pub(super) enum Node {
    Constant(bool),
    Literal {
        positive: bool,
        atom: LiftedAtom,
    },
    Equal {
        positive: bool,
        left: LiftedTerm,
        right: LiftedTerm,
    },
    Compare {
        positive: bool,
        comparison: Comparison,
        sides: Box<(LiftedExpression, LiftedExpression)>,
    },
    And(Vec<Node>),
    Or(Vec<Node>),
    Quantified {
        existential: bool,
        plan: JoinPlan,
        inner: Box<Node>,
    },
}

/// What grounding a condition reads and grows.
pub(super) struct Grounder<'g> {
    pub(super) lifted: &'g Lifted,
    pub(super) relations: &'g [Relation],
    /// The raw fact of each relation's first row.
    pub(super) offsets: &'g [usize],
    pub(super) values: &'g mut Values,
    /// Comparisons found so far; their raw facts start at `comparison_offset`.
    pub(super) comparisons: &'g mut Vec<GroundComparison>,
    /// Where each of them is, by its text.
    pub(super) comparison_ids: FxHashMap<String, usize>,
    pub(super) comparison_offset: usize,
}

/// Raw facts for comparisons are set apart before their number is known.
pub(super) const COMPARISONS_MAX: usize = 1 << 24;

// === impl Node ===

impl Node {
    pub(super) fn compile(
        lifted: &Lifted,
        relations: &mut [Relation],
        formula: &Formula,
        bound: &mut [bool],
    ) -> Node {
        let mut all = |parts: &[Formula], relations: &mut [Relation]| {
            parts.iter().map(|part| Node::compile(lifted, relations, part, bound)).collect()
        };
        match formula {
            Formula::Constant(truth) => Node::Constant(*truth),
            Formula::Literal { positive, atom } => {
                Node::Literal { positive: *positive, atom: atom.clone() }
            }
            Formula::Equal { positive, left, right } => {
                Node::Equal { positive: *positive, left: *left, right: *right }
            }
            Formula::Compare { positive, comparison, sides } => {
                Node::Compare { positive: *positive, comparison: *comparison, sides: sides.clone() }
            }
            Formula::And(parts) => Node::And(all(parts, relations)),
            Formula::Or(parts) => Node::Or(all(parts, relations)),
            Formula::Exists(slots, inner) => {
                Node::quantified(lifted, relations, slots, inner, true, bound)
            }
            Formula::Forall(slots, inner) => {
                Node::quantified(lifted, relations, slots, inner, false, bound)
            }
        }
    }

    fn quantified(
        lifted: &Lifted,
        relations: &mut [Relation],
        slots: &[Slot],
        inner: &Formula,
        existential: bool,
        bound: &mut [bool],
    ) -> Node {
        let mut inside = bound.to_vec();
        let plan = enumeration(lifted, relations, slots, inner, existential, &mut inside);
        let inner = Box::new(Node::compile(lifted, relations, inner, &mut inside));
        Node::Quantified { existential, plan, inner }
    }
}

/// A join that binds `slots` to all objects for which `formula` is not already decided: false of an
/// `exists` or a `when`, true of a `forall`.
pub(super) fn enumeration(
    lifted: &Lifted,
    relations: &mut [Relation],
    slots: &[Slot],
    formula: &Formula,
    existential: bool,
    bound: &mut [bool],
) -> JoinPlan {
    let mut atoms = Vec::new();
    collect_guards(formula, existential, slots, bound, &mut atoms);
    JoinPlan::compile(lifted, relations, &atoms, &[], slots, bound)
}

/// The atoms that must hold for a conjunction to be true, or a disjunction to be false.
fn collect_guards(
    formula: &Formula,
    existential: bool,
    slots: &[Slot],
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

// === impl Grounder ===

impl Grounder<'_> {
    /// The condition under a binding.
    pub(super) fn tree(
        &mut self,
        node: &Node,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut Work<'_>,
    ) -> Result<Tree, StopReason> {
        work.step()?;
        Ok(match node {
            Node::Constant(truth) => truth_value(*truth),
            Node::Literal { positive, atom } => self.literal(*positive, atom, binding),
            Node::Equal { positive, left, right } => {
                truth_value((left.object(binding) == right.object(binding)) == *positive)
            }
            Node::Compare { positive, comparison, sides } => {
                let tree = self.compare(*comparison, sides, binding);
                if *positive { tree } else { tree.negated() }
            }
            Node::And(parts) => {
                let mut trees = Vec::with_capacity(parts.len());
                for part in parts {
                    let tree = self.tree(part, frame, binding, work)?;
                    if tree == Tree::False {
                        return Ok(tree);
                    }
                    trees.push(tree);
                }
                Tree::and(trees)
            }
            Node::Or(parts) => {
                let mut trees = Vec::with_capacity(parts.len());
                for part in parts {
                    trees.push(self.tree(part, frame, binding, work)?);
                }
                Tree::or(trees)
            }
            Node::Quantified { existential, plan, inner } => {
                let instances = self.instances(plan, inner, frame, binding, work)?;
                if *existential { Tree::or(instances) } else { Tree::and(instances) }
            }
        })
    }

    /// Runs a join and grounds a condition under each of its bindings.
    fn instances(
        &mut self,
        plan: &JoinPlan,
        inner: &Node,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut Work<'_>,
    ) -> Result<Vec<Tree>, StopReason> {
        let mut bindings = Vec::new();
        self.bindings(plan, frame, binding, work, &mut bindings)?;
        let width = binding.len();
        if width == 0 {
            // A quantifier over no variables in an empty frame.
            return Ok(vec![self.tree(inner, frame, binding, work)?]);
        }
        let mut trees = Vec::new();
        for inside in bindings.chunks_exact_mut(width) {
            trees.push(self.tree(inner, frame, inside, work)?);
        }
        Ok(trees)
    }

    /// All bindings of a join, one after the other.
    pub(super) fn bindings(
        &self,
        plan: &JoinPlan,
        frame: &[TypeIndex],
        binding: &mut [ObjectId],
        work: &mut Work<'_>,
        found: &mut Vec<ObjectId>,
    ) -> Result<(), StopReason> {
        // The static values are not needed: these joins have no filters.
        let Grounder { lifted, relations, values, .. } = self;
        let join = Join { lifted, relations, values, frame };
        join.run(plan, binding, work, &mut |binding, _| {
            found.extend_from_slice(binding);
            Ok(())
        })
    }

    /// The raw fact of an atom, if it can ever hold.
    pub(super) fn fact(&self, atom: &LiftedAtom, binding: &[ObjectId]) -> Option<FactId> {
        let tuple: Vec<ObjectId> = objects(&atom.arguments, binding).collect();
        let row = self.relations[atom.predicate].find(&tuple)?;
        Some(FactId::from_index(self.offsets[atom.predicate] + row))
    }

    fn literal(&self, positive: bool, atom: &LiftedAtom, binding: &[ObjectId]) -> Tree {
        let predicate = &self.lifted.predicates[atom.predicate];
        let relation = &self.relations[atom.predicate];
        let Some(fact) = self.fact(atom, binding) else { return truth_value(!positive) };
        let row = fact.index() - self.offsets[atom.predicate];
        if row < relation.initial && !predicate.deleted && !predicate.derived {
            return truth_value(positive);
        }
        Tree::Literal(Literal::new(fact, positive))
    }

    fn compare(
        &mut self,
        comparison: Comparison,
        sides: &(LiftedExpression, LiftedExpression),
        binding: &[ObjectId],
    ) -> Tree {
        let left = self.values.ground(&sides.0, binding);
        let right = self.values.ground(&sides.1, binding);
        let expression = |side| match side {
            Grounded::Undefined => None,
            Grounded::Fixed(number) => Some(GroundExpression::Number(number)),
            Grounded::Varying(expression) => Some(expression),
        };
        match (left, right) {
            (Grounded::Fixed(left), Grounded::Fixed(right)) => {
                truth_value(compares(comparison, left, right))
            }
            (left, right) => match (expression(left), expression(right)) {
                (Some(left), Some(right)) => {
                    self.comparison(GroundComparison { comparison, left, right })
                }
                _ => Tree::False,
            },
        }
    }

    fn comparison(&mut self, comparison: GroundComparison) -> Tree {
        let Grounder { comparisons, comparison_ids, .. } = self;
        let index = *comparison_ids.entry(format!("{comparison:?}")).or_insert_with(|| {
            comparisons.push(comparison);
            comparisons.len() - 1
        });
        Tree::Literal(Literal::new(FactId::from_index(self.comparison_offset + index), true))
    }
}

fn truth_value(truth: bool) -> Tree {
    if truth { Tree::True } else { Tree::False }
}
