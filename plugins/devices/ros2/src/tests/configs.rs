//! Mistakes in an entry are refused in the words of the entry.

use std::fs;

use agent::{BuildCheck, EcosystemFolder};

use super::*;

fn problem_of(config: Value) -> String {
    let built = ros_actuator(&blueprint(config));
    let problem = built.err().map(|error| error.to_string()).unwrap_or_default();
    problem.strip_prefix("build `arm-1`: ").unwrap_or(&problem).to_owned()
}

fn arm() -> Value {
    config("tcp/192.168.1.30:7447", "ros2dds")
}

#[test]
fn the_example_has_no_mistake() {
    assert_eq!(problem_of(arm()), "");
}

#[test]
fn mistakes_of_an_entry_are_refused_with_what_would_be_right() {
    let pick = "/actions/pick/ros-action";
    for (place, value, expected) in [
        (
            "/actions/pick/ros-action/type",
            json!("arm_msgs/action/Pik"),
            "actions.pick.ros-action.type: there is no definition of `arm_msgs/action/Pik`: \
             `arm_msgs/action` has Pick, Place",
        ),
        (
            "/topics/0/type",
            json!("hand_msgs/msg/Gripper"),
            "topics, `gripper`: type: there is no definition of `hand_msgs/msg/Gripper`: \
             `definitions` has nothing of `hand_msgs/msg`",
        ),
        (
            "/actions/pick/ros-action/type",
            json!("arm_msgs/msg/Gripper"),
            "actions.pick.ros-action.type: `arm_msgs/msg/Gripper` is another kind of name: the type \
             of an action of ROS is such as `arm_msgs/action/Pick`",
        ),
        (
            "/actions/pick/ros-action/name",
            json!("pick it"),
            "actions.pick.ros-action.name: `pick it` is no name of ROS",
        ),
        (
            "/actions/pick/ros-action/goal",
            json!({ "objekt": "{p}" }),
            "actions.pick.ros-action.goal: `objekt` is no field of `arm_msgs/action/Pick_Goal`; its \
             fields are object, at, speed",
        ),
        (
            "/actions/pick/ros-action/goal",
            json!({ "object": "{part}" }),
            "actions.pick.ros-action.goal: `{part}` is none of its variables: {a}, {p}, {s}",
        ),
        (
            "/actions/pick/ros-action/goal",
            json!({ "speed": "{p}" }),
            "actions.pick.ros-action.goal: `speed` takes a number of at most 3.4e38, \"nan\", \"inf\" \
             or \"-inf\", not \"cup-1\"",
        ),
        (
            "/objects",
            json!({ "tray": { "x": 1, "y": 2 } }),
            "actions.pick.ros-action.goal: fill in `{s.x}`: write objects.shelf = { x = … }",
        ),
        (
            "/actions/pick/success",
            json!("result.succes == true"),
            "actions.pick.success: `succes` is no field of `arm_msgs/action/Pick_Result`; its fields \
             are success, weight, message",
        ),
        (
            "/actions/pick/success",
            json!("result.success == \"yes\""),
            "actions.pick.success: `success` takes true or false, not \"yes\"",
        ),
        (
            "/actions/pick/reason",
            json!("result.weight"),
            "actions.pick.reason: `result.weight` has another type: `reason` names a field with a text",
        ),
        (
            "/actions/pick/reason",
            json!("message"),
            "actions.pick.reason: `message` is no field: a field is such as `result.success`",
        ),
        (
            "/actions/pick/facts",
            json!(["(= (weigt {p}) {result.weight})"]),
            "actions.pick.facts: `(= (weigt {p}) {result.weight})`: unknown function `weigt`; did \
             you mean `weight`?",
        ),
        (
            "/actions/pick/facts",
            json!(["(held {p} {a})"]),
            "actions.pick.facts: `(held {p} {a})`: ",
        ),
        (
            "/actions/pick/facts",
            json!(["(= (weight {p}) {weight})"]),
            "`{weight}` is none of its placeholders: {a}, {p}, {s}, {result.FIELD}",
        ),
        (
            "/actions/pick/facts",
            json!(["(= (weight {p}) {result.message})"]),
            "`result.message` has another type: a fact takes numbers, `when` compares other values",
        ),
        (
            "/actions/pick/facts",
            json!(["(= (weight {?p}) {result.weight})"]),
            "`{?p}` is no placeholder: write `{p}`",
        ),
        (
            "/actions/pick/facts",
            json!(["(= (weight {p}) {{ result.weight }})"]),
            "`{{ result.weight }}` is no placeholder: write `{result.weight}`",
        ),
        ("/actions/pick/facts", json!(["(held {a} {s})"]), "`{s}` is of type `spot`"),
        (
            "/actions/pick/ros-action/goal",
            json!({ "object": "{?p}" }),
            "actions.pick.ros-action.goal: `{?p}` is no placeholder: write `{p}`",
        ),
        (
            "/actions/pick/ros-action/goal",
            json!({ "at": { "x": "{{ s.x }}" } }),
            "actions.pick.ros-action.goal: `{{ s.x }}` is no placeholder: write `{s.x}`",
        ),
        (
            "/actions/pick/ros-action/goal",
            json!({ "object": 0 }),
            "actions.pick.ros-action.goal: `object` takes a text, not 0",
        ),
        (
            "/definitions/arm_msgs~1action~1Pick",
            json!(""),
            "definitions: `arm_msgs/action/Pick`: line 1, column 1: an action has two lines",
        ),
        ("/topics/0/name", json!("cell/2nd"), "name: `cell/2nd` is no name of ROS"),
        (
            "/ros2/namespace",
            json!("1cell"),
            "namespace = \"1cell\": a namespace has letters, digits and `_`, and no digit at the \
             beginning or behind a slash",
        ),
        (
            "/actions/pick/time-out",
            json!("2h"),
            "actions.pick.time-out `2h`: write a time between 1ms and 1h",
        ),
        (
            "/topics/0/facts",
            json!([{ "fact": "(gripping arm-1)", "when": "message.grip >= 2" }]),
            "topics, `gripper`: facts: `grip` is no field of `arm_msgs/msg/Gripper`; its fields are \
             state, force",
        ),
        (
            "/topics/0/facts",
            json!(["(gripping {a})"]),
            "`{a}` is none of its placeholders: {message.FIELD}",
        ),
        (
            "/topics/0/facts",
            json!([{ "fact": "(gripping arm-1)", "wen": "message.force >= 2" }]),
            "each of `facts` is a text, or { fact = \"(…)\", when = \"…\" }",
        ),
        (
            "/topics/0/facts",
            json!(["(gripping arm-1)", "(gripping arm-1)"]),
            "topics: `(gripping arm-1)` is told twice",
        ),
        (
            "/topics/0/valid-for",
            json!("1ms"),
            "topics, `gripper`: valid-for `1ms`: write a time between 1s and 1day",
        ),
        ("/ros2/endpoint", json!("192.168.1.30"), "an endpoint is such as"),
    ] {
        let mut entry = arm();
        *entry.pointer_mut(place).expect(place) = value;
        let problem = problem_of(entry);
        assert!(problem.contains(expected), "{place}: {problem}\n  is not\n{expected}");
    }
    let mut entry = arm();
    let unknown = entry.pointer(pick).cloned().expect("an action");
    entry["actions"]["grab"] = json!({ "ros-action": unknown });
    assert_eq!(
        problem_of(entry),
        "actions.grab: the model has pick, place, calibrate, and no `grab`"
    );
    let mut entry = arm();
    entry["actions"].as_object_mut().expect("a table").remove("place");
    assert!(
        problem_of(entry).starts_with("`place` has nothing that carries it out: actions.place")
    );
    let mut entry = arm();
    entry["actions"]["pick"]["facts"] = json!(["(= (weight {p}) {result.wieght})"]);
    let problem = problem_of(entry);
    assert!(problem.ends_with("its fields are success, weight, message"), "{problem}");
    let mut entry = arm();
    entry["model"] = json!(MODEL.replace("(increase (total-cost) 5)", "(increase (force ?a) 5)"));
    assert!(problem_of(entry).contains("take it from the result, as in facts = [\"(= (force ?a)"));
}

/// Returns the problem of the arm with definitions in files below `folder`.
fn with_files(folder: &std::path::Path, definitions: Value, is_check: bool) -> String {
    let mut entry = arm();
    entry["definitions"] = definitions;
    let mut blueprint = blueprint(entry);
    let host = Arc::get_mut(&mut blueprint.host).expect("the only one");
    host.resources.insert(EcosystemFolder(folder.to_owned()));
    if is_check {
        host.resources.insert(BuildCheck);
    }
    ros_actuator(&blueprint).err().map(|error| error.to_string()).unwrap_or_default()
}

#[test]
fn definitions_are_read_from_files_and_folders() {
    let folder = tempfile::tempdir().expect("a folder");
    for (file, text) in
        [("action/Pick.action", PICK), ("action/Place.action", PLACE), ("Gripper.msg", GRIPPER)]
    {
        let file = folder.path().join("share/arm_msgs").join(file);
        fs::create_dir_all(file.parent().expect("a folder")).expect("a folder");
        fs::write(file, text).expect("a file");
    }
    let path = folder.path();
    assert_eq!(with_files(path, json!("share"), true), "");
    let single = json!(["share/arm_msgs/action", "share/arm_msgs/Gripper.msg"]);
    assert_eq!(with_files(path, single, false), "");
    assert_eq!(with_files(path, json!(path.join("share")), false), "");
    let missing = with_files(path, json!("shared"), true);
    assert!(
        missing.contains("definitions: `shared`: there is no such file or folder"),
        "{missing}"
    );
    // An absolute path is one of the agent's machine, which may be another one than this.
    assert_eq!(with_files(path, json!("/nowhere/share"), true), "");
    let missing = with_files(path, json!("/nowhere/share"), false);
    assert!(missing.contains("there is no such file or folder"), "{missing}");
    fs::write(path.join("share/arm_msgs/Bad.msg"), "integer x\n").expect("a file");
    let bad = with_files(path, json!("share"), true);
    assert!(bad.contains("Bad.msg`: line 1, column 1"), "{bad}");
    assert!(!bad.contains("`arm_msgs/Bad.msg`"), "there is no such path: {bad}");
    fs::write(path.join("share/arm_msgs/Bad.msg"), b"# f\xfcr\nint32 x\n").expect("a file");
    let bad = with_files(path, json!("share"), true);
    assert!(bad.contains("Bad.msg` is no text in UTF-8: save it with this encoding"), "{bad}");
}
