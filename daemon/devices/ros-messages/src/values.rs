//! Conversion of numbers to JSON values and back, for encoding, decoding and default values.

use serde_json::{Number, Value};

use crate::structure::PrimitiveType;

/// Returns the value of a float: a number, or one of the strings `"nan"`, `"inf"` and `"-inf"`.
pub(crate) fn float_value(float: f64) -> Value {
    match Number::from_f64(float) {
        Some(number) => Value::Number(number),
        None if float.is_nan() => Value::from("nan"),
        None if float > 0.0 => Value::from("inf"),
        None => Value::from("-inf"),
    }
}

/// Returns the value of a whole number; `None` if it has more than 64 bits.
pub(crate) fn whole_value(whole: i128) -> Option<Value> {
    let signed = i64::try_from(whole).map(Value::from);
    signed.or_else(|_| u64::try_from(whole).map(Value::from)).ok()
}

/// Returns the float that a JSON value stands for; `None` if it stands for none.
fn float_of(value: &Value) -> Option<f64> {
    match value {
        Value::Number(number) => number.as_f64(),
        Value::String(text) => match text.as_str() {
            "nan" => Some(f64::NAN),
            "inf" => Some(f64::INFINITY),
            "-inf" => Some(f64::NEG_INFINITY),
            _ => None,
        },
        _ => None,
    }
}

/// Returns the whole number that a JSON value stands for; `None` if it stands for none.
fn whole_of(value: &Value) -> Option<i128> {
    value.as_i64().map(i128::from).or_else(|| value.as_u64().map(i128::from))
}

/// Returns the little-endian bytes of a value, in the first [`PrimitiveType::size`] bytes of the
/// array; `None` if the type does not have the value.
pub(crate) fn little_endian(primitive: PrimitiveType, value: &Value) -> Option<[u8; 8]> {
    let bits = match primitive {
        PrimitiveType::Bool => u64::from(value.as_bool()?),
        PrimitiveType::Float64 => float_of(value)?.to_bits(),
        PrimitiveType::Float32 => {
            let float = float_of(value)?;
            let narrow = float as f32;
            if float.is_finite() && !narrow.is_finite() {
                return None;
            }
            u64::from(narrow.to_bits())
        }
        _ => {
            let (least, greatest) = primitive.whole_range()?;
            let whole = whole_of(value).filter(|whole| (least..=greatest).contains(whole))?;
            // The low bits of two's complement are those of every smaller type.
            whole as u64
        }
    };
    Some(bits.to_le_bytes())
}

/// Returns the value that `bits` stand for in the type; `None` if the type has no such value.
pub(crate) fn from_bits(primitive: PrimitiveType, bits: u64) -> Option<Value> {
    Some(match primitive {
        PrimitiveType::Bool if bits > 1 => return None,
        PrimitiveType::Bool => Value::Bool(bits == 1),
        PrimitiveType::Float32 => float_value(f64::from(f32::from_bits(bits as u32))),
        PrimitiveType::Float64 => float_value(f64::from_bits(bits)),
        PrimitiveType::Int8 => Value::from(bits as i8),
        PrimitiveType::Int16 => Value::from(bits as i16),
        PrimitiveType::Int32 => Value::from(bits as i32),
        PrimitiveType::Int64 => Value::from(bits as i64),
        PrimitiveType::Byte
        | PrimitiveType::Uint8
        | PrimitiveType::Uint16
        | PrimitiveType::Uint32
        | PrimitiveType::Uint64 => Value::from(bits),
    })
}
