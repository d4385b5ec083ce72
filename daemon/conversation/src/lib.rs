//! The interaction protocols (the paper, “Flow of Control”) as state machines without I/O.
//!
//! - [`Exchange`] follows one initiator and one participant through one protocol.
//! - [`PROTOCOLS`] is every turn there is: to add a performative to a protocol, add a line.
//! - [`Transcript`] follows all exchanges that a listener hears; conformance tests and
//!   `althing watch` use it.
//!
//! What a message means is decided by the agent that processes it; here is only what may follow.

mod exchange;
mod seen;
mod transcript;
mod turn;

pub use exchange::{Exchange, Phase, Role, Violation};
pub use seen::Seen;
pub use transcript::{TRANSCRIPT_EXCHANGES_MAX, Transcript};
pub use turn::{PROTOCOLS, Turn};
