//! Fields of messages, and conditions on them: `result.success == true`.
//!
//! A field is written with the name of its message: `result` for the end of an action or the answer
//! of a service, `message` for a topic. Fields and values are checked by encoding a message that has
//! the value in the field.

use std::fmt;

use ros_messages::{CdrEncodeError, Interfaces};
use serde_json::{Value, json};

/// A field of a message, such as `result.pose.x`.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct NamedField {
    /// Name of the message: `result` or `message`.
    root: &'static str,
    /// Names of the fields, the outermost first; at least one.
    names: Vec<String>,
}

impl NamedField {
    /// Parses the field of a message that is called `root`.
    ///
    /// # Errors
    ///
    /// Returns what would be right, as text for a person.
    pub(crate) fn parse(text: &str, root: &'static str) -> Result<NamedField, String> {
        let is_name = |name: &str| {
            let is_plain = |letter: char| letter.is_ascii_alphanumeric() || letter == '_';
            !name.is_empty() && name.chars().all(is_plain)
        };
        let names = text.strip_prefix(root).and_then(|rest| rest.strip_prefix('.'));
        let names: Vec<_> = names.into_iter().flat_map(|rest| rest.split('.')).collect();
        if names.is_empty() || !names.iter().all(|name| is_name(name)) {
            return Err(format!("`{text}` is no field: a field is such as `{root}.success`"));
        }
        Ok(NamedField { root, names: names.into_iter().map(str::to_owned).collect() })
    }

    /// Returns the value of the field; `None` if the message has no such field.
    pub(crate) fn value<'a>(&self, message: &'a Value) -> Option<&'a Value> {
        self.names.iter().try_fold(message, |value, name| value.get(name))
    }

    /// Checks that a message of a type has the field, and that the field takes `value`.
    ///
    /// # Errors
    ///
    /// Returns the mistake as text for a person, with the fields that there are.
    pub(crate) fn check(
        &self,
        interfaces: &Interfaces,
        type_name: &str,
        value: &Value,
    ) -> Result<(), FieldMistake> {
        let within = |inner: Value, name: &String| json!({ name: inner });
        let message = self.names.iter().rev().fold(value.clone(), within);
        check_message(interfaces, type_name, &message)
    }
}

impl fmt::Display for NamedField {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.root, self.names.join("."))
    }
}

/// Reason why a message does not have its type.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum FieldMistake {
    /// The definition of a type is missing.
    UnknownType(String),
    /// The field takes other values.
    WrongValue {
        /// Path of the field.
        path: String,
        /// Description of the values that the field takes.
        expected: String,
        /// The value that was given.
        found: String,
    },
    /// The type has no such field, or the text is no condition.
    Wrong(String),
}

impl fmt::Display for FieldMistake {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            FieldMistake::UnknownType(text) | FieldMistake::Wrong(text) => f.pad(text),
            FieldMistake::WrongValue { path, expected, found } => {
                write!(f, "`{path}` takes {expected}, not {found}")
            }
        }
    }
}

/// Checks that a message has its type. Missing fields have their defaults.
///
/// # Errors
///
/// Returns the mistake as text for a person, with the fields that there are.
pub(crate) fn check_message(
    interfaces: &Interfaces,
    type_name: &str,
    message: &Value,
) -> Result<(), FieldMistake> {
    let Err(error) = interfaces.encode(type_name, message) else { return Ok(()) };
    Err(match error {
        CdrEncodeError::UnknownType(unknown) => FieldMistake::UnknownType(format!(
            "there is no definition of the type `{}`: {} (`definitions`)",
            unknown.name, unknown.advice
        )),
        CdrEncodeError::UnknownField { path, type_name, known } => FieldMistake::Wrong(format!(
            "`{path}` is no field of `{type_name}`; its fields are {known}"
        )),
        CdrEncodeError::WrongValue { path, expected, found } => {
            FieldMistake::WrongValue { path, expected, found }
        }
        other => FieldMistake::Wrong(other.to_string()),
    })
}

/// A condition on one field, such as `message.effort >= 2.5`.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct FieldCondition {
    field: NamedField,
    operator: FieldOperator,
    /// The value that the field is compared with.
    value: Value,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum FieldOperator {
    Equal,
    Unequal,
    AtLeast,
    AtMost,
}

/// The operators with their spellings.
const OPERATORS: [(&str, FieldOperator); 4] = [
    ("==", FieldOperator::Equal),
    ("!=", FieldOperator::Unequal),
    (">=", FieldOperator::AtLeast),
    ("<=", FieldOperator::AtMost),
];

impl FieldCondition {
    /// Parses a condition on a message of the type `type_name`, which is called `root`, and checks
    /// it. The value is `true`, `false`, a number, a text in quotation marks, or a constant of the
    /// type.
    ///
    /// # Errors
    ///
    /// Returns the mistake as text for a person.
    pub(crate) fn parse(
        text: &str,
        root: &'static str,
        interfaces: &Interfaces,
        type_name: &str,
    ) -> Result<FieldCondition, FieldMistake> {
        let wrong = |problem: String| FieldMistake::Wrong(format!("`{text}`: {problem}"));
        let first = |(spelling, operator): (&'static str, FieldOperator)| {
            text.find(spelling).map(|at| (at, spelling, operator))
        };
        let found = OPERATORS.into_iter().filter_map(first).min_by_key(|(at, ..)| *at);
        let (at, spelling, operator) = found.ok_or_else(|| {
            wrong(format!("a condition is such as `{root}.success == true`, with ==, !=, >= or <="))
        })?;
        let field = NamedField::parse(text[..at].trim(), root).map_err(wrong)?;
        let written = text[at + spelling.len()..].trim();
        let constant = interfaces.constants(type_name).find(|(name, _)| *name == written);
        let value = match constant {
            Some((_, value)) => value.clone(),
            None => serde_json::from_str(written).map_err(|_| {
                let names: Vec<_> = interfaces.constants(type_name).map(|(name, _)| name).collect();
                let names = if names.is_empty() {
                    String::new()
                } else {
                    format!(", or a constant: {}", names.join(", "))
                };
                wrong(format!(
                    "`{written}` is no value: write true, false, a number, a text in quotation \
                     marks{names}"
                ))
            })?,
        };
        let is_ordered = matches!(operator, FieldOperator::AtLeast | FieldOperator::AtMost);
        if is_ordered && !value.is_number() {
            return Err(wrong(format!("{spelling} compares with a number")));
        }
        field.check(interfaces, type_name, &value)?;
        Ok(FieldCondition { field, operator, value })
    }

    /// Whether the condition holds of a message; `None` if the message lacks the field, or the field
    /// has no comparable value, such as “not a number”.
    pub(crate) fn holds(&self, message: &Value) -> Option<bool> {
        let found = self.field.value(message)?;
        let (Some(found), Some(value)) = (found.as_f64(), self.value.as_f64()) else {
            let is_same_kind = matches!(
                (found, &self.value),
                (Value::Bool(_), Value::Bool(_)) | (Value::String(_), Value::String(_))
            );
            let is_equal = found == &self.value;
            return is_same_kind.then_some(is_equal == (self.operator == FieldOperator::Equal));
        };
        // Many fields are floats of 32 bits: 0.1 is to equal 0.1.
        let is_equal = found == value || found as f32 == value as f32;
        Some(match self.operator {
            FieldOperator::Equal => is_equal,
            FieldOperator::Unequal => !is_equal,
            FieldOperator::AtLeast => found >= value || is_equal,
            FieldOperator::AtMost => found <= value || is_equal,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BATTERY: &str = "sensor_msgs/msg/BatteryState";

    fn parse(text: &str, type_name: &str) -> Result<FieldCondition, String> {
        let parsed = FieldCondition::parse(text, "message", &Interfaces::standard(), type_name);
        parsed.map_err(|mistake| mistake.to_string())
    }

    #[test]
    fn a_condition_compares_one_field() {
        for (condition, type_name, message, expected) in [
            ("message.data == true", "std_msgs/msg/Bool", json!({ "data": true }), Some(true)),
            ("message.data != true", "std_msgs/msg/Bool", json!({ "data": true }), Some(false)),
            ("message.data == true", "std_msgs/msg/Bool", json!({}), None),
            (
                "message.data == \"a >= b\"",
                "std_msgs/msg/String",
                json!({ "data": "a >= b" }),
                Some(true),
            ),
            ("message.data >= 3", "std_msgs/msg/Int32", json!({ "data": 3 }), Some(true)),
            ("message.data <= 3", "std_msgs/msg/Int32", json!({ "data": 4 }), Some(false)),
            ("message.data >= 3", "std_msgs/msg/Float64", json!({ "data": "nan" }), None),
            (
                "message.percentage == 0.1",
                BATTERY,
                json!({ "percentage": f64::from(0.1_f32) }),
                Some(true),
            ),
            (
                "message.power_supply_status == POWER_SUPPLY_STATUS_FULL",
                BATTERY,
                json!({ "power_supply_status": 4 }),
                Some(true),
            ),
            (
                "message.header.frame_id != \"map\"",
                BATTERY,
                json!({ "header": { "frame_id": "odom" } }),
                Some(true),
            ),
        ] {
            let parsed = parse(condition, type_name).expect(condition);
            assert_eq!(parsed.holds(&message), expected, "{condition} of {message}");
        }
    }

    #[test]
    fn a_wrong_condition_is_refused_with_what_would_be_right() {
        for (condition, expected) in [
            (
                "message.dat == true",
                "`dat` is no field of `std_msgs/msg/Bool`; its fields are data",
            ),
            ("message.data == 3", "`data` takes true or false, not 3"),
            ("data == true", "`data` is no field: a field is such as `message.success`"),
            ("message.data = true", "a condition is such as `message.success == true`"),
            ("message.data == yes", "`yes` is no value: write true, false, a number"),
            ("message.data >= true", ">= compares with a number"),
        ] {
            let mistake = parse(condition, "std_msgs/msg/Bool").expect_err(condition);
            assert!(mistake.contains(expected), "{condition}: {mistake}");
        }
    }
}
