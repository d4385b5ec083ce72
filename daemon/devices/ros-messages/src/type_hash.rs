//! Type hashes: SHA-256 of the description of a type and of all types that it contains, in the
//! canonical JSON of REP-2016, “ROS 2 Interface Type Descriptions”.

use std::collections::BTreeSet;
use std::fmt::Write as _;

use ring::digest;

use crate::errors::UnknownTypeError;
use crate::interfaces::Interfaces;
use crate::structure::{
    DUMMY_FIELD, FieldArity, FieldElement, MessageField, MessageStructure, PrimitiveType,
};

/// Version of the hash, which precedes it.
const PREFIX: &str = "RIHS01_";

impl Interfaces {
    /// Returns the hash of a message, a service (`std_srvs/srv/Trigger`) or an action
    /// (`nav2_msgs/action/NavigateToPose`), for instance `RIHS01_10f3786d…`. Types of equal names
    /// and equal fields have equal hashes in all distributions of ROS; constants and default values
    /// do not count.
    ///
    /// # Errors
    ///
    /// Returns an error if the type, or a type that it contains, is not known.
    pub fn type_hash(&self, type_name: &str) -> Result<String, UnknownTypeError> {
        let mut contained = BTreeSet::new();
        let mut queue = vec![type_name];
        while let Some(name) = queue.pop() {
            let references = self.structure(name)?.references();
            queue.extend(references.map(|(_, name)| name).filter(|name| contained.insert(*name)));
        }
        let mut json = format!(
            "{{\"type_description\": {}, \"referenced_type_descriptions\": [",
            description(type_name, self.structure(type_name)?)
        );
        for (index, name) in contained.into_iter().enumerate() {
            json.push_str(if index == 0 { "" } else { ", " });
            json.push_str(&description(name, self.structure(name)?));
        }
        json.push_str("]}");
        let hash = digest::digest(&digest::SHA256, json.as_bytes());
        Ok(hash.as_ref().iter().fold(PREFIX.to_owned(), |mut text, byte| {
            let _ = write!(text, "{byte:02x}");
            text
        }))
    }
}

/// Returns the description of one structure. Names consist of ASCII letters, digits, underscores
/// and slashes, so they need no escapes.
fn description(name: &str, structure: &MessageStructure) -> String {
    let dummy = MessageField::added(
        DUMMY_FIELD,
        FieldElement::Primitive(PrimitiveType::Uint8),
        FieldArity::One,
    );
    let fields = if structure.fields.is_empty() { &vec![dummy] } else { &structure.fields };
    let fields: Vec<_> = fields.iter().map(field_description).collect();
    format!("{{\"type_name\": \"{name}\", \"fields\": [{}]}}", fields.join(", "))
}

fn field_description(field: &MessageField) -> String {
    let (element_id, string_capacity, nested) = match &field.element {
        FieldElement::Nested(name) => (1, 0, name.as_str()),
        FieldElement::Primitive(primitive) => (primitive_id(*primitive), 0, ""),
        FieldElement::String(None) => (17, 0, ""),
        FieldElement::WideString(None) => (18, 0, ""),
        FieldElement::String(Some(bound)) => (21, *bound, ""),
        FieldElement::WideString(Some(bound)) => (22, *bound, ""),
    };
    let (arity_id, capacity) = match field.arity {
        FieldArity::One => (0, 0),
        FieldArity::Array(size) => (48, size),
        FieldArity::BoundedSequence(bound) => (96, bound),
        FieldArity::Sequence => (144, 0),
    };
    format!(
        "{{\"name\": \"{}\", \"type\": {{\"type_id\": {}, \"capacity\": {capacity}, \
         \"string_capacity\": {string_capacity}, \"nested_type_name\": \"{nested}\"}}}}",
        field.name,
        element_id + arity_id,
    )
}

/// Returns the number of a type in `type_description_interfaces/msg/FieldType`.
fn primitive_id(primitive: PrimitiveType) -> u32 {
    match primitive {
        PrimitiveType::Int8 => 2,
        PrimitiveType::Uint8 => 3,
        PrimitiveType::Int16 => 4,
        PrimitiveType::Uint16 => 5,
        PrimitiveType::Int32 => 6,
        PrimitiveType::Uint32 => 7,
        PrimitiveType::Int64 => 8,
        PrimitiveType::Uint64 => 9,
        PrimitiveType::Float32 => 10,
        PrimitiveType::Float64 => 11,
        PrimitiveType::Bool => 15,
        PrimitiveType::Byte => 16,
    }
}
