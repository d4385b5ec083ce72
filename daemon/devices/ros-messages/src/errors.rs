//! Errors of this crate. The text of each completes “failed to …”, and says what would be right.

use std::fmt;

/// Number of characters of a wrong value or text that an error repeats.
const FOUND_CHARS_MAX: usize = 40;

/// Error about a definition that ROS 2 does not allow, with all its mistakes.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("read `{file}`: {}", mistakes.iter().map(ToString::to_string).collect::<Vec<_>>().join("; "))]
pub struct DefinitionError {
    /// Package and name of the file.
    pub file: String,
    /// The mistakes, in the order of the file; at least one.
    pub mistakes: Vec<DefinitionMistake>,
}

/// One mistake of a definition.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct DefinitionMistake {
    /// Line of the mistake, from 1; 0 if the name of the file is wrong.
    pub line: usize,
    /// Column of the mistake in characters, from 1; 0 if the name of the file is wrong.
    pub column: usize,
    /// Text of the mistake, shortened if it is long.
    pub found: String,
    /// Description of the mistake and its correction.
    pub problem: String,
}

impl fmt::Display for DefinitionMistake {
    fn fmt(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.line > 0 {
            write!(formatter, "line {}, column {}: ", self.line, self.column)?;
        }
        match self.found.as_str() {
            // The mistake is that something is missing.
            "" => formatter.write_str(&self.problem),
            found => write!(formatter, "`{found}`: {}", self.problem),
        }
    }
}

/// Error about a type that is not known, or that has no encoding.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("find the ROS type `{name}`: {advice}")]
pub struct UnknownTypeError {
    /// Name of the type.
    pub name: String,
    /// Advice for a correction.
    pub advice: String,
}

/// Reason why a value cannot be encoded as a message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrEncodeError {
    /// The type of the message or of one of its fields is not known.
    #[error(transparent)]
    UnknownType(#[from] UnknownTypeError),
    /// The value has a field that its type does not have.
    #[error("encode `{path}`: `{type_name}` has no such field; its fields are {known}")]
    UnknownField {
        /// Path to the field.
        path: String,
        /// Name of the type that has no such field.
        type_name: String,
        /// Fields of the type, separated by commas.
        known: String,
    },
    /// The field does not take the value.
    #[error("encode `{path}`: the field takes {expected}, not {found}")]
    WrongValue {
        /// Path to the field.
        path: String,
        /// Description of the values that the field takes.
        expected: String,
        /// Value that was given, shortened if it is long.
        found: String,
    },
    /// The message would have more than [`crate::ENCODED_BYTES_MAX`] bytes.
    #[error("encode `{path}`: the message has more than {} bytes", crate::ENCODED_BYTES_MAX)]
    TooLong {
        /// Path to the field that does not fit any more.
        path: String,
    },
    /// Messages lie within messages on more than [`crate::NESTING_MAX`] levels.
    #[error("encode `{path}`: its definitions nest on more than {} levels", crate::NESTING_MAX)]
    TooDeep {
        /// Path to the field that is too deep.
        path: String,
    },
}

/// Reason why bytes cannot be decoded as a message.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrDecodeError {
    /// The type of the message or of one of its fields is not known.
    #[error(transparent)]
    UnknownType(#[from] UnknownTypeError),
    /// The first four bytes are not those of XCDR1.
    #[error(
        "decode the message: it begins with the bytes {found:02x?}; \
         CDR begins with 00 00 or 00 01 and two more bytes"
    )]
    UnknownEncoding {
        /// At most four bytes with which the message begins.
        found: Vec<u8>,
    },
    /// The field has a value that its type does not have.
    #[error("decode `{path}`: {problem}; the definition may be that of another version")]
    WrongValue {
        /// Path to the field.
        path: String,
        /// Description of the mistake, and of a right value.
        problem: String,
    },
    /// The message has more than [`crate::DECODED_VALUES_MAX`] values.
    #[error("decode `{path}`: the message has more than {} values", crate::DECODED_VALUES_MAX)]
    TooManyValues {
        /// Path to the field with the first value too many.
        path: String,
    },
    /// Messages lie within messages on more than [`crate::NESTING_MAX`] levels.
    #[error("decode `{path}`: its definitions nest on more than {} levels", crate::NESTING_MAX)]
    TooDeep {
        /// Path to the field that is too deep.
        path: String,
    },
}

/// Returns `text`, shortened if it is long.
pub(crate) fn shortened(text: &str) -> String {
    let mut short: String = text.chars().take(FOUND_CHARS_MAX).collect();
    if short.len() < text.len() {
        short.push('…');
    }
    short
}
