//! Phidgets: the USB interface kits and sensors that `libphidget22` of Phidgets Inc. speaks to, in
//! canonical units.
//!
//! - The library is looked for and loaded at run time ([`Library`]); nothing of it is needed to
//!   build, and where it is missing the error says how to get it.
//! - [`Part`] is the table of what can be plugged in and what it measures; [`Channel`] is one of
//!   them, opened. A channel whose device is unplugged stays open: the library finds the device again.
//! - Calls wait for USB devices and other programs. Whoever calls does so on a thread that may wait,
//!   and knows until when: there is no async here, and no clock.
//!
//! All that is `unsafe` in this crate is in `ffi`.

mod channel;
mod ffi;
mod library;
mod part;

pub use channel::{Address, Channel};
pub use ffi::CallError;
pub use library::{Library, LoadError};
pub use part::{Part, Quantity};
