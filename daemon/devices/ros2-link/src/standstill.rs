//! A robot at a standstill: no action server has a goal of any program, and the velocity is zero.

use std::time::Duration;

use serde::Deserialize;
use serde_json::{Value, json};

use crate::action::ActionClient;
use crate::error::RosError;
use crate::nav2::Nav2Robot;

/// Number of messages with a velocity of zero, and the pause between them. A mux of velocities
/// listens to a source again half a second after the last message of a source before it.
const VELOCITIES: u32 = 6;
const VELOCITY_PAUSE: Duration = Duration::from_millis(100);

/// Type of the messages that set the velocity of a robot. Nav2 changed it with ROS 2 Kilted.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum VelocityMessage {
    /// `geometry_msgs/msg/Twist`.
    #[default]
    Twist,
    /// `geometry_msgs/msg/TwistStamped`.
    TwistStamped,
}

impl VelocityMessage {
    fn type_name(self) -> &'static str {
        match self {
            VelocityMessage::Twist => "geometry_msgs/msg/Twist",
            VelocityMessage::TwistStamped => "geometry_msgs/msg/TwistStamped",
        }
    }
}

impl Nav2Robot {
    /// Cancels all goals of the robot, also those of other programs, sets its velocity to zero, and
    /// waits until Nav2 has no goal. The time of the wait is not bounded.
    ///
    /// # Errors
    ///
    /// Returns an error if Nav2 does not confirm the cancellation. The velocity is set to zero all
    /// the same.
    pub async fn stand_still(&self, velocity: VelocityMessage) -> Result<(), RosError> {
        let (ended, zero) = tokio::join!(self.end_all_goals(), self.set_velocity_zero(velocity));
        ended.and(zero)
    }

    async fn end_all_goals(&self) -> Result<(), RosError> {
        let navigation = self.navigation().await?;
        let (dock, undock) = (self.docking().await?, self.undocking().await?);
        let (ended, docking, undocking) =
            tokio::join!(navigation.end_all(), dock.end_all(), undock.end_all());
        ended?;
        for other in [docking, undocking] {
            match other {
                // Many robots have no dock.
                Ok(()) | Err(RosError::NoAnswer { .. }) => (),
                Err(error) => return Err(error),
            }
        }
        Ok(())
    }

    async fn set_velocity_zero(&self, velocity: VelocityMessage) -> Result<(), RosError> {
        // Fields that are left out are zero.
        let (topic, zero) = (&self.names().velocity, json!({}));
        for number in 0..VELOCITIES {
            if number > 0 {
                tokio::time::sleep(VELOCITY_PAUSE).await;
            }
            self.publish(topic, velocity.type_name(), &zero).await?;
        }
        Ok(())
    }
}

impl ActionClient {
    /// Cancels all goals of the server, and waits until it has none. The time of the wait is not
    /// bounded.
    ///
    /// # Errors
    ///
    /// Returns an error if the server does not confirm the cancellation.
    pub async fn end_all(&self) -> Result<(), RosError> {
        // To ROS, an identifier and a time of zero mean all goals.
        self.cancel(&[0; 16]).await?;
        let mut statuses = self.statuses();
        while statuses.latest()?.as_ref().is_some_and(has_goal) {
            statuses.next().await?;
        }
        Ok(())
    }
}

/// Whether a goal in an array of statuses is accepted, running or being cancelled.
fn has_goal(statuses: &Value) -> bool {
    let list = statuses["status_list"].as_array();
    list.into_iter().flatten().any(|status| matches!(status["status"].as_i64(), Some(1..=3)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn goals_are_over_when_none_is_accepted_running_or_cancelled() {
        let statuses = |numbers: &[i64]| {
            let list = numbers.iter().map(|number| json!({ "status": number }));
            json!({ "status_list": list.collect::<Vec<_>>() })
        };
        for (numbers, expected) in
            [(vec![], false), (vec![4, 5, 6], false), (vec![4, 2], true), (vec![3], true)]
        {
            assert_eq!(has_goal(&statuses(&numbers)), expected, "{numbers:?}");
        }
    }
}
