//! What a robot's plugin does with a robot with ROS 2, besides driving between places.

use actuator::BoxFuture;
use ros2_link::MapPose;

use crate::ros2::Ros2Base;

const TEXT: &str = "std_msgs/msg/String";
const SWITCH: &str = "std_srvs/srv/SetBool";

/// Access of a robot's plugin to a robot with ROS 2. The texts of all errors complete “failed to
/// …”.
#[derive(Clone)]
pub struct RosPart {
    base: Ros2Base,
}

impl RosPart {
    pub(crate) fn of(base: Ros2Base) -> RosPart {
        RosPart { base }
    }

    /// Drives through these poses, one after the other, and back to the place at which the robot
    /// stands. Dropping the future stops the robot.
    pub fn drive_through(&self, poses: Vec<MapPose>, place: &str) -> BoxFuture<Result<(), String>> {
        let (base, place) = (self.base.clone(), place.to_owned());
        Box::pin(async move {
            let driven = base.drive_through(&poses, &place).await;
            driven.map_err(|failure| failure.to_string())
        })
    }

    /// Publishes a text on a topic of the type `std_msgs/msg/String`.
    pub fn publish_text(&self, topic: &str, text: &str) -> BoxFuture<Result<(), String>> {
        let (base, topic, text) = (self.base.clone(), topic.to_owned(), text.to_owned());
        Box::pin(async move {
            let message = serde_json::json!({ "data": text });
            base.robot().publish(&topic, TEXT, &message).await.map_err(|error| error.to_string())
        })
    }

    /// Switches a service of the type `std_srvs/srv/SetBool` on, does the work, and switches it off
    /// again, also if the work fails or is cancelled.
    pub fn while_on(
        &self,
        service: &str,
        work: BoxFuture<Result<(), String>>,
    ) -> BoxFuture<Result<(), String>> {
        let (on, robot) = (self.switch(service, true), self.clone());
        let service = service.to_owned();
        Box::pin(async move {
            let mut running = RunningSwitch { robot, service, is_on: true };
            // A request without an answer may have been obeyed.
            on.await?;
            let done = work.await;
            running.is_on = false;
            done.and(running.robot.switch(&running.service, false).await)
        })
    }

    /// Calls a service of the type `std_srvs/srv/SetBool`, and fails if it reports no success.
    pub fn switch(&self, service: &str, on: bool) -> BoxFuture<Result<(), String>> {
        let (base, service) = (self.base.clone(), service.to_owned());
        Box::pin(async move {
            let request = serde_json::json!({ "data": on });
            let answer = base.robot().call(&service, SWITCH, &request).await;
            let answer = answer.map_err(|error| error.to_string())?;
            if answer["success"].as_bool() == Some(true) {
                return Ok(());
            }
            let state = if on { "on" } else { "off" };
            let why = answer["message"].as_str().filter(|why| !why.is_empty());
            let why = why.map_or("it gives no reason".to_owned(), ros2_link::printable);
            Err(format!("switch `{service}` {state}: {why}"))
        })
    }
}

/// A switch that was switched on. Dropping it switches it off, if that is not being done already.
struct RunningSwitch {
    robot: RosPart,
    service: String,
    is_on: bool,
}

impl Drop for RunningSwitch {
    fn drop(&mut self) {
        let Ok(runtime) = tokio::runtime::Handle::try_current() else { return };
        if !self.is_on {
            return;
        }
        let (off, service) = (self.robot.switch(&self.service, false), self.service.clone());
        runtime.spawn(async move {
            if let Err(problem) = off.await {
                tracing::warn!(service, problem, "a switch of a robot is perhaps still on");
            }
        });
    }
}
