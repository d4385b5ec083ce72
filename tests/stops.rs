//! Stops, on real processes: a robot that drives stands still, and begins nothing until the stop is
//! released. The building of the simulated Nav2 is in the process of the test, and its truth
//! decides.

use building::BuildingEvent;
use simulated_nav2::RobotWire;

use crate::robots::{PLACES, ROBOT, Robot, entry};
use crate::support::{Office, lab, stdout};

/// A robot whose trips take twelve seconds, in an office with one daemon.
fn office() -> (Robot, Office) {
    let robot = Robot::start(RobotWire::Ros2Dds, "tb1", 1.0);
    let office = Office::new();
    let file = lab("centralized") + &entry(robot.nav2.endpoint(), "ros2dds", &PLACES);
    let file = office.write("lab.toml", &file);
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);
    (robot, office)
}

/// Returns how many trips of the robot began and ended without arrival in the building.
fn trips(robot: &Robot) -> (usize, usize) {
    let truth = robot.building.truth();
    let count = |of: fn(&BuildingEvent) -> bool| {
        truth.occurrences().filter(|occurrence| of(&occurrence.event)).count()
    };
    let began = count(|event| matches!(event, BuildingEvent::Departed { .. }));
    (began, count(|event| matches!(event, BuildingEvent::Stayed { .. })))
}

#[test]
fn a_driving_robot_stands_still_until_the_stop_is_released() {
    let (robot, mut office) = office();
    let goal = format!("(at {ROBOT} office1)");
    let mut asked = office.command(&["goal", &goal]);
    let mut asked = asked.spawn().expect("a command");
    robot.await_event(|event| matches!(event, BuildingEvent::Departed { .. }));

    let (code, table) = office.ask(&["stop", "--because", "the fire alarm"]);
    assert_eq!(code, Some(0), "{table}");
    assert!(table.contains(&format!("stopped: (move {ROBOT} corridor office1)")), "{table}");
    // The answer comes when the robot has confirmed that it stands still.
    assert_eq!((robot.place().as_str(), trips(&robot)), ("corridor", (1, 1)));
    assert!(robot.nav2.zero_velocities() > 0, "its velocity is set to zero");
    office.await_devices(0);

    let step = format!("(move {ROBOT} corridor office2)");
    let (code, said) = office.ask(&["act", &step]);
    assert_ne!(code, Some(0), "{said}");
    let (_, table) = office.ask(&["stop"]);
    assert!(table.contains("was already still"), "{table}");
    let stops = office.ask_json(&["stop", "--list"])["stops"].clone();
    assert_eq!(stops.as_object().map(serde_json::Map::len), Some(2), "{stops}");

    // The stop outlives the process.
    office.kill("alone");
    office.up_alone(&[]);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);
    let (code, said) = office.ask(&["act", &step]);
    assert_ne!(code, Some(0), "{said}");

    // A release ends only the stops that it names.
    let ids: Vec<String> =
        stops.as_object().into_iter().flatten().map(|(id, _)| id.clone()).collect();
    let (code, said) = office.ask(&["stop", "--release", &ids[0]]);
    assert!(code == Some(0) && said.contains("still stopped"), "{said}");
    assert_eq!(trips(&robot).0, 1, "it has begun something");
    let (code, said) = office.ask(&["stop", "--release"]);
    assert!(code == Some(0) && said.contains("may act again"), "{said}");
    office.await_devices(1);
    let (code, said) = office.ask(&["act", &step]);
    assert_eq!((code, robot.place().as_str()), (Some(0), "office2"), "{said}");
    assert_eq!(stdout(&office.run(&["stop", "--list"])), "nothing is stopped\n");
    let _ = asked.kill();
    asked.wait().expect("it ends");
}

#[test]
fn a_stopped_place_is_not_entered() {
    let (robot, office) = office();
    let (code, table) = office.ask(&["stop", "office1"]);
    assert!(code == Some(0) && table.contains("was still; the stop does not name it"), "{table}");
    let (code, said) = office.ask(&["act", &format!("(move {ROBOT} corridor office1)")]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("stopped (office1) by `stop-"), "{said}");
    assert!(said.contains("althing stop --release"), "{said}");
    let (code, said) = office.ask(&["act", &format!("(move {ROBOT} corridor office2)")]);
    assert_eq!((code, robot.place().as_str()), (Some(0), "office2"), "{said}");
    // A name that nothing has is not taken for a success.
    let (code, table) = office.ask(&["stop", "turtlebot1"]);
    assert_ne!(code, Some(0), "{table}");
    assert!(table.contains("did you mean `turtlebot-1`?"), "{table}");
    assert!(table.contains("error: the stop concerns no agent"), "{table}");
    let (code, said) = office.ask(&["stop", "--release", "12345678"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("there is no stop `12345678`; in force: "), "{said}");
    // A robot that stands at a stopped place does nothing at all.
    let (_, table) = office.ask(&["stop", "office2"]);
    assert!(table.contains("was already still"), "{table}");
    office.await_devices(0);
}

/// Actuators of one daemon learn of a stop together; each still tells what the stop has ended.
#[test]
fn each_of_two_robots_of_a_daemon_tells_what_a_stop_has_ended() {
    let robots = [0, 1].map(|_| Robot::start(RobotWire::Ros2Dds, "tb1", 1.0));
    let names = [ROBOT, "turtlebot-2"];
    let entries = [0, 1].map(|number| {
        entry(robots[number].nav2.endpoint(), "ros2dds", &PLACES).replace(ROBOT, names[number])
    });
    let office = Office::new();
    let file = office.write("lab.toml", &(lab("centralized") + &entries.concat()));
    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(2);
    let mut asked = names.map(|name| {
        office.await_fact(&format!("(at {name} corridor)"), true);
        let mut command = office.command(&["act", &format!("(move {name} corridor office1)")]);
        command.spawn().expect("a command")
    });
    for robot in &robots {
        robot.await_event(|event| matches!(event, BuildingEvent::Departed { .. }));
    }
    let (code, table) = office.ask(&["stop"]);
    assert_eq!(code, Some(0), "{table}");
    for (name, robot) in names.iter().zip(&robots) {
        let line = format!("stopped: (move {name} corridor office1)");
        assert!(table.contains(&line), "{line}: {table}");
        robot.await_event(|event| matches!(event, BuildingEvent::Stayed { .. }));
    }
    for asked in &mut asked {
        asked.wait().expect("it ends");
    }
}

#[test]
fn a_stop_tells_that_a_robot_out_of_reach_may_go_on() {
    let (robot, office) = office();
    let mut asked = office.command(&["act", &format!("(move {ROBOT} corridor office1)")]);
    let mut asked = asked.spawn().expect("a command");
    robot.await_event(|event| matches!(event, BuildingEvent::Departed { .. }));
    // The building, in which the robot goes on, is held by the test.
    let building = robot.switch_off();
    let (code, table) = office.ask(&["stop"]);
    assert_ne!(code, Some(0), "{table}");
    let row = table.lines().find(|line| line.contains(ROBOT)).expect("it is in the table");
    assert!(row.contains("MAY GO ON: "), "{table}");
    drop(building);
    let _ = asked.kill();
    asked.wait().expect("it ends");
}
