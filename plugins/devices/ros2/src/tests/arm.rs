//! An arm with `pick` and `place`, a service and a topic, over real Zenoh on loopback, in both
//! dialects. What the nodes received is the evidence.

use std::sync::Mutex;
use std::sync::atomic::AtomicBool;

use ros2_link::standard_interfaces;
use simulated_nav2::{AcceptsGoals, ActionServer, RobotNode, RobotWire, RunGoal};
use tokio::sync::watch;
use tokio_util::task::AbortOnDropHandle;

use super::*;

/// Time limit of a step, on a machine that is busy with other tests.
const PATIENCE: Duration = Duration::from_secs(60);

const WIRES: [(RobotWire, &str); 2] =
    [(RobotWire::Ros2Dds, "ros2dds"), (RobotWire::RmwZenoh(7), "rmw-zenoh")];

const TRIGGER: &str = "std_srvs/srv/Trigger";
const GRIPPER_TYPE: &str = "arm_msgs/msg/Gripper";

/// How the nodes of the arm behave at present.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
enum Conduct {
    #[default]
    Succeeds,
    /// A goal is rejected.
    Rejects,
    /// A goal is aborted; a service answers without success.
    Fails,
    /// A goal is reached, and the result says that it has not succeeded.
    Denies,
    /// A goal has no end; a service keeps its question.
    Hangs,
    /// A service answers with bytes that are no message.
    Babbles,
}

/// The nodes of an arm.
struct Cell {
    node: Arc<RobotNode>,
    endpoint: String,
    conduct: Arc<Mutex<Conduct>>,
    /// Goals that were begun, in their order.
    goals: Arc<watch::Sender<Vec<Value>>>,
    /// Number of goals that are carried out at present.
    running: Arc<watch::Sender<usize>>,
    _tasks: Vec<AbortOnDropHandle<()>>,
}

/// Counts a goal as running until it is dropped.
struct Busy(Arc<watch::Sender<usize>>);

impl Drop for Busy {
    fn drop(&mut self) {
        self.0.send_modify(|running| *running -= 1);
    }
}

impl Cell {
    async fn start(wire: RobotWire, listen: Option<&str>) -> Cell {
        let mut interfaces = standard_interfaces();
        for (file, text) in
            [("Pick.action", PICK), ("Place.action", PLACE), ("Gripper.msg", GRIPPER)]
        {
            interfaces.add("arm_msgs", file, text).expect("a definition");
        }
        let opened = RobotNode::open(wire, listen, "cell", interfaces).await;
        let (node, endpoint) = opened.expect("a router");
        let mut cell = Cell {
            node: Arc::new(node),
            endpoint,
            conduct: Arc::default(),
            goals: Arc::default(),
            running: Arc::default(),
            _tasks: Vec::new(),
        };
        let picked = json!({ "success": true, "weight": 0.35, "message": "" });
        let picking = cell.serve("pick", "arm_msgs/action/Pick", picked).await;
        let placing = cell.serve("place", "arm_msgs/action/Place", json!({})).await;
        let calibrating = cell.serve_calibrate().await;
        cell._tasks = vec![picking, placing, calibrating];
        cell
    }

    async fn serve(
        &self,
        name: &'static str,
        type_name: &'static str,
        result: Value,
    ) -> AbortOnDropHandle<()> {
        let conduct = Arc::clone(&self.conduct);
        let accepts: AcceptsGoals =
            Arc::new(move || *conduct.lock().expect("no panic") != Conduct::Rejects);
        let conduct = Arc::clone(&self.conduct);
        let (goals, running) = (Arc::clone(&self.goals), Arc::clone(&self.running));
        let run: RunGoal = Arc::new(move |goal, _| {
            running.send_modify(|running| *running += 1);
            let busy = Busy(Arc::clone(&running));
            goals.send_modify(|goals| goals.push(goal));
            let (conduct, result) = (*conduct.lock().expect("no panic"), result.clone());
            Box::pin(async move {
                let _busy = busy;
                match conduct {
                    Conduct::Hangs => std::future::pending().await,
                    Conduct::Fails => Err(json!({ "message": "it \u{1b}[31mslipped" })),
                    Conduct::Denies => Ok(json!({ "success": false, "message": "it is glued" })),
                    _ => Ok(result),
                }
            })
        });
        let answers = Arc::new(AtomicBool::new(true));
        let served = ActionServer::serve(&self.node, name, type_name, accepts, run, &answers);
        served.await.expect("a server")
    }

    async fn serve_calibrate(&self) -> AbortOnDropHandle<()> {
        let mut service = self.node.service("calibrate", TRIGGER).await.expect("a service");
        let (node, conduct) = (Arc::clone(&self.node), Arc::clone(&self.conduct));
        AbortOnDropHandle::new(tokio::spawn(async move {
            let mut kept = Vec::new();
            while let Some(query) = service.next().await {
                let conduct = *conduct.lock().expect("no panic");
                let answer = |success| json!({ "success": success, "message": "at the stops" });
                match conduct {
                    Conduct::Hangs => kept.push(query),
                    Conduct::Babbles => {
                        node.reply_bytes(&query, "calibrate", TRIGGER, vec![0, 1, 0, 0, 9]).await;
                    }
                    _ => {
                        let answer = answer(conduct == Conduct::Succeeds);
                        node.reply(&query, "calibrate", TRIGGER, &answer).await;
                    }
                }
            }
        }))
    }

    fn conduct(&self, conduct: Conduct) {
        *self.conduct.lock().expect("no panic") = conduct;
    }

    async fn until_running(&self, number: usize) {
        let mut running = self.running.subscribe();
        let reached = running.wait_for(|running| *running == number);
        drop(tokio::time::timeout(PATIENCE, reached).await.expect("in time").expect("a sender"));
    }

    async fn grip(&self, force: f64) {
        self.node.publish("gripper", GRIPPER_TYPE, &json!({ "force": force })).await;
    }
}

/// Returns an actuator that has reached the nodes.
async fn reached(config: Value) -> RosActuator {
    let device = ros_actuator(&blueprint(config)).expect("right");
    let nodes = device.nodes();
    let mut state = nodes.state.subscribe();
    let linked = tokio::time::timeout(PATIENCE, state.wait_for(|state| state.is_reached)).await;
    drop(linked.expect("in time").expect("a sender"));
    device
}

async fn arm(cell: &Cell, dialect: &str) -> RosActuator {
    reached(config(&cell.endpoint, dialect)).await
}

fn call(text: &str) -> MethodCall {
    let words: Vec<_> = text.trim_matches(['(', ')']).split(' ').collect();
    let variables = ["a", "p", "s"].into_iter().zip(&words[1..]);
    let arguments = variables.map(|(name, value)| (name.to_owned(), (*value).to_owned()));
    let arguments = arguments.collect();
    MethodCall { action: text.to_owned(), method: words[0].to_owned(), arguments }
}

async fn act(device: &mut RosActuator, text: &str) -> Result<MethodResult, String> {
    let call = call(text);
    let performed = tokio::time::timeout(PATIENCE, device.perform(&call)).await.expect("in time");
    match performed {
        Ok(result) => Ok(device.on_success(&call, result)),
        Err(failure) => {
            device.on_failure(&call, &failure);
            Err(failure.to_string())
        }
    }
}

fn facts(device: &RosActuator) -> Vec<String> {
    device.facts().iter().map(|fact| fact.fact.to_string()).collect()
}

/// Waits for events until the actuator reports the fact.
async fn until_fact(device: &mut RosActuator, fact: &str) {
    let reported = async {
        while !facts(device).iter().any(|known| known == fact) {
            let event = device.next_event().expect("it has events").await;
            assert!(event(device).is_empty());
        }
    };
    let in_time = tokio::time::timeout(PATIENCE, reported).await;
    assert!(in_time.is_ok(), "{fact} is not in {:?}", facts(device));
}

const PICK_CUP: &str = "(pick arm-1 cup-1 tray)";

#[tokio::test(flavor = "multi_thread")]
async fn an_arm_picks_and_places_in_both_dialects() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut device = arm(&cell, dialect).await;
        assert_eq!(device.describe().model.actions.len(), 3);
        assert_eq!(device.describe().methods["pick"].arguments["s"], "?s");
        let before = ["(empty arm-1)", "(lies cup-1 tray)", "(unknown (gripping arm-1))"];
        assert_eq!(facts(&device), before, "{dialect}");

        let picked = act(&mut device, PICK_CUP).await.expect("it picks");
        assert_eq!(picked.detail, "(pick arm-1 cup-1 tray) is done");
        let observed: Vec<_> = picked.observations.iter().map(ToString::to_string).collect();
        let held = ["(held arm-1 cup-1)", "(gripping arm-1)", "(= (weight cup-1) 0.35)"];
        assert_eq!(observed, held, "{dialect}");
        let after = ["(= (weight cup-1) 0.35)", "(held arm-1 cup-1)", "(unknown (gripping arm-1))"];
        let mut known = facts(&device);
        known.sort();
        assert_eq!(known, after, "{dialect}: the topic alone tells whether it grips");

        act(&mut device, "(place arm-1 cup-1 shelf)").await.expect("it places");
        assert!(facts(&device).contains(&"(lies cup-1 shelf)".to_owned()), "{:?}", facts(&device));
        let goals = cell.goals.borrow().clone();
        let at = |x: f64, y: f64| json!({ "x": x, "y": y, "z": 0.0 });
        assert_eq!(goals[0], json!({ "object": "cup-1", "at": at(0.25, 0.5), "speed": 0.5 }));
        assert_eq!(goals[1], json!({ "at": at(1.0, -0.125) }));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_that_is_rejected_or_aborted_changes_nothing_and_has_its_reason() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut device = arm(&cell, dialect).await;
        let before = facts(&device);
        for (conduct, reason) in [
            (Conduct::Rejects, "begin: `cell/pick` rejected the goal"),
            (Conduct::Fails, "carry out `pick`: it  [31mslipped"),
            (Conduct::Denies, "carry out `pick`: it is glued"),
        ] {
            cell.conduct(conduct);
            assert_eq!(act(&mut device, PICK_CUP).await, Err(reason.to_owned()), "{dialect}");
            assert_eq!(facts(&device), before, "{dialect}: {conduct:?}");
        }
        cell.conduct(Conduct::Succeeds);
        assert!(act(&mut device, PICK_CUP).await.is_ok(), "{dialect}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_cancelled_action_cancels_its_goal_and_leaves_its_effect_unknown() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut device = arm(&cell, dialect).await;
        cell.conduct(Conduct::Hangs);
        let call = call(PICK_CUP);
        let performing = device.perform(&call);
        tokio::select! {
            ended = performing => panic!("{dialect}: it ended: {ended:?}"),
            () = cell.until_running(1) => (),
        }
        device.on_failure(&call, &MethodFailure::GivenUp);
        cell.until_running(0).await;
        let known = facts(&device);
        for fact in ["(unknown (held arm-1 cup-1))", "(unknown (empty arm-1))"] {
            assert!(known.iter().any(|one| one == fact), "{dialect}: {fact} is not in {known:?}");
        }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_arm_is_still_when_its_servers_have_no_goal() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut device = arm(&cell, dialect).await;
        cell.conduct(Conduct::Hangs);
        let running = tokio::spawn(device.perform(&call(PICK_CUP)));
        cell.until_running(1).await;
        let still = device.stand_still().expect("it can be asked");
        assert_eq!(still.await, Ok(()), "{dialect}");
        cell.until_running(0).await;
        assert!(running.await.expect("no panic").is_err(), "{dialect}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_goal_without_end_is_cancelled_after_its_time_and_other_goals_do_not_end_it() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut entry = config(&cell.endpoint, dialect);
        entry["actions"]["pick"]["time-out"] = json!("2s");
        let mut device = reached(entry).await;
        cell.conduct(Conduct::Hangs);
        let another = async {
            cell.until_running(1).await;
            let other = json!({ "goal_info": { "goal_id": { "uuid": vec![7; 16] } }, "status": 4 });
            let statuses = json!({ "status_list": [other] });
            let status = "action_msgs/msg/GoalStatusArray";
            cell.node.publish("pick/_action/status", status, &statuses).await;
        };
        let (ended, ()) = tokio::join!(act(&mut device, PICK_CUP), another);
        assert_eq!(ended, Err("finish within 2s".to_owned()), "{dialect}");
        cell.until_running(0).await;
        assert!(facts(&device).contains(&"(unknown (held arm-1 cup-1))".to_owned()), "{dialect}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_service_is_an_action_and_its_failures_have_reasons() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut device = arm(&cell, dialect).await;
        let calibrate = "(calibrate arm-1)";
        let done = act(&mut device, calibrate).await.expect("it is calibrated");
        assert_eq!(done.detail, "at the stops");
        assert!(facts(&device).contains(&"(calibrated arm-1)".to_owned()), "{dialect}");

        let mut device = arm(&cell, dialect).await;
        for (conduct, reason, is_unknown) in [
            (Conduct::Fails, "carry out `calibrate`: at the stops", false),
            (Conduct::Babbles, "read what `cell/calibrate` says: ", true),
            (Conduct::Hangs, "within 3s", true),
        ] {
            cell.conduct(conduct);
            let said = act(&mut device, calibrate).await.expect_err("it fails");
            assert!(said.contains(reason), "{dialect}: {said}");
            let unknown = "(unknown (calibrated arm-1))".to_owned();
            assert_eq!(facts(&device).contains(&unknown), is_unknown, "{dialect}: {conduct:?}");
        }
        let mut entry = config(&cell.endpoint, dialect);
        entry["actions"]["calibrate"]["service"]["name"] = json!("calibrate_all");
        let mut device = reached(entry).await;
        let said = act(&mut device, calibrate).await.expect_err("no node has it");
        assert!(said.contains("`cell/calibrate_all`: no node of the robot answered"), "{said}");
        assert!(!facts(&device).contains(&"(unknown (calibrated arm-1))".to_owned()), "{dialect}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_topic_tells_facts_until_it_is_silent() {
    for (wire, dialect) in WIRES {
        let cell = Cell::start(wire, None).await;
        let mut device = arm(&cell, dialect).await;
        let (yes, no) = ("(gripping arm-1)", "(not (gripping arm-1))");
        let unknown = "(unknown (gripping arm-1))";
        until_fact(&mut device, unknown).await;
        // The subscription may come after the first messages.
        let cell = &cell;
        let telling = |force: f64| async move {
            loop {
                cell.grip(force).await;
                tokio::time::sleep(Duration::from_millis(50)).await;
            }
        };
        tokio::select! {
            () = telling(3.0) => (),
            () = until_fact(&mut device, yes) => (),
        }
        assert!(facts(&device).contains(&"(= (force arm-1) 3)".to_owned()), "{:?}", facts(&device));
        tokio::select! {
            () = telling(2.0) => (),
            () = until_fact(&mut device, no) => (),
        }
        until_fact(&mut device, unknown).await;
        assert_eq!(facts(&device).iter().filter(|fact| fact.contains("force")).count(), 0);
    }
}

/// The messages count as long as the link exists.
#[tokio::test(flavor = "multi_thread")]
async fn a_topic_follows_an_action_until_it_tells_more_and_ignores_no_nonsense() {
    let cell = Cell::start(RobotWire::RmwZenoh(7), None).await;
    let mut entry = config(&cell.endpoint, "rmw-zenoh");
    entry["topics"][0].as_object_mut().expect("a table").remove("valid-for");
    let mut device = reached(entry).await;
    // The subscription may come after the first messages. The last one is read before the next step.
    let telling = async {
        loop {
            cell.grip(2.0).await;
            tokio::time::sleep(Duration::from_millis(500)).await;
        }
    };
    tokio::select! {
        () = telling => (),
        () = until_fact(&mut device, "(not (gripping arm-1))") => (),
    }
    act(&mut device, PICK_CUP).await.expect("it picks");
    assert!(facts(&device).contains(&"(gripping arm-1)".to_owned()), "{:?}", facts(&device));
    cell.grip(1.0).await;
    until_fact(&mut device, "(not (gripping arm-1))").await;
    cell.node.publish_bytes("gripper", GRIPPER_TYPE, vec![9; 3]).await;
    until_fact(&mut device, "(unknown (gripping arm-1))").await;
    cell.grip(2.5).await;
    until_fact(&mut device, "(gripping arm-1)").await;
}

/// The daemon announces between two calls of `next_event`, and after an action.
#[tokio::test(flavor = "multi_thread")]
async fn a_message_that_differs_from_what_was_announced_is_an_event() {
    let cell = Cell::start(RobotWire::Ros2Dds, None).await;
    let mut entry = config(&cell.endpoint, "ros2dds");
    entry["topics"][0].as_object_mut().expect("a table").remove("valid-for");
    let mut device = reached(entry).await;
    until_fact(&mut device, "(unknown (gripping arm-1))").await;
    let first = device.next_event().expect("it has events");
    let event = tokio::time::timeout(PATIENCE, first).await.expect("the state is new");
    assert!(event(&mut device).is_empty());

    let nodes = device.nodes();
    let mut state = nodes.state.subscribe();
    let rule = device.settings.topics[0].valid_for;
    let is_told = |state: &NodeState| state.topics[0].fact(0, rule) != FactState::Unknown;
    let telling = async {
        loop {
            cell.grip(1.0).await;
            tokio::time::sleep(Duration::from_millis(500)).await;
        }
    };
    tokio::select! {
        () = telling => (),
        told = state.wait_for(is_told) => drop(told.expect("a sender")),
    }

    let second = device.next_event().expect("it has events");
    let event = tokio::time::timeout(PATIENCE, second).await.expect("the message is an event");
    assert!(event(&mut device).is_empty());
    let opened = "(not (gripping arm-1))".to_owned();
    assert!(facts(&device).contains(&opened), "{:?}", facts(&device));

    let third = tokio::spawn(device.next_event().expect("it has events"));
    act(&mut device, PICK_CUP).await.expect("it picks");
    assert!(facts(&device).contains(&"(gripping arm-1)".to_owned()), "{:?}", facts(&device));
    cell.grip(1.0).await;
    let event = tokio::time::timeout(PATIENCE, third).await.expect("it differs from the action");
    assert!(event.expect("no panic")(&mut device).is_empty());
    assert!(facts(&device).contains(&opened), "{:?}", facts(&device));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_arm_out_of_reach_offers_no_actions_and_says_why() {
    let cell = Cell::start(RobotWire::Ros2Dds, None).await;
    let mut device = arm(&cell, "ros2dds").await;
    let endpoint = cell.endpoint.clone();
    cell.node.close().await;
    drop(cell);
    let gone = async {
        while !device.describe().model.actions.is_empty() {
            let event = device.next_event().expect("it has events").await;
            event(&mut device);
        }
    };
    tokio::time::timeout(PATIENCE, gone).await.expect("in time");
    let said = act(&mut device, PICK_CUP).await.expect_err("nothing is there");
    assert!(said.starts_with(&format!("reach the robot at `{endpoint}`: ")), "{said}");
    assert!(facts(&device).contains(&"(empty arm-1)".to_owned()), "nothing was begun");

    let _cell = Cell::start(RobotWire::Ros2Dds, Some(&endpoint)).await;
    let back = async {
        while device.describe().model.actions.is_empty() {
            let event = device.next_event().expect("it has events").await;
            event(&mut device);
        }
    };
    tokio::time::timeout(PATIENCE, back).await.expect("in time");
    assert!(act(&mut device, PICK_CUP).await.is_ok());
}

#[tokio::test(flavor = "multi_thread")]
async fn an_arm_that_was_never_there_offers_no_actions() {
    let mut device = ros_actuator(&blueprint(config("tcp/127.0.0.1:9", "ros2dds"))).expect("right");
    device.read_state().expect("it reads").await;
    assert!(device.describe().model.actions.is_empty());
    let said = act(&mut device, PICK_CUP).await.expect_err("nothing is there");
    assert!(said.contains("nothing answers there"), "{said}");
}
