//! Finds dominated additions of relaxed operators. An added proposition is dominated if the
//! operator itself requires it, or if another operator adds it with fewer or the same preconditions
//! at no greater cost.
//!
//! The method follows the simplification of unary operators in Fast Downward (Helmert, 2006), but
//! does not split operators into unary ones. Sums and maxima of costs (h_add, h_max) stay the same.
//! The cheapest relaxed plan may become more expensive: a proposition that one operator added as a
//! side effect may then need another operator.

use crate::rows::Rows;

/// Maximum number of operators with the same first precondition that an operator is compared with;
/// the others are skipped. More comparisons would cost more time than they save.
const COMPARED_MAX: usize = 8;

/// Relaxed operators. The propositions in each row of `preconditions` and `adds` must be sorted.
pub(super) struct RelaxedOperators<'r> {
    pub(super) preconditions: &'r Rows,
    pub(super) adds: &'r Rows,
    pub(super) base_costs: &'r [u64],
}

// === impl RelaxedOperators ===

impl RelaxedOperators<'_> {
    /// Returns the propositions that each operator adds, without the dominated ones. Additions that
    /// `is_exempt` accepts are always kept, because their costs depend on the state. The costs of
    /// propositions stay the same.
    pub(super) fn useful_adds(
        &self,
        proposition_count: usize,
        is_exempt: &dyn Fn(u32, u32) -> bool,
    ) -> Rows {
        let adding = self.adds.inverted(proposition_count);
        // Operators that add the current proposition, by their first precondition. The last entry
        // is for operators without preconditions.
        let mut by_first: Vec<Vec<u32>> = vec![Vec::new(); proposition_count + 1];
        let first = |relaxed: &u32| {
            let first = self.preconditions.row(*relaxed).first();
            first.map_or(proposition_count, |first| *first as usize)
        };
        let mut useful = Vec::with_capacity(self.adds.item_count());
        for proposition in 0..proposition_count as u32 {
            let adders = adding.row(proposition);
            adders.iter().for_each(|adder| by_first[first(adder)].push(*adder));
            for &adder in adders {
                let asked = self.preconditions.row(adder);
                let firsts = asked.iter().map(|one| *one as usize).chain([proposition_count]);
                let mut others = firsts.flat_map(|one| by_first[one].iter().take(COMPARED_MAX));
                let is_dominated = asked.binary_search(&proposition).is_ok()
                    || others.any(|other| self.dominates(*other, adder));
                if !is_dominated || is_exempt(adder, proposition) {
                    useful.push((adder, proposition));
                }
            }
            adders.iter().for_each(|adder| by_first[first(adder)].clear());
        }
        Rows::collect(self.adds.len(), useful.iter().copied())
    }

    /// Whether the operator `left` dominates `right`: its preconditions are a subset of those of
    /// `right`, at no greater cost. If both have the same preconditions and cost, the operator with
    /// more additions dominates, because it adds the others at no cost.
    fn dominates(&self, left: u32, right: u32) -> bool {
        let (asked, other) = (self.preconditions.row(left), self.preconditions.row(right));
        let (cost, other_cost) = (self.base_costs[left as usize], self.base_costs[right as usize]);
        let is_equal = asked.len() == other.len() && cost == other_cost;
        let more = self.adds.row(right).len().cmp(&self.adds.row(left).len());
        let is_before = !is_equal || more.then(left.cmp(&right)).is_lt();
        left != right
            && cost <= other_cost
            && asked.len() <= other.len()
            && is_before
            && is_subset(asked, other)
    }
}

/// Whether the sorted list `whole` contains all items of the sorted list `part`.
fn is_subset(part: &[u32], whole: &[u32]) -> bool {
    let mut rest = whole.iter();
    part.iter().all(|one| rest.any(|other| other == one))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(lists: &[&[u32]]) -> Rows {
        let mut rows = Rows::default();
        lists.iter().for_each(|list| rows.push(list));
        rows
    }

    #[track_caller]
    fn check(preconditions: &[&[u32]], adds: &[&[u32]], base_costs: &[u64], expected: &[&[u32]]) {
        let (preconditions, adds) = (rows(preconditions), rows(adds));
        let operators = RelaxedOperators { preconditions: &preconditions, adds: &adds, base_costs };
        let useful = operators.useful_adds(6, &|_, _| false);
        let found: Vec<&[u32]> = (0..useful.len() as u32).map(|one| useful.row(one)).collect();
        assert_eq!(found, expected);
    }

    #[test]
    fn a_required_proposition_is_not_added() {
        check(&[&[0, 1]], &[&[1, 2]], &[1], &[&[2]]);
    }

    #[test]
    fn fewer_preconditions_at_no_greater_cost_dominate() {
        check(&[&[0, 1], &[1]], &[&[2, 3], &[2]], &[1, 1], &[&[3], &[2]]);
        check(&[&[0, 1], &[]], &[&[2], &[2]], &[1, 1], &[&[], &[2]]);
        check(&[&[0, 1], &[1]], &[&[2], &[2]], &[1, 2], &[&[2], &[2]]);
        check(&[&[0, 1], &[3]], &[&[2], &[2]], &[1, 1], &[&[2], &[2]]);
    }

    #[test]
    fn among_equal_operators_the_one_that_adds_most_stays() {
        check(&[&[0], &[0]], &[&[2], &[2, 3]], &[1, 1], &[&[], &[2, 3]]);
        check(&[&[0], &[0], &[0]], &[&[2], &[2], &[2]], &[1, 1, 1], &[&[2], &[], &[]]);
        check(&[&[0], &[0]], &[&[2], &[2]], &[2, 1], &[&[], &[2]]);
    }
}
