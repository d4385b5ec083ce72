//! Successor generator: finds the applicable operators of a state without testing all operators.
//!
//! Every operator is indexed by one of its positive preconditions: that of the fewest operators.
//! Only operators with an index fact that is true in the state are tested.

use crate::state::{State, all_hold, true_facts};
use crate::task::{OperatorId, Task};

/// Index of the operators of a task by one positive precondition each.
#[derive(Debug)]
pub(crate) struct SuccessorGenerator {
    fact_count: usize,
    waiting: Vec<Vec<OperatorId>>,
    /// Operators without a positive precondition, which are tested in every state.
    always: Vec<OperatorId>,
}

// === impl SuccessorGenerator ===

impl SuccessorGenerator {
    pub(crate) fn new(task: &Task) -> SuccessorGenerator {
        let mut popularity = vec![0u32; task.fact_count];
        for literal in task.operators.iter().flat_map(|operator| operator.preconditions) {
            popularity[literal.fact().index()] += 1;
        }
        let mut generator = SuccessorGenerator {
            fact_count: task.fact_count,
            waiting: vec![Vec::new(); task.fact_count],
            always: Vec::new(),
        };
        for (index, operator) in task.operators.iter().enumerate() {
            let positive = operator.preconditions.iter().filter(|literal| literal.is_positive());
            let rarest = positive.min_by_key(|literal| popularity[literal.fact().index()]);
            let id = OperatorId(index as u32);
            match rarest {
                Some(literal) => generator.waiting[literal.fact().index()].push(id),
                None => generator.always.push(id),
            }
        }
        generator
    }

    /// Returns the number of bytes of the index.
    pub(crate) fn bytes(&self) -> usize {
        let lists = self.waiting.iter().map(Vec::capacity).sum::<usize>() + self.always.capacity();
        self.waiting.capacity() * size_of::<Vec<OperatorId>>() + lists * size_of::<OperatorId>()
    }

    /// Appends the operators that are applicable in `state` to `found`.
    pub(crate) fn applicable(&self, task: &Task, state: &State, found: &mut Vec<OperatorId>) {
        found.clear();
        let applies = |id: &&OperatorId| all_hold(state, task.operator(**id).preconditions);
        found.extend(self.always.iter().filter(applies));
        for fact in true_facts(state, self.fact_count) {
            found.extend(self.waiting[fact.index()].iter().filter(applies));
        }
    }
}
