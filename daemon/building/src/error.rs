//! The errors of each border: laying out a building, using a device, serving it.
//!
//! Messages are lower-case fragments that complete "failed to …" and say what
//! would be right; finding the likely intended name is done here for all of them.

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
    /// The name would not survive as a PDDL object.
    #[error(
        "name something `{name}`: a name is a lower-case letter, then at most {} of `a-z 0-9 - _`",
        NAME_MAX - 1
    )]
    BadName {
        /// What was written.
        name: String,
    },
    /// Locations and devices share one set of names, as PDDL objects do.
    #[error("name something `{name}`: a {taken_by} has that name; choose another")]
    NameTaken {
        /// The name that is asked for twice.
        name: String,
        /// What bears it already, in words.
        taken_by: String,
    },
    /// A door or device names a place that is not on the plan.
    #[error("find the location `{name}`{}", hint(.nearest))]
    UnknownLocation {
        /// What was written.
        name: String,
        /// The most similar location, if one is similar.
        nearest: Option<String>,
    },
    /// A sensor is mounted on something that is not in the building.
    #[error("find the robot `{name}`{}", hint(.nearest))]
    UnknownRobot {
        /// What was written.
        name: String,
        /// The most similar robot, if one is similar.
        nearest: Option<String>,
    },
    /// A device is removed, or named, that is not in the building.
    #[error("find the device `{name}`{}", hint(.nearest))]
    UnknownDevice {
        /// What was written.
        name: String,
        /// The most similar device, if one is similar.
        nearest: Option<String>,
    },
    /// Only robots carry.
    #[error("mount a sensor on `{name}`: it is a {is}, and only a robot carries sensors")]
    NotARobot {
        /// The intended carrier.
        name: String,
        /// What it is, in words.
        is: String,
    },
    /// A temperature outside what a building can have.
    #[error(
        "set {celsius} °C in `{location}`: between {CELSIUS_MIN} and {CELSIUS_MAX} is possible"
    )]
    BadTemperature {
        /// Where.
        location: String,
        /// What was written.
        celsius: f64,
    },
    /// A value that the quantity cannot have.
    #[error(
        "set the {} of `{location}` to {value}: between {} and {} is possible",
        quantity.name(), quantity.bounds().0, quantity.bounds().1
    )]
    BadValue {
        /// Where.
        location: String,
        /// Of what.
        quantity: Quantity,
        /// What was written.
        value: f64,
    },
    /// A distance that no building has.
    #[error(
        "connect `{from}` and `{to}` by {meters} m: more than 0 and at most {METERS_MAX} m is possible"
    )]
    BadDistance {
        /// One end.
        from: String,
        /// The other end.
        to: String,
        /// What was written.
        meters: f64,
    },
    /// A location cannot be its own neighbor.
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
        /// The distance that is known already.
        meters: f64,
    },
    /// A door is locked or unlocked where there is none.
    #[error("find a door between `{a}` and `{b}`: name two locations that are connected")]
    NoDoor {
        /// One side.
        a: String,
        /// The other side.
        b: String,
    },
    /// A speed that would never arrive, or arrive before it left.
    #[error(
        "let `{robot}` drive at {meters_per_second} m/s: between {SPEED_MIN} and {SPEED_MAX} m/s is possible"
    )]
    BadSpeed {
        /// The robot.
        robot: String,
        /// What was written.
        meters_per_second: f64,
    },
    /// A battery that no robot has.
    #[error(
        "give `{robot}` such a battery: range, charge and recharge-time are not negative, and the \
         charge is at most the range"
    )]
    BadBattery {
        /// The robot.
        robot: String,
    },
    /// A camera can look in these directions only.
    #[error("let `{camera}` see so: at most 16 places, pan -170 to 170, tilt -90 to 90 degrees")]
    BadView {
        /// The camera.
        camera: String,
    },
    /// Time cannot be scaled by this factor.
    #[error(
        "scale time by {time_scale}: 1.0 is real time, 0.1 ten times faster; between 0 and 1000 is possible"
    )]
    BadTimeScale {
        /// What was written.
        time_scale: f64,
    },
}

/// Why a device did not do what its driver asked. Travels over the socket too.
#[derive(Clone, Debug, Deserialize, Eq, Error, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
#[non_exhaustive]
pub enum DeviceError {
    /// There is no such device in the building, or no longer.
    #[error("find the device `{device}` in the building{}", hint(.nearest))]
    UnknownDevice {
        /// What was asked for.
        device: String,
        /// The most similar device, if one is similar.
        nearest: Option<String>,
    },
    /// The device is there, and is not made for this.
    #[error("use `{device}` as a {wanted}: it is a {is}")]
    WrongKind {
        /// What was asked.
        device: String,
        /// What it is, in words.
        is: String,
        /// What the operation needs, in words.
        wanted: String,
    },
    /// There is no such place in the building.
    #[error("find the location `{location}` in the building{}", hint(.nearest))]
    UnknownLocation {
        /// What was asked for.
        location: String,
        /// The most similar location, if one is similar.
        nearest: Option<String>,
    },
    /// The robot does not stand next to where it shall go.
    #[error("go from `{from}` to `{to}`: from there a robot can go to {}", list(.ways))]
    NoWay {
        /// Where the robot truly is.
        from: String,
        /// Where it was sent.
        to: String,
        /// Where it could go.
        ways: Vec<String>,
    },
    /// There is a door, and it is locked.
    #[error("go from `{from}` to `{to}`: the door is locked")]
    Locked {
        /// Where the robot truly is.
        from: String,
        /// Where it was sent.
        to: String,
    },
    /// The device has failed.
    #[error("use `{device}`: it is broken")]
    Broken {
        /// The device.
        device: String,
    },
    /// The robot is on its way somewhere else.
    #[error("send `{device}`: it is on another errand; cancel that one first")]
    Busy {
        /// The robot.
        device: String,
    },
    /// The robot's battery is empty, or nearly so.
    #[error("drive `{device}` to `{to}`: its battery does not last so far")]
    EmptyBattery {
        /// The robot.
        device: String,
        /// Where it was sent.
        to: String,
    },
    /// The camera does not turn or zoom so far.
    #[error("turn `{device}` so far: pan -170 to 170, tilt -90 to 90 degrees, zoom 1 to 10")]
    OutOfReach {
        /// The camera.
        device: String,
    },
    /// A screen on a wall shows nothing before it has a channel.
    #[error("show anything on `{device}`: it was given no channel yet")]
    NoChannel {
        /// The screen.
        device: String,
    },
    /// No screen is that large.
    #[error("show that on `{device}`: {bytes_max} bytes are possible")]
    TooLong {
        /// The screen.
        device: String,
        /// The longest text.
        bytes_max: usize,
    },
    /// A battery can be filled at the dock only.
    #[error("recharge `{device}`: it {}", at_dock(.dock))]
    NotAtDock {
        /// The robot.
        device: String,
        /// Where it would have to stand; `None` if it has no battery.
        dock: Option<String>,
    },
    /// The building's socket does not answer (any more).
    #[error("reach the building: {reason}")]
    Unreachable {
        /// What happened to the connection.
        reason: String,
    },
    /// The building's server would not take the request.
    #[error("be heard by the building: {reason}")]
    Refused {
        /// What would have been right.
        reason: String,
    },
}

/// Why a building cannot be served at a socket.
#[derive(Debug, Error)]
#[non_exhaustive]
pub enum ServeError {
    /// Another server answers there.
    #[error("serve the building at {}: another building is served there", .path.display())]
    InUse {
        /// The path of the socket.
        path: PathBuf,
    },
    /// Something that is not a socket is in the way; it is not ours to remove.
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
        /// What the operating system said.
        #[source]
        source: io::Error,
    },
}

/// The candidate most similar to `name`, if one is similar enough to be meant.
pub(crate) fn nearest<'a>(name: &str, candidates: impl Iterator<Item = &'a str>) -> Option<String> {
    // A third of the letters wrong is a slip; more is another word.
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
