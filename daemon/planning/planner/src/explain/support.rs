//! Computes the suppositions that make each literal of the [`SupposedTask`] reachable. The result
//! for a literal is its smallest sets of at most two suppositions. The sets are propagated along
//! the operators to a fixpoint.

use std::collections::{BTreeMap, VecDeque};

use pddl::Name;

use super::suppose::{OperatorMeaning, SupposedTask};
use crate::task::{Changes, Literal, Task};

/// Maximum number of sets of suppositions that are kept for one literal, the smallest ones first.
/// If there are more, the explanation is incomplete. More would not be shown to the user.
const SETS_MAX: usize = 12;

/// Limit on the work: the sum, over the literals of rule bodies, of the number of their sets. After
/// it is reached, the explanation is incomplete. For a building of hundreds of rooms, the work
/// takes about a second.
const STEPS_MAX: u64 = 20_000_000;

/// A set of at most two suppositions. The empty set means that no supposition is needed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct SuppositionSet {
    /// Number of suppositions in the set. This field comes first, so that smaller sets are sorted
    /// first.
    count: u8,
    members: [u32; 2],
}

/// What a rule supposes, according to the operator or axiom of the [`SupposedTask`] that it comes
/// from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum RuleOrigin {
    /// An action that an agent offers, or an axiom: no supposition is needed.
    World,
    /// A supposition with this number.
    Suppose(u32),
    /// A fact about a new agent, given by the number of its group of alternative places and its
    /// position in the group.
    Place(usize, usize),
}

/// A rule `heads :- body`: if all literals of the body are reachable, the heads are reachable.
struct SuppositionRule {
    body: Box<[usize]>,
    heads: Vec<usize>,
    origin: RuleOrigin,
}

/// The operators and axioms of the [`SupposedTask`], each as a [`SuppositionRule`].
#[derive(Default)]
pub(super) struct SuppositionRules {
    rules: Vec<SuppositionRule>,
    /// For each literal: the rules with the literal in their body.
    readers: Vec<Vec<usize>>,
    /// Literals that hold in the initial state.
    initial: Vec<usize>,
    /// For each supposition: the number of the supposed capability, and the agent that would offer
    /// it.
    pub(super) suppositions: Vec<(usize, Name)>,
    /// Alternative places, grouped by kind of placement and by new agent.
    pub(super) groups: Vec<PlaceGroup>,
    parts: BTreeMap<usize, usize>,
    touches: BTreeMap<(usize, usize), usize>,
}

/// Alternative places in one fact about one new agent. A place is the list of the other arguments
/// of the fact.
pub(super) struct PlaceGroup {
    pub(super) placement: usize,
    pub(super) agent: Name,
    pub(super) values: Vec<Vec<Name>>,
}

/// Result of the computation: for each part of the goal, the sets of suppositions that make it
/// reachable; for each fact in a part, whether it is reachable without suppositions.
pub(super) struct Support {
    parts: BTreeMap<usize, Vec<SuppositionSet>>,
    touches: BTreeMap<(usize, usize), bool>,
    pub(super) is_complete: bool,
}

// === impl SuppositionSet ===

impl SuppositionSet {
    fn of(one: u32) -> SuppositionSet {
        SuppositionSet { count: 1, members: [one, 0] }
    }

    pub(super) fn members(&self) -> &[u32] {
        &self.members[..usize::from(self.count)]
    }

    /// Returns the union of two sets of suppositions; `None` if it would have more than two
    /// members.
    fn with(self, other: SuppositionSet) -> Option<SuppositionSet> {
        let mut both = self;
        for member in other.members() {
            if both.members().contains(member) {
                continue;
            }
            *both.members.get_mut(usize::from(both.count))? = *member;
            both.count += 1;
        }
        if both.count == 2 {
            both.members.sort_unstable();
        }
        Some(both)
    }

    fn is_within(&self, other: &SuppositionSet) -> bool {
        self.members().iter().all(|member| other.members().contains(member))
    }
}

/// Adds a set to `sets`, unless `sets` contains a subset of it. Returns whether `sets` has changed.
fn insert(sets: &mut Vec<SuppositionSet>, set: SuppositionSet, is_complete: &mut bool) -> bool {
    if sets.iter().any(|known| known.is_within(&set)) {
        return false;
    }
    sets.retain(|known| !set.is_within(known));
    let at = sets.partition_point(|known| *known < set);
    if sets.len() >= SETS_MAX {
        *is_complete = false;
        // Only a smaller set may replace a larger one, which ensures termination.
        if sets.last().is_none_or(|last| last.count <= set.count) {
            return false;
        }
        sets.pop();
    }
    sets.insert(at.min(sets.len()), set);
    true
}

// === impl SuppositionRules ===

impl SuppositionRules {
    pub(super) fn new(task: &Task, supposed: &SupposedTask) -> SuppositionRules {
        let mut rules = SuppositionRules::default();
        let literals = task.fact_count * 2;
        rules.readers = vec![Vec::new(); literals];
        rules.begin(task);
        for operator in task.operators.iter() {
            let name = &task.schema_names[operator.schema as usize];
            let names = operator.arguments.iter();
            let arguments: Vec<Name> =
                names.map(|object| task.object_names[object.index()].clone()).collect();
            let body = operator.preconditions.iter().map(|literal| index(*literal)).collect();
            let mut heads = heads(operator.effect);
            let origin = match supposed.meanings.get(name) {
                None => RuleOrigin::World,
                Some(OperatorMeaning::Suppose(capability)) => {
                    rules.supposition(*capability, &arguments)
                }
                Some(OperatorMeaning::Place(placement)) => rules.placement(*placement, &arguments),
                Some(OperatorMeaning::Reach(part)) => {
                    heads = vec![rules.goal()];
                    rules.parts.insert(*part, heads[0]);
                    RuleOrigin::World
                }
                Some(OperatorMeaning::Touch(part, atom)) => {
                    heads = vec![rules.goal()];
                    rules.touches.insert((*part, *atom), heads[0]);
                    RuleOrigin::World
                }
            };
            for conditional in operator.conditional.iter() {
                let conditions = operator.preconditions.iter().chain(conditional.conditions);
                let body = conditions.map(|literal| index(*literal)).collect();
                let heads = self::heads(conditional.effect);
                rules.add(SuppositionRule { body, heads, origin });
            }
            rules.add(SuppositionRule { body, heads, origin });
        }
        for axiom in &task.axioms {
            let body = axiom.body.iter().map(|literal| index(*literal)).collect();
            let heads = vec![index(Literal::new(axiom.head, true))];
            rules.add(SuppositionRule { body, heads, origin: RuleOrigin::World });
        }
        rules
    }

    /// Adds the literals that hold in the initial state. Negated derived facts and comparisons are
    /// assumed to hold, so that no reachable literal is missed.
    fn begin(&mut self, task: &Task) {
        let mut holds = vec![false; task.fact_count];
        task.initial.iter().for_each(|fact| holds[fact.index()] = true);
        for (fact, holds) in holds.into_iter().enumerate() {
            let is_basic = fact < task.basic_count;
            let is_comparison = !is_basic && fact < task.basic_count + task.comparisons.len();
            if holds || is_comparison {
                self.initial.push(fact * 2);
            }
            if !holds {
                self.initial.push(fact * 2 + 1);
            }
        }
    }

    fn add(&mut self, rule: SuppositionRule) {
        for literal in &rule.body {
            self.readers[*literal].push(self.rules.len());
        }
        self.rules.push(rule);
    }

    /// Adds a literal that represents no fact of the task. Returns its number.
    fn goal(&mut self) -> usize {
        self.readers.push(Vec::new());
        self.readers.len() - 1
    }

    fn supposition(&mut self, capability: usize, arguments: &[Name]) -> RuleOrigin {
        let Some(agent) = arguments.first() else { return RuleOrigin::World };
        let number = u32::try_from(self.suppositions.len()).unwrap_or(u32::MAX);
        self.suppositions.push((capability, agent.clone()));
        RuleOrigin::Suppose(number)
    }

    fn placement(&mut self, placement: usize, arguments: &[Name]) -> RuleOrigin {
        let Some((agent, others)) = arguments.split_first() else { return RuleOrigin::World };
        let is_same = |group: &PlaceGroup| group.placement == placement && group.agent == *agent;
        let group = self.groups.iter().position(is_same).unwrap_or_else(|| {
            let (agent, values) = (agent.clone(), Vec::new());
            self.groups.push(PlaceGroup { placement, agent, values });
            self.groups.len() - 1
        });
        let values = &mut self.groups[group].values;
        values.push(others.to_vec());
        RuleOrigin::Place(group, values.len() - 1)
    }

    /// Returns the parts of the goal that are reachable by the allowed rules. Adds the work to
    /// `steps`.
    pub(super) fn reached(
        &self,
        allowed: impl Fn(RuleOrigin) -> bool,
        steps: &mut u64,
    ) -> Vec<usize> {
        let mut holds = vec![false; self.readers.len()];
        let mut open: Vec<usize> = self.rules.iter().map(|rule| rule.body.len()).collect();
        let mut queue = self.initial.clone();
        let is_open = |rule: &SuppositionRule| allowed(rule.origin);
        let free = self.rules.iter().filter(|rule| rule.body.is_empty() && is_open(rule));
        queue.extend(free.flat_map(|rule| rule.heads.iter().copied()));
        while let Some(literal) = queue.pop() {
            if std::mem::replace(&mut holds[literal], true) {
                continue;
            }
            for reader in &self.readers[literal] {
                *steps += 1;
                open[*reader] -= 1;
                let rule = &self.rules[*reader];
                if open[*reader] == 0 && is_open(rule) {
                    queue.extend(rule.heads.iter().filter(|head| !holds[**head]));
                }
            }
        }
        let reached = self.parts.iter().filter(|(_, literal)| holds[**literal]);
        reached.map(|(part, _)| *part).collect()
    }
}

fn index(literal: Literal) -> usize {
    literal.fact().index() * 2 + usize::from(!literal.is_positive())
}

fn heads(changes: Changes<'_>) -> Vec<usize> {
    let adds = changes.adds.iter().map(|fact| index(Literal::new(*fact, true)));
    let deletes = changes.deletes.iter().map(|fact| index(Literal::new(*fact, false)));
    adds.chain(deletes).collect()
}

// === impl Support ===

impl Support {
    pub(super) fn compute(rules: &SuppositionRules) -> Support {
        let mut sets: Vec<Vec<SuppositionSet>> = vec![Vec::new(); rules.readers.len()];
        for literal in &rules.initial {
            sets[*literal].push(SuppositionSet::default());
        }
        let (mut steps, mut is_complete) = (0, true);
        let mut queue: VecDeque<usize> = (0..rules.rules.len()).collect();
        let mut waits = vec![true; rules.rules.len()];
        while let Some(next) = queue.pop_front() {
            if steps >= STEPS_MAX {
                is_complete = false;
                break;
            }
            waits[next] = false;
            let rule = &rules.rules[next];
            let found = body_sets(rule, &sets, &mut steps, &mut is_complete);
            for head in &rule.heads {
                let known = &mut sets[*head];
                let before = found.iter().filter(|set| insert(known, **set, &mut is_complete));
                if before.count() == 0 {
                    continue;
                }
                for reader in &rules.readers[*head] {
                    if !std::mem::replace(&mut waits[*reader], true) {
                        queue.push_back(*reader);
                    }
                }
            }
        }
        let of = |literal: &usize| sets[*literal].clone();
        let parts = rules.parts.iter().map(|(part, literal)| (*part, of(literal))).collect();
        let holds = |literal: &usize| sets[*literal].contains(&SuppositionSet::default());
        let touches = rules.touches.iter().map(|(at, literal)| (*at, holds(literal))).collect();
        Support { parts, touches, is_complete }
    }

    /// Whether a part of the goal is reachable without any supposition.
    pub(super) fn is_reached(&self, part: usize) -> bool {
        self.parts.get(&part).is_some_and(|sets| sets.contains(&SuppositionSet::default()))
    }

    /// Whether a fact in a part of the goal is reachable without any supposition.
    pub(super) fn is_fact_reached(&self, part: usize, atom: usize) -> bool {
        self.touches.get(&(part, atom)).copied().unwrap_or(false)
    }

    /// Returns the smallest sets of suppositions that make a part of the goal reachable.
    pub(super) fn sets(&self, part: usize) -> &[SuppositionSet] {
        self.parts.get(&part).map_or(&[], Vec::as_slice)
    }
}

/// Returns the smallest sets of suppositions that make the whole body of a rule reachable.
fn body_sets(
    rule: &SuppositionRule,
    sets: &[Vec<SuppositionSet>],
    steps: &mut u64,
    is_complete: &mut bool,
) -> Vec<SuppositionSet> {
    let own = match rule.origin {
        RuleOrigin::Suppose(number) => SuppositionSet::of(number),
        RuleOrigin::World | RuleOrigin::Place(..) => SuppositionSet::default(),
    };
    let mut whole = vec![own];
    for literal in &rule.body {
        let mut both = Vec::new();
        for left in &whole {
            for right in &sets[*literal] {
                *steps += 1;
                if let Some(set) = left.with(*right) {
                    insert(&mut both, set, is_complete);
                }
            }
        }
        whole = both;
        if whole.is_empty() {
            break;
        }
    }
    whole
}
