//! The errors of laying out a building, using a device, and serving a building.
//!
//! Messages are lower-case fragments that complete "failed to …" and say what would be right. The search
//! for the most similar name is here for all of them.

use std::io;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use thiserror::Error;

use crate::layout::{CELSIUS_MAX, CELSIUS_MIN, METERS_MAX, NAME_MAX, SPEED_MAX, SPEED_MIN};
use crate::quantity::Quantity;

/// Why a building cannot be laid out as asked.
#[derive(Clone, Debug, Error, PartialEq)]
#[non_exhaustive]
pub enum LayoutError {
    /// The name is not a valid name of a PDDL object.
    #[error(
        "name something `{name}`: a name is a lower-case letter, then at most {} of `a-z 0-9 - _`",
        NAME_MAX - 1
    )]
    BadName {
        /// The name as written.
        name: String,
    },
    /// The name is used already. Locations and devices share one set of names, as PDDL objects do.
    #[error("name something `{name}`: a {taken_by} has that name; choose another")]
    NameTaken {
        /// The name in question.
        name: String,
        /// The kind of thing that has the name already, in words.
        taken_by: String,
    },
    /// A door or device names a location that is not in the layout.
    #[error("find the location `{name}`{}", hint(.nearest))]
    UnknownLocation {
        /// The name as written.
        name: String,
        /// The most similar location, if one is similar.
        nearest: Option<String>,
    },
    /// A sensor is mounted on something that is not in the building.
    #[error("find the robot `{name}`{}", hint(.nearest))]
    UnknownRobot {
        /// The name as written.
        name: String,
        /// The most similar robot, if one is similar.
        nearest: Option<String>,
    },
    /// The named device is not in the building.
    #[error("find the device `{name}`{}", hint(.nearest))]
    UnknownDevice {
        /// The name as written.
        name: String,
        /// The most similar device, if one is similar.
        nearest: Option<String>,
    },
    /// The carrier is not a robot; only robots carry devices.
    #[error("mount a sensor on `{name}`: it is a {is}, and only a robot carries sensors")]
    NotARobot {
        /// The intended carrier.
        name: String,
        /// The kind of the carrier, in words.
        is: String,
    },
    /// The temperature is out of range.
    #[error(
        "set {celsius} °C in `{location}`: between {CELSIUS_MIN} and {CELSIUS_MAX} is possible"
    )]
    BadTemperature {
        /// The location.
        location: String,
        /// The value as written, in °C.
        celsius: f64,
    },
    /// The value is out of the quantity's range.
    #[error(
        "set the {} of `{location}` to {value}: between {} and {} is possible",
        quantity.name(), quantity.bounds().0, quantity.bounds().1
    )]
    BadValue {
        /// The location.
        location: String,
        /// The quantity.
        quantity: Quantity,
        /// The value as written.
        value: f64,
    },
    /// The distance is out of range.
    #[error(
        "connect `{from}` and `{to}` by {meters} m: more than 0 and at most {METERS_MAX} m is possible"
    )]
    BadDistance {
        /// One end.
        from: String,
        /// The other end.
        to: String,
        /// The distance as written.
        meters: f64,
    },
    /// A location cannot be connected with itself.
    #[error("connect `{location}` with itself: name two different locations")]
    ConnectedToItself {
        /// The location named twice.
        location: String,
    },
    /// The two locations are connected already.
    #[error("connect `{from}` and `{to}` again: they are connected by {meters} m already")]
    ConnectedTwice {
        /// One end.
        from: String,
        /// The other end.
        to: String,
        /// The distance of the existing connection.
        meters: f64,
    },
    /// There is no door between the two locations.
    #[error("find a door between `{a}` and `{b}`: name two locations that are connected")]
    NoDoor {
        /// One side.
        a: String,
        /// The other side.
        b: String,
    },
    /// The speed is out of range: the robot would never arrive, or at once.
    #[error(
        "let `{robot}` drive at {meters_per_second} m/s: between {SPEED_MIN} and {SPEED_MAX} m/s is possible"
    )]
    BadSpeed {
        /// The robot.
        robot: String,
        /// The speed as written.
        meters_per_second: f64,
    },
    /// The values of the battery are out of range.
    #[error(
        "give `{robot}` such a battery: range, charge and recharge-time are not negative, and the \
         charge is at most the range"
    )]
    BadBattery {
        /// The robot.
        robot: String,
    },
    /// The camera has too many views, or a view lies in a direction that no camera can take.
    #[error("point `{camera}` so: at most 16 places, pan -170 to 170, tilt -90 to 90 degrees")]
    BadView {
        /// The camera.
        camera: String,
    },
    /// The time scale is out of range.
    #[error(
        "scale time by {time_scale}: 1.0 is real time, 0.1 ten times faster; between 0 and 1000 is possible"
    )]
    BadTimeScale {
        /// The factor as written.
        time_scale: f64,
    },
}

/// Why a device did not do what its driver asked. This type is also sent over the socket.
#[derive(Clone, Debug, Deserialize, Eq, Error, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DeviceError {
    /// There is no such device in the building (any more).
    #[error("find the device `{device}` in the building{}", hint(.nearest))]
    UnknownDevice {
        /// The name as given in the request.
        device: String,
        /// The most similar device, if one is similar.
        nearest: Option<String>,
    },
    /// The device exists but is of another kind than the operation needs.
    #[error("use `{device}` as a {wanted}: it is a {is}")]
    WrongKind {
        /// The device.
        device: String,
        /// The kind of the device, in words.
        is: String,
        /// The kind that the operation needs, in words.
        wanted: String,
    },
    /// There is no such place in the building.
    #[error("find the location `{location}` in the building{}", hint(.nearest))]
    UnknownLocation {
        /// The name as given in the request.
        location: String,
        /// The most similar location, if one is similar.
        nearest: Option<String>,
    },
    /// The destination is not a neighbor of the robot's location.
    #[error("go from `{from}` to `{to}`: from there a robot can go to {}", list(.ways))]
    NoWay {
        /// The true location of the robot.
        from: String,
        /// The destination.
        to: String,
        /// The neighbors of the robot's location.
        ways: Vec<String>,
    },
    /// The door on the way is locked.
    #[error("go from `{from}` to `{to}`: the door is locked")]
    Locked {
        /// The true location of the robot.
        from: String,
        /// The destination.
        to: String,
    },
    /// The device has failed.
    #[error("use `{device}`: it is broken")]
    Broken {
        /// The device.
        device: String,
    },
    /// The robot is on another errand.
    #[error("send `{device}`: it is driving already; cancel that drive first")]
    Busy {
        /// The robot.
        device: String,
    },
    /// The robot's battery does not last for the way.
    #[error("drive `{device}` to `{to}`: its battery does not last so far")]
    EmptyBattery {
        /// The robot.
        device: String,
        /// The destination.
        to: String,
    },
    /// The aim is beyond the limits of the camera.
    #[error("turn `{device}` so far: pan -170 to 170, tilt -90 to 90 degrees, zoom 1 to 10")]
    OutOfReach {
        /// The camera.
        device: String,
    },
    /// The screen has no channel yet; a screen on a wall shows nothing without one.
    #[error("show anything on `{device}`: it was given no channel yet")]
    NoChannel {
        /// The screen.
        device: String,
    },
    /// The text is too long for a screen.
    #[error("show that on `{device}`: at most {bytes_max} bytes are possible")]
    TooLong {
        /// The screen.
        device: String,
        /// The longest possible text.
        bytes_max: usize,
    },
    /// The robot does not stand at its dock, where alone it can recharge.
    #[error("recharge `{device}`: it {}", at_dock(.dock))]
    NotAtDock {
        /// The robot.
        device: String,
        /// The robot's dock; `None` if the robot has no battery.
        dock: Option<String>,
    },
    /// The building's socket does not answer, or the connection broke.
    #[error("reach the building: {reason}")]
    Unreachable {
        /// The problem of the connection.
        reason: String,
    },
    /// The building's server refused the request.
    #[error("get an answer of the building: {reason}")]
    Refused {
        /// The reason, and what would have been right.
        reason: String,
    },
}

/// Why a building cannot be served at a socket.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ServeError {
    /// Another server answers at this socket.
    #[error("serve the building at {}: another building is served there", .path.display())]
    InUse {
        /// The path of the socket.
        path: PathBuf,
    },
    /// The path is taken by a file that is not a socket; it is not removed.
    #[error("serve the building at {}: a file is there that is no socket; choose another path", .path.display())]
    NotASocket {
        /// The path of the file.
        path: PathBuf,
    },
    /// The operating system refused.
    #[error("serve the building at {}", .path.display())]
    Io {
        /// The path of the socket.
        path: PathBuf,
        /// The error of the operating system.
        #[source]
        source: io::Error,
    },
}

/// Returns the candidate most similar to `name`; `None` if none is similar enough.
pub(crate) fn nearest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    // Up to a third of the letters wrong counts as a slip; more is another word.
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
