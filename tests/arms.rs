//! An arm with ROS 2, by the lines of docs/robots.md: from the config to a goal. Its nodes are served
//! in the process of the test, over Zenoh as real ones are; the goals that they received decide.

use std::sync::atomic::AtomicBool;
use std::sync::{Arc, Mutex};

use ros2_link::standard_interfaces;
use serde_json::{Value, json};
use simulated_nav2::{AcceptsGoals, ActionServer, RobotNode, RobotWire, RunGoal};
use tokio::runtime::Runtime;
use tokio_util::task::AbortOnDropHandle;

use crate::support::{Office, lab, stderr};

const DOCUMENT: &str = include_str!("../docs/robots.md");

const DEFINITIONS: [(&str, &str); 3] = [
    (
        "action/Pick.action",
        include_str!("../plugins/devices/ros2/src/tests/arm_msgs/action/Pick.action"),
    ),
    (
        "action/Place.action",
        include_str!("../plugins/devices/ros2/src/tests/arm_msgs/action/Place.action"),
    ),
    ("msg/Gripper.msg", include_str!("../plugins/devices/ros2/src/tests/arm_msgs/msg/Gripper.msg")),
];

const TRIGGER: &str = "std_srvs/srv/Trigger";

/// The nodes of the arm, with the goals that they have received.
struct Arm {
    endpoint: String,
    goals: Arc<Mutex<Vec<String>>>,
    /// Whether a goal is aborted.
    is_stuck: Arc<AtomicBool>,
    _tasks: Vec<AbortOnDropHandle<()>>,
    _runtime: Runtime,
}

impl Arm {
    fn start() -> Arm {
        let runtime = Runtime::new().expect("a runtime");
        let (goals, is_stuck) = (Arc::default(), Arc::default());
        let (endpoint, tasks) = runtime.block_on(serve(&goals, &is_stuck));
        Arm { endpoint, goals, is_stuck, _tasks: tasks, _runtime: runtime }
    }

    fn goals(&self) -> Vec<String> {
        self.goals.lock().expect("no panic").clone()
    }
}

async fn serve(
    goals: &Arc<Mutex<Vec<String>>>,
    is_stuck: &Arc<AtomicBool>,
) -> (String, Vec<AbortOnDropHandle<()>>) {
    let mut interfaces = standard_interfaces();
    for (file, text) in DEFINITIONS {
        let name = file.split('/').next_back().expect("a name");
        interfaces.add("arm_msgs", name, text).expect("a definition");
    }
    let opened = RobotNode::open(RobotWire::Ros2Dds, None, "", interfaces).await;
    let (node, endpoint) = opened.expect("a router");
    let node = Arc::new(node);
    let mut tasks = Vec::new();
    for (name, type_name, result) in [
        ("pick", "arm_msgs/action/Pick", json!({ "success": true, "weight": 0.35 })),
        ("place", "arm_msgs/action/Place", json!({})),
    ] {
        let accepts: AcceptsGoals = Arc::new(|| true);
        let (goals, is_stuck) = (Arc::clone(goals), Arc::clone(is_stuck));
        let run: RunGoal = Arc::new(move |goal: Value, _| {
            goals.lock().expect("no panic").push(format!("{name} {}", goal["at"]["x"]));
            let is_stuck = is_stuck.load(std::sync::atomic::Ordering::Relaxed);
            let aborted = Err(json!({ "message": "the joint is stuck" }));
            let result = if is_stuck { aborted } else { Ok(result.clone()) };
            Box::pin(std::future::ready(result))
        });
        let answers = Arc::new(AtomicBool::new(true));
        let served = ActionServer::serve(&node, name, type_name, accepts, run, &answers);
        tasks.push(served.await.expect("a server"));
    }
    let mut calibrate = node.service("calibrate", TRIGGER).await.expect("a service");
    let goals = Arc::clone(goals);
    tasks.push(AbortOnDropHandle::new(tokio::spawn(async move {
        while let Some(query) = calibrate.next().await {
            goals.lock().expect("no panic").push("calibrate".to_owned());
            node.reply(&query, "calibrate", TRIGGER, &json!({ "success": true })).await;
        }
    })));
    (endpoint, tasks)
}

/// Returns the example of the document that names this agent.
fn example(agent: &str) -> &'static str {
    let name = format!("name = \"{agent}\"\nplugin = \"ros2\"");
    let mut blocks = DOCUMENT.split("```").skip(1).step_by(2);
    let block = blocks.find(|block| block.contains(&name)).expect("an example");
    block.strip_prefix("toml").expect("TOML")
}

/// Returns the entry of the document, with the arm at `endpoint`.
fn entry(endpoint: &str) -> String {
    example("arm-1").replace("tcp/192.168.1.30:7447", endpoint)
}

#[test]
fn a_topic_can_be_a_hardware_stop() {
    let office = Office::new();
    let file = office.write("lab.toml", &(lab("decentralized") + example("e-stop-1")));
    let checked = office.run(&["check", &file.display().to_string()]);
    assert!(checked.status.success(), "{}", stderr(&checked));
    let mistaken = example("e-stop-1").replace("pressed = \"(pressed", "pressed = \"(presed");
    let file = office.write("lab.toml", &(lab("decentralized") + &mistaken));
    let said = stderr(&office.run(&["check", &file.display().to_string()]));
    assert!(said.contains("did you mean `pressed`?"), "{said}");
    // The stop waits for a fact that no topic tells.
    let other = example("e-stop-1").replace("fact = \"(pressed", "fact = \"(not-pressed");
    let other =
        other.replace("(pressed ?b - button)", "(pressed ?b - button) (not-pressed ?b - button)");
    let file = office.write("lab.toml", &(lab("decentralized") + &other));
    let said = stderr(&office.run(&["check", &file.display().to_string()]));
    assert!(said.contains("its topics tell `(not-pressed e-stop-1)`"), "{said}");
}

#[test]
fn an_arm_reaches_a_goal_by_its_actions_and_its_service() {
    let arm = Arm::start();
    let office = Office::new();
    for (file, text) in DEFINITIONS {
        let folder = office.folder().join("arm_msgs").join(file);
        std::fs::create_dir_all(folder.parent().expect("a folder")).expect("a folder");
        std::fs::write(folder, text).expect("a file");
    }
    let file = office.write("lab.toml", &(lab("decentralized") + &entry(&arm.endpoint)));
    let checked = office.run(&["check", &file.display().to_string()]);
    assert!(checked.status.success(), "{}", stderr(&checked));

    let mistaken = entry(&arm.endpoint).replace("result.success", "result.succeeded");
    let wrong = office.write("wrong.toml", &(lab("decentralized") + &mistaken));
    let checked = office.run(&["check", &wrong.display().to_string()]);
    assert!(!checked.status.success());
    let said = stderr(&checked).split_whitespace().collect::<Vec<_>>().join(" ");
    assert!(said.contains("`succeeded` is no field of"), "{said}");
    assert!(said.contains("its fields are success"), "{said}");

    // A mistake in a topic is shown at its line.
    let mistaken = entry(&arm.endpoint).replace("valid-for = \"3s\"", "valid-for = \"3 fs\"");
    let wrong = office.write("wrong.toml", &(lab("decentralized") + &mistaken));
    let said = stderr(&office.run(&["check", &wrong.display().to_string()]));
    let shown = said.lines().filter(|line| line.contains(" | "));
    assert!(shown.into_iter().any(|line| line.contains("valid-for = \"3 fs\"")), "{said}");

    let mut office = office.with_file(file);
    office.up_alone(&[]);
    office.await_devices(1);
    let (code, said) = office.ask(&["goal", "(lies cup-1 shelf)"]);
    assert_eq!(code, Some(0), "{said}");
    assert_eq!(arm.goals(), ["calibrate", "pick 0.25", "place 1.0"], "{said}");
    office.await_fact("(lies cup-1 shelf)", true);
    office.await_fact("(= (weight cup-1) 0.35)", true);
    office.await_fact("(unknown (gripping arm-1))", true);

    arm.is_stuck.store(true, std::sync::atomic::Ordering::Relaxed);
    let (code, said) = office.ask(&["act", "(pick arm-1 cup-1 shelf)"]);
    assert_ne!(code, Some(0), "{said}");
    assert!(said.contains("the joint is stuck"), "{said}");
    office.await_fact("(lies cup-1 shelf)", true);
}
