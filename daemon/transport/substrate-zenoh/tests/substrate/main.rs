//! Tests of the Zenoh substrate as a daemon uses it, over real sessions on this machine.
//!
//! No test sleeps: each waits for the messages that it expects, until a deadline that is reached
//! only if the test fails. Ports are chosen by the kernel.

mod asking;
mod daemon;
mod messages;
mod opening;
mod overhearing;
mod presence;
mod relinking;
mod secured;
mod strangers;
