//! The parsed form of a definition: named structures of fields.

use std::collections::BTreeMap;

use serde_json::Value;

/// Name of the field of a structure that has no fields. ROS gives such a structure one byte, which
/// neither a definition nor a value mentions.
pub(crate) const DUMMY_FIELD: &str = "structure_needs_at_least_one_member";

/// A message, or the type of a service or an action, which has a hash but no encoding.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MessageStructure {
    pub(crate) role: StructureRole,
    pub(crate) fields: Vec<MessageField>,
    pub(crate) constants: BTreeMap<String, Value>,
}

/// Kind of definition that a structure stands for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum StructureRole {
    Message,
    Service,
    Action,
}

/// A field of a structure.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct MessageField {
    pub(crate) name: String,
    pub(crate) element: FieldElement,
    pub(crate) arity: FieldArity,
    /// Value of the field if a message does not give one; `None` stands for zero.
    pub(crate) default: Option<Value>,
    /// Line and column of the type in the definition, from 1; zeros for a field that ROS adds.
    pub(crate) place: (usize, usize),
}

/// Type of a field, without its arity.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum FieldElement {
    Primitive(PrimitiveType),
    /// Text in UTF-8, with the maximum number of bytes; `None` for no maximum.
    String(Option<u32>),
    /// Text in UTF-16, with the maximum number of units of 16 bits; `None` for no maximum.
    WideString(Option<u32>),
    /// The full name of another structure, such as `geometry_msgs/msg/Pose`.
    Nested(String),
}

/// How many elements a field has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FieldArity {
    One,
    Array(u32),
    BoundedSequence(u32),
    Sequence,
}

/// Types of fixed size. `char` is [`PrimitiveType::Uint8`], as ROS defines it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum PrimitiveType {
    Bool,
    Byte,
    Int8,
    Uint8,
    Int16,
    Uint16,
    Int32,
    Uint32,
    Int64,
    Uint64,
    Float32,
    Float64,
}

impl MessageStructure {
    pub(crate) fn new(role: StructureRole, fields: Vec<MessageField>) -> MessageStructure {
        MessageStructure { role, fields, constants: BTreeMap::new() }
    }

    /// Returns the fields that contain a structure, each with the name of that structure.
    pub(crate) fn references(&self) -> impl Iterator<Item = (&MessageField, &str)> {
        self.fields.iter().filter_map(|field| match &field.element {
            FieldElement::Nested(name) => Some((field, name.as_str())),
            _ => None,
        })
    }
}

impl MessageField {
    /// Returns a field that ROS adds to those of a definition.
    pub(crate) fn added(name: &str, element: FieldElement, arity: FieldArity) -> MessageField {
        MessageField { name: name.to_owned(), element, arity, default: None, place: (0, 0) }
    }

    /// Returns an added field with the structure `nested` in it.
    pub(crate) fn nested(name: &str, nested: &str) -> MessageField {
        MessageField::added(name, FieldElement::Nested(nested.to_owned()), FieldArity::One)
    }
}

impl PrimitiveType {
    /// Returns the type that the definition language calls `name`; `None` if there is none.
    pub(crate) fn named(name: &str) -> Option<PrimitiveType> {
        Some(match name {
            "bool" => PrimitiveType::Bool,
            "byte" => PrimitiveType::Byte,
            "int8" => PrimitiveType::Int8,
            "uint8" | "char" => PrimitiveType::Uint8,
            "int16" => PrimitiveType::Int16,
            "uint16" => PrimitiveType::Uint16,
            "int32" => PrimitiveType::Int32,
            "uint32" => PrimitiveType::Uint32,
            "int64" => PrimitiveType::Int64,
            "uint64" => PrimitiveType::Uint64,
            "float32" => PrimitiveType::Float32,
            "float64" => PrimitiveType::Float64,
            _ => return None,
        })
    }

    /// Returns the size in bytes, which is also the alignment.
    pub(crate) fn size(self) -> usize {
        match self {
            PrimitiveType::Bool
            | PrimitiveType::Byte
            | PrimitiveType::Int8
            | PrimitiveType::Uint8 => 1,
            PrimitiveType::Int16 | PrimitiveType::Uint16 => 2,
            PrimitiveType::Int32 | PrimitiveType::Uint32 | PrimitiveType::Float32 => 4,
            PrimitiveType::Int64 | PrimitiveType::Uint64 | PrimitiveType::Float64 => 8,
        }
    }

    /// Returns the least and the greatest value of a type of whole numbers; `None` for other types.
    pub(crate) fn whole_range(self) -> Option<(i128, i128)> {
        let is_signed = match self {
            PrimitiveType::Bool | PrimitiveType::Float32 | PrimitiveType::Float64 => return None,
            PrimitiveType::Int8
            | PrimitiveType::Int16
            | PrimitiveType::Int32
            | PrimitiveType::Int64 => true,
            _ => false,
        };
        let values = 1_i128 << (8 * self.size());
        Some(if is_signed { (-values / 2, values / 2 - 1) } else { (0, values - 1) })
    }

    /// Returns a description of the type's values, for errors.
    pub(crate) fn expectation(self) -> String {
        match (self, self.whole_range()) {
            (_, Some((least, greatest))) => format!("a whole number from {least} to {greatest}"),
            (PrimitiveType::Bool, _) => "true or false".to_owned(),
            (PrimitiveType::Float32, _) => {
                "a number of at most 3.4e38, \"nan\", \"inf\" or \"-inf\"".to_owned()
            }
            _ => "a number, \"nan\", \"inf\" or \"-inf\"".to_owned(),
        }
    }
}
