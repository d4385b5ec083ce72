//! Times between a robot's driver and a Nav2 on the other side of a Zenoh link over loopback, in
//! both dialects: from the call of the driver to the goal at Nav2, and to the end of a goal that
//! takes no time.

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use building::{Building, Layout};
use ros2_link::{
    MapPose, Nav2Names, Nav2Robot, RosAddress, RosDialect, RosLink, standard_interfaces,
};
use simulated_nav2::{Nav2Settings, RobotWire, SimulatedNav2};

/// Number of goals that are timed.
const GOALS: usize = 300;

/// Number of goals before the first that is timed: the first ones open routes.
const WARM_UP: usize = 20;

fn main() {
    let runtime = tokio::runtime::Builder::new_multi_thread().enable_all().build();
    let runtime = runtime.expect("a runtime");
    for (wire, dialect, domain_id) in [
        (RobotWire::Ros2Dds, RosDialect::Ros2Dds, 0),
        (RobotWire::RmwZenoh(7), RosDialect::RmwZenoh, 7),
    ] {
        let (mut sent, mut ended) = runtime.block_on(drive(wire, dialect, domain_id));
        println!("{dialect:?}: goal at Nav2 {}; goal over {}", told(&mut sent), told(&mut ended));
    }
}

fn told(times: &mut [Duration]) -> String {
    times.sort_unstable();
    let at = |share: f64| times[((times.len() - 1) as f64 * share) as usize];
    format!("p50 {:.2?}, p99 {:.2?}", at(0.5), at(0.99))
}

async fn drive(
    wire: RobotWire,
    dialect: RosDialect,
    domain_id: u32,
) -> (Vec<Duration>, Vec<Duration>) {
    let mut layout = Layout::new();
    layout.add_corridor("hall", 20.0).expect("a corridor");
    layout.add_room("lab", 20.0).expect("a room");
    layout.connect("hall", "lab", 5.0).expect("a door");
    layout.add_robot("robot", "hall", 1.0).expect("a robot");
    // In this building nothing takes time.
    let building = Building::new(layout, 0.0).expect("a building");
    let places = [("hall", 0.0), ("lab", 5.0)];
    let settings = Nav2Settings {
        robot: "robot".to_owned(),
        wire,
        listen: None,
        namespace: String::new(),
        places: places
            .map(|(place, x)| (place.to_owned(), (x, 0.0)))
            .into_iter()
            .collect::<BTreeMap<_, _>>(),
        battery_range: None,
    };
    let nav2 = SimulatedNav2::start(building.handle(), settings).await.expect("a robot");
    let endpoint = nav2.endpoint().to_owned();
    let address = RosAddress { endpoint, dialect, namespace: String::new(), domain_id };
    let link = RosLink::open(address, Arc::new(standard_interfaces())).expect("an address");
    let robot = Nav2Robot::new(link, Nav2Names::default());
    let (mut sent, mut ended) = (Vec::new(), Vec::new());
    for number in 0..WARM_UP + GOALS {
        let x = if number % 2 == 0 { 5.0 } else { 0.0 };
        let began = Instant::now();
        let arrived = async {
            robot.drive(MapPose { x, y: 0.0, yaw: 0.0 }, |_| ()).await.expect("it arrives");
            began.elapsed()
        };
        let goals = u64::try_from(number + 1).unwrap_or(u64::MAX);
        let at_nav2 = async {
            nav2.until_goals(goals).await;
            began.elapsed()
        };
        let (over, received) = tokio::join!(arrived, at_nav2);
        if number >= WARM_UP {
            sent.push(received);
            ended.push(over);
        }
    }
    (sent, ended)
}
