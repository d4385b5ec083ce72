//! Checks of a building beyond its files: sensors that no goal asks for, and two agents that use one
//! thing.

use crate::mistakes::{MAP, SCHOOL, WARNING, all_told, check, told};

/// Returns the school with more entries of agents before its goals.
fn with(entries: &str) -> String {
    SCHOOL.replacen("[goals]", &format!("{entries}\n[goals]"), 1)
}

/// Returns the reports on the school with two more entries, each with a driver and a `config`.
#[track_caller]
fn of_two(plugin: &str, driver: &str, daemons: [&str; 2], configs: [&str; 2]) -> Vec<String> {
    let entry = |name: &str, daemon: &str, config: &str| {
        format!(
            "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndriver = \"{driver}\"\n\
             daemon = \"{daemon}\"\nconfig = {{ {config} }}\n\n"
        )
    };
    let entries = entry("first", daemons[0], configs[0]) + &entry("second", daemons[1], configs[1]);
    let told = told(&with(&entries), MAP);
    // What stops a robot whose daemon dies is not asked here.
    let about_two = told.into_iter().filter(|(.., text)| !text.starts_with("if the daemon of"));
    about_two.map(|(severity, _, text)| format!("{severity}: {text}")).collect()
}

#[track_caller]
fn rivals(plugin: &str, driver: &str, configs: [&str; 2], words: &[&str]) {
    let told = of_two(plugin, driver, ["class-a-pi"; 2], configs);
    let [only] = told.as_slice() else { panic!("one report: {told:#?}") };
    for word in words.iter().chain(&["`second`", "so does `first`"]) {
        assert!(only.contains(word), "no `{word}`: {only}");
    }
}

#[test]
fn one_line_of_a_board_has_one_agent() {
    let lamps = [
        "location = \"class-a\", kind = \"lamp\", line = \"GPIO17\"",
        "location = \"class-b\", kind = \"relay\", line = \"GPIO17\"",
    ];
    rivals("switch", "gpio", lamps, &["error: ", "the GPIO line `GPIO17`"]);
    // Another machine has another line of the same name.
    assert_eq!(of_two("switch", "gpio", ["class-a-pi", "class-b-pi"], lamps), [""; 0]);
    let other = [lamps[0], "location = \"class-b\", kind = \"relay\", line = \"GPIO18\""];
    assert_eq!(of_two("switch", "gpio", ["class-a-pi"; 2], other), [""; 0]);
}

#[test]
fn one_topic_and_one_device_have_one_agent() {
    let topic = |room: &str, topic: &str| {
        format!(
            "location = \"{room}\", broker = \"localhost:1883\", topic = \"{topic}\", json = \"/t\""
        )
    };
    let (a, b) = (topic("class-a", "home/a"), topic("class-b", "home/a"));
    rivals("temperature-sensor", "mqtt", [&a, &b], &["warning: ", "the topic `home/a`"]);
    let b = topic("class-b", "home/b");
    assert_eq!(of_two("temperature-sensor", "mqtt", ["class-a-pi"; 2], [&a, &b]), [""; 0]);
    let device = |room: &str| format!("location = \"{room}\", device = \"bme280@i2c-1/1-0076\"");
    let devices = [device("class-a"), device("class-b")];
    let devices = [devices[0].as_str(), devices[1].as_str()];
    rivals("temperature-sensor", "linux", devices, &["the sensor `bme280@i2c-1/1-0076`"]);
}

#[test]
fn one_robot_has_one_agent() {
    let pose = "{ x = 0.0, y = 0.0, yaw = 0.0 }";
    let places = ["passage", "yard", "class-a", "class-b", "entrance"];
    let places: Vec<_> = places.map(|place| format!("{place} = {pose}")).into();
    let places = places.join(", ");
    let robot = |namespace: &str| {
        format!(
            "start = \"passage\", ros2 = {{ endpoint = \"tcp/10.0.0.7:7447\", \
             namespace = \"{namespace}\", places = {{ {places} }} }}"
        )
    };
    let (same, other) = (robot("r1"), robot("r2"));
    rivals("turtlebot", "ros2", [&same, &same], &["error: ", "the robot at `tcp/10.0.0.7:7447`"]);
    assert_eq!(of_two("turtlebot", "ros2", ["class-a-pi"; 2], [&same, &other]), [""; 0]);
    // Slashes at the ends of a namespace do not count.
    for (one, another) in [("/r1/", "r1"), ("/", "")] {
        let two = [robot(one), robot(another)];
        let two = [two[0].as_str(), two[1].as_str()];
        rivals("turtlebot", "ros2", two, &["error: ", "the robot at `tcp/10.0.0.7:7447`"]);
    }
    let of_domain = |domain: u8, dialect: &str| {
        let keys = format!("domain-id = {domain}, dialect = \"{dialect}\", places");
        same.replacen("places", &keys, 1)
    };
    // A bridge names its domain by itself.
    let idle = of_domain(3, "ros2dds");
    let told = of_two("turtlebot", "ros2", ["class-a-pi"; 2], [&same, &idle]);
    let begins = |words: &str| told.iter().any(|text| text.starts_with(words));
    assert_eq!(told.len(), 2, "{told:#?}");
    assert!(begins("error: `second` uses the robot at"), "{told:#?}");
    assert!(begins("warning: `domain-id` has no effect with dialect = \"ros2dds\""), "{told:#?}");
    let two = [of_domain(3, "rmw-zenoh"), of_domain(4, "rmw-zenoh")];
    assert_eq!(of_two("turtlebot", "ros2", ["class-a-pi"; 2], [&two[0], &two[1]]), [""; 0]);
}

#[test]
fn one_thing_of_the_network_has_one_agent_however_it_is_written() {
    let screen = |address: &str, medium: &str| {
        format!(
            "location = \"class-a\", address = \"{address}\", \
             media = {{ {medium} = \"http://10.0.0.2/{medium}.mp4\" }}"
        )
    };
    let (one, other) = (screen("10.0.0.7", "one"), screen("10.0.0.7:8009", "other"));
    rivals("screen", "cast", [&one, &other], &["warning: ", "the Chromecast `10.0.0.7:8009`"]);
    let other = screen("10.0.0.7:32187", "other");
    assert_eq!(of_two("screen", "cast", ["class-a-pi"; 2], [&one, &other]), [""; 0]);
    let lamp = |room: &str, more: &str| {
        format!("location = \"{room}\", kind = \"lamp\", line = \"GPIO17\"{more}")
    };
    let lamps = [lamp("class-a", ""), lamp("class-b", ", chips = \"/dev\"")];
    rivals("switch", "gpio", [&lamps[0], &lamps[1]], &["error: ", "the GPIO line `GPIO17`"]);
}

#[test]
fn a_sensor_that_no_goal_asks_for_is_noted() {
    let told = all_told(SCHOOL, MAP);
    let [(severity, place, text)] = told.as_slice() else { panic!("one hint: {told:#?}") };
    assert_eq!((severity.as_str(), place.as_str()), ("hint", "files/school.toml:34"));
    assert!(text.contains("no goal of this file asks for what `air-b` measures"), "{text}");
    assert!(text.contains("(known-co2 class-b)"), "the goal to write: {text}");
    let asked = SCHOOL.replacen("[goals]", "[goals]\nair = \"(known-co2 class-b)\"", 1);
    assert_eq!(all_told(&asked, MAP), []);
    let elsewhere = SCHOOL.replacen("[goals]", "[goals]\nair = \"(known-co2 class-a)\"", 1);
    assert!(all_told(&elsewhere, MAP).iter().any(|(severity, ..)| severity == "hint"));
}

#[test]
fn two_agents_of_one_gateway() {
    let gateway = |name: &str, more: &str| {
        format!(
            "[[agent]]\nname = \"{name}\"\nplugin = \"mqtt\"\ndaemon = \"office-pc\"\n\
             config = {{ broker = \"localhost:1883\"{more} }}\n\n"
        )
    };
    let twice = with(&(gateway("zigbee", "") + &gateway("zwave", "")));
    let words = ["`zwave` uses the broker `localhost:1883`", "each device would appear twice"];
    check(&twice, MAP, WARNING, "files/school.toml:73", &words);
    let (a, b) = (", devices = [\"a\"]", ", devices = [\"b\"]");
    assert_eq!(told(&with(&(gateway("zigbee", a) + &gateway("zwave", b))), MAP), []);
}
