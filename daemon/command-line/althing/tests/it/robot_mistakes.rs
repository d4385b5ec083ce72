//! Mistakes in the entries of robots, of nodes with ROS 2, and of what is around them: each is reported
//! once, at its place, and with what would be right.

use crate::mistakes::{ERROR, MAP, WARNING, changed, check, told};

/// A laboratory with a robot, its watchdog, an arm and a camera.
const LAB: &str = r#"[ecosystem]
name = "lab"
reasoning = "desk"
[rooms]
office = {}
corridor = { kind = "corridor" }
[doors]
corridor = { office = 4.0 }
[[agent]]
name = "rover"
plugin = "turtlebot"
driver = "ros2"
daemon = "desk"
config.start = "corridor"
[agent.config.ros2]
endpoint = "tcp/10.0.0.7:7447"
namespace = "/robot1/"
places.corridor = { x = 0.0, y = 0.0 }
places.office = { x = 6.2, y = -0.4 }
[[agent]]
name = "guard"
plugin = "robot-watchdog"
daemon = "hall-pi"
config.robot = "rover"
config.on-loss = "stop"
[agent.config.ros2]
endpoint = "tcp/10.0.0.7:7447"
namespace = "robot1"
[[agent]]
name = "arm-1"
plugin = "ros2"
daemon = "desk"
[agent.config]
ros2 = { endpoint = "tcp/10.0.0.8:7447" }
model = '''
(define (agent arm-1) (:domain smart-office)
  (:types arm - object)
  (:predicates (gripping ?a - arm) (near ?a - arm ?l - location))
  (:objects arm-1 - arm)
  (:action grip :agent ?a - arm :parameters () :effect (and (gripping ?a) (increase (total-cost) 1))))
'''
actions.grip.service = { name = "grip", type = "std_srvs/srv/Trigger" }
[[agent.config.topics]]
name = "gripper"
type = "std_msgs/msg/Bool"
facts = [{ fact = "(gripping arm-1)", when = "message.data == true" }]
[[agent]]
name = "eye"
plugin = "ptz-camera"
driver = "v4l2"
daemon = "desk"
[agent.config]
location = "office"
device = "/dev/video0"
on-motion = { goal = "(known-picture ?l)" }
"#;

/// Lines of the text above.
const ENDPOINT: usize = 16;
const NAMESPACE: usize = 17;
const OFFICE: usize = 19;
const FACT: usize = 46;
const GOAL: usize = 55;

#[track_caller]
fn one(severity: &str, from: &str, to: &str, line: usize, words: &[&str]) {
    check(&changed(LAB, from, to), MAP, severity, &format!("files/school.toml:{line}"), words);
}

#[test]
fn the_laboratory_has_no_mistake() {
    assert_eq!(told(LAB, MAP), []);
}

#[test]
fn a_wrong_address_of_a_robot_does_not_accuse_its_watchdog() {
    let endpoint = "\"tcp/10.0.0.7:7447\"";
    let protocol = ["endpoint = \"10.0.0.7:7447\"", "begins with a protocol"];
    one(ERROR, endpoint, "\"10.0.0.7:7447\"", ENDPOINT, &protocol);
    let address = ["an IPv6 address stands in brackets", "`tcp/[fe80::1]:7447`"];
    one(ERROR, endpoint, "\"tcp/fe80::1:7447\"", ENDPOINT, &address);
    let digit = ["namespace = \"1robot\"", "no digit at the beginning"];
    one(ERROR, "\"/robot1/\"", "\"1robot\"", NAMESPACE, &digit);
    let dialect = "namespace = \"/robot1/\"\ndialect = \"dds\"";
    one(ERROR, "namespace = \"/robot1/\"", dialect, NAMESPACE + 1, &["no dialect `dds`"]);
}

#[test]
fn a_watchdog_without_an_address_is_reported_once() {
    let table = "[agent.config.ros2]\nendpoint = \"tcp/10.0.0.7:7447\"\nnamespace = \"robot1\"\n";
    let found = told(&changed(LAB, table, ""), MAP);
    let [(severity, _, text)] = found.as_slice() else { panic!("one report: {found:#?}") };
    assert!(severity == ERROR && text.contains("`ros2` is missing"), "{text}");
    let other = "write namespace = \"/robot1/\"";
    one(WARNING, "\"robot1\"", "\"robot2\"", 26, &["`namespace` is not that of `rover`", other]);
}

#[test]
fn a_domain_is_one_of_ros_and_has_an_effect() {
    let domain = |key: &str| format!("namespace = \"/robot1/\"\n{key}");
    let idle = ["`domain-id` has no effect", "zenoh-bridge-ros2dds -d 5"];
    let namespace = "namespace = \"/robot1/\"";
    one(WARNING, namespace, &domain("domain-id = 5"), NAMESPACE + 1, &idle);
    let great = domain("domain-id = 300\ndialect = \"rmw-zenoh\"");
    one(ERROR, namespace, &great, NAMESPACE + 1, &["domain-id = 300", "domains 0 to 232"]);
}

#[test]
fn names_of_services_are_those_that_ros_allows() {
    let start = "config.start = \"corridor\"";
    let text = changed(LAB, start, &format!("{start}\nconfig.brush = \"2nd/brush\""));
    let text = text.replacen("turtlebot", "cleaning-robot", 1);
    let words = ["brush = \"2nd/brush\" is no name of ROS", "no digit at the beginning"];
    check(&text, MAP, ERROR, "files/school.toml:15", &words);
}

#[test]
fn a_pose_is_a_table_and_no_list() {
    let table = "{ x = 6.2, y = -0.4 }";
    for list in ["[6.2, -0.4]", "[6.2, -0.4, 0.0]", "[6.2, -0.4, 0.0, 1.0]"] {
        one(ERROR, table, list, OFFICE, &["no list: write { x = 6.2, y = -0.4 }"]);
    }
}

#[test]
fn the_facts_of_topics_are_compared_with_the_objects_of_all_agents() {
    let fact = |text: &str| format!("\"{text}\"");
    let own = fact("(gripping arm-1)");
    let near = ["config of `arm-1`: `(gripping arm-2)`", "unknown object", "`arm-1`?"];
    one(ERROR, &own, &fact("(gripping arm-2)"), FACT, &near);
    let far = ["unknown object `conveyor`", "declare it in (:objects …) of `model`"];
    one(WARNING, &own, &fact("(gripping conveyor)"), FACT, &far);
    // The place of the map has another type; the robot is an object of another agent.
    one(ERROR, &own, &fact("(gripping office)"), FACT, &["`office` is"]);
    assert_eq!(told(&changed(LAB, &own, &fact("(near arm-1 office)")), MAP), []);
    assert_eq!(told(&changed(LAB, &own, &fact("(at rover office)")), MAP), []);
    let result = "actions.grip.facts = [\"(near {a} ofice)\"]\nactions.grip.service";
    one(ERROR, "actions.grip.service", result, 42, &["unknown object `ofice`", "`office`?"]);
    let result = result.replace("ofice", "office");
    assert_eq!(told(&changed(LAB, "actions.grip.service", &result), MAP), []);
}

#[test]
fn the_goal_of_a_camera_is_compared_with_the_words_of_all_agents() {
    let goal = "(known-picture ?l)";
    let words = ["config of `eye`: `(known-pictur ?l)`", "did you mean `known-picture`?"];
    one(ERROR, goal, "(known-pictur ?l)", GOAL, &words);
    let variable = ["unknown variable `?r`", "write `?l` for the place of the motion"];
    one(ERROR, goal, "(known-picture ?r)", GOAL, &variable);
    assert_eq!(told(&changed(LAB, goal, "(gripping arm-1)"), MAP), []);
    let idle = "device = \"/dev/video0\"\nmotion = false";
    let found = told(&changed(LAB, "device = \"/dev/video0\"", idle), MAP);
    let [(severity, _, text)] = found.as_slice() else { panic!("one report: {found:#?}") };
    assert!(severity == ERROR && text.contains("leave `motion = false` out"), "{text}");
}

#[test]
fn an_agent_without_actions_has_no_safeguards() {
    let text = format!("{LAB}[safeguards.guard]\nstop = {{ confirm = true }}\n");
    let words = ["`guard` has no actions", "name its actions in [safeguards.rover]"];
    check(&text, MAP, ERROR, "files/school.toml:56", &words);
    let text = text.replace("[safeguards.guard]\nstop", "[safeguards.rover]\nmove");
    assert_eq!(told(&text, MAP), []);
}

#[test]
fn a_switch_with_the_keys_of_another_driver_is_reported_once() {
    let lamp = |more: &str| {
        format!(
            "{LAB}[[agent]]\nname = \"lamp\"\nplugin = \"switch\"\ndaemon = \"desk\"\n[agent.config]\n\
             location = \"office\"\nkind = \"lamp\"\n{more}"
        )
    };
    let found = told(&lamp("on = [\"true\"]\noff = [\"true\"]\n"), MAP);
    let [(severity, _, text)] = found.as_slice() else { panic!("one report: {found:#?}") };
    assert!(
        severity == ERROR && text.contains("write driver = \"command\" beside `plugin`"),
        "{text}"
    );
}
