//! The interaction protocols (the paper, “Flow of Control”) as state machines without I/O.
//!
//! - [`Exchange`] follows one initiator and one participant through one protocol.
//! - [`PROTOCOLS`] lists every turn of every protocol: to add a performative to a protocol, add a line.
//! - [`Transcript`] follows all exchanges that a listener receives; conformance tests and
//!   `althing watch` use it.
//!
//! The meaning of a message is decided by the agent that handles it; this crate decides only which
//! message may follow which.

mod duplicate_window;
mod exchange;
mod transcript;
mod turn;

pub use duplicate_window::DuplicateWindow;
pub use exchange::{Exchange, ProtocolViolation};
pub use transcript::{TRANSCRIPT_EXCHANGES_MAX, Transcript};
pub use turn::{ExchangePhase, ExchangeRole, PROTOCOLS, ProtocolTurn};
