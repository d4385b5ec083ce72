//! Quantifiers rearranged, so that each ranges over no more than it must.
//!
//! - `exists` moves into `or`, `forall` into `and`; what does not mention a variable leaves its
//!   quantifier; variables that no part connects get quantifiers of their own.
//! - A disjunction inside an `exists` is multiplied out while it stays small, so that a join can
//!   use the facts of each alternative; dually for `forall`.
//!
//! All of it holds for empty types as well.

use super::lifted::{Formula, LiftedTerm, Slot};

/// Alternatives that one quantifier may be split into.
const ALTERNATIVES_MAX: usize = 8;

/// The same condition, easier to ground.
pub(super) fn rearrange(formula: Formula) -> Formula {
    match formula {
        Formula::And(parts) => junction(parts.into_iter().map(rearrange), true),
        Formula::Or(parts) => junction(parts.into_iter().map(rearrange), false),
        Formula::Exists(slots, inner) => quantified(slots, rearrange(*inner), true),
        Formula::Forall(slots, inner) => quantified(slots, rearrange(*inner), false),
        other => other,
    }
}

/// The parts as one conjunction, or disjunction, without another of its kind inside.
fn junction(parts: impl IntoIterator<Item = Formula>, conjunction: bool) -> Formula {
    let mut flat = Vec::new();
    for part in parts {
        match part {
            Formula::And(inner) if conjunction => flat.extend(inner),
            Formula::Or(inner) if !conjunction => flat.extend(inner),
            other => flat.push(other),
        }
    }
    match flat.len() {
        1 => flat.swap_remove(0),
        _ if conjunction => Formula::And(flat),
        _ => Formula::Or(flat),
    }
}

/// `exists` over a conjunction, or `forall` over a disjunction, once all else is taken apart.
fn quantified(mut slots: Vec<Slot>, inner: Formula, existential: bool) -> Formula {
    let mut parts = match inner {
        Formula::Or(parts) if existential => return each(slots, parts, existential),
        Formula::And(parts) if !existential => return each(slots, parts, existential),
        Formula::And(parts) | Formula::Or(parts) => parts,
        other => vec![other],
    };
    pull_up(&mut slots, &mut parts, existential);
    match alternatives(&slots, &parts, existential) {
        Some(all) => each(slots, all, existential),
        None => components(slots, parts, existential),
    }
}

fn each(slots: Vec<Slot>, parts: Vec<Formula>, existential: bool) -> Formula {
    let parts = parts.into_iter().map(|part| quantified(slots.clone(), part, existential));
    junction(parts, !existential)
}

/// Takes the variables of inner quantifiers of the same kind.
fn pull_up(slots: &mut Vec<Slot>, parts: &mut Vec<Formula>, existential: bool) {
    let mut position = 0;
    while position < parts.len() {
        let more = match &parts[position] {
            Formula::Exists(more, _) if existential => more,
            Formula::Forall(more, _) if !existential => more,
            _ => &Vec::new(),
        };
        let others = parts.iter().enumerate().filter(|(at, _)| *at != position);
        let is_taken = more.iter().any(|slot| slots.contains(slot))
            || others.into_iter().any(|(_, part)| mentions(part, more));
        if more.is_empty() || is_taken {
            position += 1;
            continue;
        }
        if let Formula::Exists(more, inner) | Formula::Forall(more, inner) = parts.remove(position)
        {
            slots.extend(more);
            match *inner {
                Formula::And(inner) if existential => parts.extend(inner),
                Formula::Or(inner) if !existential => parts.extend(inner),
                other => parts.push(other),
            }
        }
    }
}

/// A conjunction as a disjunction of a few, or dually; `None` if there is nothing to multiply out
/// or too much.
fn alternatives(slots: &[Slot], parts: &[Formula], existential: bool) -> Option<Vec<Formula>> {
    let choices = |part: &Formula| match part {
        Formula::Or(choices) if existential && mentions(part, slots) => Some(choices.clone()),
        Formula::And(choices) if !existential && mentions(part, slots) => Some(choices.clone()),
        _ => None,
    };
    let mut all: Vec<Vec<Formula>> = vec![Vec::new()];
    let mut is_split = false;
    for part in parts {
        let choices = match choices(part) {
            Some(choices) => {
                is_split = true;
                choices
            }
            None => vec![part.clone()],
        };
        if all.len() * choices.len() > ALTERNATIVES_MAX {
            return None;
        }
        let pairs = all.iter().flat_map(|left| {
            choices.iter().map(move |right| [left.as_slice(), std::slice::from_ref(right)].concat())
        });
        all = pairs.collect();
    }
    is_split.then(|| all.into_iter().map(|parts| junction(parts, existential)).collect())
}

/// One quantifier per group of variables that parts connect; what mentions none stays outside.
fn components(slots: Vec<Slot>, parts: Vec<Formula>, existential: bool) -> Formula {
    let mut groups: Vec<(Vec<Slot>, Vec<Formula>)> =
        slots.into_iter().map(|slot| (vec![slot], Vec::new())).collect();
    let mut outside = Vec::new();
    for part in parts {
        let (touched, mut rest): (Vec<_>, Vec<_>) =
            groups.into_iter().partition(|(slots, _)| mentions(&part, slots));
        if touched.is_empty() {
            outside.push(part);
        } else {
            let mut whole = (Vec::new(), Vec::new());
            for (slots, parts) in touched {
                whole.0.extend(slots);
                whole.1.extend(parts);
            }
            whole.1.push(part);
            rest.push(whole);
        }
        groups = rest;
    }
    let quantified = groups.into_iter().map(|(slots, parts)| {
        let inner = Box::new(junction(parts, existential));
        if existential { Formula::Exists(slots, inner) } else { Formula::Forall(slots, inner) }
    });
    junction(outside.into_iter().chain(quantified), existential)
}

/// Whether a formula mentions one of these variables.
fn mentions(formula: &Formula, slots: &[Slot]) -> bool {
    let is_one = |term: &LiftedTerm| match term {
        LiftedTerm::Variable(slot) => slots.contains(slot),
        LiftedTerm::Object(_) => false,
    };
    match formula {
        Formula::Constant(_) => false,
        Formula::Literal { atom, .. } => atom.arguments.iter().any(is_one),
        Formula::Equal { left, right, .. } => is_one(left) || is_one(right),
        Formula::Compare { sides, .. } => {
            let mut found = false;
            sides.0.terms(&mut |term| found |= is_one(term));
            sides.1.terms(&mut |term| found |= is_one(term));
            found
        }
        Formula::And(parts) | Formula::Or(parts) => parts.iter().any(|part| mentions(part, slots)),
        Formula::Exists(_, inner) | Formula::Forall(_, inner) => mentions(inner, slots),
    }
}

#[cfg(test)]
mod tests {
    use super::super::lifted::LiftedAtom;
    use super::*;

    fn atom(predicate: usize, slots: &[Slot]) -> Formula {
        let arguments = slots.iter().map(|slot| LiftedTerm::Variable(*slot)).collect();
        Formula::Literal { positive: true, atom: LiftedAtom { predicate, arguments } }
    }

    fn show(formula: &Formula) -> String {
        let all = |parts: &[Formula]| parts.iter().map(show).collect::<Vec<_>>().join(" ");
        match formula {
            Formula::Literal { atom, .. } => {
                let slots = atom.arguments.iter().map(|term| match term {
                    LiftedTerm::Variable(slot) => slot.to_string(),
                    LiftedTerm::Object(_) => "o".to_owned(),
                });
                format!("p{}{}", atom.predicate, slots.collect::<String>())
            }
            Formula::And(parts) => format!("(and {})", all(parts)),
            Formula::Or(parts) => format!("(or {})", all(parts)),
            Formula::Exists(slots, inner) => format!("(E{slots:?} {})", show(inner)),
            Formula::Forall(slots, inner) => format!("(A{slots:?} {})", show(inner)),
            other => format!("{other:?}"),
        }
    }

    #[track_caller]
    fn check(formula: Formula, expected: &str) {
        assert_eq!(show(&rearrange(formula)), expected);
    }

    #[test]
    fn exists_goes_into_disjunctions_and_leaves_out_what_is_free_of_it() {
        let or = Formula::Or(vec![atom(1, &[7]), atom(2, &[8])]);
        let inner = Formula::And(vec![atom(0, &[7]), or, atom(3, &[9])]);
        check(
            Formula::Exists(vec![7], Box::new(inner)),
            "(or (and p39 (E[7] (and p07 p17))) (and p28 p39 (E[7] p07)))",
        );
    }

    #[test]
    fn unconnected_variables_part() {
        let inner = Formula::And(vec![atom(0, &[1]), atom(1, &[2]), atom(2, &[1, 5])]);
        check(
            Formula::Exists(vec![1, 2], Box::new(inner)),
            "(and (E[2] p12) (E[1] (and p01 p215)))",
        );
    }

    #[test]
    fn a_forall_inside_a_disjunction_joins_the_one_around_it() {
        let inner = Formula::Forall(vec![2], Box::new(atom(0, &[1, 2])));
        let or = Formula::Or(vec![inner, atom(1, &[1])]);
        check(Formula::Forall(vec![1], Box::new(or)), "(A[2, 1] (or p11 p012))");
    }
}
