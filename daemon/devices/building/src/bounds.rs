//! The bounds of numbers and names in a layout.

/// Minimum and maximum of temperatures, in °C: absolute zero, and the heat of a furnace.
pub(crate) const CELSIUS_MIN: f64 = -273.15;
pub(crate) const CELSIUS_MAX: f64 = 1_000.0;
/// Maximum length of a connection, in meters: long enough for a tunnel between two buildings.
pub(crate) const METERS_MAX: f64 = 1_000.0;
/// Minimum and maximum speed of a robot, in meters per second. With these bounds, the duration of
/// every trip is finite, and adding durations cannot overflow.
pub(crate) const SPEED_MIN: f64 = 0.001;
pub(crate) const SPEED_MAX: f64 = 100.0;
/// Maximum length of a name, in bytes; a longer name is invalid. A refusal that lists a hundred
/// names of this length still fits into one line on the socket.
pub(crate) const NAME_MAX: usize = 64;
