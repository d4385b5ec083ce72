//! A robot with Nav2 as its client sees it, over real Zenoh, in both dialects. The robot drives in
//! the simulated building. The truth of the building decides.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::Duration;

use building::{Building, Layout, RobotBattery};
use ros2_link::{
    ActionClient, MapPose, Nav2Names, Nav2Robot, RosAddress, RosDialect, RosGoalStatus, RosLink,
    VelocityMessage, standard_interfaces,
};
use simulated_nav2::{Nav2Settings, RobotWire, SimulatedNav2};

/// Duration of a second of the building, in seconds.
const PACE: f64 = 1.0 / 100.0;

/// Time limit of a step, on a machine that is busy with other tests.
const PATIENCE: Duration = Duration::from_secs(60);

const ROBOT: &str = "robot";
const RANGE: f64 = 100.0;

struct Office {
    building: Building,
    nav2: SimulatedNav2,
    robot: Nav2Robot,
    link: RosLink,
}

fn layout() -> Layout {
    let mut layout = Layout::new();
    layout.add_corridor("corridor", 20.0).expect("a corridor");
    layout.add_room("office1", 21.0).expect("a room");
    layout.add_room("office2", 22.0).expect("a room");
    layout.connect("corridor", "office1", 6.0).expect("a door");
    layout.connect("corridor", "office2", 6.0).expect("a door");
    layout.add_robot(ROBOT, "corridor", 0.5).expect("a robot");
    let battery = RobotBattery {
        dock: "corridor".to_owned(),
        range: RANGE,
        charge: 40.0,
        recharge_time: 60.0,
    };
    layout.equip(ROBOT, battery).expect("a battery");
    layout
}

const NAVIGATE: &str = "nav2_msgs/action/NavigateToPose";

fn goal_at(pose: MapPose) -> serde_json::Value {
    serde_json::json!({ "pose": { "pose": { "position": { "x": pose.x, "y": pose.y } } } })
}

const CORRIDOR: MapPose = MapPose { x: 0.0, y: 0.0, yaw: 0.0 };
const OFFICE1: MapPose = MapPose { x: 6.0, y: 0.0, yaw: 1.5 };
const OFFICE2: MapPose = MapPose { x: -6.0, y: 0.0, yaw: 0.0 };

async fn office(wire: RobotWire, namespace: &str) -> Office {
    office_at(PACE, wire, namespace).await
}

async fn office_at(pace: f64, wire: RobotWire, namespace: &str) -> Office {
    let building = Building::new(layout(), pace).expect("a building");
    let places = [("corridor", CORRIDOR), ("office1", OFFICE1), ("office2", OFFICE2)];
    let places: BTreeMap<_, _> =
        places.into_iter().map(|(name, pose)| (name.to_owned(), (pose.x, pose.y))).collect();
    let settings = Nav2Settings {
        robot: ROBOT.to_owned(),
        wire,
        listen: None,
        namespace: namespace.to_owned(),
        places,
        battery_range: Some(RANGE),
    };
    let nav2 = SimulatedNav2::start(building.handle(), settings).await.expect("a robot");
    let (dialect, domain_id) = match wire {
        RobotWire::Ros2Dds => (RosDialect::Ros2Dds, 0),
        RobotWire::RmwZenoh(domain) => (RosDialect::RmwZenoh, domain),
    };
    let (endpoint, namespace) = (nav2.endpoint().to_owned(), namespace.to_owned());
    let address = RosAddress { endpoint, dialect, namespace, domain_id };
    let link = RosLink::open(address, Arc::new(standard_interfaces())).expect("an address");
    let robot = Nav2Robot::new(link.clone(), Nav2Names::default());
    Office { building, nav2, robot, link }
}

impl Office {
    async fn drive(&self, to: MapPose) -> Result<(), String> {
        let driven = tokio::time::timeout(PATIENCE, self.robot.drive(to, |_| ()));
        driven.await.expect("in time").map_err(|error| error.to_string())
    }

    fn place(&self) -> String {
        self.building.place_of(ROBOT).expect("the robot")
    }

    /// Waits until the robot drives in the building.
    async fn departed(&self) {
        let departs = self.building.wait_for(|truth| {
            truth.any(|event| matches!(event, building::BuildingEvent::Departed { .. }))
        });
        tokio::time::timeout(PATIENCE, departs).await.expect("it departs");
    }
}

const WIRES: [(RobotWire, &str); 3] =
    [(RobotWire::Ros2Dds, ""), (RobotWire::Ros2Dds, "tb1"), (RobotWire::RmwZenoh(7), "tb1")];

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_arrives_where_it_is_sent_in_both_dialects() {
    for (wire, namespace) in WIRES {
        let office = office(wire, namespace).await;
        let mut distances = Vec::new();
        let driven = office.robot.drive(OFFICE1, |meters| distances.push(meters));
        tokio::time::timeout(PATIENCE, driven).await.expect("in time").expect("it arrives");
        assert_eq!(office.place(), "office1", "{wire:?}");
        assert!(distances.iter().all(|meters| (0.0..=6.0).contains(meters)), "{distances:?}");
        office.robot.next_message().await.expect("a message");
        let charge = office.robot.charge().await.expect("linked").expect("a battery");
        assert!(charge < 0.41, "{charge}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_that_nav2_cannot_reach_fails_with_its_reason() {
    let office = office(RobotWire::Ros2Dds, "").await;
    office.drive(OFFICE1).await.expect("it arrives");
    office.building.lock_door("corridor", "office1").expect("a door");
    let reason = office.drive(CORRIDOR).await.expect_err("the door is locked");
    assert_eq!(
        reason,
        "drive there: Nav2 gave up: go from `office1` to `corridor`: the door is locked (error 9000)"
    );
    assert_eq!(office.place(), "office1");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_whose_nav2_is_inactive_drives_when_it_is_active() {
    let office = office(RobotWire::RmwZenoh(0), "").await;
    office.nav2.set_active(false);
    let driving = office.robot.drive(OFFICE2, |_| ());
    let activation = async {
        tokio::time::timeout(PATIENCE, office.nav2.until_goals(1)).await.expect("it is sent");
        assert_eq!(office.place(), "corridor");
        office.nav2.set_active(true);
    };
    let (driven, ()) = tokio::join!(tokio::time::timeout(PATIENCE, driving), activation);
    driven.expect("in time").expect("it arrives");
    assert_eq!((office.place().as_str(), office.nav2.goals()), ("office2", 2));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_that_is_dropped_is_cancelled_at_the_robot() {
    for (wire, namespace) in WIRES {
        let office = office(wire, namespace).await;
        let driving = office.robot.drive(OFFICE1, |_| ());
        tokio::select! {
            _ = driving => panic!("it arrived before it was cancelled"),
            () = office.departed() => (),
        }
        let cancelled = office.building.wait_for(|truth| {
            truth.any(|event| matches!(event, building::BuildingEvent::Stayed { .. }))
        });
        tokio::time::timeout(PATIENCE, cancelled).await.expect("it stops");
    }
}

/// Another program drives the robot, and no goal of this client is there to be cancelled.
#[tokio::test(flavor = "multi_thread")]
async fn a_robot_stands_still_whoever_has_sent_its_goal() {
    for (wire, namespace) in WIRES {
        let office = office(wire, namespace).await;
        let name = Nav2Names::default().navigate;
        let client = ActionClient::new(&office.link, &name, NAVIGATE, PATIENCE).await;
        let mut goal = client.expect("a link").send(&goal_at(OFFICE2)).await.expect("accepted");
        office.departed().await;
        let still = office.robot.stand_still(VelocityMessage::Twist);
        tokio::time::timeout(PATIENCE, still).await.expect("in time").expect("it stands still");
        assert_eq!(office.place(), "corridor", "{wire:?}");
        let end = tokio::time::timeout(PATIENCE, goal.end(|_| ())).await.expect("in time");
        assert_eq!(end.expect("an end").status, RosGoalStatus::Canceled);
        assert!(office.nav2.zero_velocities() > 0);
        // A robot without a goal confirms it, too.
        let still = office.robot.stand_still(VelocityMessage::Twist);
        tokio::time::timeout(PATIENCE, still).await.expect("in time").expect("it stands still");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_of_another_program_is_named_as_the_reason() {
    let office = office(RobotWire::Ros2Dds, "").await;
    let other = async {
        office.departed().await;
        let name = Nav2Names::default().navigate;
        let client =
            ActionClient::new(&office.link, &name, NAVIGATE, PATIENCE).await.expect("a link");
        let mut goal = client.send(&goal_at(OFFICE2)).await.expect("accepted");
        goal.end(|_| ()).await.expect("an end").status
    };
    let (driven, end) = tokio::join!(office.drive(OFFICE1), other);
    assert_eq!(
        driven.expect_err("it was replaced"),
        "drive there: another program's goal took the place of this one"
    );
    assert_eq!(end, RosGoalStatus::Succeeded);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_charges_in_its_dock_and_leaves_it_before_it_drives() {
    let office = office(RobotWire::Ros2Dds, "tb1").await;
    let charged = tokio::time::timeout(PATIENCE, office.robot.recharge()).await;
    charged.expect("in time").expect("it charges");
    assert!(office.nav2.is_docked());
    assert_eq!(office.building.charge_of(ROBOT).expect("a robot"), Some(RANGE));
    while !office.robot.is_docked().await.expect("linked") {
        office.robot.next_message().await.expect("a message");
    }
    office.drive(OFFICE1).await.expect("it leaves the dock first");
    assert!(!office.nav2.is_docked());
    assert_eq!(office.place(), "office1");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_is_switched_off_is_out_of_reach() {
    let office = office(RobotWire::Ros2Dds, "").await;
    office.drive(OFFICE1).await.expect("it arrives");
    let Office { nav2, robot, .. } = office;
    drop(nav2);
    let driven = tokio::time::timeout(PATIENCE, robot.drive(CORRIDOR, |_| ())).await;
    let reason = driven.expect("in time").expect_err("nobody drives").to_string();
    assert!(reason.contains("no node of the robot answered"), "{reason}");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_that_was_never_there_is_named_by_its_endpoint() {
    let endpoint = "tcp/127.0.0.1:9".to_owned();
    let address = RosAddress {
        endpoint: endpoint.clone(),
        dialect: RosDialect::Ros2Dds,
        namespace: String::new(),
        domain_id: 0,
    };
    let link = RosLink::open(address, Arc::new(standard_interfaces())).expect("an address");
    let robot = Nav2Robot::new(link, Nav2Names::default());
    let reason = robot.pose().await.expect_err("nothing listens there").to_string();
    assert!(reason.starts_with(&format!("reach the robot at `{endpoint}`: ")), "{reason}");
}

/// Number of messages that a faulty node publishes on each topic in a second.
const GARBAGE_RATE: u32 = 1000;

/// Topics that the client reads, with their types.
const TOPICS: [(&str, &str); 4] = [
    ("navigate_to_pose/_action/feedback", "nav2_msgs/action/NavigateToPose_FeedbackMessage"),
    ("navigate_to_pose/_action/status", "action_msgs/msg/GoalStatusArray"),
    ("amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped"),
    ("battery_state", "sensor_msgs/msg/BatteryState"),
];

/// Returns bytes that no ROS node encodes: noise of any length, of which some begins like a message
/// and announces four billion elements.
fn garbage(random: &mut fastrand::Rng) -> Vec<u8> {
    let mut bytes = vec![0; random.usize(0..400)];
    random.fill(&mut bytes);
    let beginning = [0, 1, 0, 0, 0xff, 0xff, 0xff, 0xff];
    if random.bool() && bytes.len() > beginning.len() {
        bytes[..beginning.len()].copy_from_slice(&beginning);
    }
    bytes
}

#[tokio::test(flavor = "multi_thread")]
async fn a_robot_arrives_although_a_node_floods_its_topics_with_garbage() {
    for (wire, namespace) in WIRES {
        let office = office_at(1.0 / 10.0, wire, namespace).await;
        let mut random = fastrand::Rng::with_seed(28);
        let flooding = async {
            let mut ticks = tokio::time::interval(Duration::from_secs(1) / GARBAGE_RATE);
            loop {
                ticks.tick().await;
                for (topic, type_name) in TOPICS {
                    let bytes = garbage(&mut random);
                    office.nav2.publish_bytes(topic, type_name, bytes).await;
                }
            }
        };
        tokio::select! {
            driven = office.drive(OFFICE1) => driven.expect("it arrives"),
            () = flooding => (),
        }
        assert_eq!(office.place(), "office1", "{wire:?}");
        // The next message that can be read counts again.
        let read = async {
            while office.robot.charge().await.is_err() {
                drop(office.robot.next_message().await);
            }
        };
        tokio::time::timeout(PATIENCE, read).await.expect("in time");
    }
}

/// The trip takes longer than the client tolerates the silence of a server.
#[tokio::test(flavor = "multi_thread")]
async fn a_server_that_answers_no_questions_for_results_is_followed_by_its_topics() {
    let office = office_at(1.0, RobotWire::Ros2Dds, "").await;
    office.nav2.set_answers_results(false);
    office.drive(OFFICE1).await.expect("it arrives");
    assert_eq!(office.place(), "office1");
}
