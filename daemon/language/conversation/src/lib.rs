//! The interaction protocols (the paper, “Flow of Control”) as state machines without I/O.
//!
//! - [`Exchange`] tracks one run of a protocol between one initiator and one participant.
//! - [`PROTOCOLS`] lists every turn of every protocol. A new line adds a performative to a
//!   protocol.
//! - [`Transcript`] tracks all exchanges that a listener receives. Conformance tests and `althing
//!   watch` use it.
//!
//! This crate decides only which message may follow which. The agent that handles a message decides
//! its meaning.

mod duplicate_window;
mod exchange;
mod transcript;
mod turn;

pub use duplicate_window::DuplicateWindow;
pub use exchange::{Exchange, ProtocolViolation};
pub use transcript::{TRANSCRIPT_EXCHANGES_MAX, Transcript};
pub use turn::{ExchangePhase, ExchangeRole, PROTOCOLS, ProtocolTurn};
