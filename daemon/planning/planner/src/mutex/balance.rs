//! Balance check: whether every operator preserves that at most one fact of a set is true.
//!
//! The proof is by induction: at most one fact of the set is true before an operator. An effect
//! that adds a fact of the set must then require and delete another fact of the set, or require the
//! fact that it adds. Two effects that add different facts of the set must not occur together.

use crate::task::{FactId, GroundOperator, Literal, Task};

/// Checks sets of facts against all operators of a task.
pub(super) struct BalanceCheck<'t> {
    task: &'t Task,
    /// Start of the operators of each fact in `adders`. The last entry is the length of `adders`.
    starts: Vec<u32>,
    /// Operators that may add each fact. The lists of all facts are in one array.
    adders: Vec<u32>,
    /// Work so far: the number of visited preconditions and added facts of effects, and one for
    /// each visited operator.
    pub(super) work: u64,
}

/// Result of the check of one set of facts.
#[derive(Debug)]
pub(super) enum BalanceResult {
    Holds,
    /// An operator may add two facts of the set at the same time.
    TooHeavy,
    /// An operator adds a fact of the set without requiring and deleting another one. `deleted`
    /// contains all facts, inside and outside the set, that the operator requires and deletes
    /// whenever it adds this fact.
    Unbalanced {
        deleted: Vec<FactId>,
    },
}

/// An effect of an operator that adds a fact of the checked set.
struct Addition<'t> {
    fact: FactId,
    /// Conditions of a conditional effect; empty for the unconditional effect. The precondition of
    /// the operator is not repeated here.
    conditions: &'t [Literal],
    /// Facts that a conditional effect deletes; empty for the unconditional effect of the operator.
    /// The deletions of the unconditional effect count for every addition, and are read from the
    /// operator.
    deletes: &'t [FactId],
}

// === impl BalanceCheck ===

impl<'t> BalanceCheck<'t> {
    pub(super) fn new(task: &'t Task) -> BalanceCheck<'t> {
        let mut starts = vec![0u32; task.fact_count + 1];
        let each = |visit: &mut dyn FnMut(FactId, u32)| {
            for (index, operator) in task.operators.iter().enumerate() {
                operator.effect.adds.iter().for_each(|fact| visit(*fact, index as u32));
                for one in operator.conditional.iter() {
                    one.effect.adds.iter().for_each(|fact| visit(*fact, index as u32));
                }
            }
        };
        each(&mut |fact, _| starts[fact.index()] += 1);
        let mut sum = 0;
        for start in &mut starts {
            sum += *start;
            *start = sum;
        }
        let mut adders = vec![0; sum as usize];
        each(&mut |fact, operator| {
            starts[fact.index()] -= 1;
            adders[starts[fact.index()] as usize] = operator;
        });
        BalanceCheck { task, starts, adders, work: 0 }
    }

    /// Checks the set of facts `facts`. In `instance_of`, exactly these facts have the value
    /// `instance`.
    pub(super) fn check(
        &mut self,
        facts: &[FactId],
        instance_of: &[u32],
        instance: u32,
    ) -> BalanceResult {
        let is_in = |fact: FactId| instance_of.get(fact.index()) == Some(&instance);
        let mut additions = Vec::new();
        for fact in facts {
            let (from, to) = (self.starts[fact.index()], self.starts[fact.index() + 1]);
            for at in from as usize..to as usize {
                let operator = self.task.operators.get(self.adders[at] as usize);
                self.work += 1 + collect(operator, &is_in, &mut additions);
                match judge(operator, &additions, &is_in) {
                    BalanceResult::Holds => (),
                    other => return other,
                }
            }
        }
        BalanceResult::Holds
    }
}

/// Finds the effects of an operator that add a fact of the set. Returns the number of visited
/// preconditions and added facts.
fn collect<'t>(
    operator: GroundOperator<'t>,
    is_in: &impl Fn(FactId) -> bool,
    additions: &mut Vec<Addition<'t>>,
) -> u64 {
    additions.clear();
    let mut work = operator.preconditions.len() + operator.effect.adds.len();
    for &fact in operator.effect.adds.iter().filter(|fact| is_in(**fact)) {
        additions.push(Addition { fact, conditions: &[], deletes: &[] });
    }
    for one in operator.conditional.iter() {
        work += one.effect.adds.len();
        for &fact in one.effect.adds.iter().filter(|fact| is_in(**fact)) {
            let (conditions, deletes) = (one.conditions, one.effect.deletes);
            additions.push(Addition { fact, conditions, deletes });
        }
    }
    work as u64
}

fn judge(
    operator: GroundOperator<'_>,
    additions: &[Addition<'_>],
    is_in: &impl Fn(FactId) -> bool,
) -> BalanceResult {
    // The facts of the set that an addition requires. Two different facts of the set are never both
    // true.
    let asked = |addition: &Addition<'_>| {
        let all = operator.preconditions.iter().chain(addition.conditions);
        let positive = all.filter(|literal| literal.is_positive() && is_in(literal.fact()));
        let mut first = None;
        for literal in positive {
            match first {
                None => first = Some(literal.fact()),
                Some(known) if known != literal.fact() => return RequiredFacts::Two,
                Some(_) => (),
            }
        }
        first.map_or(RequiredFacts::Nothing, RequiredFacts::One)
    };
    for (index, addition) in additions.iter().enumerate() {
        let own = asked(addition);
        match own {
            RequiredFacts::Two => continue,
            RequiredFacts::One(fact)
                if fact == addition.fact || is_deleted(operator, addition, fact) => {}
            RequiredFacts::One(_) | RequiredFacts::Nothing => {
                return BalanceResult::Unbalanced { deleted: deleted(operator, addition) };
            }
        }
        for other in additions[..index].iter().filter(|other| other.fact != addition.fact) {
            if !excludes(own, asked(other)) && !contradict(addition.conditions, other.conditions) {
                return BalanceResult::TooHeavy;
            }
        }
    }
    BalanceResult::Holds
}

/// Facts of the checked set that an addition requires: none, one, or at least two.
#[derive(Clone, Copy, PartialEq, Eq)]
enum RequiredFacts {
    Nothing,
    One(FactId),
    Two,
}

/// Whether two additions cannot occur together, because they require different facts of the checked
/// set.
fn excludes(left: RequiredFacts, right: RequiredFacts) -> bool {
    match (left, right) {
        (RequiredFacts::One(left), RequiredFacts::One(right)) => left != right,
        (RequiredFacts::Two, _) | (_, RequiredFacts::Two) => true,
        _ => false,
    }
}

fn contradict(left: &[Literal], right: &[Literal]) -> bool {
    left.iter().any(|literal| right.contains(&literal.negated()))
}

/// Whether `fact` is deleted whenever the addition occurs. Another effect may add `fact` again;
/// that effect is checked as an addition of its own.
fn is_deleted(operator: GroundOperator<'_>, addition: &Addition<'_>, fact: FactId) -> bool {
    let follows = |literal: &Literal| {
        addition.conditions.contains(literal) || operator.preconditions.contains(literal)
    };
    operator.effect.deletes.contains(&fact)
        || addition.deletes.contains(&fact)
        || operator
            .conditional
            .iter()
            .any(|one| one.effect.deletes.contains(&fact) && one.conditions.iter().all(follows))
}

/// Returns the facts that an addition requires and that are deleted whenever it occurs.
fn deleted(operator: GroundOperator<'_>, addition: &Addition<'_>) -> Vec<FactId> {
    let all = operator.preconditions.iter().chain(addition.conditions);
    let positive = all.filter(|literal| literal.is_positive()).map(|literal| literal.fact());
    positive.filter(|fact| is_deleted(operator, addition, *fact)).collect()
}
