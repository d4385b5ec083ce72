//! ROS 2 robots, without ROS on this machine: topics, services and actions over Zenoh.
//!
//! - [`RosLink`] (`link`) is a Zenoh session of its own to one robot. It is a device bus: it shares
//!   nothing with the sessions that carry the messages of agents.
//! - [`LinkWatch`] (`link_watch`) decides whether the robot is in reach.
//! - [`TopicReader`] (`topic`) has the latest message of a topic.
//! - Two [`RosDialect`]s are known (`dialect`). In that of `zenoh-bridge-ros2dds`, the keys of
//!   Zenoh are the names of ROS; in that of `rmw_zenoh`, the keys also have the domain, the type
//!   and its hash.
//! - [`ActionClient`] (`action`) sends goals to an action server, and follows them.
//! - [`Nav2Robot`] (`nav2`) is a robot that drives with Nav2: poses, battery, dock, and a
//!   standstill (`standstill`).
//!
//! The encoding of messages is that of the crate `ros-messages`.

mod action;
mod dialect;
mod error;
mod link;
mod link_watch;
mod nav2;
mod pose;
mod standstill;
mod topic;

pub use action::{ActionClient, GoalEnd, RosGoal, RosGoalStatus};
pub use dialect::RosDialect;
pub use error::{RosError, printable};
pub use link::{RosAddress, RosLink, is_ros_name};
pub use link_watch::{LinkReach, LinkWatch};
pub use nav2::{Nav2Names, Nav2Robot};
pub use pose::MapPose;
pub use standstill::VelocityMessage;
pub use topic::TopicReader;

/// Returns the definitions of messages that robots need most, those of ROS 2 Jazzy.
pub fn standard_interfaces() -> ros_messages::Interfaces {
    ros_messages::Interfaces::standard()
}
