//! Robots that are not ours: Cyclone DDS behind the bridge of Zenoh, and `hiroz` at a router of
//! Zenoh. Each test is done with both. What a robot did is read from the robot, not from the link.

mod support;

use std::sync::{Arc, Mutex};
use std::time::Duration;

use ros2_link::{ActionClient, MapPose, Nav2Robot, RosDialect, RosError, RosGoalStatus};
use serde_json::json;
use support::{PATIENCE, Peer};

/// How long a link is awaited.
const LINK_TIMEOUT: Duration = Duration::from_secs(20);

const THERE: MapPose = MapPose { x: 6.5, y: -1.25, yaw: 1.0 };

/// Waits until `is_so` holds of the robot, which is asked after each of its messages.
async fn until<F: Future<Output = Result<bool, RosError>>>(
    robot: &Nav2Robot,
    is_so: impl Fn() -> F,
) {
    let seen = async {
        while !is_so().await.expect("the robot is reached") {
            robot.next_message().await.expect("the robot tells something");
        }
    };
    tokio::time::timeout(PATIENCE, seen).await.expect("the robot tells it in time");
}

async fn until_at(robot: &Nav2Robot, x: f64, y: f64) {
    let at = MapPose { x, y, yaw: 0.0 };
    until(robot, async || Ok(robot.pose().await?.is_some_and(|pose| pose.distance(&at) < 1e-6)))
        .await;
}

type Driving = tokio::task::JoinHandle<Result<(), RosError>>;

/// Begins to drive, and returns when the robot has told that it does.
async fn begin_to_drive(robot: &Nav2Robot) -> Driving {
    let (robot, begun) = (robot.clone(), Arc::new(tokio::sync::Notify::new()));
    let told = Arc::clone(&begun);
    let driving = tokio::spawn(async move { robot.drive(THERE, |_| told.notify_one()).await });
    tokio::time::timeout(PATIENCE, begun.notified()).await.expect("it drives");
    driving
}

async fn what_the_robot_tells_is_seen(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "robot1").await;
    let robot = peer.robot();
    assert!(robot.pose().await.expect("it is linked").is_none());
    for command in ["pose 1.5 -2", "battery 0.5", "docked true"] {
        peer.nodes.tell(command);
    }
    until_at(&robot, 1.5, -2.0).await;
    until(&robot, async || Ok(robot.charge().await? == Some(0.5))).await;
    until(&robot, async || robot.is_docked().await).await;
    // A client that comes later reads the pose that was told before.
    until_at(&peer.robot(), 1.5, -2.0).await;
    robot.set_pose(MapPose { x: -3.0, y: 4.0, yaw: 0.5 }).await.expect("it is linked");
    assert_eq!(peer.nodes.saw("initialpose").await.replace(".0", ""), "initialpose -3 4");
    until_at(&robot, -3.0, 4.0).await;
}

async fn goal_is_reached(dialect: RosDialect, namespace: &str, distribution: &'static str) {
    let mut peer = Peer::of(dialect, namespace, distribution).await;
    let robot = peer.robot();
    let meters = Mutex::new(Vec::new());
    let driven = robot.drive(THERE, |left| meters.lock().expect("no panic").push(left));
    driven.await.expect("it arrives");
    assert_eq!(peer.nodes.saw("goal").await, "goal 6.5 -1.25");
    peer.nodes.saw("arrived").await;
    let meters = meters.into_inner().expect("no panic");
    assert!(meters.len() > 2 && meters.is_sorted_by(|one, two| one >= two), "{meters:?}");
    until_at(&robot, 6.5, -1.25).await;
}

async fn a_goal_is_cancelled(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    peer.nodes.tell("behave wait");
    let action = "nav2_msgs/action/NavigateToPose";
    let link = peer.link();
    let client = ActionClient::new(&link, "navigate_to_pose", action, LINK_TIMEOUT);
    let client = client.await.expect("it is linked");
    let goal = client.send(&json!({})).await.expect("it is accepted");
    peer.nodes.saw("goal").await;
    let end = goal.cancel().await.expect("it is confirmed");
    assert_eq!(end.status, RosGoalStatus::Canceled);
    peer.nodes.saw("canceled").await;
    // A drive that is given up is cancelled too.
    begin_to_drive(&peer.robot()).await.abort();
    peer.nodes.saw("canceled").await;
}

async fn a_rejected_goal_is_told_or_awaited(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    let robot = peer.robot();
    peer.nodes.tell("behave reject");
    let error = robot.drive(THERE, |_| ()).await.expect_err("it is rejected");
    assert!(matches!(error, RosError::Rejected { .. }), "{error}");
    // It is sent again, because Nav2 says that it is active.
    peer.nodes.saw("rejected").await;
    peer.nodes.saw("rejected").await;
    peer.nodes.tell("behave arrive");
    peer.nodes.tell("lifecycle inactive");
    let driving = tokio::spawn(async move { robot.drive(THERE, |_| ()).await });
    peer.nodes.saw("rejected").await;
    peer.nodes.tell("lifecycle active");
    peer.nodes.saw("arrived").await;
    driving.await.expect("no panic").expect("it waits, and arrives");
}

async fn aborted_goal_has_its_reason(dialect: RosDialect, distribution: &'static str, why: &str) {
    let mut peer = Peer::of(dialect, "", distribution).await;
    peer.nodes.tell("behave abort 9003 the way is blocked");
    let error = peer.robot().drive(THERE, |_| ()).await.expect_err("it is aborted");
    assert_eq!(error.to_string(), format!("drive there: {why}"));
    peer.nodes.saw("aborted").await;
}

async fn the_goal_of_another_program_is_named(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    peer.nodes.tell("behave wait");
    let driving = begin_to_drive(&peer.robot()).await;
    peer.nodes.tell("other 9 9");
    peer.nodes.saw("preempted").await;
    let error = driving.await.expect("no panic").expect_err("it is replaced");
    assert!(error.to_string().contains("another program's goal"), "{error}");
}

async fn a_robot_docks_and_leaves_its_dock(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    peer.nodes.tell("battery 0.25");
    let robot = peer.robot();
    let charging = robot.clone();
    let charging = tokio::spawn(async move { charging.recharge().await });
    peer.nodes.saw("docked").await;
    peer.nodes.tell("battery 1.0");
    charging.await.expect("no panic").expect("it is full");
    until(&robot, async || robot.is_docked().await).await;
    robot.drive(THERE, |_| ()).await.expect("it arrives");
    peer.nodes.saw("undocked").await;
    peer.nodes.saw("goal").await;
}

async fn nodes_that_start_anew_are_seen(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    peer.nodes.tell("pose 1 1");
    let robot = peer.robot();
    until_at(&robot, 1.0, 1.0).await;
    // The new nodes tell their pose once, before anybody can have asked for it.
    peer.restart_nodes("2 2").await;
    until_at(&robot, 2.0, 2.0).await;
    robot.drive(THERE, |_| ()).await.expect("it arrives");
}

async fn a_pose_that_was_told_while_the_link_was_broken_is_seen(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    let (robot, mut relay) = peer.robot_through_relay().await;
    peer.nodes.tell("pose 1 1");
    until_at(&robot, 1.0, 1.0).await;
    relay.cut().await;
    peer.nodes.tell("pose 2 2");
    while peer.nodes.saw("pose").await.replace(".0", "") != "pose 2 2" {}
    relay.heal().await;
    until_at(&robot, 2.0, 2.0).await;
}

async fn a_robot_that_dies_is_out_of_reach(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    peer.nodes.tell("behave wait");
    let driving = begin_to_drive(&peer.robot()).await;
    peer.kill_nodes();
    // DDS notices after its lease of ten seconds, and the bridge then.
    let error = tokio::time::timeout(PATIENCE * 2, driving).await.expect("it is noticed");
    let error = error.expect("no panic").expect_err("it is lost");
    assert!(error.to_string().contains("out of reach"), "{error}");
}

async fn a_bridge_that_dies_is_out_of_reach(dialect: RosDialect) {
    let mut peer = Peer::start(dialect, "").await;
    peer.nodes.tell("behave wait");
    let robot = peer.robot();
    let driving = begin_to_drive(&robot).await;
    assert!(robot.is_linked().await);
    peer.kill_bridge();
    let error = tokio::time::timeout(PATIENCE, driving).await.expect("it is noticed");
    let error = error.expect("no panic").expect_err("it is lost");
    assert!(error.to_string().contains("out of reach"), "{error}");
    assert!(!robot.is_linked().await);
}

/// Writes a test for each dialect.
macro_rules! with_both {
    ($($test:ident),* $(,)?) => {
        mod cyclone_dds_behind_the_bridge {
            use super::RosDialect::Ros2Dds;
            $(
                #[tokio::test(flavor = "multi_thread")]
                async fn $test() { super::$test(Ros2Dds).await; }
            )*

            #[tokio::test(flavor = "multi_thread")]
            async fn a_goal_is_reached_in_each_distribution() {
                for (namespace, distribution) in [("", "jazzy"), ("robot1", "iron"), ("", "humble")] {
                    super::goal_is_reached(Ros2Dds, namespace, distribution).await;
                }
            }

            #[tokio::test(flavor = "multi_thread")]
            async fn an_aborted_goal_has_the_reason_of_its_distribution() {
                for (distribution, why) in [
                    ("jazzy", "Nav2 gave up: the way is blocked (error 9003)"),
                    ("iron", "Nav2 gave up with error 9003"),
                    ("humble", "Nav2 gave up, and gives no reason"),
                ] {
                    super::aborted_goal_has_its_reason(Ros2Dds, distribution, why).await;
                }
            }
        }

        mod hiroz_at_a_router {
            use super::RosDialect::RmwZenoh;
            $(
                #[tokio::test(flavor = "multi_thread")]
                async fn $test() { super::$test(RmwZenoh).await; }
            )*

            #[tokio::test(flavor = "multi_thread")]
            async fn a_goal_is_reached() {
                for namespace in ["", "robot1"] {
                    super::goal_is_reached(RmwZenoh, namespace, "jazzy").await;
                }
            }

            #[tokio::test(flavor = "multi_thread")]
            async fn an_aborted_goal_has_its_reason() {
                let why = "Nav2 gave up: the way is blocked (error 9003)";
                super::aborted_goal_has_its_reason(RmwZenoh, "jazzy", why).await;
            }
        }
    };
}

with_both!(
    what_the_robot_tells_is_seen,
    a_goal_is_cancelled,
    a_rejected_goal_is_told_or_awaited,
    the_goal_of_another_program_is_named,
    a_robot_docks_and_leaves_its_dock,
    nodes_that_start_anew_are_seen,
    a_pose_that_was_told_while_the_link_was_broken_is_seen,
    a_robot_that_dies_is_out_of_reach,
    a_bridge_that_dies_is_out_of_reach,
);
