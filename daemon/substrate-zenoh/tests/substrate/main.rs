//! The Zenoh substrate as a daemon sees it, over real sessions on this machine.
//!
//! No test sleeps: each waits for the messages it expects, until a deadline that only a failure reaches.
//! Ports are chosen by the kernel.

mod asking;
mod daemon;
mod messages;
mod opening;
mod presence;
mod relinking;
mod secured;
mod strangers;
