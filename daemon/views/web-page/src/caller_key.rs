//! The key by which the requests and streams of a caller are counted.

use accounts::PersonName;

/// The part of a caller by which its requests and streams are counted.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
pub(crate) enum CallerKey {
    Session(u64),
    /// A program of a person, or a screen.
    Program(PersonName),
}
