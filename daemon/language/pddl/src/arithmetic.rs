//! Arithmetic with decimal numbers that gives the results of calculation by hand, and exact
//! comparisons.
//!
//! The numbers `0.1`, `0.2` and `0.3` have no exact binary form, so in binary arithmetic `(- 0.3
//! 0.1)` is a little less than `0.2`. A comparison with a tolerance would hide this error, but
//! would also treat different numbers as equal. Instead, every result is rounded to the fifteen
//! decimal digits that a binary number can hold. Sums, differences and products of decimals are
//! then exact decimals, and comparisons need no tolerance.
//!
//! A sum may need more digits: `(+ 1000000000000 0.001)` loses the thousandth. Such losses are counted
//! ([`rounding_losses`]), because a proof that rests on them is none.

use std::cell::Cell;

use crate::tree::{Assignment, Comparison, Operator};

/// Number of decimal digits that `f64` preserves in every number.
const DIGITS: i32 = 15;

/// Number of decimal digits to which a quotient is rounded, if this changes the quotient by no more
/// than a rounding error.
const QUOTIENT_DIGITS: i32 = 12;

/// 2^53: up to this bound, `f64` represents every whole number exactly.
const WHOLE_MAX: f64 = 9_007_199_254_740_992.0;

/// Powers of ten that `f64` represents exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16,
    1e17, 1e18, 1e19, 1e20, 1e21, 1e22,
];

/// Part of the last kept digit from which a sum has lost a digit of an operand; below it is the error
/// of binary numbers.
const LOSS_MIN: f64 = 1e-9;

/// The same in relation to the operand, for operands with many digits.
const RELATIVE_LOSS_MIN: f64 = 4.0 * f64::EPSILON;

thread_local! {
    static LOSSES: Cell<u64> = const { Cell::new(0) };
}

/// Returns the number of sums and differences on this thread so far that have lost a decimal digit of
/// one of their operands.
///
/// ```
/// use pddl::{Operator, rounding_losses};
/// let before = rounding_losses();
/// Operator::Add.apply(0.1, 0.2);
/// assert_eq!(rounding_losses(), before);
/// Operator::Add.apply(1e12, 0.001);
/// assert_eq!(rounding_losses(), before + 1);
/// ```
pub fn rounding_losses() -> u64 {
    LOSSES.get()
}

/// Adds losses that another thread has counted to those of this thread.
pub fn add_rounding_losses(losses: u64) {
    LOSSES.set(LOSSES.get() + losses);
}

// === impl Operator ===

impl Operator {
    /// Returns the value of `(OPERATOR left right)`. If there is no such value, the result is
    /// infinite or NaN.
    ///
    /// ```
    /// use pddl::Operator;
    /// assert_eq!(Operator::Subtract.apply(0.3, 0.1), 0.2);
    /// assert_eq!(Operator::Divide.apply(0.3, 0.1), 3.0);
    /// assert!(!Operator::Divide.apply(1.0, 0.0).is_finite());
    /// ```
    pub fn apply(self, left: f64, right: f64) -> f64 {
        match self {
            Operator::Add => sum(left, right),
            Operator::Subtract => sum(left, -right),
            Operator::Multiply => {
                let product = left * right;
                rounded(product, product.abs(), DIGITS)
            }
            Operator::Divide => quotient(left, right),
        }
    }
}

// === impl Assignment ===

impl Assignment {
    /// Returns the value of a fluent after `(ASSIGNMENT fluent operand)`; `old` is the value
    /// before.
    pub fn apply(self, old: f64, operand: f64) -> f64 {
        match self {
            Assignment::Assign => operand,
            Assignment::Increase => Operator::Add.apply(old, operand),
            Assignment::Decrease => Operator::Subtract.apply(old, operand),
            Assignment::ScaleUp => Operator::Multiply.apply(old, operand),
            Assignment::ScaleDown => Operator::Divide.apply(old, operand),
        }
    }
}

// === impl Comparison ===

impl Comparison {
    /// Whether `(COMPARISON left right)` holds; `false` if either side is not a number.
    pub fn holds(self, left: f64, right: f64) -> bool {
        match self {
            Comparison::Less => left < right,
            Comparison::LessOrEqual => left <= right,
            Comparison::Equal => left == right,
            Comparison::GreaterOrEqual => left >= right,
            Comparison::Greater => left > right,
        }
    }

    /// Returns comparisons that together are the negation of this one. For two numbers, exactly one
    /// of them holds if this comparison does not hold, and none otherwise. If either side is not a
    /// number, none of them holds, because an undefined value satisfies neither a comparison nor
    /// its negation.
    ///
    /// ```
    /// use pddl::Comparison;
    /// assert_eq!(Comparison::Greater.negated(), [Comparison::LessOrEqual]);
    /// assert_eq!(Comparison::Equal.negated(), [Comparison::Less, Comparison::Greater]);
    /// assert!(!Comparison::Greater.holds(f64::NAN, 0.0));
    /// assert!(!Comparison::LessOrEqual.holds(f64::NAN, 0.0));
    /// ```
    pub fn negated(self) -> &'static [Comparison] {
        match self {
            Comparison::Less => &[Comparison::GreaterOrEqual],
            Comparison::LessOrEqual => &[Comparison::Greater],
            Comparison::Equal => &[Comparison::Less, Comparison::Greater],
            Comparison::GreaterOrEqual => &[Comparison::Less],
            Comparison::Greater => &[Comparison::LessOrEqual],
        }
    }
}

fn sum(left: f64, right: f64) -> f64 {
    let (value, magnitude) = (left + right, left.abs().max(right.abs()));
    // Fast path: most numbers in most tasks are whole.
    if left.fract() == 0.0 && right.fract() == 0.0 && magnitude <= WHOLE_MAX / 2.0 {
        return value;
    }
    // A number that is no decimal, such as a third, stays as it is.
    if left == 0.0 || right == 0.0 || !value.is_finite() {
        return value;
    }
    let places = places(magnitude, DIGITS);
    if loses_digit(left, places) || loses_digit(right, places) {
        add_rounding_losses(1);
    }
    rounded(value, magnitude, DIGITS)
}

/// Returns the position of the `digits`-th digit of a number, in places behind the point.
fn places(magnitude: f64, digits: i32) -> i32 {
    digits - 1 - magnitude.log10().floor() as i32
}

/// Whether a number has digits behind this many places.
fn loses_digit(number: f64, places: i32) -> bool {
    let scaled = (number * 10_f64.powi(places)).abs();
    (scaled - scaled.round()).abs() > LOSS_MIN.max(RELATIVE_LOSS_MIN * scaled)
}

fn quotient(left: f64, right: f64) -> f64 {
    let exact = left / right;
    let decimal = rounded(exact, exact.abs(), QUOTIENT_DIGITS);
    // A third, for example, is not a decimal and is returned unchanged.
    if (exact - decimal).abs() <= 4.0 * f64::EPSILON * exact.abs() { decimal } else { exact }
}

/// Rounds `value` to the nearest decimal number. The position of the last digit is the `digits`-th
/// digit of `magnitude`.
#[inline]
fn rounded(value: f64, magnitude: f64, digits: i32) -> f64 {
    // Fast path: most numbers in most tasks are whole.
    if (value.fract() == 0.0 && value.abs() <= WHOLE_MAX) || !value.is_finite() {
        return value;
    }
    round_fraction(value, magnitude, digits)
}

fn round_fraction(value: f64, magnitude: f64, digits: i32) -> f64 {
    // `magnitude` is finite, because `value` is.
    let Ok(places) = usize::try_from(places(magnitude, digits)) else { return value };
    let Some(power) = POWERS.get(places) else { return of_text(value, places) };
    let scaled = (value * power).round();
    // A whole number divided by an exact power of ten gives the binary number nearest to the
    // decimal.
    if scaled.abs() <= WHOLE_MAX { scaled / power } else { value }
}

/// Rounds a number to `places` decimal places by formatting and parsing it. Used for so many places
/// that `f64` does not represent the power of ten exactly.
fn of_text(value: f64, places: usize) -> f64 {
    format!("{value:.places$}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whether adding the two numbers loses a digit.
    fn loses(left: f64, right: f64) -> bool {
        let before = rounding_losses();
        sum(left, right);
        rounding_losses() > before
    }

    #[test]
    fn a_digit_that_is_lost_is_counted() {
        for (left, right) in [
            (1e12, 0.001),
            (1e12, 0.0001234),
            (0.1234567, 1e12),
            (1.0 / 3.0, 1.0 / 3.0),
            (1e15, 0.5),
            (1e16, 0.1),
        ] {
            assert!(loses(left, right) && loses(right, left), "{left} {right}");
        }
        for (left, right) in [
            (0.1, 0.2),
            (0.3, -0.1),
            (1e9, 0.1),
            (1e12, 0.12),
            (123_456.789_012_345, 0.1),
            (99_999_999.999_999, -1e-6),
            (1.0 / 3.0, 0.0),
            (1e12, 1e12),
            (4_503_599_627_370_496.0, 1.0),
            (1e-7, 2e-20),
        ] {
            assert!(!loses(left, right) && !loses(-left, -right), "{left} {right}");
        }
    }

    #[test]
    fn zero_changes_no_number() {
        for number in [1.0 / 3.0, 0.1, 2.71828182845905e3, -2.5] {
            assert_eq!(sum(number, 0.0).to_bits(), number.to_bits());
            assert_eq!(sum(0.0, number).to_bits(), number.to_bits());
        }
    }

    #[test]
    fn decimals_are_calculated_exactly() {
        let add =
            |numbers: &[f64]| numbers.iter().fold(0.0, |all, one| Operator::Add.apply(all, *one));
        assert_eq!(add(&[0.1; 10]), 1.0);
        assert_eq!(add(&[0.1, 0.2, -0.3]), 0.0);
        assert_eq!(add(&[1_000_000.3, -1_000_000.1]), 0.2);
        assert_eq!(add(&[1e-9; 3]), 3e-9);
        assert_eq!(Operator::Multiply.apply(1.1, 1.1), 1.21);
        assert_eq!(Operator::Multiply.apply(0.07, 100.0), 7.0);
        assert_eq!(Operator::Divide.apply(0.3, 0.1), 3.0);
        assert_eq!(Operator::Divide.apply(4.35, 100.0), 0.0435);
    }

    #[test]
    fn very_small_and_very_large_numbers_keep_their_value() {
        for value in [1e-300, 3.5e-30, 1e300, 123_456_789_012_345_680.0, -7e-12] {
            assert_eq!(Operator::Add.apply(value, 0.0), value);
            assert_eq!(Operator::Multiply.apply(value, 1.0), value);
        }
        assert!(!Operator::Multiply.apply(1e300, 1e300).is_finite());
        assert!(Comparison::Greater.holds(1e-12, 0.0) && !Comparison::Equal.holds(1e-12, 0.0));
        assert!(!Comparison::GreaterOrEqual.holds(f64::NAN, f64::NAN));
    }

    #[test]
    fn thirds_add_up_to_one() {
        let third = Operator::Divide.apply(1.0, 3.0);
        let two = Operator::Add.apply(third, third);
        assert_eq!(Operator::Add.apply(two, third), 1.0);
        assert_eq!(Operator::Multiply.apply(third, 3.0), 1.0);
    }
}
