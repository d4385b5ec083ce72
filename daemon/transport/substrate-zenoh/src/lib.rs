//! The substrate over Zenoh: one embedded router session per daemon.
//!
//! - [`Config::open`] opens a session; the resulting [`ZenohSubstrate`] is a
//!   [`substrate::Substrate`].
//! - `key_expr` is the only module in which key expressions are built and parsed (docs/design.md,
//!   “Key expressions”).
//! - Every daemon is a *router*, because Zenoh's peers do not relay since 1.9. A process that
//!   cannot be a router (a command line, a plugin in a process of its own) opens a session as a
//!   *client*.
//! - With a [`Security`], links are TLS with certificates on both sides, and every message is
//!   signed: see `sealing`.
//!
//! This is the only crate that uses `zenoh`. It gives the same guarantees as [`substrate`] and no
//! more: a message that Zenoh has accepted may be lost. The Communication Agent adds receipts and
//! retries.
//!
//! All calls except [`Config::open`] and `close` are synchronous. Zenoh's `wait` on a declaration
//! or a publication runs to its end on the caller's thread and needs no runtime of its own, so it
//! may be called on a Tokio worker. Dropping the last handle closes the session and blocks. On
//! Tokio's current-thread scheduler Zenoh therefore panics: use the multi-thread one.

mod anti_entropy;
mod batch;
mod config;
mod declarations;
mod endpoint;
mod inbound;
mod json_merge;
mod key_expr;
mod known_sessions;
mod listen_problem;
mod membership;
mod open_error;
mod overhear;
mod oversize;
mod own_address;
mod presence;
mod publishers;
mod queries;
mod revocations;
mod scouting;
mod sealing;
mod session;
mod tap;
mod zenoh_errors;

pub use config::{
    Config, LEASE, MESSAGE_BYTES_MAX, REOPEN_DELAY, SessionMode, SettingProblem, lease,
    listen_addresses, plain_connections, problems,
};
pub use endpoint::EndpointError;
pub use open_error::OpenError;
pub use oversize::oversize_layer;
pub use own_address::self_link_filter;
pub use sealing::Security;
pub use session::ZenohSubstrate;
pub use tap::{Tap, tap};
pub use zenoh_errors::{is_error_of_zenoh, zenoh_error_layer};
