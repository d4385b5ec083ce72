//! Requests of drivers to the building, and their answers; the same in this process and over the
//! socket.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::{Deserialize, Serialize};

use crate::camera_aim::CameraAim;
use crate::error::DeviceError;
use crate::parcel_place::ParcelPlace;
use crate::quantity::Quantity;
use crate::truth::TemperatureReading;

/// A driver's request to the building.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum DriverRequest {
    ReadTemperature {
        sensor: String,
    },
    Navigate {
        robot: String,
        to: String,
    },
    PlaceOf {
        device: String,
    },
    Measure {
        sensor: String,
        quantity: Quantity,
    },
    /// Waits until the quantity differs from `known`. The answer is sent only then.
    AwaitChange {
        sensor: String,
        quantity: Quantity,
        known: f64,
    },
    Battery(BatteryAsk),
    Camera(CameraAsk),
    Cleaning(CleaningAsk),
    Screen(ScreenAsk),
    Parcel(ParcelAsk),
    /// Cancels the request with the same id. The cancellation itself has no answer.
    Cancel,
}

/// The answer to a [`DriverRequest`].
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum DriverAnswer {
    Reading(TemperatureReading),
    Arrived,
    Place(String),
    Measured(MeasuredValue),
    Battery(BatteryAnswer),
    Camera(CameraAnswer),
    Cleaning(CleaningAnswer),
    Screen(ScreenAnswer),
    Parcel(ParcelAnswer),
}

impl DriverAnswer {
    /// Returns an error which states that the answer does not match its request.
    pub(crate) fn unexpected(self) -> DeviceError {
        DeviceError::Unreachable { reason: format!("its answer does not fit: {self:?}") }
    }
}

/// A driver's request to a battery.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BatteryAsk {
    Recharge { robot: String },
    Charge { robot: String },
}

/// The answer to a [`BatteryAsk`].
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum BatteryAnswer {
    Full,
    Charge(Option<f64>),
}

/// A driver's request to a camera.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CameraAsk {
    Aim { camera: String, aim: CameraAim },
    Look { camera: String },
}

/// The answer to a [`CameraAsk`].
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CameraAnswer {
    Aimed,
    Sight(CameraView),
}

/// The places that a camera sees at one moment.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct CameraView {
    /// The direction and the zoom of the camera at that moment.
    pub aim: CameraAim,
    /// The places in the camera's field of view.
    pub places: Vec<SeenPlace>,
    /// Time of the view, counted from the opening of the building.
    pub at: Duration,
}

/// A place in a camera's field of view, and the people and robots there.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct SeenPlace {
    /// Name of the seen place.
    pub location: String,
    /// Horizontal position of the middle of the place in the picture: from -1 at the left to 1 at
    /// the right.
    pub right: f64,
    /// Vertical position of the middle of the place in the picture: from -1 at the bottom to 1 at
    /// the top.
    pub up: f64,
    /// Names of the people in this place, at most eight.
    pub people: Vec<String>,
    /// Names of the robots in this place, at most eight.
    pub robots: Vec<String>,
    /// Whether there is continuous motion in this place.
    pub stirs: bool,
}

/// A driver's request to a cleaning robot.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CleaningAsk {
    Sweep { robot: String },
}

/// The answer to a [`CleaningAsk`].
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum CleaningAnswer {
    Swept(String),
}

/// A driver's request about parcels, and about what hands them over.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ParcelAsk {
    SetDoor { door: String, open: bool },
    IsOpen { door: String },
    SendCabin { lift: String, to: String },
    TakeUp { robot: String, parcel: String },
    SetDown { robot: String, lift: Option<String> },
    Carried { robot: String },
    ReadTags { reader: String },
    Grip { arm: String, parcel: String },
    PutBack { arm: String, parcel: String, shelf: String },
    Load { arm: String, parcel: String, robot: String },
    OfArm { arm: String },
    CarryTable { robot: String, other: String, table: String, to: String },
}

/// The answer to a [`ParcelAsk`].
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ParcelAnswer {
    Done,
    Open(bool),
    Carried(Option<String>),
    Places(BTreeMap<String, ParcelPlace>),
}

/// A driver's request to a screen.
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ScreenAsk {
    Allocate { screen: String },
    Show { screen: String, text: Option<String> },
    Panel { screen: String },
}

/// The answer to a [`ScreenAsk`].
#[derive(Debug, Deserialize, Serialize)]
#[serde(rename_all = "kebab-case")]
pub(crate) enum ScreenAnswer {
    Channel(u32),
    Done,
    Panel(ScreenState),
}

/// State of a screen, as returned to its driver.
#[derive(Clone, Debug, Default, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct ScreenState {
    /// Channel of the screen; `None` if no channel was allocated.
    pub channel: Option<u32>,
    /// Text that the screen shows; `None` if the screen is dark.
    pub text: Option<String>,
}

/// The result of a measurement, and the true location of the sensor.
#[derive(Clone, Debug, Deserialize, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub struct MeasuredValue {
    /// Name of the location of the sensor at the time of the measurement.
    pub location: String,
    /// The measured quantity.
    pub quantity: Quantity,
    /// The measured value in the quantity's unit; for a yes-or-no quantity, 1 is yes and 0 is no.
    pub value: f64,
}
