//! Poses on the robot's map.

use std::f64::consts::TAU;

use serde::Deserialize;
use serde_json::{Value, json};

/// How far a heading may exceed a full turn, in radians: the error of two written decimals.
const ROUNDING: f64 = 0.01;

/// Position and heading of a robot in the frame `map`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapPose {
    /// Position in meters.
    pub x: f64,
    /// Position in meters.
    pub y: f64,
    /// Heading in radians, counterclockwise from the x axis.
    #[serde(default)]
    pub yaw: f64,
}

impl MapPose {
    /// Checks that the numbers are finite, and that the heading is in radians.
    ///
    /// # Errors
    ///
    /// Returns what a pose must be, as text for a person.
    pub fn check(&self) -> Result<(), &'static str> {
        let is_finite = [self.x, self.y, self.yaw].iter().all(|number| number.is_finite());
        if is_finite && self.yaw.abs() <= TAU + ROUNDING {
            return Ok(());
        }
        Err("x and y are finite, in meters; yaw is in radians, from -6.28 to 6.28 (a full turn)")
    }

    /// Returns the distance between the positions of two poses, in meters.
    pub fn distance(&self, other: &MapPose) -> f64 {
        (self.x - other.x).hypot(self.y - other.y)
    }

    /// Returns the pose as a `geometry_msgs/msg/Pose`.
    pub(crate) fn to_message(self) -> Value {
        let half = self.yaw / 2.0;
        json!({
            "position": { "x": self.x, "y": self.y, "z": 0.0 },
            "orientation": { "x": 0.0, "y": 0.0, "z": half.sin(), "w": half.cos() },
        })
    }

    /// Reads a `geometry_msgs/msg/Pose`. Returns `None` if a number is missing or not finite.
    pub(crate) fn of_message(message: &Value) -> Option<MapPose> {
        let number = |part: &str, axis: &str| {
            message[part][axis].as_f64().filter(|number| number.is_finite())
        };
        let (x, y) = (number("position", "x")?, number("position", "y")?);
        let turn = |axis| number("orientation", axis);
        let (qx, qy, qz, qw) = (turn("x")?, turn("y")?, turn("z")?, turn("w")?);
        let yaw = (2.0 * (qw * qz + qx * qy)).atan2(1.0 - 2.0 * (qy * qy + qz * qz));
        Some(MapPose { x, y, yaw })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_pose_survives_its_message() {
        for yaw in [-3.0, -1.5, 0.0, 0.7, 3.1] {
            let pose = MapPose { x: 1.25, y: -2.5, yaw };
            let read = MapPose::of_message(&pose.to_message()).expect("a pose");
            assert!((read.yaw - yaw).abs() < 1e-9 && read.distance(&pose) == 0.0, "{read:?}");
        }
    }

    #[test]
    fn a_pose_without_a_number_is_none() {
        let mut message = MapPose { x: 0.0, y: 0.0, yaw: 0.0 }.to_message();
        message["position"]["x"] = json!("nan");
        assert_eq!(MapPose::of_message(&message), None);
        assert_eq!(MapPose::of_message(&json!({})), None);
    }
}
