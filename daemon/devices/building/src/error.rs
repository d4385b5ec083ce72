//! The errors of changing a layout, using a device, and serving a building.
//!
//! Messages are lower-case fragments that complete “failed to …” and name a correction. The search
//! for the most similar name, which all of these errors use, is in this file.

use std::io;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::bounds::{CELSIUS_MAX, CELSIUS_MIN, METERS_MAX, NAME_MAX, SPEED_MAX, SPEED_MIN};
use crate::quantity::Quantity;

/// Reason why a layout or a building cannot be made or changed as requested.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum LayoutError {
    /// The name is not a valid name of a PDDL object.
    #[error(
        "name something `{name}`: a name is a lower-case letter, then at most {} of `a-z 0-9 - _`",
        NAME_MAX - 1
    )]
    BadName {
        /// The invalid name, as written.
        name: String,
    },
    /// The new name is already in use. Locations and devices share one set of names, as PDDL
    /// objects do.
    #[error("name something `{name}`: a {taken_by} has that name; choose another")]
    NameTaken {
        /// The name that is already in use.
        name: String,
        /// Kind of the thing with this name, in words.
        taken_by: String,
    },
    /// A door or device names a location that is not in the layout.
    #[error("find the location `{name}`{}", hint(.nearest))]
    UnknownLocation {
        /// Name of the location that was not found, as written.
        name: String,
        /// Name of the most similar location; `None` if no location is similar.
        nearest: Option<String>,
    },
    /// A sensor is to be mounted on a robot that is not in the building.
    #[error("find the robot `{name}`{}", hint(.nearest))]
    UnknownRobot {
        /// Name of the robot that was not found, as written.
        name: String,
        /// Name of the most similar robot; `None` if no robot is similar.
        nearest: Option<String>,
    },
    /// The named device is not in the building.
    #[error("find the device `{name}`{}", hint(.nearest))]
    UnknownDevice {
        /// Name of the device that was not found, as written.
        name: String,
        /// Name of the most similar device; `None` if no device is similar.
        nearest: Option<String>,
    },
    /// The intended carrier is not a robot; only robots carry devices.
    #[error("mount a sensor on `{name}`: it is a {is}, and only a robot carries sensors")]
    NotARobot {
        /// Name of the intended carrier.
        name: String,
        /// The kind of the intended carrier, in words.
        is: String,
    },
    /// The temperature is out of range.
    #[error(
        "set {celsius} °C in `{location}`: between {CELSIUS_MIN} and {CELSIUS_MAX} is possible"
    )]
    BadTemperature {
        /// Name of the location with the impossible temperature.
        location: String,
        /// The impossible temperature as written, in °C.
        celsius: f64,
    },
    /// The value is out of the range of its quantity.
    #[error(
        "set the {} of `{location}` to {value}: between {} and {} is possible",
        quantity.name(), quantity.bounds().0, quantity.bounds().1
    )]
    BadValue {
        /// Name of the location with the impossible value.
        location: String,
        /// The quantity that was to be set.
        quantity: Quantity,
        /// The impossible value as written, in the quantity's unit.
        value: f64,
    },
    /// The length of a connection is out of range.
    #[error(
        "connect `{from}` and `{to}` by {meters} m: more than 0 and at most {METERS_MAX} m is possible"
    )]
    BadDistance {
        /// Name of the location at one end of the connection.
        from: String,
        /// Name of the location at the other end of the connection.
        to: String,
        /// The impossible length as written, in meters.
        meters: f64,
    },
    /// A connection has the same location at both ends.
    #[error("connect `{location}` with itself: name two different locations")]
    ConnectedToItself {
        /// Name of the location at both ends.
        location: String,
    },
    /// The two locations are already connected.
    #[error("connect `{from}` and `{to}` again: they are connected by {meters} m already")]
    ConnectedTwice {
        /// Name of the location at one end of the connection.
        from: String,
        /// Name of the location at the other end of the connection.
        to: String,
        /// Length of the existing connection, in meters.
        meters: f64,
    },
    /// There is no door between the two locations.
    #[error("find a door between `{a}` and `{b}`: name two locations that are connected")]
    NoDoor {
        /// Name of the location on one side of the missing door.
        a: String,
        /// Name of the location on the other side of the missing door.
        b: String,
    },
    /// A lift has fewer than two landings.
    #[error("give the lift `{lift}` a way: name at least two landings")]
    FewLandings {
        /// Name of the lift.
        lift: String,
    },
    /// An arm has no shelf.
    #[error("give the arm `{arm}` something to reach: name at least one shelf")]
    NoShelves {
        /// Name of the arm.
        arm: String,
    },
    /// A parcel lies on a shelf that its arm does not have.
    #[error("find the shelf `{shelf}` of the arm `{arm}`")]
    UnknownShelf {
        /// Name of the arm.
        arm: String,
        /// The name that is no shelf.
        shelf: String,
    },
    /// The speed is out of range.
    #[error(
        "let `{robot}` drive at {meters_per_second} m/s: between {SPEED_MIN} and {SPEED_MAX} m/s is possible"
    )]
    BadSpeed {
        /// Name of the robot.
        robot: String,
        /// The impossible speed as written, in meters per second.
        meters_per_second: f64,
    },
    /// Range, charge or recharge time of the battery is out of range.
    #[error(
        "give `{robot}` such a battery: range, charge and recharge-time are not negative, and the \
         charge is at most the range"
    )]
    BadBattery {
        /// Name of the robot with the battery.
        robot: String,
    },
    /// The camera has too many views, or the direction of a view is beyond the limits of a camera.
    #[error("point `{camera}` so: at most 16 places, pan -170 to 170, tilt -90 to 90 degrees")]
    BadView {
        /// Name of the camera.
        camera: String,
    },
    /// The time scale is out of range.
    #[error(
        "scale time by {time_scale}: 1.0 is real time, 0.1 ten times faster; between 0 and 1000 is possible"
    )]
    BadTimeScale {
        /// The impossible time scale as written.
        time_scale: f64,
    },
}

/// Reason why a device did not do what its driver requested. This type is also sent over the
/// socket.
#[derive(Clone, Debug, Deserialize, Eq, Error, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DeviceError {
    /// There is no device of this name in the building (any more).
    #[error("find the device `{device}` in the building{}", hint(.nearest))]
    UnknownDevice {
        /// Name of the device, as given in the request.
        device: String,
        /// Name of the most similar device; `None` if no device is similar.
        nearest: Option<String>,
    },
    /// The device is of another kind than the operation needs.
    #[error("use `{device}` as a {wanted}: it is a {is}")]
    WrongKind {
        /// Name of the device.
        device: String,
        /// The kind of the device, in words.
        is: String,
        /// Kind that the operation needs, in words.
        wanted: String,
    },
    /// There is no such place in the building.
    #[error("find the location `{location}` in the building{}", hint(.nearest))]
    UnknownLocation {
        /// Name of the location, as given in the request.
        location: String,
        /// Name of the most similar location; `None` if no location is similar.
        nearest: Option<String>,
    },
    /// The destination is not a neighbor of the robot's location, so there is no direct way.
    #[error("go from `{from}` to `{to}`: from there a robot can go to {}", list(.ways))]
    NoWay {
        /// Name of the true location of the robot.
        from: String,
        /// Name of the destination.
        to: String,
        /// Names of the neighbors of the robot's location.
        ways: Vec<String>,
    },
    /// The door between the robot's location and the destination is locked.
    #[error("go from `{from}` to `{to}`: the door is locked")]
    Locked {
        /// Name of the true location of the robot.
        from: String,
        /// Name of the destination.
        to: String,
    },
    /// The device has failed.
    #[error("use `{device}`: it is broken")]
    Broken {
        /// Name of the failed device.
        device: String,
    },
    /// The robot is in use: another trip is under way, or the robot was moved during a sweep.
    #[error("send `{device}`: it is driving already; cancel that drive first")]
    Busy {
        /// Name of the robot.
        device: String,
    },
    /// The device cannot do this now: it carries nothing, or something else is elsewhere.
    #[error("use `{device}` for that: {reason}")]
    Impossible {
        /// Name of the device.
        device: String,
        /// Reason, in words.
        reason: String,
    },
    /// The robot has lifted a table at one end, and no other robot at the other.
    #[error("use `{device}` for that: {reason}")]
    LiftedAlone {
        /// Name of the robot.
        device: String,
        /// Reason, in words.
        reason: String,
    },
    /// The other robot has let go of a table that both carried.
    #[error("carry `{table}` on with `{device}`: the other robot has let go of it")]
    LetGo {
        /// Name of the robot.
        device: String,
        /// Name of the table.
        table: String,
    },
    /// The charge of the robot's battery is too low for the trip.
    #[error("drive `{device}` to `{to}`: its battery does not last so far")]
    EmptyBattery {
        /// Name of the robot.
        device: String,
        /// Name of the destination.
        to: String,
    },
    /// The aim is beyond the limits of the camera.
    #[error("turn `{device}` so far: pan -170 to 170, tilt -90 to 90 degrees, zoom 1 to 10")]
    OutOfReach {
        /// Name of the camera.
        device: String,
    },
    /// The screen has no channel yet. A screen shows nothing without a channel.
    #[error("show anything on `{device}`: it was given no channel yet")]
    NoChannel {
        /// Name of the screen.
        device: String,
    },
    /// The text is too long for a screen.
    #[error("show that on `{device}`: at most {bytes_max} bytes are possible")]
    TooLong {
        /// Name of the screen.
        device: String,
        /// Length of the longest possible text, in bytes.
        bytes_max: usize,
    },
    /// The robot is not at its dock, and it can recharge only there.
    #[error("recharge `{device}`: it {}", at_dock(.dock))]
    NotAtDock {
        /// Name of the robot.
        device: String,
        /// Name of the location of the robot's dock; `None` if the robot has no battery.
        dock: Option<String>,
    },
    /// The building's socket does not answer, or the connection broke.
    #[error("reach the building: {reason}")]
    Unreachable {
        /// Description of the connection's problem, in words.
        reason: String,
    },
    /// The building's server refused the request.
    #[error("get an answer of the building: {reason}")]
    Refused {
        /// Reason of the refusal, and the correction, in words.
        reason: String,
    },
}

/// Reason why a building cannot be served at a socket.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ServeError {
    /// Another server answers at this socket.
    #[error("serve the building at {}: another building is served there", .path.display())]
    InUse {
        /// Path of the socket.
        path: PathBuf,
    },
    /// The path of the socket is taken by a file that is not a socket. The file is not removed.
    #[error("serve the building at {}: a file is there that is no socket; choose another path", .path.display())]
    NotASocket {
        /// Path of the file.
        path: PathBuf,
    },
    /// The operating system returned an error.
    #[error("serve the building at {}", .path.display())]
    Io {
        /// Path of the socket.
        path: PathBuf,
        /// Error of the operating system.
        #[source]
        source: io::Error,
    },
}

/// Returns the candidate most similar to `name`; `None` if no candidate is similar enough.
pub(crate) fn nearest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    // A name counts as misspelt if at most a third of its letters is wrong.
    let slips_max = (name.chars().count() / 3).max(1);
    candidates
        .map(|candidate| (strsim::damerau_levenshtein(name, candidate), candidate))
        .filter(|(slips, _)| *slips <= slips_max)
        .min()
        .map(|(_, candidate)| candidate.to_owned())
}

fn hint(nearest: &Option<String>) -> String {
    match nearest {
        Some(name) => format!("; did you mean `{name}`?"),
        None => String::new(),
    }
}

fn at_dock(dock: &Option<String>) -> String {
    match dock {
        Some(dock) => format!("does not stand at its dock `{dock}`"),
        None => "has no battery".to_owned(),
    }
}

fn list(names: &[String]) -> String {
    match names {
        [] => "nowhere".to_owned(),
        names => names.iter().map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", "),
    }
}
