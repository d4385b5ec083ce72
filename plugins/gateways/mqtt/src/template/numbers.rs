//! Arithmetic and comparisons for templates, according to Python's rules.

use std::cmp::Ordering;

use minijinja::value::ValueKind;
use minijinja::{Error, ErrorKind, Value};

/// Maximum length of a text from repeating or joining, in bytes; a longer one is an error.
pub(super) const TEXT_BYTES_MAX: usize = 1 << 20;

/// Maximum nesting depth of a value; a deeper one is an error, because values are printed, compared
/// and dropped by recursion. JSON may be nested up to 128 levels deep.
const DEPTH_MAX: usize = 200;

/// Weight of a part of a value, in addition to the bytes of its text.
const WEIGHT_OF_PART: usize = 8;

/// Weight that costs one step of the budget of a rendering.
pub(super) const WEIGHT_OF_STEP: usize = 64;

/// Returns the weight of a value: the sum of the weights of its parts and of the bytes of its
/// texts. A part that occurs several times is counted each time.
///
/// # Errors
///
/// Returns an error if the value is nested too deeply or is too large. The computation stops at
/// this point.
pub(super) fn weight(value: &Value) -> Result<usize, Error> {
    let mut left = TEXT_BYTES_MAX;
    weigh(value, 0, &mut left)?;
    Ok(TEXT_BYTES_MAX - left)
}

fn weigh(value: &Value, depth: usize, left: &mut usize) -> Result<(), Error> {
    if depth > DEPTH_MAX {
        return Err(wrong("a value nests too deeply"));
    }
    let own = value.as_str().map_or(0, str::len) + if depth == 0 { 0 } else { WEIGHT_OF_PART };
    *left = left.checked_sub(own).ok_or_else(|| wrong("a value becomes too large"))?;
    match value.kind() {
        ValueKind::Seq | ValueKind::Iterable => {
            value.try_iter()?.try_for_each(|part| weigh(&part, depth + 1, left))
        }
        ValueKind::Map => value.try_iter()?.try_for_each(|key| {
            weigh(&key, depth + 1, left)?;
            weigh(&value.get_item(&key)?, depth + 1, left)
        }),
        _ => Ok(()),
    }
}

/// A number, in one of the two forms that Python has.
#[derive(Clone, Copy, Debug)]
pub(super) enum PythonNumber {
    Whole(i128),
    Real(f64),
}

pub(super) fn wrong(problem: impl Into<String>) -> Error {
    Error::new(ErrorKind::InvalidOperation, problem.into())
}

pub(super) fn missing() -> Error {
    Error::new(ErrorKind::UndefinedError, "the value that it asks for does not exist")
}

impl PythonNumber {
    /// Returns the number with which Python calculates for a number or a boolean; `None` for any
    /// other value.
    pub(super) fn of(value: &Value) -> Option<PythonNumber> {
        match value.kind() {
            ValueKind::Bool => Some(PythonNumber::Whole(i128::from(value.is_true()))),
            ValueKind::Number if value.is_integer() => {
                Some(i128::try_from(value.clone()).map_or_else(
                    |_| PythonNumber::Real(f64::try_from(value.clone()).unwrap_or(f64::NAN)),
                    PythonNumber::Whole,
                ))
            }
            ValueKind::Number => Some(PythonNumber::Real(f64::try_from(value.clone()).ok()?)),
            _ => None,
        }
    }

    #[allow(clippy::cast_precision_loss, reason = "as Python does it")]
    pub(super) fn real(self) -> f64 {
        match self {
            PythonNumber::Whole(whole) => whole as f64,
            PythonNumber::Real(real) => real,
        }
    }

    fn value(self) -> Value {
        match self {
            // The value is not an i128 if possible, because minijinja prints and compares small
            // numbers best.
            PythonNumber::Whole(whole) => {
                i64::try_from(whole).map_or(Value::from(whole), Value::from)
            }
            PythonNumber::Real(real) => Value::from(real),
        }
    }
}

/// An arithmetic operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum ArithmeticOperator {
    Add,
    Subtract,
    Multiply,
    Divide,
    DivideWhole,
    Remainder,
    Power,
}

/// Applies an arithmetic operator. Returns an error if the values do not support it.
pub(super) fn calculated(
    operator: ArithmeticOperator,
    one: &Value,
    other: &Value,
) -> Result<Value, Error> {
    if one.is_undefined() || other.is_undefined() {
        return Err(missing());
    }
    if let (Some(one), Some(other)) = (PythonNumber::of(one), PythonNumber::of(other)) {
        return of_numbers(operator, one, other).map(PythonNumber::value);
    }
    let unsupported =
        || wrong(format!("`{}` and `{}` cannot be calculated with", one.kind(), other.kind()));
    match operator {
        ArithmeticOperator::Add => match (one.as_str(), other.as_str()) {
            (Some(one), Some(other)) => joined(&[one, other]).map(Value::from),
            _ if one.kind() == ValueKind::Seq && other.kind() == ValueKind::Seq => {
                Ok(one.try_iter()?.chain(other.try_iter()?).collect::<Value>())
            }
            _ => Err(unsupported()),
        },
        ArithmeticOperator::Multiply => {
            let (text, count) = match (one.as_str(), other.as_str()) {
                (Some(text), None) => (text, PythonNumber::of(other)),
                (None, Some(text)) => (text, PythonNumber::of(one)),
                _ => return Err(unsupported()),
            };
            let Some(PythonNumber::Whole(count)) = count else { return Err(unsupported()) };
            let count = usize::try_from(count.max(0)).unwrap_or(usize::MAX);
            if text.len().saturating_mul(count) > TEXT_BYTES_MAX {
                return Err(wrong("the text becomes too long"));
            }
            Ok(Value::from(text.repeat(count)))
        }
        _ => Err(unsupported()),
    }
}

pub(super) fn joined(texts: &[&str]) -> Result<String, Error> {
    let bytes: usize = texts.iter().map(|text| text.len()).sum();
    if bytes > TEXT_BYTES_MAX {
        return Err(wrong("the text becomes too long"));
    }
    Ok(texts.concat())
}

fn of_numbers(
    operator: ArithmeticOperator,
    one: PythonNumber,
    other: PythonNumber,
) -> Result<PythonNumber, Error> {
    use PythonNumber::{Real, Whole};
    let is_division = matches!(
        operator,
        ArithmeticOperator::Divide
            | ArithmeticOperator::DivideWhole
            | ArithmeticOperator::Remainder
    );
    if is_division && other.real() == 0.0 {
        return Err(wrong("division by zero"));
    }
    let too_large = || wrong("the number becomes too large");
    if let (Whole(one), Whole(other)) = (one, other) {
        let whole = match operator {
            ArithmeticOperator::Add => one.checked_add(other),
            ArithmeticOperator::Subtract => one.checked_sub(other),
            ArithmeticOperator::Multiply => one.checked_mul(other),
            // Python rounds down instead of towards zero.
            ArithmeticOperator::DivideWhole => one
                .checked_div_euclid(other)
                .map(|quotient| quotient - i128::from(other < 0 && one.rem_euclid(other) != 0)),
            ArithmeticOperator::Remainder => one.checked_rem(other).map(|rest| {
                if rest != 0 && (rest < 0) != (other < 0) { rest + other } else { rest }
            }),
            ArithmeticOperator::Power if other >= 0 => {
                u32::try_from(other).ok().and_then(|exponent| one.checked_pow(exponent))
            }
            ArithmeticOperator::Divide | ArithmeticOperator::Power => {
                return of_reals(operator, Whole(one).real(), Whole(other).real());
            }
        };
        return whole.map(Whole).ok_or_else(too_large);
    }
    of_reals(operator, one.real(), other.real()).map(|number| Real(number.real()))
}

fn of_reals(operator: ArithmeticOperator, one: f64, other: f64) -> Result<PythonNumber, Error> {
    let real = match operator {
        ArithmeticOperator::Add => one + other,
        ArithmeticOperator::Subtract => one - other,
        ArithmeticOperator::Multiply => one * other,
        ArithmeticOperator::Divide => one / other,
        ArithmeticOperator::DivideWhole => (one / other).floor(),
        ArithmeticOperator::Remainder => {
            let rest = one % other;
            if rest != 0.0 && (rest < 0.0) != (other < 0.0) { rest + other } else { rest }
        }
        ArithmeticOperator::Power if one < 0.0 && other.fract() != 0.0 => {
            return Err(wrong("a power of a negative number that is not real"));
        }
        ArithmeticOperator::Power => one.powf(other),
    };
    Ok(PythonNumber::Real(real))
}

/// Whether two values are equal according to Python's rules. Undefined equals only undefined, and
/// `None` equals only `None`.
pub(super) fn is_equal(one: &Value, other: &Value) -> bool {
    if one.is_undefined() || other.is_undefined() {
        return one.is_undefined() && other.is_undefined();
    }
    if one.is_none() || other.is_none() {
        return one.is_none() && other.is_none();
    }
    match (PythonNumber::of(one), PythonNumber::of(other)) {
        (Some(PythonNumber::Whole(one)), Some(PythonNumber::Whole(other))) => one == other,
        #[allow(clippy::float_cmp, reason = "as Python does it")]
        (Some(one), Some(other)) => one.real() == other.real(),
        (None, None) => one == other,
        _ => false,
    }
}

/// Compares two values according to Python's rules. Returns `None` if they have no order, as with
/// NaN.
///
/// # Errors
///
/// Returns an error if only one value is a number, if the types cannot be compared, or if one value
/// is undefined.
pub(super) fn compared(one: &Value, other: &Value) -> Result<Option<Ordering>, Error> {
    if one.is_undefined() || other.is_undefined() {
        return Err(missing());
    }
    match (PythonNumber::of(one), PythonNumber::of(other)) {
        (Some(PythonNumber::Whole(one)), Some(PythonNumber::Whole(other))) => {
            Ok(Some(one.cmp(&other)))
        }
        (Some(one), Some(other)) => Ok(one.real().partial_cmp(&other.real())),
        _ => match (one.as_str(), other.as_str()) {
            (Some(one), Some(other)) => Ok(Some(one.cmp(other))),
            _ if one.kind() == ValueKind::Seq && other.kind() == ValueKind::Seq => {
                Ok(one.partial_cmp(other))
            }
            _ => Err(wrong(format!("`{}` and `{}` cannot be compared", one.kind(), other.kind()))),
        },
    }
}
