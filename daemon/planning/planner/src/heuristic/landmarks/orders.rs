//! Reasonable orders (Koehler and Hoffmann, 2000; Richter and Westphal, 2010). One landmark should
//! be achieved before another if achieving it later would undo the other.

use rustc_hash::FxHashMap;

use super::LandmarkGraph;
use crate::heuristic::relaxation::Relaxation;
use crate::mutex::MutexGroups;
use crate::rows::Rows;
use crate::task::{FactId, Literal, OperatorId, Task};

/// Limit on the whole work: the number of compared pairs of landmarks, plus the number of visited
/// edges in the search for cycles. When it is exceeded, no further orders are added.
const WORK_MAX: usize = 20_000_000;

/// Adds reasonable orders between landmarks that are single facts. The landmark graph stays
/// acyclic.
pub(super) fn add_reasonable(
    graph: &mut LandmarkGraph,
    task: &Task,
    relaxation: &Relaxation,
    mutex: &MutexGroups,
) {
    let mut orders = Orders::new(graph, task, relaxation, mutex);
    let goals: Vec<u32> = orders.simple().filter(|one| orders.is_goal(*one)).collect();
    for later in orders.simple().collect::<Vec<_>>() {
        let earlier = if orders.is_goal(later) { goals.clone() } else { orders.rivals(later) };
        for one in earlier {
            orders.work += 1;
            if orders.work > WORK_MAX {
                return;
            }
            if one != later && orders.interferes(one, later) {
                orders.order(one, later);
            }
        }
    }
}

struct Orders<'g> {
    graph: &'g mut LandmarkGraph,
    /// Per fact: the mutex groups that contain the fact.
    groups: Rows,
    /// Per landmark: its fact; `None` for a disjunctive landmark.
    facts: Vec<Option<FactId>>,
    /// Per landmark: the facts that all its achieving operators add.
    together: Vec<Vec<FactId>>,
    /// Per landmark: the facts that all its achieving operators delete.
    undone: Vec<Vec<FactId>>,
    marks: Vec<u32>,
    mark: u32,
    work: usize,
}

// === impl Orders ===

impl<'g> Orders<'g> {
    fn new(
        graph: &'g mut LandmarkGraph,
        task: &'g Task,
        relaxation: &'g Relaxation,
        mutex: &MutexGroups,
    ) -> Orders<'g> {
        let fact = |propositions: &[u32]| match propositions {
            [one] => relaxation.positive(*one),
            _ => None,
        };
        let facts: Vec<Option<FactId>> =
            graph.landmarks.iter().map(|landmark| fact(&landmark.propositions)).collect();
        let achievers = achievers(task, &facts);
        let together = { achievers.iter() }
            .map(|operators| shared(operators, |id| task.operator(id).effect.adds))
            .collect();
        let undone = { achievers.iter() }
            .map(|operators| shared(operators, |id| task.operator(id).effect.deletes))
            .collect();
        let numbered = mutex.groups().iter().zip(0..);
        let members = numbered.flat_map(|(group, index)| group.iter().map(move |f| (f.0, index)));
        let groups = Rows::collect(task.fact_count, members);
        let marks = vec![0; graph.landmarks.len()];
        Orders { graph, groups, facts, together, undone, marks, mark: 0, work: 0 }
    }

    fn simple(&self) -> impl Iterator<Item = u32> + use<> {
        let simple: Vec<u32> = (0..self.facts.len())
            .filter(|one| self.facts[*one].is_some())
            .map(|one| one as u32)
            .collect();
        simple.into_iter()
    }

    fn is_goal(&self, landmark: u32) -> bool {
        self.graph.landmarks[landmark as usize].is_goal
    }

    /// Returns the single-fact landmarks with a common successor of `landmark`. These are the
    /// parents of all landmarks that require `landmark` immediately before, and all predecessors of
    /// these parents.
    fn rivals(&mut self, landmark: u32) -> Vec<u32> {
        self.mark += 1;
        let mut found = Vec::new();
        for &child in &self.graph.landmarks[landmark as usize].needed_for {
            found.extend(&self.graph.landmarks[child as usize].parents);
        }
        found.retain(|one| {
            *one != landmark
                && std::mem::replace(&mut self.marks[*one as usize], self.mark) != self.mark
        });
        let mut next = 0;
        while let Some(&one) = found.get(next) {
            next += 1;
            for &parent in &self.graph.landmarks[one as usize].parents {
                self.work += 1;
                let mark = &mut self.marks[parent as usize];
                if parent != landmark && std::mem::replace(mark, self.mark) != self.mark {
                    found.push(parent);
                }
            }
        }
        found.retain(|one| self.facts[*one as usize].is_some());
        found
    }

    /// Whether achieving the landmark `one` undoes the landmark `other`.
    ///
    /// A greedy-necessary predecessor of `one` that excludes `other` is no reason for an order: the
    /// step that achieves `one` may achieve `other`, too. With precise mutex groups such orders hide
    /// the progress of a search.
    fn interferes(&self, one: u32, other: u32) -> bool {
        let (Some(fact), Some(undone)) = (self.facts[one as usize], self.facts[other as usize])
        else {
            return false;
        };
        let excludes = |first: FactId| first != undone && self.excludes(first, undone);
        excludes(fact)
            || self.undone[one as usize].contains(&undone)
            || self.together[one as usize].iter().any(|fact| excludes(*fact))
    }

    /// Whether two facts are mutex: they are never true in the same state.
    fn excludes(&self, one: FactId, other: FactId) -> bool {
        let others = self.groups.row(other.0);
        self.groups.row(one.0).iter().any(|group| others.contains(group))
    }

    /// Adds the order of the landmark `before` before the landmark `after`, unless it would create
    /// a cycle.
    fn order(&mut self, before: u32, after: u32) {
        if self.graph.landmarks[after as usize].parents.contains(&before)
            || self.comes_before(after, before)
        {
            return;
        }
        self.graph.landmarks[after as usize].parents.push(before);
    }

    fn comes_before(&mut self, one: u32, other: u32) -> bool {
        self.mark += 1;
        let mut stack = vec![other];
        while let Some(landmark) = stack.pop() {
            if landmark == one {
                return true;
            }
            for &parent in &self.graph.landmarks[landmark as usize].parents {
                self.work += 1;
                if std::mem::replace(&mut self.marks[parent as usize], self.mark) != self.mark {
                    stack.push(parent);
                }
            }
        }
        false
    }
}

/// Returns, per landmark, the operators that can make its fact true. The relaxation does not show all
/// of them, since it lacks dominated additions. Only landmarks that are one basic fact have any.
fn achievers(task: &Task, facts: &[Option<FactId>]) -> Vec<Vec<OperatorId>> {
    let mut achievers = vec![Vec::new(); facts.len()];
    let places: FxHashMap<FactId, usize> =
        facts.iter().zip(0..).filter_map(|(fact, place)| fact.map(|fact| (fact, place))).collect();
    for (operator, index) in task.operators.iter().zip(0..) {
        let conditional = operator.conditional.iter().flat_map(|one| one.effect.adds);
        for fact in operator.effect.adds.iter().chain(conditional) {
            let is_given = || operator.preconditions.contains(&Literal::new(*fact, true));
            if let Some(&place) = places.get(fact).filter(|_| !is_given()) {
                let of_fact: &mut Vec<OperatorId> = &mut achievers[place];
                if of_fact.last() != Some(&OperatorId(index)) {
                    of_fact.push(OperatorId(index));
                }
            }
        }
    }
    achievers
}

/// Returns the facts that are in the result of `of` for every operator.
fn shared<'t>(operators: &[OperatorId], of: impl Fn(OperatorId) -> &'t [FactId]) -> Vec<FactId> {
    let Some((first, rest)) = operators.split_first() else { return Vec::new() };
    let mut shared = of(*first).to_vec();
    for one in rest {
        if shared.is_empty() {
            break;
        }
        let facts = of(*one);
        shared.retain(|fact| facts.contains(fact));
    }
    shared
}
