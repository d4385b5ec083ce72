//! The driver of robots with ROS 2: the display shows the last text of a topic.

use actuator::BoxFuture;
use mobile_base::RosPart;

use crate::ScreenDriver;

/// Topic of the display if the config names none: that of the TurtleBot 4.
const DISPLAY: &str = "hmi/display/message";

/// The display of a robot with ROS 2.
pub(crate) struct RosDisplay {
    robot: RosPart,
    topic: String,
}

impl RosDisplay {
    /// Creates the display that shows the texts of `topic`, which has the type `std_msgs/msg/String`.
    pub(crate) fn new(robot: &RosPart, topic: Option<String>) -> RosDisplay {
        RosDisplay { robot: robot.clone(), topic: topic.unwrap_or_else(|| DISPLAY.to_owned()) }
    }
}

impl ScreenDriver for RosDisplay {
    fn show(&self, text: Option<&str>) -> BoxFuture<Result<(), String>> {
        self.robot.publish_text(&self.topic, text.unwrap_or_default())
    }
}
