//! A robot at a standstill: no action server has a goal of any program, and the velocity is zero.

use std::time::Duration;

use serde::Deserialize;
use serde_json::{Value, json};
use tokio::time::Instant;

use crate::action::{ActionClient, HELD_FOR};
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
        // Many robots have no dock.
        let (ended, docking, undocking) =
            tokio::join!(navigation.end_all(), dock.end_all_if_there(), undock.end_all_if_there());
        ended.and(docking).and(undocking)
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
        let cancelled = self.cancel(&[0; 16]).await?;
        let mut statuses = self.statuses();
        let (mut known, mut is_fresh) = (statuses.latest()?, false);
        loop {
            let is_over = match &known {
                None => cancelled.is_empty(),
                // Statuses from before the cancellation need not list all goals.
                Some(known) => !has_goal(known) && (is_fresh || are_listed(known, &cancelled)),
            };
            if is_over {
                return Ok(());
            }
            (known, is_fresh) = (Some(statuses.next().await?), true);
        }
    }
}

impl ActionClient {
    /// Does the same as [`ActionClient::end_all`] if there is a server.
    async fn end_all_if_there(&self) -> Result<(), RosError> {
        let asked_at = Instant::now();
        match self.end_all().await {
            // A server that holds the request and does not answer may go on.
            Err(RosError::NoAnswer { .. }) if asked_at.elapsed() < HELD_FOR => Ok(()),
            ended => ended,
        }
    }
}

/// Whether an array of statuses lists all goals with the identifiers `goals`.
fn are_listed(statuses: &Value, goals: &[Value]) -> bool {
    let list = statuses["status_list"].as_array().map_or(&[][..], Vec::as_slice);
    let is_listed =
        |goal: &Value| list.iter().any(|status| status["goal_info"]["goal_id"]["uuid"] == *goal);
    goals.iter().all(is_listed)
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
    fn statuses_from_before_list_not_all_goals() {
        let status = |number: u8| json!({ "goal_info": { "goal_id": { "uuid": [number] } } });
        let statuses = json!({ "status_list": [status(1), status(2)] });
        assert!(are_listed(&statuses, &[json!([1]), json!([2])]));
        assert!(!are_listed(&statuses, &[json!([3])]));
        assert!(are_listed(&json!({ "status_list": [] }), &[]));
    }

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
