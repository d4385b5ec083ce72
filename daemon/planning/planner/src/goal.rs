//! Splits goals into conjuncts, and finds conjuncts that are unreachable.
//!
//! A goal may come from outside, and a goal with many variables can represent more conditions than
//! fit into memory. Conditions are therefore counted, and a goal with too many of them is an error
//! that gives the limit.

use std::ops::ControlFlow;

use pddl::{Atom, Condition, Derived, Domain, Expression, Problem, Typed};

use crate::ground::ground;
use crate::heuristic::{Evaluator, MaxHeuristic};
use crate::limits::Cancel;
use crate::normalize::normalize;
use crate::options::Options;
use crate::outcome::PlanError;
use crate::plan::refuse_mistakes;
use crate::progression::Progression;
use crate::validate::World;
use crate::validate::bindings::Bindings;
use crate::validate::model::Model;

/// Maximum size of a goal: the number of its conditions and terms with every quantifier expanded. A
/// larger goal is an error. At the limit, splitting takes a fraction of a second and some tens of
/// megabytes. Goals of buildings have some thousands of conditions and terms.
pub const GOAL_SIZE_MAX: usize = 200_000;

/// Error for a goal that is larger than [`GOAL_SIZE_MAX`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct GoalTooLarge {
    /// Maximum number of conditions and terms of a goal: [`GOAL_SIZE_MAX`].
    pub limit: usize,
}

/// Splits a goal into the conjuncts that must all hold, without duplicates.
///
/// - `forall` is expanded over the objects of the problem, and nested conjunctions are flattened. A
///   disjunction stays one conjunct.
/// - A derived fact stays one conjunct if any of several conditions makes it true. Otherwise it is
///   replaced by the conjuncts that it is derived from: “no lamp in the room is on” becomes one
///   conjunct per lamp, so that different agents can each achieve one.
/// - Of the state in `world`, only the objects and the static facts (which no action changes) are
///   used.
///
/// # Errors
///
/// Returns an error if the goal is larger than [`GOAL_SIZE_MAX`].
pub fn conjuncts(world: &World, goal: &Condition) -> Result<Vec<Condition>, GoalTooLarge> {
    conjuncts_but(world, goal, &|_| false)
}

/// Splits a goal as [`conjuncts`] does, except that a derived fact stays one conjunct if `stays`
/// returns `true` for it. This is for facts that the caller has more knowledge of than the axioms
/// express.
///
/// # Errors
///
/// Returns an error if the goal is larger than [`GOAL_SIZE_MAX`].
pub fn conjuncts_but(
    world: &World,
    goal: &Condition,
    stays: &dyn Fn(&Atom) -> bool,
) -> Result<Vec<Condition>, GoalTooLarge> {
    let mut splitter = Splitter { world, stays, left: GOAL_SIZE_MAX, parts_max: usize::MAX };
    let mut parts = Vec::new();
    match splitter.split(goal, true, &mut Bindings::default(), &mut parts) {
        ControlFlow::Continue(()) => Ok(without_duplicates(parts)),
        ControlFlow::Break(()) => Err(GoalTooLarge { limit: GOAL_SIZE_MAX }),
    }
}

/// Returns the first conjuncts of a goal without duplicates, at most `parts_max`. The flag is
/// `true` if these are all conjuncts. Otherwise, conjuncts without quantifiers come first, because
/// a single quantifier may expand to all of the others.
pub(crate) fn first_conjuncts(
    world: &World,
    goal: &Condition,
    parts_max: usize,
) -> (Vec<Condition>, bool) {
    let first = |goal: &Condition| {
        let stays = &|_: &Atom| false;
        let mut splitter = Splitter { world, stays, left: GOAL_SIZE_MAX, parts_max };
        let mut parts = Vec::new();
        let split = splitter.split(goal, true, &mut Bindings::default(), &mut parts);
        parts.truncate(parts_max);
        (without_duplicates(parts), split.is_continue())
    };
    let (parts, is_whole) = first(goal);
    match goal {
        _ if is_whole => (parts, true),
        Condition::And(all) => {
            let is_quantified = |part: &&Condition| {
                let mut parts = part.parts();
                parts.any(|part| matches!(part, Condition::Forall(..) | Condition::Exists(..)))
            };
            let (last, before): (Vec<_>, Vec<_>) = all.iter().partition(is_quantified);
            let sorted = before.into_iter().chain(last).cloned().collect();
            (first(&Condition::And(sorted)).0, false)
        }
        // The first part alone is too large to be split.
        _ if parts.is_empty() => (vec![goal.clone()], false),
        _ => (parts, false),
    }
}

fn without_duplicates(mut parts: Vec<Condition>) -> Vec<Condition> {
    let mut seen = std::collections::HashSet::new();
    parts.retain(|part| seen.insert(part.clone()));
    parts
}

/// Returns the positions of the conditions that no reachable state satisfies.
///
/// Each result is proved by the delete relaxation. A condition without a returned position may
/// still be unreachable. If `cancel` is set, the remaining conditions are not checked.
///
/// # Errors
///
/// Returns [`PlanError::BadInput`] if the texts or a condition contain mistakes, and
/// [`PlanError::Unsupported`] if they use a feature that this planner does not support.
pub fn unreachable(
    domain: &Domain,
    problem: &Problem,
    conditions: &[Condition],
    options: &Options,
    cancel: &Cancel,
) -> Result<Vec<usize>, PlanError> {
    unreachable_or_undecided(domain, problem, conditions, options, cancel).map(|(found, _)| found)
}

/// Does the same as [`unreachable`]. Also returns whether every condition was decided; if so, all
/// other conditions are reachable in the relaxation.
pub(crate) fn unreachable_or_undecided(
    domain: &Domain,
    problem: &Problem,
    conditions: &[Condition],
    options: &Options,
    cancel: &Cancel,
) -> Result<(Vec<usize>, bool), PlanError> {
    let (mut found, mut is_decided) = (Vec::new(), true);
    for (position, condition) in conditions.iter().enumerate() {
        if cancel.is_set() {
            return Ok((found, false));
        }
        let alone = Problem { goal: condition.clone(), metric: None, ..problem.clone() };
        refuse_mistakes(domain, &alone)?;
        match is_unreachable(domain, &alone, options, cancel)? {
            Some(true) => found.push(position),
            Some(false) => (),
            None => is_decided = false,
        }
    }
    Ok((found, is_decided))
}

/// Whether no reachable state satisfies the goal of a problem, according to the delete relaxation.
/// Returns `None` if a limit ended grounding, because there is no proof then.
fn is_unreachable(
    domain: &Domain,
    problem: &Problem,
    options: &Options,
    cancel: &Cancel,
) -> Result<Option<bool>, PlanError> {
    let lifted = normalize(domain, problem)?;
    let Ok(grounded) = ground(&lifted, options.budget, cancel, &mut 0) else { return Ok(None) };
    let Some(task) = grounded.task else { return Ok(Some(true)) };
    let initial = Progression::new(&task).initial();
    let mut evaluator = MaxHeuristic::new(&task);
    Ok(Some(evaluator.evaluate(&initial).is_none()))
}

/// State of splitting a goal into conjuncts within limits.
struct Splitter<'w> {
    world: &'w World,
    /// Returns `true` for derived facts that stay one conjunct.
    stays: &'w dyn Fn(&Atom) -> bool,
    /// Number of conditions and terms that may still be created.
    left: usize,
    /// Maximum number of parts; splitting ends when it is exceeded.
    parts_max: usize,
}

// === impl Splitter ===

impl Splitter<'_> {
    /// Counts newly created conditions and terms. Breaks if they exceed the limit.
    fn spend(&mut self, count: usize) -> ControlFlow<()> {
        let left = self.left.checked_sub(count);
        self.left = left.unwrap_or(0);
        left.map_or(ControlFlow::Break(()), |_| ControlFlow::Continue(()))
    }

    /// Adds the conjuncts of `condition`, or of its negation if `positive` is false, to `parts`.
    /// Breaks if a limit is exceeded.
    fn split(
        &mut self,
        condition: &Condition,
        positive: bool,
        bindings: &mut Bindings,
        parts: &mut Vec<Condition>,
    ) -> ControlFlow<()> {
        match (condition, positive) {
            (Condition::And(all), true) | (Condition::Or(all), false) => {
                all.iter().try_for_each(|part| self.split(part, positive, bindings, parts))
            }
            (Condition::Or(all), true) if all.len() == 1 => {
                self.split(&all[0], true, bindings, parts)
            }
            (Condition::Not(inner), _) => self.split(inner, !positive, bindings, parts),
            (Condition::Imply(left, right), false) => {
                self.split(left, true, bindings, parts)?;
                self.split(right, false, bindings, parts)
            }
            (Condition::Forall(variables, inner), true)
            | (Condition::Exists(variables, inner), false) => {
                self.expand(variables, inner, positive, bindings, parts)
            }
            (Condition::Atom(atom), _) => match self.derive(atom, positive, bindings)? {
                Some(derived) => self.add(derived, parts),
                None => self.add_bound(condition, positive, bindings, parts),
            },
            _ => self.add_bound(condition, positive, bindings, parts),
        }
    }

    /// Adds a condition, or its negation if `positive` is false. Bound variables are replaced by
    /// their objects.
    fn add_bound(
        &mut self,
        condition: &Condition,
        positive: bool,
        bindings: &Bindings,
        parts: &mut Vec<Condition>,
    ) -> ControlFlow<()> {
        self.spend(size(condition))?;
        let bound = bindings.substitute(condition);
        let part = if positive { bound } else { Condition::Not(Box::new(bound)) };
        self.add(vec![part], parts)
    }

    fn add(&self, mut more: Vec<Condition>, parts: &mut Vec<Condition>) -> ControlFlow<()> {
        parts.append(&mut more);
        match parts.len() > self.parts_max {
            true => ControlFlow::Break(()),
            false => ControlFlow::Continue(()),
        }
    }

    /// Adds the conjuncts of every instance of a quantified condition to `parts`.
    fn expand(
        &mut self,
        variables: &[Typed],
        inner: &Condition,
        positive: bool,
        bindings: &mut Bindings,
        parts: &mut Vec<Condition>,
    ) -> ControlFlow<()> {
        let Some((first, rest)) = variables.split_first() else {
            return self.split(inner, positive, bindings, parts);
        };
        for object in self.world.model().members(&first.ty) {
            self.spend(1)?;
            bindings.bind(&first.name, object);
            let expanded = self.expand(rest, inner, positive, bindings, parts);
            bindings.unbind();
            expanded?;
        }
        ControlFlow::Continue(())
    }

    /// Returns the conjuncts that make a derived atom true, or false if `positive` is false.
    /// Returns `None` if the atom itself stays one conjunct. Breaks if a limit is exceeded.
    fn derive(
        &mut self,
        atom: &Atom,
        positive: bool,
        bindings: &Bindings,
    ) -> ControlFlow<(), Option<Vec<Condition>>> {
        if (self.stays)(&bindings.atom(atom)) {
            return ControlFlow::Continue(None);
        }
        let world = self.world;
        let definitions = world.model().definitions(&atom.predicate);
        let splits = |axiom: &Derived| {
            matches!(axiom.condition, Condition::And(_) | Condition::Forall(..) | Condition::Not(_))
        };
        match definitions.as_slice() {
            [] => return ControlFlow::Continue(None),
            [one] if positive && splits(one) => (),
            _ if positive => return ControlFlow::Continue(None),
            _ => (),
        }
        let arguments = bindings.objects(&atom.arguments);
        let mut parts = Vec::new();
        // The parts of an axiom count as one part of the goal.
        let parts_max = std::mem::replace(&mut self.parts_max, usize::MAX);
        for axiom in definitions {
            let mut inner = Bindings::default();
            for (parameter, object) in axiom.parameters.iter().zip(&arguments) {
                inner.bind(&parameter.name, object.clone());
            }
            self.split(&axiom.condition, positive, &mut inner, &mut parts)?;
        }
        self.parts_max = parts_max;
        let open = parts.into_iter().map(|part| fold(world, part)).filter(|part| !part.is_always());
        let open: Vec<Condition> = open.collect();
        // A condition that never holds tells less than the atom that needs it.
        let is_never = |part: &Condition| matches!(part, Condition::Or(any) if any.is_empty());
        if open.iter().any(is_never) {
            return ControlFlow::Continue(None);
        }
        // If exactly one conjunct is left, the atom itself is kept, because the author of the
        // domain chose its name.
        ControlFlow::Continue((open.len() != 1).then_some(open))
    }
}

// === impl GoalTooLarge ===

impl std::fmt::Display for GoalTooLarge {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let GoalTooLarge { limit } = self;
        write!(
            f,
            "the goal is too large: with every quantifier written out for all objects, it has more \
             than {limit} conditions and terms"
        )
    }
}

impl std::error::Error for GoalTooLarge {}

/// Returns the number of conditions and terms of a condition without expanding its quantifiers.
fn size(condition: &Condition) -> usize {
    let own = |part: &Condition| match part {
        Condition::Atom(atom) => 1 + atom.arguments.len(),
        Condition::Compare(compare) => 1 + terms(&compare.left) + terms(&compare.right),
        Condition::Exists(variables, _) | Condition::Forall(variables, _) => 1 + variables.len(),
        _ => 1,
    };
    condition.parts().map(own).sum()
}

fn terms(expression: &Expression) -> usize {
    match expression {
        Expression::Fluent(fluent) => 1 + fluent.arguments.len(),
        Expression::Negate(inner) => 1 + terms(inner),
        Expression::Apply(_, operands) => 1 + operands.iter().map(terms).sum::<usize>(),
        _ => 1,
    }
}

/// Simplifies a closed condition by evaluating its static parts. The result is the empty
/// conjunction if the condition is true, and the empty disjunction if it is false.
fn fold(world: &World, condition: Condition) -> Condition {
    match condition {
        Condition::Atom(atom) if world.model().is_static(&atom.predicate) => {
            truth(world.holds(&Condition::Atom(atom)))
        }
        Condition::Not(inner) => match fold(world, *inner) {
            Condition::And(all) if all.is_empty() => truth(false),
            Condition::Or(all) if all.is_empty() => truth(true),
            inner => Condition::Not(Box::new(inner)),
        },
        Condition::And(all) => joined(all.into_iter().map(|part| fold(world, part)), true),
        Condition::Or(all) => joined(all.into_iter().map(|part| fold(world, part)), false),
        Condition::Exists(..) | Condition::Forall(..) if is_static(world.model(), &condition) => {
            truth(world.holds(&condition))
        }
        Condition::Imply(left, right) => {
            let not = fold(world, Condition::Not(left));
            joined([not, fold(world, *right)].into_iter(), false)
        }
        other => other,
    }
}

/// Whether all predicates of a condition are static: no action changes them.
fn is_static(model: &Model, condition: &Condition) -> bool {
    condition.parts().all(|part| match part {
        Condition::Atom(atom) => model.is_static(&atom.predicate),
        Condition::Compare(_) => false,
        _ => true,
    })
}

fn truth(is_true: bool) -> Condition {
    if is_true { Condition::And(Vec::new()) } else { Condition::Or(Vec::new()) }
}

/// Builds a conjunction or disjunction of `parts`, without the parts that do not affect its truth.
fn joined(parts: impl Iterator<Item = Condition>, is_and: bool) -> Condition {
    let mut kept = Vec::new();
    for part in parts {
        match part {
            Condition::And(all) if all.is_empty() && is_and => (),
            Condition::Or(any) if any.is_empty() && !is_and => (),
            Condition::And(all) if all.is_empty() => return truth(true),
            Condition::Or(any) if any.is_empty() => return truth(false),
            part => kept.push(part),
        }
    }
    match kept.len() {
        1 => kept.remove(0),
        _ if is_and => Condition::And(kept),
        _ => Condition::Or(kept),
    }
}
