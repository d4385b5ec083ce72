//! Facts that hold and prevent a part of a goal: no action ends them, and every way to the part
//! needs some of them to be false.
//!
//! A smallest set of such facts is found by removing facts from the problem and testing whether the
//! part becomes reachable (QuickXplain: Junker, 2004).

use std::collections::BTreeSet;

use pddl::{Atom, Condition, InitElement, Name, Problem};

use super::ExplanationInput;
use crate::goal::unreachable;
use crate::limits::Cancel;
use crate::options::Options;
use crate::outcome::PlanError;

/// Maximum number of facts among which hindrances are searched for. Each test grounds the task
/// anew.
const CANDIDATES_MAX: usize = 64;

/// Prefixes of the auxiliary predicates for unknown facts (`pddl::knowledge`), which mean nothing
/// to a person.
const AUXILIARY: [&str; 2] = ["unknown-", "maybe-"];

/// Returns a smallest set of facts without which `part` would be reachable; an empty set if there
/// is none, or if there are too many candidates.
///
/// # Errors
///
/// Returns an error if the texts contain mistakes or use an unsupported feature.
pub(super) fn hindrances(
    known: ExplanationInput<'_>,
    part: &Condition,
    options: &Options,
    cancel: &Cancel,
) -> Result<Vec<Atom>, PlanError> {
    let candidates = candidates(known);
    if candidates.is_empty() || candidates.len() > CANDIDATES_MAX {
        return Ok(Vec::new());
    }
    let search = Search { known, part, options, cancel };
    if !search.is_reachable_without(&candidates)? || cancel.is_set() {
        return Ok(Vec::new());
    }
    search.smallest(&[], &candidates)
}

/// Returns the facts of the problem that an action requires to be false.
fn candidates(known: ExplanationInput<'_>) -> Vec<Atom> {
    let mut negated = BTreeSet::new();
    for action in &known.domain.actions {
        collect_negated(&action.precondition, false, &mut negated);
    }
    let is_candidate = |atom: &&Atom| {
        let name = atom.predicate.spelled();
        negated.contains(&atom.predicate) && !AUXILIARY.iter().any(|it| name.starts_with(it))
    };
    let facts = known.problem.init.iter().filter_map(|element| match element {
        InitElement::Atom(atom) => Some(atom),
        _ => None,
    });
    facts.filter(is_candidate).cloned().collect()
}

/// Collects the predicates of negated atoms in a condition, which itself stands below a negation if
/// `is_negated`.
fn collect_negated(condition: &Condition, is_negated: bool, found: &mut BTreeSet<Name>) {
    match condition {
        Condition::Atom(atom) if is_negated => drop(found.insert(atom.predicate.clone())),
        Condition::Atom(_) | Condition::Equal(..) | Condition::Compare(_) => (),
        Condition::Not(inner) => collect_negated(inner, !is_negated, found),
        Condition::And(parts) | Condition::Or(parts) => {
            parts.iter().for_each(|part| collect_negated(part, is_negated, found));
        }
        Condition::Imply(left, right) => {
            collect_negated(left, !is_negated, found);
            collect_negated(right, is_negated, found);
        }
        Condition::Exists(_, inner) | Condition::Forall(_, inner) => {
            collect_negated(inner, is_negated, found);
        }
    }
}

struct Search<'a> {
    known: ExplanationInput<'a>,
    part: &'a Condition,
    options: &'a Options,
    cancel: &'a Cancel,
}

impl Search<'_> {
    /// Returns a smallest subset of `among` that has to be removed in addition to `removed`. All of
    /// them together suffice.
    fn smallest(&self, removed: &[Atom], among: &[Atom]) -> Result<Vec<Atom>, PlanError> {
        if among.len() <= 1 || self.cancel.is_set() {
            return Ok(among.to_vec());
        }
        let (left, right) = among.split_at(among.len() / 2);
        for half in [left, right] {
            if self.is_reachable_without(&[removed, half].concat())? {
                return self.smallest(removed, half);
            }
        }
        let of_left = self.smallest(&[removed, right].concat(), left)?;
        let of_right = self.smallest(&[removed, &of_left].concat(), right)?;
        Ok([of_left, of_right].concat())
    }

    fn is_reachable_without(&self, removed: &[Atom]) -> Result<bool, PlanError> {
        let ExplanationInput { domain, problem, .. } = self.known;
        let is_kept = |element: &&InitElement| match element {
            InitElement::Atom(atom) => !removed.contains(atom),
            _ => true,
        };
        let init = problem.init.iter().filter(is_kept).cloned().collect();
        let problem = Problem { init, ..problem.clone() };
        let part = std::slice::from_ref(self.part);
        Ok(unreachable(domain, &problem, part, self.options, self.cancel)?.is_empty())
    }
}
