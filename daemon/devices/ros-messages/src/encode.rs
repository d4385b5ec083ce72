//! Encodes a JSON object as XCDR1, little-endian.

use serde_json::Value;

use crate::errors::{CdrEncodeError, shortened};
use crate::field_path::FieldPath;
use crate::interfaces::Interfaces;
use crate::structure::{FieldArity, FieldElement, MessageField, MessageStructure, PrimitiveType};
use crate::values::little_endian;
use crate::{ENCODED_BYTES_MAX, NESTING_MAX};

/// Header of a message in little-endian XCDR1: two bytes for the encoding, two for options.
/// Alignment counts from the byte after the header.
const HEADER: [u8; 4] = [0, 1, 0, 0];

impl Interfaces {
    /// Returns the bytes of a message: a header of four bytes, then XCDR1, little-endian. A field
    /// that `value` lacks has the default of its definition, or else zero.
    ///
    /// # Errors
    ///
    /// Returns an error if the type is not known, and if `value` has another field than the type or
    /// a value that does not fit; the error names the field. Strings must not contain the character
    /// NUL, at which other languages end them.
    pub fn encode(&self, type_name: &str, value: &Value) -> Result<Vec<u8>, CdrEncodeError> {
        let mut writer = CdrWriter { interfaces: self, bytes: HEADER.to_vec() };
        let structure = self.message(type_name)?;
        writer.structure(type_name, structure, Some(value), FieldPath::MESSAGE)?;
        Ok(writer.bytes)
    }
}

/// A message that is being encoded.
struct CdrWriter<'a> {
    interfaces: &'a Interfaces,
    /// The header, and the message so far.
    bytes: Vec<u8>,
}

fn wrong(path: FieldPath<'_>, expected: impl Into<String>, found: &Value) -> CdrEncodeError {
    let found = shortened(&found.to_string());
    CdrEncodeError::WrongValue { path: path.to_string(), expected: expected.into(), found }
}

impl CdrWriter<'_> {
    /// Writes zeros up to a multiple of `size`, then `bytes`.
    fn put(
        &mut self,
        size: usize,
        bytes: &[u8],
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        let aligned = (self.bytes.len() - HEADER.len()).next_multiple_of(size) + HEADER.len();
        if aligned + bytes.len() > ENCODED_BYTES_MAX {
            return Err(CdrEncodeError::TooLong { path: path.to_string() });
        }
        self.bytes.resize(aligned, 0);
        self.bytes.extend_from_slice(bytes);
        Ok(())
    }

    fn length(&mut self, length: usize, path: FieldPath<'_>) -> Result<(), CdrEncodeError> {
        let too_long = |_| CdrEncodeError::TooLong { path: path.to_string() };
        let length = u32::try_from(length).map_err(too_long)?;
        self.put(4, &length.to_le_bytes(), path)
    }

    /// Writes a structure. If there is no value, writes the defaults of its fields.
    fn structure(
        &mut self,
        type_name: &str,
        structure: &MessageStructure,
        value: Option<&Value>,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        if path.depth() > NESTING_MAX {
            return Err(CdrEncodeError::TooDeep { path: path.to_string() });
        }
        let object = match value {
            None => None,
            Some(Value::Object(object)) => Some(object),
            Some(other) => {
                return Err(wrong(path, format!("an object with fields of `{type_name}`"), other));
            }
        };
        let is_field = |name: &str| structure.fields.iter().any(|field| field.name == name);
        let unknown = object.into_iter().flatten().find(|(name, _)| !is_field(name));
        if let Some((name, _)) = unknown {
            let known: Vec<_> = structure.fields.iter().map(|field| field.name.as_str()).collect();
            let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
            let (path, type_name) = (path.field(name).to_string(), type_name.to_owned());
            return Err(CdrEncodeError::UnknownField { path, type_name, known });
        }
        if structure.fields.is_empty() {
            return self.put(1, &[0], path);
        }
        for field in &structure.fields {
            let given = object.and_then(|object| object.get(&field.name));
            self.field(field, given.or(field.default.as_ref()), path.field(&field.name))?;
        }
        Ok(())
    }

    fn field(
        &mut self,
        field: &MessageField,
        value: Option<&Value>,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        let (least, most) = match field.arity {
            FieldArity::One => return self.element(&field.element, value, path),
            FieldArity::Array(size) => (size, size),
            FieldArity::BoundedSequence(bound) => (0, bound),
            FieldArity::Sequence => (0, u32::MAX),
        };
        let Some(value) = value else { return self.default_elements(field, path) };
        let expected = || match field.arity {
            FieldArity::Array(size) => format!("an array of {size} elements"),
            FieldArity::BoundedSequence(bound) => format!("an array of at most {bound} elements"),
            _ => "an array".to_owned(),
        };
        let Value::Array(elements) = value else { return Err(wrong(path, expected(), value)) };
        if !(least as usize..=most as usize).contains(&elements.len()) {
            let found = format!("{} elements", elements.len());
            let (path, expected) = (path.to_string(), expected());
            return Err(CdrEncodeError::WrongValue { path, expected, found });
        }
        if !matches!(field.arity, FieldArity::Array(_)) {
            self.length(elements.len(), path)?;
        }
        for (index, element) in elements.iter().enumerate() {
            self.element(&field.element, Some(element), path.index(index))?;
        }
        Ok(())
    }

    /// Writes an array of zeros, or an empty sequence.
    fn default_elements(
        &mut self,
        field: &MessageField,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        let FieldArity::Array(size) = field.arity else { return self.length(0, path) };
        for index in 0..size as usize {
            self.element(&field.element, None, path.index(index))?;
        }
        Ok(())
    }

    fn element(
        &mut self,
        element: &FieldElement,
        value: Option<&Value>,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        match element {
            FieldElement::Primitive(primitive) => self.primitive(*primitive, value, path),
            FieldElement::String(bound) => self.string(*bound, value, path),
            FieldElement::WideString(bound) => self.wide_string(*bound, value, path),
            FieldElement::Nested(name) => {
                let interfaces = self.interfaces;
                self.structure(name, interfaces.message(name)?, value, path)
            }
        }
    }

    fn primitive(
        &mut self,
        primitive: PrimitiveType,
        value: Option<&Value>,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        let bytes = match value {
            None => [0; 8],
            Some(value) => little_endian(primitive, value)
                .ok_or_else(|| wrong(path, primitive.expectation(), value))?,
        };
        self.put(primitive.size(), &bytes[..primitive.size()], path)
    }

    fn string(
        &mut self,
        bound: Option<u32>,
        value: Option<&Value>,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        let text = text_of(value, path)?;
        check_bound(bound, text.len(), "bytes", path)?;
        self.length(text.len() + 1, path)?;
        self.put(1, text.as_bytes(), path)?;
        self.put(1, &[0], path)
    }

    /// Writes a text of UTF-16: the number of its units, then each unit in four bytes, without a
    /// NUL at the end. The implementations of ROS for Cyclone DDS and Fast DDS agree on this.
    fn wide_string(
        &mut self,
        bound: Option<u32>,
        value: Option<&Value>,
        path: FieldPath<'_>,
    ) -> Result<(), CdrEncodeError> {
        let units: Vec<_> = text_of(value, path)?.encode_utf16().collect();
        check_bound(bound, units.len(), "units of UTF-16", path)?;
        self.length(units.len(), path)?;
        for unit in units {
            self.put(4, &u32::from(unit).to_le_bytes(), path)?;
        }
        Ok(())
    }
}

/// Returns the text of a value; an empty text if there is no value.
fn text_of<'a>(value: Option<&'a Value>, path: FieldPath<'_>) -> Result<&'a str, CdrEncodeError> {
    match value {
        None => Ok(""),
        Some(Value::String(text)) if !text.contains('\0') => Ok(text),
        Some(text @ Value::String(_)) => Err(wrong(path, "a text without the character NUL", text)),
        Some(other) => Err(wrong(path, "a text", other)),
    }
}

fn check_bound(
    bound: Option<u32>,
    length: usize,
    unit: &str,
    path: FieldPath<'_>,
) -> Result<(), CdrEncodeError> {
    let Some(bound) = bound.filter(|bound| length > *bound as usize) else { return Ok(()) };
    let (path, found) = (path.to_string(), format!("{length} {unit}"));
    Err(CdrEncodeError::WrongValue { path, expected: format!("at most {bound} {unit}"), found })
}
