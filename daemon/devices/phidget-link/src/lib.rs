//! Phidgets: USB interface kits and sensors, read through `libphidget22` of Phidgets Inc., in
//! canonical units.
//!
//! - The library is found and loaded at run time ([`Library`]). No part of it is needed to build
//!   this crate. If the library is missing, the error explains how to install it.
//! - [`PhidgetPart`] is one entry of the table of sensors and the quantities that they measure.
//!   [`PhidgetChannel`] is an open channel to one such part. A channel stays open when its device
//!   is unplugged: the library detects the return of the device.
//! - Calls may block on USB devices and other programs. They must be made on a thread that may
//!   block, with time limits by the caller, because this crate has no async code and no clock.
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
