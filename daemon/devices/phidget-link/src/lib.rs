//! Phidgets: USB interface kits and sensors, read through `libphidget22` of Phidgets Inc., in canonical
//! units.
//!
//! - The library is found and loaded at run time ([`Library`]). No part of it is needed to build this
//!   crate; if the library is missing, the error says how to get it.
//! - [`PhidgetPart`] is one entry of the table of sensors and the quantities that they measure.
//!   [`PhidgetChannel`] is an open channel to one such part. A channel stays open when its device is
//!   unplugged: the library finds the device again.
//! - Calls may block on USB devices and other programs. Make them on a thread that may block, within bounds
//!   of time that the caller sets: this crate has no async code and no clock.
//!
//! All `unsafe` code of this crate is in `ffi`.

mod channel;
mod ffi;
mod library;
mod part;

pub use channel::{PartAddress, PhidgetChannel};
pub use ffi::CallError;
pub use library::{Library, LibraryError};
pub use part::{PhidgetPart, PhidgetQuantity};
