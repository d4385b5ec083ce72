//! Robots with ROS 2, from the config to a goal. The robot's Nav2 is simulated in the process of
//! the test, drives in a simulated building, and is reached over Zenoh as real robots are. The
//! building's truth decides.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use building::{Building, BuildingEvent, Layout, Truth};
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
        let [(corridor, ..), rooms @ ..] = PLACES;
        let doors = rooms.map(|(room, ..)| (corridor, room, 6.0));
        Robot::start_in(&doors, wire, namespace, pace)
    }

    /// Starts a robot in a building with these doors, each with the length of the way.
    fn start_in(doors: &[(&str, &str, f64)], wire: RobotWire, namespace: &str, pace: f64) -> Robot {
        let runtime = Runtime::new().expect("a runtime");
        let mut layout = Layout::new();
        layout.add_corridor(PLACES[0].0, 20.0).expect("a corridor");
        for (room, ..) in &PLACES[1..] {
            layout.add_room(room, 20.0).expect("a room");
        }
        for (from, to, meters) in doors {
            layout.connect(from, to, *meters).expect("a door");
        }
        layout.add_robot(ROBOT, PLACES[0].0, 0.5).expect("a robot");
        layout.mount_screen(&format!("{ROBOT}-screen"), ROBOT).expect("a screen");
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

    /// Switches the robot off. Returns its building.
    pub(crate) fn switch_off(self) -> Building {
        self.runtime.block_on(self.nav2.close());
        self.building
    }

    pub(crate) fn place(&self) -> String {
        self.building.place_of(ROBOT).expect("the robot")
    }

    /// Waits until the building has seen such an event.
    pub(crate) fn await_event(&self, is_it: fn(&BuildingEvent) -> bool) {
        self.await_truth(|truth| truth.any(is_it));
    }

    /// Waits until the truth of the building is as wanted.
    pub(crate) fn await_truth(&self, is_so: impl FnMut(&Truth) -> bool) {
        let seen = self.building.wait_for(is_so);
        let seen = async { tokio::time::timeout(PATIENCE, seen).await };
        self.runtime.block_on(seen).expect("the building has seen it in time");
    }
}

/// Returns the entry of a robot at `endpoint`, with the poses of `places`.
pub(crate) fn entry(endpoint: &str, dialect: &str, places: &[(&str, f64, f64)]) -> String {
    let domain = if dialect == "rmw-zenoh" { "domain-id = 7\n" } else { "" };
    let mut text = format!(
        "[[agent]]\nname = \"{ROBOT}\"\nplugin = \"turtlebot\"\ndriver = \"ros2\"\n\n\
         [agent.config]\nstart = \"corridor\"\nblocked-for = 1\n\n\
         [agent.config.ros2]\nendpoint = \"{endpoint}\"\nnamespace = \"tb1\"\n\
         dialect = \"{dialect}\"\n{domain}\n[agent.config.ros2.places]\n"
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
        office.await_fact(&format!("(blocked {ROBOT} office1 corridor)"), true);
        office.await_fact(&format!("(blocked {ROBOT} office1 corridor)"), false);

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
fn a_robot_that_nothing_can_stop_is_reported() {
    let office = Office::new();
    let watchdog = |robot: &str, daemon: &str| {
        format!(
            "[[agent]]\nname = \"watchdog\"\nplugin = \"robot-watchdog\"\ndaemon = \"{daemon}\"\n\
             [agent.config]\nrobot = \"{robot}\"\non-loss = \"dock\"\n\
             [agent.config.ros2]\nendpoint = \"tcp/127.0.0.1:7447\"\nnamespace = \"tb1\"\n\
             dialect = \"ros2dds\"\n"
        )
    };
    let entry = entry("tcp/127.0.0.1:7447", "ros2dds", &PLACES)
        .replace("plugin = \"turtlebot\"", "plugin = \"turtlebot\"\ndaemon = \"laptop\"");
    for (watchdog, complaint) in [
        (String::new(), Some("if the daemon of `turtlebot-1` dies, the robot finishes its goal")),
        (watchdog(ROBOT, "laptop"), Some("give `watchdog` another daemon than `turtlebot-1` has")),
        (watchdog("turtlebot-2", "hall"), Some("there is no agent `turtlebot-2`")),
        (
            watchdog(ROBOT, "hall").replace("tb1", "tb2"),
            Some("warning: `namespace` is not that of `turtlebot-1`"),
        ),
        (watchdog("plan-executor", "hall"), Some("`plan-executor` is no robot")),
        (watchdog(ROBOT, "hall"), None),
    ] {
        let file = office.write("lab.toml", &(lab("decentralized") + &entry + "\n" + &watchdog));
        let checked = office.run(&["check", &file.display().to_string()]);
        let said = stderr(&checked).split_whitespace().collect::<Vec<_>>().join(" ");
        match complaint {
            Some(complaint) => assert!(said.contains(complaint), "{complaint}: {said}"),
            None => assert!(!said.contains("robot"), "{said}"),
        }
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
        (
            entry("tcp/127.0.0.1:7447", "ros2dds", &PLACES[..3]),
            "drive it there, and `althing robot turtlebot-1 conf-room` prints the line to write",
        ),
        (
            entry("tcp/127.0.0.1:7447", "ros2dds", &PLACES).replacen(
                "y = 0 }",
                "y = 0, yaw = 90.0 }",
                1,
            ),
            "yaw is in radians",
        ),
        (entry("192.168.1.20", "ros2dds", &PLACES), "an endpoint is such as"),
        (
            entry("tcp/127.0.0.1:7447", "ros2dds", &[]).replace("[agent.config.ros2.places]", ""),
            "`places` is missing in `ros2`",
        ),
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

/// The file gives the watchdog and the robot daemons of their own, and one process hosts both.
#[test]
fn a_watchdog_that_a_lone_machine_hosts_beside_its_robot_is_reported() {
    let office = Office::new();
    let watchdog = format!(
        "[[agent]]\nname = \"watchdog\"\nplugin = \"robot-watchdog\"\ndaemon = \"hall\"\n\
         [agent.config]\nrobot = \"{ROBOT}\"\non-loss = \"stop\"\n\
         [agent.config.ros2]\nendpoint = \"tcp/127.0.0.1:9\"\nnamespace = \"tb1\"\n\
         dialect = \"ros2dds\"\n"
    );
    let entry = entry("tcp/127.0.0.1:9", "ros2dds", &PLACES)
        .replace("plugin = \"turtlebot\"", "plugin = \"turtlebot\"\ndaemon = \"laptop\"");
    let file = office.write("lab.toml", &(lab("decentralized") + &entry + "\n" + &watchdog));
    let output = office.run(&["up", &file.display().to_string(), "--until-stdin-ends"]);
    // The name of this machine is none of the file's, so it hosts all agents.
    let said = stderr(&output).split_whitespace().collect::<Vec<_>>().join(" ");
    let expected = format!("hosts both `{ROBOT}` and its watchdog `watchdog`");
    assert!(said.contains(&expected), "{said}");
}

/// Returns the file of an office whose map has this ring of ways in both directions, with the
/// lengths that a robot can be wrong about.
fn ring(office: &Office, entry: &str) -> PathBuf {
    let mut map = String::from(
        "(define (problem ring) (:domain smart-office)
        (:objects office1 office2 conf-room - room corridor - corridor)
        (:init (= (total-cost) 0)",
    );
    for (from, to, meters) in RING {
        for (from, to) in [(from, to), (to, from)] {
            write!(map, " (connected {from} {to}) (= (distance {from} {to}) {meters})")
                .expect("a text");
        }
    }
    map += ") (:goal (and)) (:metric minimize (total-cost)))";
    let map = office.write("ring.pddl", &map).display().to_string();
    let file = lab("centralized") + entry;
    let line = file.lines().find(|line| line.starts_with("problem = ")).expect("it has a map");
    office.write("lab.toml", &file.replace(line, &format!("problem = \"{map}\"")))
}

/// Two ways lead from the corridor to the first office.
const RING: [(&str, &str, f64); 4] = [
    ("corridor", "office1", 6.0),
    ("corridor", "office2", 6.0),
    ("office2", "conf-room", 6.0),
    ("conf-room", "office1", 6.0),
];

#[test]
fn a_robot_goes_around_a_way_that_is_blocked() {
    let robot = Robot::start_in(&RING, RobotWire::Ros2Dds, "tb1", 0.01);
    robot.building.lock_door("corridor", "office1").expect("a door");
    let office = Office::new();
    let entry = entry(robot.nav2.endpoint(), "ros2dds", &PLACES).replace("blocked-for = 1", "");
    let file = ring(&office, &entry);
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);

    let (code, said) = office.ask(&["goal", &format!("(at {ROBOT} office1)")]);
    assert_eq!((code, robot.place().as_str()), (Some(0), "office1"), "{said}");
    assert!(said.contains("the door is locked (error 9000)"), "{said}");
    let truth = robot.building.truth();
    let trips = truth.occurrences().filter_map(|occurrence| match &occurrence.event {
        BuildingEvent::Moved { to, .. } => Some(to.clone()),
        _ => None,
    });
    assert_eq!(trips.collect::<Vec<_>>(), ["office2", "conf-room", "office1"]);

    // Without another way, the goal ends with the reason, and does not wait.
    robot.building.lock_door("office1", "conf-room").expect("a door");
    let (code, said) = office.ask(&["goal", &format!("(at {ROBOT} office2)")]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains(&format!("`(blocked {ROBOT} ")), "{said}");
    assert!(said.contains("prevents it, which no agent here ends"), "{said}");
    assert_eq!(robot.place(), "office1");
}

/// The map says that both ways from the corridor to the office are equally long.
#[test]
fn a_robot_prefers_ways_that_have_taken_less_time() {
    let slow = [("corridor", "office1", 30.0), RING[1], RING[2], RING[3]];
    let robot = Robot::start_in(&slow, RobotWire::Ros2Dds, "tb1", 0.05);
    let office = Office::new();
    // In the building of the test, a second takes 50 ms, so that the robot is so much faster.
    let entry =
        entry(robot.nav2.endpoint(), "ros2dds", &PLACES).replace("blocked-for = 1", "speed = 10.0");
    let file = ring(&office, &entry);
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    let cost = |office: &Office| {
        let state = office.ask_json(&["state"]).to_string();
        let told = state.split(&format!("(travel {ROBOT} corridor office1) ")).nth(1);
        let told = told.expect("it tells the cost").split(')').next().expect("a number");
        told.parse::<f64>().expect("a number")
    };
    assert!((cost(&office) - 6.0).abs() < 0.01);
    for place in ["office1", "corridor"] {
        let (code, said) = office.ask(&["goal", &format!("(at {ROBOT} {place})")]);
        assert_eq!((code, robot.place().as_str()), (Some(0), place), "{said}");
    }
    let learned = cost(&office);
    assert!(learned > 10.0, "{learned}");

    // A restart of the daemon does not forget what driving took.
    office.kill("alone");
    office.up_alone(&[]);
    office.await_devices(1);
    assert_eq!(cost(&office), learned);
}

#[test]
fn a_cleaning_robot_sweeps_the_lanes_of_a_room() {
    let robot = Robot::start(RobotWire::RmwZenoh(7), "tb1", 0.01);
    let office = Office::new();
    let lanes = "brush = \"brush\"\n[agent.config.lanes]\n\
        office1 = [{ x = 6.0, y = 1.0 }, { x = 7.0, y = 1.0 }, { x = 7.0, y = -1.0 }]\n\n\
        [agent.config.ros2]\n";
    let entry = entry(robot.nav2.endpoint(), "rmw-zenoh", &PLACES)
        .replace("plugin = \"turtlebot\"", "plugin = \"cleaning-robot\"")
        .replace("[agent.config.ros2]\n", lanes);
    let file = lab("centralized") + &entry;
    let line = file.lines().find(|line| line.starts_with("domain = ")).expect("it has a domain");
    let domain = line.split('"').nth(1).expect("a path");
    let domain = std::fs::read_to_string(domain).expect("it is there");
    let domain = domain.replacen("(:predicates", "(:predicates (swept ?l - location)", 1);
    let domain = office.write("domain.pddl", &domain).display().to_string();
    let file = file.replace(line, &format!("domain = \"{domain}\""));
    let file = office.write("lab.toml", &file);
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(swept office1)"]);
    let truth = robot.building.truth();
    let is_swept = |event: &BuildingEvent| matches!(event, BuildingEvent::Swept { location, .. } if location == "office1");
    assert!(code == Some(0) && truth.any(is_swept), "{said}");
    assert!(!robot.nav2.is_brush_on());
    // It is back at the pose of the room, and so can go on.
    let (code, said) = office.ask(&["goal", &format!("(at {ROBOT} corridor)")]);
    assert_eq!((code, robot.place().as_str()), (Some(0), "corridor"), "{said}");
    let (code, said) = office.ask(&["goal", "(swept office2)"]);
    assert_ne!(code, Some(0), "it has no lanes there: {said}");
}

#[test]
fn a_video_robot_shows_a_text_on_its_display() {
    let robot = Robot::start(RobotWire::Ros2Dds, "tb1", 0.01);
    let office = Office::new();
    let entry = entry(robot.nav2.endpoint(), "ros2dds", &PLACES)
        .replace("plugin = \"turtlebot\"", "plugin = \"video-robot\"")
        .replace("blocked-for = 1\n", "media = { slides = \"the slides\" }\n");
    let file = office.write("lab.toml", &(lab("centralized") + &entry));
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(presented slides conf-room)"]);
    assert_eq!((code, robot.place().as_str()), (Some(0), "conf-room"), "{said}");
    robot.await_event(
        |event| matches!(event, BuildingEvent::Shown { text, .. } if text == "the slides"),
    );
}

#[test]
fn a_robot_that_was_never_there_offers_nothing() {
    let office = Office::new();
    let file = lab("centralized") + &entry("tcp/127.0.0.1:9", "ros2dds", &PLACES);
    let file = office.write("lab.toml", &file);
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_fact(&format!("(lost {ROBOT})"), true);
    office.await_fact(&format!("(at {ROBOT} corridor)"), false);
    office.await_devices(0);
}

/// The daemon of a robot is killed while the robot drives; the watchdog runs on another machine.
#[test]
fn a_robot_whose_daemon_dies_is_stopped_by_its_watchdog() {
    let robot = Robot::start(RobotWire::RmwZenoh(7), "tb1", 1.0);
    let office = Office::new();
    let on = |daemon: &str, text: &str| {
        text.replace("\nplugin = ", &format!("\ndaemon = \"{daemon}\"\nplugin = "))
    };
    let watchdog = format!(
        "[[agent]]\nname = \"watchdog-1\"\nplugin = \"robot-watchdog\"\ndaemon = \"hall\"\n\n\
         [agent.config]\nrobot = \"{ROBOT}\"\non-loss = \"stop\"\nafter = \"200ms\"\n\n\
         [agent.config.ros2]\nendpoint = \"{}\"\nnamespace = \"tb1\"\n\
         dialect = \"rmw-zenoh\"\ndomain-id = 7\n\n",
        robot.nav2.endpoint()
    );
    let entry = entry(robot.nav2.endpoint(), "rmw-zenoh", &PLACES);
    let file = on("hall", &lab("centralized")) + &on("laptop", &entry) + "\n\n" + &watchdog;
    let file = office.write("lab.toml", &file);
    let mut office = office.with_file(file);
    office.up(&["hall", "laptop"], &[]);
    office.await_devices(1);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);
    let mut asked = office.command(&["act", &format!("(move {ROBOT} corridor office1)")]);
    let mut asked = asked.spawn().expect("a command");
    robot.await_event(|event| matches!(event, BuildingEvent::Departed { .. }));

    office.kill("laptop");
    robot.await_event(|event| matches!(event, BuildingEvent::Stayed { .. }));
    assert_eq!(robot.place(), "corridor");
    let _ = asked.kill();
    asked.wait().expect("it ends");

    // A daemon that is back drives the robot as before, and the watchdog lets it.
    office.up(&["laptop"], &[]);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);
    office.await_devices(1);
    let (code, said) = office.ask(&["act", &format!("(move {ROBOT} corridor office2)")]);
    assert_eq!((code, robot.place().as_str()), (Some(0), "office2"), "{said}");
}
