//! One action under one binding, while it becomes operators.

use rustc_hash::FxHashMap;

use crate::task::{FactId, Literal, NumericChange, ObjectId, Operators};

/// What is known of it so far. Used for one after the other, so that its buffers last.
#[derive(Default)]
pub(super) struct Draft {
    pub(super) preconditions: Vec<Literal>,
    pub(super) always: Changes,
    conditional: Vec<(Vec<Literal>, Changes)>,
    /// Where each condition is, once there are many.
    positions: FxHashMap<Vec<Literal>, usize>,
    pub(super) cost: f64,
    combined: Changes,
}

/// Changes in the making.
#[derive(Clone, Default)]
pub(super) struct Changes {
    pub(super) adds: Vec<FactId>,
    pub(super) deletes: Vec<FactId>,
    pub(super) numeric: Vec<NumericChange>,
}

/// So many conditions are compared one by one.
const FEW_CONDITIONS: usize = 8;

// === impl Draft ===

impl Draft {
    pub(super) fn clear(&mut self) {
        self.preconditions.clear();
        self.always.clear();
        self.conditional.clear();
        self.positions.clear();
        self.cost = 0.0;
    }

    /// The changes under a sorted condition.
    pub(super) fn under(&mut self, conditions: &[Literal]) -> &mut Changes {
        if conditions.is_empty() {
            return &mut self.always;
        }
        let known = if self.conditional.len() <= FEW_CONDITIONS {
            self.conditional.iter().position(|(known, _)| known == conditions)
        } else {
            self.positions.get(conditions).copied()
        };
        let position = known.unwrap_or_else(|| {
            self.conditional.push((conditions.to_vec(), Changes::default()));
            self.note_positions();
            self.conditional.len() - 1
        });
        &mut self.conditional[position].1
    }

    /// Keeps the map complete from the moment on that it is needed.
    fn note_positions(&mut self) {
        let count = self.conditional.len();
        let new = match count.cmp(&(FEW_CONDITIONS + 1)) {
            std::cmp::Ordering::Less => return,
            std::cmp::Ordering::Equal => 0,
            std::cmp::Ordering::Greater => count - 1,
        };
        for (position, (conditions, _)) in self.conditional.iter().enumerate().skip(new) {
            self.positions.insert(conditions.clone(), position);
        }
    }

    /// Adds the operator whose precondition is `preconditions` and nothing else.
    pub(super) fn operator(
        &mut self,
        schema: u32,
        arguments: &[ObjectId],
        preconditions: &[Literal],
        operators: &mut Operators,
    ) {
        let Draft { always, conditional, combined, .. } = self;
        // What the precondition says need not be asked again, and what contradicts it cannot happen.
        let is_known = |literal: &Literal| preconditions.binary_search(literal).is_ok();
        let cannot =
            |conditions: &[Literal]| conditions.iter().any(|literal| is_known(&literal.negated()));
        combined.clear();
        combined.extend(always);
        for (conditions, changes) in conditional.iter() {
            if conditions.iter().all(is_known) {
                combined.extend(changes);
            }
        }
        combined.tidy(&[]);
        operators.push(schema, arguments.iter().copied(), preconditions.iter().copied());
        for (conditions, changes) in conditional.iter() {
            if cannot(conditions) || conditions.iter().all(is_known) {
                continue;
            }
            let mut changes = changes.clone();
            changes.tidy(&combined.adds);
            if !changes.is_empty() {
                let conditions = conditions.iter().filter(|literal| !is_known(literal)).copied();
                let Changes { adds, deletes, numeric } = changes;
                operators.push_conditional(conditions, adds, deletes, numeric);
            }
        }
        let Changes { adds, deletes, numeric } = combined;
        // What holds already need not be added, what does not hold not be deleted.
        adds.retain(|fact| !is_known(&Literal::new(*fact, true)));
        deletes.retain(|fact| !is_known(&Literal::new(*fact, false)));
        operators.set_effect(adds.drain(..), deletes.drain(..), numeric.drain(..));
        operators.set_cost(self.cost.to_bits());
    }
}

// === impl Changes ===

impl Changes {
    fn clear(&mut self) {
        self.adds.clear();
        self.deletes.clear();
        self.numeric.clear();
    }

    fn extend(&mut self, other: &Changes) {
        self.adds.extend_from_slice(&other.adds);
        self.deletes.extend_from_slice(&other.deletes);
        self.numeric.extend_from_slice(&other.numeric);
    }

    fn is_empty(&self) -> bool {
        self.adds.is_empty() && self.deletes.is_empty() && self.numeric.is_empty()
    }

    /// Sorts, and leaves out deletes that an add overrules; `added` is added in any case.
    fn tidy(&mut self, added: &[FactId]) {
        self.adds.retain(|fact| added.binary_search(fact).is_err());
        self.adds.sort_unstable();
        self.adds.dedup();
        self.deletes.sort_unstable();
        self.deletes.dedup();
        let adds = &self.adds;
        self.deletes
            .retain(|fact| adds.binary_search(fact).is_err() && added.binary_search(fact).is_err());
    }
}
