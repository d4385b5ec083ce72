//! Poses on the robot's map.

use std::f64::consts::TAU;

use serde::de::Error as _;
use serde::{Deserialize, Deserializer};
use serde_json::{Value, json};

/// How far a heading may exceed a full turn, in radians: the error of two written decimals.
const ROUNDING: f64 = 0.01;

/// Position and heading of a robot in the frame `map`.
#[derive(Clone, Copy, Debug, PartialEq, Deserialize)]
#[serde(remote = "Self", deny_unknown_fields)]
pub struct MapPose {
    /// Position in meters.
    pub x: f64,
    /// Position in meters.
    pub y: f64,
    /// Heading in radians, counterclockwise from the x axis.
    #[serde(default)]
    pub yaw: f64,
}

impl<'de> Deserialize<'de> for MapPose {
    /// Reads a pose from a table. A list is refused, because its third number may be a height or a
    /// heading.
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<MapPose, D::Error> {
        let value = Value::deserialize(deserializer)?;
        if let Value::Array(list) = &value {
            let number = |place: usize| list.get(place).filter(|value| value.is_number());
            let (x, y) = match (number(0), number(1)) {
                (Some(x), Some(y)) => (x.to_string(), y.to_string()),
                _ => ("1.5".to_owned(), "-0.5".to_owned()),
            };
            return Err(D::Error::custom(format!(
                "a pose is a table and no list: write {{ x = {x}, y = {y} }}, with yaw = … for its \
                 heading in radians"
            )));
        }
        MapPose::deserialize(value).map_err(D::Error::custom)
    }
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
    fn a_pose_is_a_table() {
        let read = |value: Value| {
            serde_json::from_value::<MapPose>(value).map_err(|error| error.to_string())
        };
        assert_eq!(read(json!({ "x": 1, "y": 2.5 })), Ok(MapPose { x: 1.0, y: 2.5, yaw: 0.0 }));
        for list in [json!([-5.8, 0.1]), json!([-5.8, 0.1, 0.0]), json!([-5.8, 0.1, 0.0, 1.0])] {
            let problem = read(list).expect_err("a list");
            assert!(problem.contains("no list: write { x = -5.8, y = 0.1 }"), "{problem}");
        }
        assert_eq!(read(json!({ "x": 1 })), Err("missing field `y`".to_owned()));
        let text = read(json!("1, 2")).expect_err("a text");
        assert!(text.starts_with("invalid type: string \"1, 2\", expected struct"), "{text}");
    }

    #[test]
    fn a_pose_without_a_number_is_none() {
        let mut message = MapPose { x: 0.0, y: 0.0, yaw: 0.0 }.to_message();
        message["position"]["x"] = json!("nan");
        assert_eq!(MapPose::of_message(&message), None);
        assert_eq!(MapPose::of_message(&json!({})), None);
    }
}
