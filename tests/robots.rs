//! Robots with ROS 2, from the config to a goal. The robot's Nav2 is simulated in the process of
//! the test, drives in a simulated building, and is reached over Zenoh as real robots are. The
//! building's truth decides.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use building::{Building, BuildingEvent, Layout};
use simulated_nav2::{Nav2Settings, RobotWire, SimulatedNav2};
use tokio::runtime::Runtime;

use crate::support::{Office, PATIENCE, lab, stderr, stdout};

/// The places of the smart office's map, with their positions on the robot's map.
pub(crate) const PLACES: [(&str, f64, f64); 4] = [
    ("corridor", 0.0, 0.0),
    ("office1", 6.0, 0.0),
    ("office2", -6.0, 0.0),
    ("conf-room", 0.0, 6.0),
];

pub(crate) const ROBOT: &str = "turtlebot-1";

/// A robot in a building of its own, with the runtime of its Zenoh session.
pub(crate) struct Robot {
    pub(crate) building: Building,
    pub(crate) nav2: SimulatedNav2,
    settings: Nav2Settings,
    runtime: Runtime,
}

impl Robot {
    /// Starts a robot. A second of the building takes `pace` seconds.
    pub(crate) fn start(wire: RobotWire, namespace: &str, pace: f64) -> Robot {
        let runtime = Runtime::new().expect("a runtime");
        let mut layout = Layout::new();
        layout.add_corridor(PLACES[0].0, 20.0).expect("a corridor");
        for (room, ..) in &PLACES[1..] {
            layout.add_room(room, 20.0).expect("a room");
            layout.connect(PLACES[0].0, room, 6.0).expect("a door");
        }
        layout.add_robot(ROBOT, PLACES[0].0, 0.5).expect("a robot");
        let building = Building::new(layout, pace).expect("a building");
        let places = PLACES.map(|(place, x, y)| (place.to_owned(), (x, y)));
        let settings = Nav2Settings {
            robot: ROBOT.to_owned(),
            wire,
            listen: None,
            namespace: namespace.to_owned(),
            places: BTreeMap::from(places),
            battery_range: None,
        };
        let nav2 = runtime.block_on(SimulatedNav2::start(building.handle(), settings.clone()));
        Robot { building, nav2: nav2.expect("a robot"), settings, runtime }
    }

    /// Switches the robot off, calls `meanwhile`, and switches it on again at the same endpoint.
    fn restart(self, meanwhile: impl FnOnce()) -> Robot {
        let Robot { building, nav2, settings, runtime } = self;
        let listen = Some(nav2.endpoint().to_owned());
        runtime.block_on(nav2.close());
        meanwhile();
        let again = Nav2Settings { listen, ..settings.clone() };
        let nav2 = runtime.block_on(SimulatedNav2::start(building.handle(), again));
        Robot { building, nav2: nav2.expect("a robot"), settings, runtime }
    }

    pub(crate) fn place(&self) -> String {
        self.building.place_of(ROBOT).expect("the robot")
    }

    /// Waits until the building has seen such an event.
    pub(crate) fn await_event(&self, is_it: fn(&BuildingEvent) -> bool) {
        let seen = self.building.wait_for(|truth| truth.any(is_it));
        let seen = async { tokio::time::timeout(PATIENCE, seen).await };
        self.runtime.block_on(seen).expect("the building has seen it in time");
    }
}

/// Returns the entry of a robot at `endpoint`, with the poses of `places`.
pub(crate) fn entry(endpoint: &str, dialect: &str, places: &[(&str, f64, f64)]) -> String {
    let mut text = format!(
        "[[agent]]\nname = \"{ROBOT}\"\nplugin = \"turtlebot\"\ndriver = \"ros2\"\n\n\
         [agent.config]\nstart = \"corridor\"\n\n\
         [agent.config.ros2]\nendpoint = \"{endpoint}\"\nnamespace = \"tb1\"\n\
         dialect = \"{dialect}\"\ndomain-id = 7\n\n[agent.config.ros2.places]\n"
    );
    for (place, x, y) in places {
        writeln!(text, "{place} = {{ x = {x}, y = {y} }}").expect("a text");
    }
    text
}

#[test]
fn a_robot_with_nav2_reaches_goals_in_both_dialects() {
    for (wire, dialect) in [(RobotWire::Ros2Dds, "ros2dds"), (RobotWire::RmwZenoh(7), "rmw-zenoh")]
    {
        let robot = Robot::start(wire, "tb1", 0.01);
        let office = Office::new();
        let file = lab("decentralized") + &entry(robot.nav2.endpoint(), dialect, &PLACES);
        let file = office.write("lab.toml", &file);
        let mut office = office.with_file(file);
        office.up_alone(&[]);
        office.await_devices(1);
        office.await_fact(&format!("(at {ROBOT} corridor)"), true);

        let file = office.file.display().to_string();
        let recorded = office.run(&["robot", ROBOT, "hall", "--ecosystem", &file]);
        let line = "hall = { x = 0.000, y = 0.000, yaw = 0.000 }\n";
        assert_eq!(stdout(&recorded), line, "{}", stderr(&recorded));

        let (code, said) = office.ask(&["goal", &format!("(at {ROBOT} office1)")]);
        assert_eq!((code, robot.place().as_str()), (Some(0), "office1"), "{said}");

        robot.building.lock_door("corridor", "office1").expect("a door");
        let (code, said) = office.ask(&["act", &format!("(move {ROBOT} office1 corridor)")]);
        assert_ne!(code, Some(0), "{said}");
        assert!(said.contains("the door is locked (error 9000)"), "{said}");
        robot.building.unlock_door("corridor", "office1").expect("a door");

        robot.nav2.set_localized(false);
        office.await_fact(&format!("(lost {ROBOT})"), true);
        office.await_fact(&format!("(at {ROBOT} office1)"), false);
        robot.nav2.set_localized(true);
        office.await_fact(&format!("(at {ROBOT} office1)"), true);

        let robot = robot.restart(|| {
            office.await_devices(0);
            office.await_fact(&format!("(at {ROBOT} office1)"), false);
        });
        office.await_devices(1);
        let (code, said) = office.ask(&["goal", &format!("(at {ROBOT} corridor)")]);
        assert_eq!((code, robot.place().as_str()), (Some(0), "corridor"), "{said}");
    }
}

#[test]
fn a_place_without_a_pose_is_refused() {
    let office = Office::new();
    for (entry, complaint) in [
        (
            entry("tcp/127.0.0.1:7447", "ros2dds", &PLACES[..2]),
            "config.ros2.places lacks the pose of",
        ),
        (entry("tcp/127.0.0.1:7447", "dds", &PLACES), "there is no dialect `dds`"),
        (entry("192.168.1.20", "ros2dds", &PLACES), "an endpoint is such as"),
        (
            entry("tcp/127.0.0.1:7447", "ros2dds", &PLACES).replace("office1 =", "office9 ="),
            "office9",
        ),
    ] {
        let file = office.write("lab.toml", &(lab("decentralized") + &entry));
        let checked = office.run(&["check", &file.display().to_string()]);
        assert!(!checked.status.success(), "{complaint}");
        // The lines are wrapped.
        let said = stderr(&checked).split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(complaint), "{said}");
    }
}
