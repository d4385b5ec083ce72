//! Stops, on real processes: a robot that drives stands still, and begins nothing until the stop is
//! released. The building of the simulated Nav2 is in the process of the test, and its truth
//! decides.

use building::{BuildingEvent, Truth};
use simulated_nav2::RobotWire;

use crate::robots::{PLACES, ROBOT, Robot, entry};
use crate::support::{Office, lab, stderr, stdout};

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

fn is_departure(event: &BuildingEvent) -> bool {
    matches!(event, BuildingEvent::Departed { .. })
}

fn is_stay(event: &BuildingEvent) -> bool {
    matches!(event, BuildingEvent::Stayed { .. })
}

fn count(truth: &Truth, is_it: fn(&BuildingEvent) -> bool) -> usize {
    truth.occurrences().filter(|occurrence| is_it(&occurrence.event)).count()
}

/// Returns how many trips of the robot began and ended without arrival in the building.
fn trips(robot: &Robot) -> (usize, usize) {
    let truth = robot.building.truth();
    (count(&truth, is_departure), count(&truth, is_stay))
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

/// Returns the entry of a button whose contact is what a file says: 1 is closed, 0 is open.
fn button(file: &std::path::Path) -> String {
    format!(
        "[[agent]]\nname = \"button-1\"\nplugin = \"sensor\"\ndriver = \"command\"\n\n\
         [agent.config]\nquantity = \"contact\"\nlocation = \"office2\"\nevery = \"100ms\"\n\
         command = [\"cat\", \"{}\"]\n\n",
        file.display()
    )
}

/// Sets the contact of the button; its program never reads half of it.
fn set_contact(office: &Office, contact: &str) {
    let beside = office.write("contact.new", contact);
    std::fs::rename(&beside, beside.with_extension("")).expect("renamed");
}

/// The button and the robot are on different daemons. The button is pressed, is released, and loses
/// its daemon.
#[test]
fn a_hardware_stop_stops_a_robot_of_another_daemon() {
    let robot = Robot::start(RobotWire::Ros2Dds, "tb1", 1.0);
    let office = Office::new();
    let contact = office.write("contact", "1\n");
    let on = |daemon: &str, text: &str| {
        text.replace("\nplugin = ", &format!("\ndaemon = \"{daemon}\"\nplugin = "))
    };
    let entry = entry(robot.nav2.endpoint(), "ros2dds", &PLACES);
    let rule = "[hardware-stops.button-1]\nstops = [\"turtlebot-1\"]\nfail-safe = true\n";
    let file = on("reasoning", &lab("centralized"))
        + &on("hall", &button(&contact))
        + &on("laptop", &entry)
        + "\n"
        + rule;
    let file = office.write("lab.toml", &file);
    let mut office = office.with_file(file);
    office.up(&["reasoning", "hall", "laptop"], &[]);
    office.await_devices(2);
    office.await_fact(&format!("(at {ROBOT} corridor)"), true);
    office.await_fact("(shut button-1)", true);
    // The machines may have started one after the other.
    office.run(&["stop", "--release"]);
    let list = |office: &Office| stdout(&office.run(&["stop", "--list"]));
    assert_eq!(list(&office), "nothing is stopped\nhardware stop button-1: not pressed\n");

    let mut asked = office.command(&["act", &format!("(move {ROBOT} corridor office1)")]);
    let mut asked = asked.spawn().expect("a command");
    robot.await_event(|event| matches!(event, BuildingEvent::Departed { .. }));
    set_contact(&office, "0\n");
    robot.await_event(|event| matches!(event, BuildingEvent::Stayed { .. }));
    let said = list(&office);
    assert!(said.contains("button-1") && said.contains("2 of 2"), "{said}");
    assert!(said.contains("turtlebot-1 (it was pressed)"), "{said}");
    assert!(said.contains("hardware stop button-1: PRESSED"), "{said}");
    let (code, said) = office.ask(&["stop", "--release"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("`button-1` stops it: it is pressed"), "{said}");
    let step = format!("(move {ROBOT} corridor office2)");
    let (code, said) = office.ask(&["act", &step]);
    assert_ne!(code, Some(0), "{said}");

    set_contact(&office, "1\n");
    office.await_fact("(shut button-1)", true);
    let (code, said) = office.ask(&["stop", "--release"]);
    assert_eq!(code, Some(0), "{said}");
    let mut driving = office.command(&["act", &step]);
    let mut driving = driving.spawn().expect("a command");
    robot.await_truth(|truth| count(truth, is_departure) == 2);
    office.kill("hall");
    robot.await_truth(|truth| count(truth, is_stay) == 2);
    let (_, said) = office.ask(&["agents"]);
    assert!(said.contains("hardware stop button-1: SILENT for 1 of 1 actuators"), "{said}");
    for asked in [&mut asked, &mut driving] {
        let _ = asked.kill();
        asked.wait().expect("it ends");
    }
}

#[test]
fn mistakes_in_hardware_stops_are_reported() {
    let office = Office::new();
    let contact = office.write("contact", "1\n");
    let entries = button(&contact)
        + "[[agent]]\nname = \"thermometer-1\"\nplugin = \"temperature-sensor\"\n\
           config = { location = \"office1\" }\n\n\
           [[agent]]\nname = \"co2-1\"\nplugin = \"sensor\"\n\
           config = { location = \"office1\", quantity = \"co2\" }\n\n";
    for (rule, complaint) in [
        ("button-1 = {}", "`fail-safe` is missing"),
        ("button-1 = { fail-safe = \"yes\" }", "true or false"),
        ("buton-1 = { fail-safe = true }", "did you mean `button-1`?"),
        ("button-1 = { fail-safe = true, stops = \"lobby7\" }", "no place of the map"),
        ("button-1 = { fail-safe = true, pressed = \"shut\" }", "none of \"open\", \"closed\""),
        ("button-1 = { fail-safe = true, pressed = \"(prest button-1)\" }", "`prest`"),
        ("button-1 = { fail-safe = true, release = \"me\" }", "\"person\" or \"button\""),
        ("button-1 = { fail-safe = true, stops = \"ofice1\" }", "did you mean `office1`?"),
        ("thermometer-1 = { fail-safe = true }", "its plugin is `temperature-sensor`"),
        ("office1 = { fail-safe = true }", "`office1` is an object of the map, and no agent"),
        ("button-1 = { fail-safe = true, stops = [] }", "`stops` is empty"),
        ("co2-1 = { fail-safe = true }", "`co2-1` measures co2, and is no contact"),
    ] {
        let text = format!("{}{entries}[hardware-stops]\n{rule}\n", lab("centralized"));
        let file = office.write("lab.toml", &text);
        let checked = office.run(&["check", &file.display().to_string()]);
        // The lines are wrapped.
        let said = stderr(&checked);
        let said = said.split_whitespace().collect::<Vec<_>>().join(" ");
        assert!(said.contains(complaint), "{complaint}: {said}");
    }
    let right = "button-1 = { fail-safe = false, pressed = \"closed\", stops = \"office1\" }";
    let text = format!("{}{entries}[hardware-stops]\n{right}\n", lab("centralized"));
    let file = office.write("lab.toml", &text);
    let checked = office.run(&["check", &file.display().to_string()]);
    assert!(checked.status.success(), "{}", stderr(&checked));
}
