//! Decodes XCDR1 of either byte order as a JSON object.
//!
//! The bytes come from outside, so no length in them is trusted. A message that ends early is no
//! error; it gives the fields up to its end. A later version of ROS may append fields to a message,
//! and an earlier one lacks them.

use serde_json::{Map, Value};

use crate::errors::CdrDecodeError;
use crate::field_path::FieldPath;
use crate::interfaces::Interfaces;
use crate::structure::{FieldArity, FieldElement, MessageField, MessageStructure, PrimitiveType};
use crate::values::from_bits;
use crate::{DECODED_VALUES_MAX, NESTING_MAX};

/// Number of bytes before the fields: two for the encoding, two for options.
const HEADER_BYTES: usize = 4;

/// A decoded message.
#[derive(Clone, Debug, PartialEq)]
pub struct Decoded {
    /// The object with all complete fields, in their nesting.
    pub value: Value,
    /// Path to the first field that the bytes do not contain as a whole; all fields after it are
    /// missing, too. `None` if the message is complete.
    pub first_missing: Option<String>,
}

impl Decoded {
    /// Whether the bytes contain all fields.
    pub fn is_complete(&self) -> bool {
        self.first_missing.is_none()
    }
}

impl Interfaces {
    /// Returns the fields of a message. The object lacks each field that the bytes do not contain
    /// as a whole; it lacks an array or sequence if one of its elements is incomplete. Bytes after
    /// the last field are ignored. Text that is not UTF-8 has replacement characters.
    ///
    /// # Errors
    ///
    /// Returns an error if the type is not known, if the header is not that of XCDR1, if a field
    /// has a value that its type does not have, or if the message exceeds [`DECODED_VALUES_MAX`] or
    /// [`NESTING_MAX`].
    pub fn decode(&self, type_name: &str, bytes: &[u8]) -> Result<Decoded, CdrDecodeError> {
        let structure = self.message(type_name)?;
        let is_big_endian = match bytes {
            [0, 0, _, _, ..] => true,
            [0, 1, _, _, ..] => false,
            other => {
                let found = other.iter().take(HEADER_BYTES).copied().collect();
                return Err(CdrDecodeError::UnknownEncoding { found });
            }
        };
        let mut reader = CdrReader {
            interfaces: self,
            bytes: &bytes[HEADER_BYTES..],
            position: 0,
            is_big_endian,
            values: 0,
        };
        let (object, first_missing) = reader.structure(structure, FieldPath::MESSAGE)?;
        Ok(Decoded { value: Value::Object(object), first_missing })
    }
}

/// Reason why reading stops.
enum ReadStop {
    /// The bytes end before the end of the value at this path.
    Ended(String),
    Failed(CdrDecodeError),
}

impl From<CdrDecodeError> for ReadStop {
    fn from(error: CdrDecodeError) -> ReadStop {
        ReadStop::Failed(error)
    }
}

/// A message that is being decoded.
struct CdrReader<'a> {
    interfaces: &'a Interfaces,
    /// The bytes of the message after its header. Alignment counts from the first of them.
    bytes: &'a [u8],
    position: usize,
    is_big_endian: bool,
    /// Number of values that were read so far.
    values: usize,
}

fn wrong(path: FieldPath<'_>, problem: String) -> CdrDecodeError {
    CdrDecodeError::WrongValue { path: path.to_string(), problem }
}

impl<'a> CdrReader<'a> {
    fn remaining(&self) -> usize {
        self.bytes.len().saturating_sub(self.position)
    }

    /// Skips padding up to a multiple of `alignment`, and returns the next `length` bytes.
    fn take(
        &mut self,
        alignment: usize,
        length: usize,
        path: FieldPath<'_>,
    ) -> Result<&'a [u8], ReadStop> {
        let start = self.position.next_multiple_of(alignment);
        let taken = start.checked_add(length).and_then(|end| self.bytes.get(start..end));
        let taken = taken.ok_or_else(|| ReadStop::Ended(path.to_string()))?;
        self.position = start + length;
        Ok(taken)
    }

    /// Reads a number of `size` bytes, and returns its bits.
    fn bits(&mut self, size: usize, path: FieldPath<'_>) -> Result<u64, ReadStop> {
        let taken = self.take(size, size, path)?;
        let mut bytes = [0; 8];
        if self.is_big_endian {
            bytes[8 - size..].copy_from_slice(taken);
            return Ok(u64::from_be_bytes(bytes));
        }
        bytes[..size].copy_from_slice(taken);
        Ok(u64::from_le_bytes(bytes))
    }

    /// Reads the number of bytes, units or elements that follow. A number that does not fit into
    /// `usize` counts as an early end of the message.
    fn length(&mut self, path: FieldPath<'_>) -> Result<usize, ReadStop> {
        let length = self.bits(4, path)?;
        usize::try_from(length).map_err(|_| ReadStop::Ended(path.to_string()))
    }

    /// Reads a structure. Returns its complete fields, and the path to the first missing field;
    /// `None` if all are complete.
    fn structure(
        &mut self,
        structure: &MessageStructure,
        path: FieldPath<'_>,
    ) -> Result<(Map<String, Value>, Option<String>), CdrDecodeError> {
        if path.depth() > NESTING_MAX {
            return Err(CdrDecodeError::TooDeep { path: path.to_string() });
        }
        let mut object = Map::new();
        if structure.fields.is_empty() {
            return match self.take(1, 1, path) {
                Ok(_) => Ok((object, None)),
                Err(ReadStop::Ended(missing)) => Ok((object, Some(missing))),
                Err(ReadStop::Failed(error)) => Err(error),
            };
        }
        for field in &structure.fields {
            let path = path.field(&field.name);
            // An incomplete structure is kept; any other incomplete value is dropped.
            if let (FieldElement::Nested(name), FieldArity::One) = (&field.element, field.arity) {
                let (nested, missing) = self.structure(self.interfaces.message(name)?, path)?;
                if missing.is_none() || !nested.is_empty() {
                    self.count(path)?;
                    object.insert(field.name.clone(), Value::Object(nested));
                }
                if missing.is_some() {
                    return Ok((object, missing));
                }
                continue;
            }
            match self.field(field, path) {
                Ok(value) => object.insert(field.name.clone(), value),
                Err(ReadStop::Ended(missing)) => return Ok((object, Some(missing))),
                Err(ReadStop::Failed(error)) => return Err(error),
            };
        }
        Ok((object, None))
    }

    fn field(&mut self, field: &MessageField, path: FieldPath<'_>) -> Result<Value, ReadStop> {
        let length = match field.arity {
            FieldArity::One => return self.element(&field.element, path),
            FieldArity::Array(size) => size as usize,
            FieldArity::Sequence => self.length(path)?,
            FieldArity::BoundedSequence(bound) => {
                let length = self.length(path)?;
                check_bound(Some(bound), length, "elements", path)?;
                length
            }
        };
        // Every element has at least one byte, so a longer sequence ends early.
        if length > self.remaining() {
            return Err(ReadStop::Ended(path.to_string()));
        }
        let mut elements = Vec::with_capacity(length.min(DECODED_VALUES_MAX - self.values));
        for index in 0..length {
            elements.push(self.element(&field.element, path.index(index))?);
        }
        self.count(path)?;
        Ok(Value::Array(elements))
    }

    fn element(&mut self, element: &FieldElement, path: FieldPath<'_>) -> Result<Value, ReadStop> {
        self.count(path)?;
        match element {
            FieldElement::Primitive(primitive) => self.primitive(*primitive, path),
            FieldElement::String(bound) => self.string(*bound, path),
            FieldElement::WideString(bound) => self.wide_string(*bound, path),
            FieldElement::Nested(name) => {
                let structure = self.interfaces.message(name).map_err(CdrDecodeError::from)?;
                match self.structure(structure, path)? {
                    (object, None) => Ok(Value::Object(object)),
                    (_, Some(missing)) => Err(ReadStop::Ended(missing)),
                }
            }
        }
    }

    /// Counts one value. Returns an error if there are more than [`DECODED_VALUES_MAX`].
    fn count(&mut self, path: FieldPath<'_>) -> Result<(), CdrDecodeError> {
        if self.values >= DECODED_VALUES_MAX {
            return Err(CdrDecodeError::TooManyValues { path: path.to_string() });
        }
        self.values += 1;
        Ok(())
    }

    fn primitive(
        &mut self,
        primitive: PrimitiveType,
        path: FieldPath<'_>,
    ) -> Result<Value, ReadStop> {
        let bits = self.bits(primitive.size(), path)?;
        let problem = || format!("{bits} is not {}", primitive.expectation());
        Ok(from_bits(primitive, bits).ok_or_else(|| wrong(path, problem()))?)
    }

    /// Reads a text. Its length counts the NUL at its end. Some senders write no NUL, and do not
    /// count it.
    fn string(&mut self, bound: Option<u32>, path: FieldPath<'_>) -> Result<Value, ReadStop> {
        let length = self.length(path)?;
        let bytes = self.take(1, length, path)?;
        let bytes = bytes.strip_suffix(&[0]).unwrap_or(bytes);
        check_bound(bound, bytes.len(), "bytes", path)?;
        Ok(Value::String(String::from_utf8_lossy(bytes).into_owned()))
    }

    /// Reads a text of UTF-16, each unit in four bytes.
    fn wide_string(&mut self, bound: Option<u32>, path: FieldPath<'_>) -> Result<Value, ReadStop> {
        let length = self.length(path)?;
        if length > self.remaining() / 4 {
            return Err(ReadStop::Ended(path.to_string()));
        }
        check_bound(bound, length, "units of UTF-16", path)?;
        let mut units = Vec::with_capacity(length);
        for _ in 0..length {
            let unit = u16::try_from(self.bits(4, path)?);
            // A unit that UTF-16 does not have becomes a replacement character.
            units.push(unit.unwrap_or(0xfffd));
        }
        Ok(Value::String(String::from_utf16_lossy(&units)))
    }
}

fn check_bound(
    bound: Option<u32>,
    length: usize,
    unit: &str,
    path: FieldPath<'_>,
) -> Result<(), CdrDecodeError> {
    let Some(bound) = bound.filter(|bound| length > *bound as usize) else { return Ok(()) };
    Err(wrong(path, format!("{length} {unit} are more than the {bound} of the definition")))
}
