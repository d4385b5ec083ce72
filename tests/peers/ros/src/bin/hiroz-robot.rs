//! A robot with Nav2 whose nodes are those of `hiroz`, which speak as `rmw_zenoh` does: what they say
//! is written here, how it is said is `hiroz`'s.
//!
//!     hiroz-robot ENDPOINT DOMAIN [NAMESPACE]
//!
//! Its commands and events are those of `dds/robot.py`.

use std::io::BufRead;
use std::time::Duration;

use hiroz::Builder;
use hiroz::action::messages::CancelGoalServiceResponse;
use hiroz::action::server::{ExecutingGoal, RequestedGoal, ZActionServer};
use hiroz::action::{ClientGoalHandle, ZAction};
use hiroz::context::{ZContext, ZContextBuilder};
use hiroz::lifecycle::{LifecycleState, ZLifecycleNode};
use hiroz::node::ZNode;
use hiroz::pubsub::ZPub;
use hiroz::qos::{QosDurability, QosHistory, QosProfile, QosReliability};
use hiroz_msgs::ros::geometry_msgs::{Point, PoseWithCovarianceStamped};
use hiroz_msgs::ros::sensor_msgs::BatteryState;
use ros_peers::ros::irobot_create_msgs::action::{Dock, Undock};
use ros_peers::ros::irobot_create_msgs::{DockResult, DockStatus, UndockResult};
use ros_peers::ros::nav2_msgs::action::NavigateToPose;
use ros_peers::ros::nav2_msgs::{NavigateToPoseFeedback, NavigateToPoseGoal, NavigateToPoseResult};
use tokio::sync::mpsc;
use tokio::task::JoinSet;

/// The robot's clock: it says feedback and moves at this rate.
const TICK: Duration = Duration::from_millis(20);
const TICKS_TO_ARRIVE: u32 = 10;

/// How long another program looks for the robot's action server.
const SERVER_FOUND_WITHIN: Duration = Duration::from_secs(10);

type Publisher<M> = ZPub<M, <M as hiroz::msg::ZMessage>::Serdes>;

struct Robot {
    address: (String, usize, String),
    lifecycle: ZLifecycleNode,
    _node: ZNode,
    pose: Publisher<PoseWithCovarianceStamped>,
    battery: Publisher<BatteryState>,
    dock_status: Publisher<DockStatus>,
    behavior: Vec<String>,
    at: (f64, f64),
    share: f32,
    is_docked: bool,
    goal: Option<(ExecutingGoal<NavigateToPose>, u32)>,
    others: Vec<(ZContext, ClientGoalHandle<NavigateToPose>)>,
}

fn context((endpoint, domain, namespace): &(String, usize, String)) -> hiroz::Result<ZContext> {
    let builder =
        ZContextBuilder::default().with_router_endpoint(endpoint.as_str())?.with_domain_id(*domain);
    match namespace.is_empty() {
        true => builder.build(),
        false => builder.with_namespace(format!("/{namespace}")).build(),
    }
}

fn quality(reliability: QosReliability, durability: QosDurability) -> QosProfile {
    QosProfile { reliability, durability, history: QosHistory::from_depth(1), ..Default::default() }
}

fn tell(words: &str) {
    println!("{words}");
}

impl Robot {
    fn obey(&mut self, words: &[&str]) -> hiroz::Result<()> {
        match words {
            ["behave", behavior @ ..] => {
                self.behavior = behavior.iter().map(|word| (*word).to_owned()).collect();
            }
            ["lifecycle", "active"] => drop(self.lifecycle.activate()?),
            ["lifecycle", _] => drop(self.lifecycle.deactivate()?),
            ["pose", x, y] => {
                self.at = (x.parse()?, y.parse()?);
                self.tell_pose()?;
            }
            ["battery", share] => self.share = share.parse()?,
            ["docked", docked] => self.is_docked = *docked == "true",
            _ => panic!("no command: {words:?}"),
        }
        Ok(())
    }

    fn tell_pose(&self) -> hiroz::Result<()> {
        let mut message = PoseWithCovarianceStamped::default();
        message.header.frame_id = "map".to_owned();
        message.pose.pose.position = Point { x: self.at.0, y: self.at.1, z: 0.0 };
        message.pose.pose.orientation.w = 1.0;
        (message.pose.covariance[0], message.pose.covariance[7]) = (0.05, 0.05);
        self.pose.publish(&message)?;
        tell(&format!("pose {} {}", self.at.0, self.at.1));
        Ok(())
    }

    fn on_goal(&mut self, requested: RequestedGoal<NavigateToPose>) -> hiroz::Result<()> {
        let is_active = self.lifecycle.get_current_state() == LifecycleState::Active;
        if !is_active || self.behavior[0] == "reject" {
            tell("rejected");
            return requested.reject();
        }
        let Point { x, y, .. } = requested.goal.pose.pose.position;
        tell(&format!("goal {x} {y}"));
        // Nav2 accepts a goal before it gives up the one in whose place it comes.
        let accepted = requested.accept();
        if let Some((before, _)) = self.goal.take() {
            tell("preempted");
            before.abort(NavigateToPoseResult::default())?;
        }
        self.goal = Some((accepted.execute(), 0));
        Ok(())
    }

    /// Carries the goal out for one tick.
    fn drive(&mut self) -> hiroz::Result<()> {
        let Some((goal, ticks)) = self.goal.take() else { return Ok(()) };
        if goal.is_cancel_requested() {
            tell("canceled");
            return goal.canceled(NavigateToPoseResult::default());
        }
        if self.behavior[0] == "abort" {
            tell("aborted");
            return goal.abort(NavigateToPoseResult {
                error_code: self.behavior[1].parse()?,
                error_msg: self.behavior[2..].join(" "),
            });
        }
        let to = goal.goal.pose.pose.position.clone();
        let meters = (to.x - self.at.0).hypot(to.y - self.at.1) as f32;
        let left = TICKS_TO_ARRIVE.saturating_sub(ticks) as f32 / TICKS_TO_ARRIVE as f32;
        goal.publish_feedback(NavigateToPoseFeedback {
            distance_remaining: left * meters,
            ..Default::default()
        })?;
        if self.behavior[0] == "arrive" && ticks >= TICKS_TO_ARRIVE {
            self.at = (to.x, to.y);
            self.tell_pose()?;
            tell("arrived");
            return goal.succeed(NavigateToPoseResult::default());
        }
        self.goal = Some((goal, ticks + 1));
        Ok(())
    }

    fn tell_state(&self) -> hiroz::Result<()> {
        let mut battery = BatteryState::default();
        battery.percentage = self.share;
        self.battery.publish(&battery)?;
        let mut dock = DockStatus::default();
        dock.is_docked = self.is_docked;
        self.dock_status.publish(&dock)
    }

    /// Another program, with a session of its own, sends a goal.
    fn send_other_goal(
        &self,
        x: f64,
        y: f64,
    ) -> impl Future<Output = hiroz::Result<Other>> + use<> {
        let address = self.address.clone();
        async move {
            let context = context(&address)?;
            let node = context.create_node("another_program").build()?;
            let client = node.create_action_client::<NavigateToPose>("navigate_to_pose").build()?;
            assert!(client.wait_for_server(SERVER_FOUND_WITHIN).await, "it finds the server");
            let mut goal = NavigateToPoseGoal::default();
            goal.pose.pose.position = Point { x, y, z: 0.0 };
            Ok((context, client.send_goal(goal).await?))
        }
    }
}

type Other = (ZContext, ClientGoalHandle<NavigateToPose>);

/// Answers requests to cancel goals: `hiroz` leaves them to the program.
async fn answer_cancel<A: ZAction>(server: &ZActionServer<A>) -> hiroz::Result<()> {
    let (request, query) = server.recv_cancel().await?;
    let is_done = server.request_cancel(request.goal_info.goal_id);
    let response = CancelGoalServiceResponse {
        return_code: if is_done { 0 } else { 3 },
        goals_canceling: is_done.then_some(request.goal_info).into_iter().collect(),
    };
    server.send_cancel_response_low(&query, &response)
}

/// Begins each goal of a dock, waits, and succeeds.
async fn serve_dock<A: ZAction>(
    server: ZActionServer<A>,
    result: A::Result,
    is_docked: bool,
    done: mpsc::UnboundedSender<bool>,
) -> hiroz::Result<()> {
    loop {
        let goal = server.recv_goal().await?.accept().execute();
        tokio::time::sleep(TICK * TICKS_TO_ARRIVE).await;
        done.send(is_docked).ok();
        goal.succeed(result.clone())?;
    }
}

/// Serves the dock. Returns whether the robot is docked, after each goal.
fn serve_docks(node: &ZNode) -> hiroz::Result<mpsc::UnboundedReceiver<bool>> {
    let (done, docked) = mpsc::unbounded_channel();
    let dock = node.create_action_server::<Dock>("dock").build()?;
    let undock = node.create_action_server::<Undock>("undock").build()?;
    tokio::spawn(serve_dock(dock, DockResult { is_docked: true }, true, done.clone()));
    tokio::spawn(serve_dock(undock, UndockResult { is_docked: false }, false, done));
    Ok(docked)
}

fn read_commands() -> mpsc::UnboundedReceiver<String> {
    let (sender, lines) = mpsc::unbounded_channel();
    std::thread::spawn(move || {
        for line in std::io::stdin().lock().lines().map_while(Result::ok) {
            drop(sender.send(line));
        }
    });
    lines
}

#[tokio::main]
async fn main() -> hiroz::Result<()> {
    zenoh::init_log_from_env_or("error");
    let mut arguments = std::env::args().skip(1);
    let mut next = || arguments.next().unwrap_or_default();
    let address = (next(), next().parse()?, next());
    let context = context(&address)?;
    let mut lifecycle = context.create_lifecycle_node("bt_navigator").build()?;
    lifecycle.configure()?;
    lifecycle.activate()?;
    let node = context.create_node("robot").build()?;
    let latched = quality(QosReliability::Reliable, QosDurability::TransientLocal);
    let sensor = quality(QosReliability::BestEffort, QosDurability::Volatile);
    let navigate = node
        .create_action_server::<NavigateToPose>("navigate_to_pose")
        .with_status_topic_qos(latched.clone())
        .build()?;
    let mut docked = serve_docks(&node)?;
    let initial = node.create_sub::<PoseWithCovarianceStamped>("initialpose").build()?;
    let mut robot = Robot {
        pose: node.create_pub("amcl_pose").with_qos(latched).build()?,
        battery: node.create_pub("battery_state").with_qos(sensor.clone()).build()?,
        dock_status: node.create_pub("dock_status").with_qos(sensor).build()?,
        address,
        lifecycle,
        _node: node,
        behavior: vec!["arrive".to_owned()],
        at: (0.0, 0.0),
        share: 0.75,
        is_docked: false,
        goal: None,
        others: Vec::new(),
    };
    if let Ok(pose) = std::env::var("ROBOT_POSE") {
        let (x, y) = pose.split_once(' ').expect("two numbers");
        robot.obey(&["pose", x, y])?;
    }
    tell("ready");
    let mut commands = read_commands();
    let mut ticks = tokio::time::interval(TICK);
    let mut others = JoinSet::new();
    loop {
        tokio::select! {
            command = commands.recv() => {
                let Some(line) = command else { return Ok(()) };
                match line.split_whitespace().collect::<Vec<_>>().as_slice() {
                    ["other", x, y] => {
                        others.spawn(robot.send_other_goal(x.parse()?, y.parse()?));
                    }
                    words => robot.obey(words)?,
                }
            }
            requested = navigate.recv_goal() => robot.on_goal(requested?)?,
            answered = answer_cancel(&navigate) => answered?,
            is_docked = docked.recv() => {
                robot.is_docked = is_docked == Some(true);
                tell(if robot.is_docked { "docked" } else { "undocked" });
            }
            message = initial.async_recv() => {
                let at = message?.pose.pose.position;
                tell(&format!("initialpose {} {}", at.x, at.y));
                robot.at = (at.x, at.y);
                robot.tell_pose()?;
            }
            Some(other) = others.join_next() => robot.others.push(other??),
            _ = ticks.tick() => {
                robot.drive()?;
                robot.tell_state()?;
            }
        }
    }
}
