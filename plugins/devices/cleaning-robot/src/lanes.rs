//! The driver of robots with ROS 2, which sweep a place by driving its lanes with the brush on, and
//! return to the pose of the place.
//!
//! - `config.lanes` has the poses of each place that the robot sweeps, in the order of driving.
//! - `config.brush` names the service that switches the brush; a robot without it sweeps always.

use std::collections::BTreeMap;
use std::future::ready;

use actuator::BoxFuture;
use agent::{Blueprint, BuildError};
use mobile_base::{MapPose, RosPart};

use crate::Broom;

/// A robot that sweeps by driving lanes.
pub(crate) struct LaneBroom {
    robot: RosPart,
    lanes: BTreeMap<String, Vec<MapPose>>,
    brush: Option<String>,
}

impl LaneBroom {
    /// Creates the driver after checking the lanes.
    ///
    /// # Errors
    ///
    /// Returns an error if no place has lanes, or if lanes belong to no place or have no poses.
    pub(crate) fn new(
        blueprint: &Blueprint,
        robot: &RosPart,
        lanes: BTreeMap<String, Vec<MapPose>>,
        brush: Option<String>,
    ) -> Result<LaneBroom, BuildError> {
        let problem = |text: String| blueprint.problem(text);
        let first = lanes.keys().next();
        first.ok_or_else(|| {
            problem(
                "the driver `ros2` of a cleaning robot needs `config.lanes`: the poses that it \
                 drives through to sweep a room, such as office1 = [{ x = 6.0, y = 0.0 }, { x = \
                 6.0, y = 2.0 }]"
                    .to_owned(),
            )
        })?;
        for (place, poses) in &lanes {
            let known = blueprint.host.has_place(place);
            known.map_err(|why| problem(format!("config.lanes: {why}")))?;
            if poses.is_empty() {
                return Err(problem(format!("config.lanes.{place}: it needs a pose or more")));
            }
            for pose in poses {
                pose.check().map_err(|why| problem(format!("config.lanes.{place}: {why}")))?;
            }
        }
        Ok(LaneBroom { robot: robot.clone(), lanes, brush })
    }
}

impl Broom for LaneBroom {
    fn places(&self) -> Option<Vec<String>> {
        Some(self.lanes.keys().cloned().collect())
    }

    fn sweep(&self, place: &str) -> BoxFuture<Result<String, String>> {
        let Some(lanes) = self.lanes.get(place).cloned() else {
            return Box::pin(ready(Err(format!("sweep `{place}`: it has no lanes"))));
        };
        let (mut swept, place) = (self.robot.drive_through(lanes, place), place.to_owned());
        if let Some(brush) = &self.brush {
            swept = self.robot.while_on(brush, swept);
        }
        Box::pin(async move { swept.await.map(|()| place) })
    }
}
