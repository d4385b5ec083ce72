//! ROS 2 interfaces without ROS: definitions (`.msg`, `.srv`, `.action`), the CDR encoding of
//! messages as JSON values, and type hashes.
//!
//! - [`Interfaces`] holds definitions. [`Interfaces::standard`] has those that robots need most, as
//!   of ROS 2 Jazzy; [`Interfaces::add`] reads further ones, and replaces known ones.
//! - [`Interfaces::encode`] and [`Interfaces::decode`] convert between a JSON object and XCDR1, the
//!   encoding of messages between ROS nodes. Decoding returns the complete fields of a message that
//!   ends early, so that one definition reads the messages of several distributions of ROS.
//! - [`Interfaces::type_hash`] and [`dds_name`] name a type on the wire.
//!
//! Numbers of 64 bits are exact. A float that is no JSON number is one of the strings `"nan"`,
//! `"inf"` and `"-inf"`. A `wstring` is a JSON string.
//!
//! The crate has no clock, no I/O and no connection to robots.
//!
//! ```
//! let mut interfaces = ros_messages::Interfaces::standard();
//! interfaces.add("arm_msgs", "Pick.action", "string object\n---\nbool is_held\n---\n")?;
//! let value = serde_json::json!({ "goal": { "object": "cup" } });
//! let bytes = interfaces.encode("arm_msgs/action/Pick_SendGoal_Request", &value)?;
//! let decoded = interfaces.decode("arm_msgs/action/Pick_SendGoal_Request", &bytes)?;
//! assert_eq!(decoded.value["goal"]["object"], "cup");
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod decode;
mod encode;
mod errors;
mod field_path;
mod grammar;
mod interface_file;
mod interfaces;
mod names;
#[cfg(test)]
mod properties;
mod standard;
mod structure;
mod type_hash;
mod values;

pub use decode::Decoded;
pub use errors::{
    CdrDecodeError, CdrEncodeError, DefinitionError, DefinitionMistake, UnknownTypeError,
};
pub use interfaces::Interfaces;
pub use names::dds_name;

/// Maximum number of levels of messages within messages. Definitions of ROS have fewer than ten;
/// the bound keeps a long chain of definitions from exhausting the stack.
pub const NESTING_MAX: usize = 64;

/// Maximum length of an encoded message, in bytes. Enough for an uncompressed image; the bound
/// keeps a definition of arrays of arrays from exhausting the memory.
pub const ENCODED_BYTES_MAX: usize = 64 << 20;

/// Maximum number of values in a decoded message. One value takes up to a few hundred bytes as
/// JSON, so a message takes some tens of MiB at most. The ranges of a laser scanner are a few
/// thousand values.
pub const DECODED_VALUES_MAX: usize = 100_000;
