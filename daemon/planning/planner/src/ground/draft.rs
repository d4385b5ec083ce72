//! A draft of the operators that result from one binding of a schema.

use rustc_hash::FxHashMap;

use crate::task::{FactId, Literal, NumericChange, ObjectId, OperatorTable};

/// Preconditions, effects and cost of the current binding that have been collected so far. One
/// draft is used for all bindings, so that its buffers are reused.
#[derive(Default)]
pub(super) struct OperatorDraft {
    pub(super) preconditions: Vec<Literal>,
    pub(super) always: ChangesDraft,
    conditional: Vec<(Vec<Literal>, ChangesDraft)>,
    /// Position of each condition in `conditional`; empty while there are at most
    /// [`FEW_CONDITIONS`].
    positions: FxHashMap<Vec<Literal>, usize>,
    pub(super) cost: f64,
    combined: ChangesDraft,
}

/// An effect that is being collected: the facts that it adds and deletes, and its numeric changes.
#[derive(Clone, Default)]
pub(super) struct ChangesDraft {
    pub(super) adds: Vec<FactId>,
    pub(super) deletes: Vec<FactId>,
    pub(super) numeric: Vec<NumericChange>,
}

/// Maximum number of conditions of an operator's effects that are searched one by one. Above it, a
/// hash table is used.
const FEW_CONDITIONS: usize = 8;

// === impl OperatorDraft ===

impl OperatorDraft {
    pub(super) fn clear(&mut self) {
        self.preconditions.clear();
        self.always.clear();
        self.conditional.clear();
        self.positions.clear();
        self.cost = 0.0;
    }

    /// Returns the changes under a condition, which is given as sorted literals. The empty
    /// condition is that of the unconditional effect.
    pub(super) fn under(&mut self, conditions: &[Literal]) -> &mut ChangesDraft {
        if conditions.is_empty() {
            return &mut self.always;
        }
        let known = if self.conditional.len() <= FEW_CONDITIONS {
            self.conditional.iter().position(|(known, _)| known == conditions)
        } else {
            self.positions.get(conditions).copied()
        };
        let position = known.unwrap_or_else(|| {
            self.conditional.push((conditions.to_vec(), ChangesDraft::default()));
            self.note_positions();
            self.conditional.len() - 1
        });
        &mut self.conditional[position].1
    }

    /// Fills `positions` when the number of conditions exceeds [`FEW_CONDITIONS`], and keeps it
    /// complete afterwards.
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

    /// Adds an operator with these preconditions and with the effects and the cost of the draft.
    pub(super) fn operator(
        &mut self,
        schema: u32,
        arguments: &[ObjectId],
        preconditions: &[Literal],
        operators: &mut OperatorTable,
    ) {
        let OperatorDraft { always, conditional, combined, .. } = self;
        // Conditions that the precondition implies are dropped. Effects with conditions that the
        // precondition contradicts are dropped, because they cannot occur.
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
                let ChangesDraft { adds, deletes, numeric } = changes;
                operators.push_conditional(conditions, adds, deletes, numeric);
            }
        }
        let ChangesDraft { adds, deletes, numeric } = combined;
        // Facts that already hold need not be added, and facts that do not hold need not be
        // deleted.
        adds.retain(|fact| !is_known(&Literal::new(*fact, true)));
        deletes.retain(|fact| !is_known(&Literal::new(*fact, false)));
        operators.set_effect(adds.drain(..), deletes.drain(..), numeric.drain(..));
        operators.set_cost(self.cost.to_bits());
    }
}

// === impl ChangesDraft ===

impl ChangesDraft {
    fn clear(&mut self) {
        self.adds.clear();
        self.deletes.clear();
        self.numeric.clear();
    }

    fn extend(&mut self, other: &ChangesDraft) {
        self.adds.extend_from_slice(&other.adds);
        self.deletes.extend_from_slice(&other.deletes);
        self.numeric.extend_from_slice(&other.numeric);
    }

    fn is_empty(&self) -> bool {
        self.adds.is_empty() && self.deletes.is_empty() && self.numeric.is_empty()
    }

    /// Sorts the changes, and drops deletes of facts that the effect also adds. Adds of the facts
    /// in `added` are dropped, too, because another effect always adds these facts.
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
