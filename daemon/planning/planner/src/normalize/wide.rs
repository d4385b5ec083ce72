//! Splits wide conditions: an `exists` over many variables becomes several over few.
//!
//! `exists ?x ?y ?z: (p ?a ?x), (q ?x ?y), (r ?y ?z)` is a join of four variables. However, ?z
//! occurs only in `r`. With a derived predicate for `exists ?z: (r ?y ?z)`, three variables are
//! left, and so on, like a tree decomposition of the join (Helmert, 2009, section 6.3; Corrêa and
//! others, 2023). The work is then a sum of small products instead of the product of all types.
//!
//! Only conditions are split, because all parameters of an action occur in the steps of plans.

use pddl::Name;

use super::lifted::{
    Formula, Lifted, LiftedAtom, LiftedAxiom, LiftedTerm, PredicateUse, SlotIndex, TypeIndex,
    TypeSet,
};

/// Number of bindings above which a join is split. Joining this many takes about a second. Smaller
/// joins are not split, because a derived predicate adds work to every state of a search.
const BINDINGS_MAX: f64 = 10_000_000.0;

/// Number of bindings at which the splitting of a join ends: a join with fewer bindings is not
/// split any further.
const BINDINGS_FEW: f64 = 10_000.0;

/// Minimum ratio between the number of bindings of the whole join and that of a part. With a
/// smaller ratio, a split is not worthwhile.
const GAIN_MIN: f64 = 10.0;

/// Splits every condition of an action or axiom with too many bindings.
pub(crate) fn split_wide(lifted: &mut Lifted) {
    split_above(lifted, BINDINGS_MAX, GAIN_MIN);
}

/// Does the same as [`split_wide`] with the given limits.
fn split_above(lifted: &mut Lifted, bindings_max: f64, gain_min: f64) {
    let Lifted { schemas, axioms, predicates, types, init, .. } = lifted;
    let mut rows = vec![0; predicates.len()];
    for (predicate, _) in init {
        rows[*predicate] += 1;
    }
    let mut strata = vec![0; predicates.len()];
    for axiom in axioms.iter() {
        strata[axiom.head] = axiom.stratum;
    }
    let mut splitter = ConditionSplitter {
        types,
        rows,
        strata,
        predicates,
        axioms: Vec::new(),
        bindings_max,
        gain_min,
    };
    for axiom in axioms.iter_mut() {
        splitter.formula(&mut axiom.body, &axiom.frame);
    }
    for schema in schemas {
        let frame = &schema.frame;
        splitter.formula(&mut schema.precondition, frame);
        let effects = schema.effects.iter_mut().map(|effect| &mut effect.condition);
        let numeric = schema.numeric.iter_mut().map(|change| &mut change.condition);
        for condition in effects.chain(numeric) {
            splitter.formula(condition, frame);
        }
    }
    axioms.append(&mut splitter.axioms);
}

struct ConditionSplitter<'l> {
    types: &'l [TypeSet],
    /// Per predicate: the number of its facts in the initial state.
    rows: Vec<usize>,
    /// Per predicate: its stratum; 0 for a predicate that is not derived.
    strata: Vec<usize>,
    predicates: &'l mut Vec<PredicateUse>,
    /// Axioms that the splitting has added.
    axioms: Vec<LiftedAxiom>,
    bindings_max: f64,
    gain_min: f64,
}

// === impl ConditionSplitter ===

impl ConditionSplitter<'_> {
    fn formula(&mut self, formula: &mut Formula, frame: &[TypeIndex]) {
        match formula {
            Formula::And(parts) | Formula::Or(parts) => {
                parts.iter_mut().for_each(|part| self.formula(part, frame));
            }
            // A `forall` is not split, because that would require a derived predicate for its
            // negation, and a new negated condition.
            Formula::Forall(_, inner) => self.formula(inner, frame),
            Formula::Exists(slots, inner) => {
                self.formula(inner, frame);
                if let Formula::And(parts) = &mut **inner {
                    self.exists(slots, parts, frame);
                }
            }
            _ => (),
        }
    }

    /// Eliminates variables of an `exists`, the cheapest first, until few bindings are left or the
    /// gain is too small.
    fn exists(
        &mut self,
        slots: &mut Vec<SlotIndex>,
        parts: &mut Vec<Formula>,
        frame: &[TypeIndex],
    ) {
        let mut bindings_max = self.bindings_max;
        loop {
            let whole = self.bindings(&scope(parts.iter()), parts.iter(), frame);
            if whole <= bindings_max {
                return;
            }
            let scopes = slots.iter().map(|slot| {
                let inside = || parts.iter().filter(|part| part.free_slots().contains(slot));
                let scope = scope(inside());
                (self.bindings(&scope, inside(), frame), *slot, scope)
            });
            let cheapest = scopes.min_by(|left, right| left.0.total_cmp(&right.0));
            let Some((bindings, slot, scope)) = cheapest else { return };
            if bindings * self.gain_min > whole {
                return;
            }
            let (inside, outside) = std::mem::take(parts)
                .into_iter()
                .partition(|part: &Formula| part.free_slots().contains(&slot));
            *parts = outside;
            parts.push(self.derive(slot, inside, &scope, frame));
            slots.retain(|one| *one != slot);
            bindings_max = bindings_max.min(BINDINGS_FEW);
        }
    }

    /// Adds a derived predicate with the meaning “there is an object for `slot` such that the parts
    /// hold”. Returns its literal.
    fn derive(
        &mut self,
        slot: SlotIndex,
        parts: Vec<Formula>,
        scope: &[SlotIndex],
        frame: &[TypeIndex],
    ) -> Formula {
        let head = self.predicates.len();
        let parameters: Vec<SlotIndex> = scope.iter().copied().filter(|one| *one != slot).collect();
        let mut body = Formula::Exists(vec![slot], Box::new(Formula::And(parts)));
        let mut stratum = 0;
        body.literals(&mut |positive, atom| {
            let is_settled_before = !positive && self.predicates[atom.predicate].derived;
            stratum = stratum.max(self.strata[atom.predicate] + usize::from(is_settled_before));
        });
        let mut slots = parameters.clone();
        renumber(&mut body, &mut slots);
        self.predicates.push(PredicateUse {
            // Names in a text contain no spaces, so this name is unique.
            name: Name::new(&format!("exists {head}")),
            arity: parameters.len(),
            added: false,
            deleted: false,
            derived: true,
        });
        self.rows.push(0);
        self.strata.push(stratum);
        self.axioms.push(LiftedAxiom {
            head,
            parameter_count: parameters.len(),
            frame: slots.iter().map(|slot| frame[*slot as usize]).collect(),
            body,
            stratum,
        });
        let arguments = parameters.into_iter().map(LiftedTerm::Variable).collect();
        Formula::Literal { positive: true, atom: LiftedAtom { predicate: head, arguments } }
    }

    /// Returns an upper bound on the number of bindings of a conjunction. If a static predicate has
    /// fewer facts than the product of the types of its variables, the number of facts is used
    /// instead of this product.
    fn bindings<'f>(
        &self,
        scope: &[SlotIndex],
        parts: impl Iterator<Item = &'f Formula>,
        frame: &[TypeIndex],
    ) -> f64 {
        let size = |slot: &SlotIndex| self.types[frame[*slot as usize]].members.len() as f64;
        let mut open = scope.to_vec();
        let mut bindings = 1.0;
        for part in parts {
            let Formula::Literal { positive: true, atom } = part else { continue };
            let rows = self.rows[atom.predicate] as f64;
            let binds = |slot: &SlotIndex| atom.arguments.contains(&LiftedTerm::Variable(*slot));
            let alone: f64 = open.iter().filter(|slot| binds(slot)).map(size).product();
            if self.predicates[atom.predicate].is_static() && rows < alone {
                bindings *= rows;
                open.retain(|slot| !binds(slot));
            }
        }
        bindings * open.iter().map(size).product::<f64>()
    }
}

/// Returns the free variables of the formulas, sorted and without duplicates.
pub(super) fn scope<'f>(parts: impl Iterator<Item = &'f Formula>) -> Vec<SlotIndex> {
    let mut scope = Vec::new();
    parts.for_each(|part| scope.extend(part.free_slots()));
    scope.sort_unstable();
    scope.dedup();
    scope
}

/// Replaces each variable by its position in `slots`. A variable that is not in `slots` is appended
/// there.
pub(super) fn renumber(formula: &mut Formula, slots: &mut Vec<SlotIndex>) {
    formula.slots_mut(&mut |slot| {
        let known = slots.iter().position(|one| one == slot);
        let place = known.unwrap_or_else(|| {
            slots.push(*slot);
            slots.len() - 1
        });
        *slot = place as SlotIndex;
    });
}

#[cfg(test)]
mod tests {
    use std::fmt::Write as _;

    use proptest::prelude::*;

    use super::*;
    use crate::ground::ground;
    use crate::limits::{Budget, Cancel};
    use crate::test_tasks::{cheapest, lifted};

    /// Returns a task with a chain of four joins that begins at an object which an action can
    /// change.
    fn chain(objects: usize) -> Lifted {
        let mut problem = String::from("(define (problem p) (:domain d) (:objects");
        (0..objects).for_each(|one| write!(problem, " o{one}").expect("it fits"));
        problem.push_str(") (:init (at o0)");
        for one in 0..objects {
            for next in 0..objects {
                write!(problem, " (r o{one} o{next})").expect("it fits");
            }
        }
        problem.push_str(") (:goal (won)))");
        let domain = "(define (domain d) (:predicates (r ?x ?y) (at ?x) (won))
            (:action win :parameters (?a) :precondition (and (at ?a)
                (exists (?b ?c ?d ?e) (and (r ?a ?b) (r ?b ?c) (r ?c ?d) (r ?d ?e))))
             :effect (won)))";
        lifted(domain, &problem)
    }

    #[test]
    fn splitting_a_chain_saves_grounding_steps() {
        let steps = |lifted: &Lifted| {
            let mut steps = 0;
            let ground = ground(lifted, Budget::default(), &Cancel::new(), &mut steps);
            assert!(ground.expect("no limit").task.is_some());
            steps
        };
        let mut split_up = chain(25);
        split_above(&mut split_up, 100_000.0, 10.0);
        assert_eq!(split_up.axioms.len(), 3, "one for each but the last");
        let (whole, parts) = (steps(&chain(25)), steps(&split_up));
        assert!(parts * 50 < whole, "{parts} steps instead of {whole}");
    }

    #[test]
    fn narrow_conditions_stay_unchanged() {
        let mut narrow = chain(25);
        split_wide(&mut narrow);
        assert!(narrow.axioms.is_empty());
        // The chain has as many variables, but each object is related to only two others.
        let mut sparse = chain(40);
        sparse.init.truncate(80);
        split_wide(&mut sparse);
        assert!(sparse.axioms.is_empty());
        let mut wide = chain(40);
        split_wide(&mut wide);
        assert!(!wide.axioms.is_empty());
    }

    /// Generates a part of a condition over the variables ?a to ?d. The variable ?a is free.
    fn part() -> impl Strategy<Value = String> {
        let term = || prop_oneof![Just("?a"), Just("?b"), Just("?c"), Just("?d")];
        prop_oneof![
            4 => (term(), term()).prop_map(|(one, two)| format!("(r {one} {two})")),
            2 => term().prop_map(|one| format!("(p {one})")),
            1 => term().prop_map(|one| format!("(not (p {one}))")),
            1 => term().prop_map(|one| format!("(reached {one})")),
            1 => term().prop_map(|one| format!("(not (reached {one}))")),
            1 => (term(), term()).prop_map(|(one, two)| format!("(not (= {one} {two}))")),
            1 => term().prop_map(|one| format!("(exists (?e) (and (r {one} ?e) (p ?e)))")),
            1 => term().prop_map(|one| format!("(forall (?f) (or (p ?f) (r {one} ?f)))")),
        ]
    }

    proptest! {
        #![proptest_config(ProptestConfig {
            cases: 300,
            failure_persistence: None,
            rng_seed: proptest::test_runner::RngSeed::Fixed(41),
            ..ProptestConfig::default()
        })]

        #[test]
        fn splitting_keeps_the_costs_of_plans(
            parts in proptest::collection::vec(part(), 2..6),
            again in proptest::collection::vec(part(), 2..5),
            facts in proptest::collection::vec((0..3, 0..3), 0..6),
            held in proptest::collection::vec(0..3, 0..2),
        ) {
            let domain = format!(
                "(define (domain d) (:predicates (r ?x ?y) (p ?x) (reached ?x) (far ?a) (won))
                 (:derived (reached ?x) (exists (?y) (and (p ?y) (or (r ?y ?x) (= ?x ?y)))))
                 (:derived (far ?a) (exists (?b ?c ?d) (and {})))
                 (:action put :parameters (?x) :precondition (not (p ?x)) :effect (p ?x))
                 (:action take :parameters (?x) :precondition (p ?x) :effect (not (p ?x)))
                 (:action turn :parameters (?x ?y) :precondition (r ?x ?y)
                  :effect (and (not (r ?x ?y)) (r ?y ?x)))
                 (:action win :parameters (?a)
                  :precondition (and (far ?a) (exists (?b ?c ?d) (and {}))) :effect (won)))",
                parts.join(" "),
                again.join(" ")
            );
            let name = |one: &i32| ["o0", "o1", "o2"][*one as usize];
            let mut init: String =
                facts.iter().map(|(one, two)| format!("(r {} {})", name(one), name(two))).collect();
            init.extend(held.iter().map(|one| format!("(p {})", name(one))));
            let problem = format!(
                "(define (problem p) (:domain d) (:objects o0 o1 o2) (:init {init}) (:goal (won)))"
            );
            let whole = lifted(&domain, &problem);
            let mut taken_apart = whole.clone();
            split_above(&mut taken_apart, 1.0, 1.5);
            prop_assume!(taken_apart.axioms.len() > whole.axioms.len());
            let cost = |lifted: &Lifted| cheapest(lifted).map(|plan| plan.cost);
            prop_assert_eq!(cost(&whole), cost(&taken_apart), "{}", domain);
        }
    }
}
