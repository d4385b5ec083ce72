//! Mistakes in action models, presets, media and drivers of a home: each is reported once, at its place,
//! and with what would be right.

use crate::mistakes::{ERROR, MAP, WARNING, changed, check, told};
use crate::sandbox::Sandbox;

/// A home with a program that makes coffee, a camera and a screen.
const HOME: &str = r#"[ecosystem]
name = "home"
[rooms]
hall = { kind = "corridor" }
kitchen = {}
[doors]
hall = { kitchen = 4.0 }
[[agent]]
name = "robot"
plugin = "turtlebot"
config = { start = "hall" }
[[agent]]
name = "coffee-1"
plugin = "command"
[agent.config]
model = """
(define (agent coffee-1) (:domain smart-office)
  (:types brewer - object)
  (:predicates (brewed ?r - room) (clean ?c - brewer))
  (:objects coffee-1 - brewer)
  (:init (clean coffee-1))
  (:action brew :agent ?c - brewer :parameters (?r - room)
    :precondition (clean ?c)
    :effect (and (brewed ?r) (increase (total-cost) 3))))
"""
actions.brew = { run = ["/bin/true", "{r}"] }
[[agent]]
name = "camera-1"
plugin = "ptz-camera"
driver = "onvif"
[agent.config]
location = "kitchen"
address = "10.0.0.9"
presets.door = { shows = "hall", preset = "Door" }
presets.desk = { shows = "kitchen", preset = "Desk" }
[[agent]]
name = "screen-1"
plugin = "screen"
config = { location = "kitchen", media = { menu = "Soup" } }
"#;

/// The lines of the second preset, of the screen's `config`, and the first one after the text.
const DESK: usize = 35;
const SCREEN: usize = 39;
const END: usize = 40;

#[track_caller]
fn found(severity: &str, text: &str, line: usize, words: &[&str]) {
    check(text, MAP, severity, &format!("files/school.toml:{line}"), words);
}

#[track_caller]
fn one(severity: &str, from: &str, to: &str, line: usize, words: &[&str]) {
    found(severity, &changed(HOME, from, to), line, words);
}

#[test]
fn the_home_has_no_mistake() {
    assert_eq!(told(HOME, MAP), []);
    // The lines of a model are found whatever its quotes and its ends of lines.
    assert_eq!(told(&HOME.replace("\"\"\"", "'''"), MAP), []);
    assert_eq!(told(&HOME.replace('\n', "\r\n"), MAP), []);
}

#[test]
fn a_mistake_in_a_model_is_at_its_own_line() {
    for (from, to, line, words) in [
        (":precondition (clean ?c)", ":precondition (cleen ?c)", 23, "did you mean `clean`?"),
        (":precondition (clean ?c)", ":precondition (clean ?d)", 23, "`?d`"),
        ("?c - brewer :parameters", "?c - brewr :parameters", 22, "`brewr`"),
        ("(agent coffee-1)", "(agent coffee-2)", 17, "write (define (agent coffee-1) …"),
        ("(:domain smart-office)", "(:domain office)", 17, "write (:domain smart-office)"),
        ("(:init (clean coffee-1))", "(:init (cleen coffee-1))", 21, "`cleen`"),
    ] {
        let words = ["model of `coffee-1`: ", words];
        one(ERROR, from, to, line, &words);
        let quoted = changed(HOME, from, to).replace("\"\"\"", "'''");
        found(ERROR, &quoted, line, &words);
        found(ERROR, &quoted.replace('\n', "\r\n"), line, &words);
    }
    let open = told(&changed(HOME, "3))))", "3)))"), MAP);
    let in_model = |(_, place, _): &(String, String, String)| {
        let line = place.rsplit(':').next().and_then(|line| line.parse::<usize>().ok());
        line.is_some_and(|line| (17..=25).contains(&line))
    };
    assert!(!open.is_empty() && open.iter().all(in_model), "{open:#?}");
}

#[test]
fn what_the_composed_domain_leaves_out_is_told() {
    let without = changed(HOME, "(:objects coffee-1 - brewer)", "");
    let without = without.replace("(:init (clean coffee-1))", "");
    let words = ["action `brew` of `coffee-1` is left out", "(:objects coffee-1 - brewer)"];
    found(WARNING, &without, 22, &words);
    let predicate = "(clean ?c - brewer)";
    let more = |declared: &str| format!("{predicate} {declared}");
    let words = ["predicate `idle` of `coffee-1` is left out", "did you mean `brewer`?"];
    one(WARNING, predicate, &more("(idle ?c - brewr)"), 19, &words);
    let words = ["predicate `lit` of `coffee-1` is left out", "the ontology declares"];
    one(WARNING, predicate, &more("(lit ?c - brewer)"), 19, &words);
    for (name, owner) in [("kitchen", "the map declares"), ("coffee-1", "`coffee-1` declares")] {
        let message = format!("object `{name}` of `screen-1` is left out");
        let words = [message.as_str(), owner, "another name"];
        one(WARNING, "{ menu =", &format!("{{ {name} ="), SCREEN, &words);
    }
    one(WARNING, "presets.desk", "presets.kitchen", DESK, &["object `kitchen` of `camera-1`"]);
}

#[test]
fn names_that_an_unknown_agent_may_declare_are_not_reported() {
    let gateway = "[[agent]]\nname = \"zigbee\"\nplugin = \"mqtt\"\n\
                   config = { broker = \"localhost:1883\" }\n";
    let predicate = "(clean ?c - brewer)";
    let text = changed(HOME, predicate, &format!("{predicate} (idle ?c - cupboard)"));
    found(WARNING, &text, 19, &["predicate `idle`", "declare the type under `:types`"]);
    assert_eq!(told(&format!("{text}{gateway}"), MAP), []);
}

#[test]
fn the_mistake_of_a_preset_is_at_the_preset() {
    let desk = "{ shows = \"kitchen\", preset = \"Desk\" }";
    for (preset, words) in [
        ("{ shows = \"kitchen\" }", "write preset = \"NAME\""),
        ("{ shows = \"kitchen\", position = [90, -30, 1] }", "from -1 to 1"),
        ("{ shows = \"kitchen\", preset = \"D\", position = [0, 0, 0] }", "and not both"),
        ("{ shows = \"kitchen\", pan = 3.0 }", "degrees of a simulated camera"),
        ("{ shows = \"kitchen\", position = [0.5, -0.3] }", "write position = [0.5, -0.3, 0.0]"),
    ] {
        one(ERROR, desk, preset, DESK, &["desk", words]);
    }
    one(ERROR, "presets.desk", "presets.Desk", DESK, &["`Desk`"]);
    one(ERROR, "address = \"10.0.0.9\"", "address = \"10.0.0.9:0\"", 33, &["from 1 to 65535"]);
}

#[test]
fn a_correction_would_be_taken() {
    let address = "address = \"10.0.0.9\"";
    let settle = format!("{address}\nsettle = 4");
    one(ERROR, address, &settle, 34, &["`settle` must be a text", "settle = \"4s\""]);
    let usb = |device: &str| {
        format!(
            "{HOME}[[agent]]\nname = \"usb\"\nplugin = \"ptz-camera\"\ndriver = \"v4l2\"\n\
             config = {{ location = \"kitchen\", device = {device} }}\n"
        )
    };
    found(ERROR, &usb("0"), END + 4, &["write device = \"/dev/video0\""]);
    assert_eq!(told(&usb("\"/dev/video0\""), MAP), []);
    let sensor = |debounce: &str| {
        format!(
            "{HOME}[[agent]]\nname = \"latch\"\nplugin = \"sensor\"\ndriver = \"gpio\"\n\
             [agent.config]\nlocation = \"kitchen\"\nquantity = \"contact\"\nline = \"GPIO17\"\n\
             debounce = {debounce}\n"
        )
    };
    found(ERROR, &sensor("10"), END + 8, &["debounce = \"10ms\""]);
    assert_eq!(told(&sensor("\"10ms\""), MAP), []);
}

#[test]
fn a_wrong_driver_makes_no_agent_unknown() {
    let plugin = "plugin = \"turtlebot\"\n";
    let wrong = changed(HOME, plugin, &format!("{plugin}driver = \"ros\"\n"));
    let safeguards = "[safeguards.robot]\nmove = { confirm = true }\n";
    let goals = "[goals]\nthere = \"(at robot hall)\"\n";
    found(ERROR, &format!("{wrong}{safeguards}{goals}"), 11, &["no driver `ros`"]);
}

#[test]
fn an_entry_without_its_driver_is_one_mistake() {
    let lamp = |driver: &str| {
        format!(
            "{HOME}[[agent]]\nname = \"lamp\"\nplugin = \"switch\"\n{driver}[agent.config]\n\
             location = \"kitchen\"\nkind = \"lamp\"\non = [\"/bin/true\"]\noff = [\"/bin/true\"]\n\
             state = [\"/bin/echo\", \"on\"]\nevery = \"10s\"\n"
        )
    };
    found(ERROR, &lamp(""), END + 2, &["config of `lamp`", "write driver = \"command\""]);
    assert_eq!(told(&lamp("driver = \"command\"\n"), MAP), []);
}

#[test]
fn a_safeguard_is_marked_at_its_own_key() {
    let with = |line: &str| format!("{HOME}[safeguards.robot]\n{line}\n");
    let words = ["`mve` is no action of it", "did you mean `move`?"];
    found(ERROR, &with("mve = { confirm = true }"), END + 1, &words);
    let misspelt = "move = { at_most = 6, per = \"1h\" }";
    found(ERROR, &with(misspelt), END + 1, &["did you mean `at-most`?"]);
}

#[test]
fn a_hardware_stop_has_one_mistake() {
    let with = |lines: &str| format!("{HOME}[hardware-stops.coffee-1]\n{lines}\n");
    let bare = with("pressed = \"clean coffee-1\"\nfail-safe = true");
    found(ERROR, &bare, END + 1, &["write pressed = \"(clean coffee-1)\""]);
    let misspelt = with("pressed = \"(clean coffee-1)\"\nfail_safe = true");
    found(ERROR, &misspelt, END + 2, &["did you mean `fail-safe`?"]);
}

#[test]
fn a_table_of_the_config_is_no_agent() {
    let media = "config = { location = \"kitchen\" }\n[agent.media]\nmenu = \"Soup\"";
    let config = "config = { location = \"kitchen\", media = { menu = \"Soup\" } }";
    one(ERROR, config, media, SCREEN + 1, &["write [agent.config.media]"]);
    let run = "actions.brew = { run = [\"/bin/true\", \"{r}\"] }\n";
    let topics = format!("{run}[[agent.topics]]\nname = \"x\"\n");
    one(ERROR, run, &topics, 27, &["write [[agent.config.topics]]"]);
    let table = "driver = \"onvif\"\n[agent.config]\n";
    let beside = "driver = \"onvif\"\naddress = \"10.0.0.9\"\n[agent.config]\n";
    let text = changed(HOME, "address = \"10.0.0.9\"\n", "").replacen(table, beside, 1);
    found(ERROR, &text, 31, &["move `address` into the entry's `config`"]);
}

/// The robot with ROS 2, with these lines after the head of its `config`.
fn ros(start: &str, poses: &str) -> Vec<(String, String, String)> {
    let config = format!(
        "driver = \"ros2\"\n[agent.config]\nstart = \"{start}\"\n[agent.config.ros2]\n\
         endpoint = \"tcp/127.0.0.1:7447\"\n[agent.config.ros2.places]\n{poses}"
    );
    let mut all = told(&changed(HOME, "config = { start = \"hall\" }\n", &config), MAP);
    // No watchdog is there.
    all.retain(|(severity, ..)| severity == ERROR);
    all
}

#[test]
fn a_place_that_is_not_there_is_one_mistake() {
    let poses = "hall = { x = 0.0, y = 0.0 }\nkitchen = { x = 1.0, y = 0.0 }\n";
    assert_eq!(ros("hall", poses), []);
    assert_eq!(ros("hal", poses).len(), 1, "{:#?}", ros("hal", poses));
}

#[test]
fn a_missing_pose_is_not_at_another_one() {
    let all = ros("hall", "hall = { x = 0.0, y = 0.0 }\n");
    let [(_, place, text)] = all.as_slice() else { panic!("one mistake: {all:#?}") };
    assert!(text.contains("lacks the pose of `kitchen`"), "{text}");
    assert_eq!(place, "files/school.toml:16", "{text}");
}

#[test]
fn a_button_works_anywhere() {
    let button = "[[agent]]\nname = \"button\"\nplugin = \"sensor\"\n\
                  config = { location = \"hall\", quantity = \"contact\" }\n";
    let stop = "[hardware-stops.button]\nstops = [\"robot\"]\nfail-safe = true\n";
    assert_eq!(told(&format!("{HOME}{button}{stop}"), MAP), []);
    found(WARNING, &format!("{HOME}{button}"), END + 3, &["is a corridor", "works in a room"]);
    let garden =
        changed(HOME, "kitchen = {}\n", "kitchen = {}\ngarden = \"outdoors\"   # no way in\n");
    let outdoors = format!("{garden}{}", button.replace("hall", "garden"));
    found(WARNING, &outdoors, END + 4, &["`garden` is outdoors, and"]);
}

#[test]
fn without_a_name_the_file_of_this_folder_is_checked() {
    let sandbox = Sandbox::new(&[("althing.toml", HOME)]);
    assert!(sandbox.check("check", 0).stdout.contains("ecosystem home"));
    let nothing = Sandbox::new(&[]).check("check", 33);
    assert!(nothing.stderr.contains("there is no althing.toml here"), "{}", nothing.stderr);
}

#[test]
fn a_robot_that_init_offers_can_be_written() {
    for kind in ["turtlebot", "cleaning-robot", "video-robot"] {
        for how in ["--simulated", ""] {
            let sandbox = Sandbox::new(&[]);
            let options = "--name home --room kitchen --no-discovery --yes";
            sandbox.check(&format!("init v.toml {options} --robot {kind}@kitchen {how}"), 0);
            sandbox.check("check v.toml", 0);
        }
    }
}
