//! The bounds of numbers and names in a layout.

/// The lowest and the highest temperature, in °C: absolute zero, and the heat of a furnace.
pub(crate) const CELSIUS_MIN: f64 = -273.15;
pub(crate) const CELSIUS_MAX: f64 = 1_000.0;
/// The longest connection, in meters: a tunnel of a kilometer still counts as part of a building.
pub(crate) const METERS_MAX: f64 = 1_000.0;
/// The lowest and the highest speed, in meters per second: a crawl, and a train. The bounds give every trip
/// a finite duration that can be added to others.
pub(crate) const SPEED_MIN: f64 = 0.001;
pub(crate) const SPEED_MAX: f64 = 100.0;
/// Length of the longest name, in bytes: a refusal that lists a hundred such names fits into one line on
/// the socket.
pub(crate) const NAME_MAX: usize = 64;
