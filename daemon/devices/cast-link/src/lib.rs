//! A client of Chromecasts and of what else speaks Google's Cast protocol (CASTV2): it has a medium
//! shown, and asks what is shown.
//!
//! - [`Chromecast`] is a connection to one device. It shows a medium by the “default media
//!   receiver”, an app that every device has, and which fetches the medium by itself.
//! - [`discover`] finds the devices of a network by multicast DNS.
//! - Every wait has a deadline, and every message of a device a bound. No message causes a panic.
//! - The certificate of a device names nobody and is signed by nobody that can be asked, so that it
//!   is not checked: the connection is encrypted, but a device at the same address could pretend to
//!   be the Chromecast. No secret is ever sent.
//!
//! This crate knows no agents and no goals; `plugins/devices/screen` does.

mod address;
mod channel;
mod chromecast;
mod discovery;
mod dns;
mod error;
mod medium;
mod message;
mod receiver;
mod tls;

pub use address::CastAddress;
pub use chromecast::Chromecast;
pub use discovery::{FoundCast, MULTICAST_DNS, discover};
pub use error::CastError;
pub use medium::{CastMedium, MediumState};
pub use receiver::{CastApp, ReceiverState, TelevisionState};
