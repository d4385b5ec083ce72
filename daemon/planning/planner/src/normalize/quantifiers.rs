//! Rearranges quantifiers, so that each has as few variables and conditions as possible.
//!
//! - `exists` moves into `or`, and `forall` into `and`. Parts without a variable of a quantifier
//!   are moved out of it. Variables without a common part get separate quantifiers.
//! - A disjunction inside an `exists` is multiplied out if the result is small, so that a join can
//!   use the facts of each alternative. A conjunction inside a `forall` is treated in the dual way.
//!
//! All rules are also valid for empty types. For large and deep conditions, which an external text
//! may contain, the cost of this exceeds the benefit. The visited and copied parts are therefore
//! counted, and when the limit is reached, the rest stays as it is.

use rustc_hash::FxHashMap;

use super::lifted::{Formula, LiftedTerm, SlotIndex};

/// Maximum number of alternatives that one quantifier is split into. If there would be more, the
/// quantifier is not split.
const ALTERNATIVES_MAX: usize = 8;

/// Limit on the number of visited and copied parts of conditions. After it is reached, the
/// remaining quantifiers stay as they are. Reaching it takes a fraction of a second and a fraction
/// of a gigabyte.
const WORK_MAX: u64 = 3_000_000;

/// Rearrangement of the conditions of one task, with a limit on work.
#[derive(Clone, Debug)]
pub(super) struct QuantifierRearrangement {
    work_left: u64,
}

impl Default for QuantifierRearrangement {
    fn default() -> QuantifierRearrangement {
        QuantifierRearrangement { work_left: WORK_MAX }
    }
}

// === impl QuantifierRearrangement ===

impl QuantifierRearrangement {
    /// Returns an equivalent condition that is easier to ground.
    pub(super) fn rearrange(&mut self, formula: Formula) -> Formula {
        match formula {
            Formula::And(parts) => {
                let parts: Vec<Formula> =
                    parts.into_iter().map(|part| self.rearrange(part)).collect();
                junction(parts, true)
            }
            Formula::Or(parts) => {
                let parts: Vec<Formula> =
                    parts.into_iter().map(|part| self.rearrange(part)).collect();
                junction(parts, false)
            }
            Formula::Exists(slots, inner) => {
                let inner = self.rearrange(*inner);
                self.quantified(slots, inner, true)
            }
            Formula::Forall(slots, inner) => {
                let inner = self.rearrange(*inner);
                self.quantified(slots, inner, false)
            }
            other => other,
        }
    }

    /// Rearranges a quantifier over an already rearranged formula.
    fn quantified(
        &mut self,
        mut slots: Vec<SlotIndex>,
        inner: Formula,
        existential: bool,
    ) -> Formula {
        if self.work_left == 0 {
            return as_it_is(slots, inner, existential);
        }
        let mut parts = match inner {
            Formula::Or(parts) if existential => return self.each(slots, parts, existential),
            Formula::And(parts) if !existential => return self.each(slots, parts, existential),
            Formula::And(parts) | Formula::Or(parts) => parts,
            other => vec![other],
        };
        self.pull_up(&mut slots, &mut parts, existential);
        match self.alternatives(&slots, &parts, existential) {
            Some(all) => self.each(slots, all, existential),
            None => self.components(slots, parts, existential),
        }
    }

    fn each(&mut self, slots: Vec<SlotIndex>, parts: Vec<Formula>, existential: bool) -> Formula {
        self.spend(slots.len() as u64 * parts.len() as u64);
        let parts = parts.into_iter();
        let parts: Vec<Formula> =
            parts.map(|part| self.quantified(slots.clone(), part, existential)).collect();
        junction(parts, !existential)
    }

    /// Merges quantifiers in `parts` that are of the same kind as the outer quantifier, with the
    /// variables `slots`, into the outer one.
    fn pull_up(&mut self, slots: &mut Vec<SlotIndex>, parts: &mut Vec<Formula>, existential: bool) {
        let mut position = 0;
        while position < parts.len() {
            let more = match &parts[position] {
                Formula::Exists(more, _) if existential => more,
                Formula::Forall(more, _) if !existential => more,
                _ => &Vec::new(),
            };
            if more.is_empty() {
                position += 1;
                continue;
            }
            let mut others = parts.iter().enumerate().filter(|(at, _)| *at != position);
            let is_taken = self.work_left == 0
                || more.iter().any(|slot| slots.contains(slot))
                || others.any(|(_, part)| self.mentions(part, more));
            if is_taken {
                position += 1;
                continue;
            }
            if let Formula::Exists(more, inner) | Formula::Forall(more, inner) =
                parts.remove(position)
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

    /// Multiplies out a conjunction into a disjunction of a few conjunctions, or a disjunction into
    /// a conjunction of a few disjunctions. Returns `None` if this changes nothing or the result is
    /// too large.
    fn alternatives(
        &mut self,
        slots: &[SlotIndex],
        parts: &[Formula],
        existential: bool,
    ) -> Option<Vec<Formula>> {
        // The number of alternatives is computed first, because copies are expensive and most
        // conditions are not split.
        let mut choices: Vec<&[Formula]> = Vec::new();
        let (mut count, mut is_split) = (1, false);
        for part in parts {
            let own = match part {
                Formula::Or(own) if existential => own.as_slice(),
                Formula::And(own) if !existential => own.as_slice(),
                _ => std::slice::from_ref(part),
            };
            let is_choice = own.len() != 1 && self.mentions(part, slots);
            let own = if is_choice { own } else { std::slice::from_ref(part) };
            is_split |= is_choice;
            count *= own.len();
            if count > ALTERNATIVES_MAX {
                return None;
            }
            choices.push(own);
        }
        if !is_split {
            return None;
        }
        self.spend(count as u64 * parts.iter().map(size).sum::<u64>());
        if self.work_left == 0 {
            return None;
        }
        let mut all: Vec<Vec<Formula>> = vec![Vec::new()];
        for choices in choices {
            let pairs = all.iter().flat_map(|left| {
                choices
                    .iter()
                    .map(move |right| [left.as_slice(), std::slice::from_ref(right)].concat())
            });
            all = pairs.collect();
        }
        Some(all.into_iter().map(|parts| junction(parts, existential)).collect())
    }

    /// Quantifies the variables `slots` over `parts`, with one quantifier for each group of
    /// variables that occur together in a part. Parts without any of the variables stay outside the
    /// quantifiers.
    fn components(
        &mut self,
        slots: Vec<SlotIndex>,
        parts: Vec<Formula>,
        existential: bool,
    ) -> Formula {
        // Slots in the same part form one group (union-find).
        let places: FxHashMap<SlotIndex, usize> =
            slots.iter().enumerate().map(|(place, slot)| (*slot, place)).collect();
        let mut leader: Vec<usize> = (0..slots.len()).collect();
        let mut first_of_part = Vec::with_capacity(parts.len());
        for part in &parts {
            let mut first: Option<usize> = None;
            self.work_left = self.work_left.saturating_sub(each_slot(part, &mut |slot| {
                let Some(place) = places.get(&slot) else { return };
                let own = find(&mut leader, *place);
                match first {
                    None => first = Some(own),
                    Some(other) => {
                        let other = find(&mut leader, other);
                        leader[own.max(other)] = own.min(other);
                    }
                }
            }));
            first_of_part.push(first);
        }
        let mut groups: Vec<(Vec<SlotIndex>, Vec<Formula>)> =
            vec![(Vec::new(), Vec::new()); slots.len()];
        // Groups are sorted by the position of their last part.
        let mut last = vec![0; slots.len()];
        for (place, slot) in slots.iter().enumerate() {
            groups[find(&mut leader, place)].0.push(*slot);
        }
        let mut outside = Vec::new();
        for (position, (part, first)) in parts.into_iter().zip(first_of_part).enumerate() {
            let Some(first) = first else {
                outside.push(part);
                continue;
            };
            let group = find(&mut leader, first);
            groups[group].1.push(part);
            last[group] = position + 1;
        }
        let mut groups: Vec<_> = groups.into_iter().zip(last).collect();
        groups.retain(|((slots, _), _)| !slots.is_empty());
        groups.sort_by_key(|(_, last)| *last);
        let groups = groups.into_iter().map(|(group, _)| group);
        let quantified = groups.map(|(slots, parts)| {
            let inner = Box::new(junction(parts, existential));
            if existential { Formula::Exists(slots, inner) } else { Formula::Forall(slots, inner) }
        });
        junction(outside.into_iter().chain(quantified), existential)
    }

    fn spend(&mut self, work: u64) {
        self.work_left = self.work_left.saturating_sub(work);
    }

    /// Whether a formula contains at least one of these variables.
    fn mentions(&mut self, formula: &Formula, slots: &[SlotIndex]) -> bool {
        let mut is_mentioned = false;
        let work = each_slot(formula, &mut |slot| is_mentioned |= slots.contains(&slot));
        self.spend(work * slots.len().max(1) as u64);
        is_mentioned
    }
}

/// Joins the parts into one conjunction, or one disjunction if `conjunction` is false. A part of
/// the same kind is replaced by its own parts.
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

/// Returns a quantifier over `inner` without rearrangement.
fn as_it_is(slots: Vec<SlotIndex>, inner: Formula, existential: bool) -> Formula {
    let inner = Box::new(inner);
    if existential { Formula::Exists(slots, inner) } else { Formula::Forall(slots, inner) }
}

/// Returns the representative of the group that contains `place`: the first slot of the group.
fn find(leader: &mut [usize], mut place: usize) -> usize {
    while leader[place] != place {
        leader[place] = leader[leader[place]];
        place = leader[place];
    }
    place
}

/// Returns the number of parts of a formula.
fn size(formula: &Formula) -> u64 {
    each_slot(formula, &mut |_| ())
}

/// Calls `visit` for every occurrence of a variable in a formula. Returns the number of parts of
/// the formula.
fn each_slot(formula: &Formula, visit: &mut dyn FnMut(SlotIndex)) -> u64 {
    let mut variable = |term: &LiftedTerm| {
        if let LiftedTerm::Variable(slot) = term {
            visit(*slot);
        }
    };
    match formula {
        Formula::Constant(_) => 1,
        Formula::Literal { atom, .. } => {
            atom.arguments.iter().for_each(variable);
            1 + atom.arguments.len() as u64
        }
        Formula::Equal { left, right, .. } => {
            [left, right].into_iter().for_each(variable);
            3
        }
        Formula::Compare { sides, .. } => {
            let mut count = 1;
            for side in [&sides.0, &sides.1] {
                side.terms(&mut |term| {
                    count += 1;
                    variable(term);
                });
            }
            count
        }
        Formula::And(parts) | Formula::Or(parts) => {
            1 + parts.iter().map(|part| each_slot(part, visit)).sum::<u64>()
        }
        Formula::Exists(_, inner) | Formula::Forall(_, inner) => 1 + each_slot(inner, visit),
    }
}

#[cfg(test)]
mod tests {
    use super::super::lifted::LiftedAtom;
    use super::*;

    fn atom(predicate: usize, slots: &[SlotIndex]) -> Formula {
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
        assert_eq!(show(&QuantifierRearrangement::default().rearrange(formula)), expected);
    }

    #[test]
    fn exists_is_distributed_and_excludes_parts_without_its_variables() {
        let or = Formula::Or(vec![atom(1, &[7]), atom(2, &[8])]);
        let inner = Formula::And(vec![atom(0, &[7]), or, atom(3, &[9])]);
        check(
            Formula::Exists(vec![7], Box::new(inner)),
            "(or (and p39 (E[7] (and p07 p17))) (and p28 p39 (E[7] p07)))",
        );
    }

    #[test]
    fn unconnected_variables_are_quantified_separately() {
        let inner = Formula::And(vec![atom(0, &[1]), atom(1, &[2]), atom(2, &[1, 5])]);
        check(
            Formula::Exists(vec![1, 2], Box::new(inner)),
            "(and (E[2] p12) (E[1] (and p01 p215)))",
        );
    }

    #[test]
    fn a_forall_inside_a_disjunction_is_merged_into_the_outer_one() {
        let inner = Formula::Forall(vec![2], Box::new(atom(0, &[1, 2])));
        let or = Formula::Or(vec![inner, atom(1, &[1])]);
        check(Formula::Forall(vec![1], Box::new(or)), "(A[1, 2] (or p11 p012))");
    }
}
