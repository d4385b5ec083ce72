//! The place of a parcel.

use serde::{Deserialize, Serialize};

/// Where a parcel is.
#[derive(Clone, Debug, Deserialize, Eq, PartialEq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum ParcelPlace {
    /// In the location of this name.
    At(String),
    /// On the robot, or in the gripper of the arm, of this name.
    On(String),
    /// In the cabin of the lift of this name.
    In(String),
    /// On a shelf that only an arm reaches.
    Stored {
        /// Name of the arm.
        arm: String,
        /// Name of the shelf.
        shelf: String,
    },
}
