//! Times of robots: what they report, what is requested of them, and what follows their death.

use std::collections::BTreeMap;
use std::time::{Duration, Instant};

use acl::Message;
use acl::content::{Act, Inform, Keep, Partition, Request};
use agent::AgentSettings;
use building::{Building, Layout};
use keyboard::{GoalRequest, Terminal, UserEvent, UserRequest};
use serde_json::json;
use simulated_nav2::{Nav2Settings, RobotNode, RobotWire, SimulatedNav2};

use crate::support::{self, Figures, Machine, Outcome, PATIENCE};
use crate::{ECOSYSTEM, Listener, REASONING, enter, office, times};

/// Number of reports of a robot, and the aim for their delay.
const REPORTS: usize = 200;
const REPORT_MS: f64 = 20.0;

/// Pause between two reports. An actuator announces events at most every hundred milliseconds.
const BETWEEN: Duration = Duration::from_millis(150);

/// Number of requests to a robot, and the aim for the time until its Nav2 has the goal.
const REQUESTS: usize = 100;
const REQUEST_MS: f64 = 10.0;

/// Number of robots that die in each flow, and the aim for the time until another robot moves.
const DEATHS: usize = 15;
const DEATH_MS: f64 = 50.0;

/// Duration of a second of the building in which robots die, in seconds. A trip takes two seconds,
/// in which the robot is killed.
const PACE: f64 = 0.15;

const ROBOT: &str = "turtlebot-1";

/// The places of the map, with their positions on the robot's map.
const PLACES: [(&str, f64, f64); 4] = [
    ("corridor", 0.0, 0.0),
    ("office1", 4.0, 0.0),
    ("office2", -6.0, 0.0),
    ("conf-room", 0.0, 8.0),
];

const WIRES: [(RobotWire, &str); 2] =
    [(RobotWire::Ros2Dds, "ros2dds"), (RobotWire::RmwZenoh(7), "rmw-zenoh")];

/// Returns the entry of a robot at `endpoint`.
fn entry(endpoint: &str, dialect: &str) -> String {
    let poses = PLACES.map(|(place, x, y)| format!("{place} = {{ x = {x}, y = {y} }}\n"));
    format!(
        "[[agent]]\nname = \"{ROBOT}\"\nplugin = \"turtlebot\"\ndriver = \"ros2\"\ndaemon = \"laptop\"\n\n\
         [agent.config]\nstart = \"corridor\"\n\n[agent.config.ros2]\nendpoint = \"{endpoint}\"\n\
         dialect = \"{dialect}\"\ndomain-id = 7\n\n[agent.config.ros2.places]\n{}\n",
        poses.concat()
    )
}

/// Starts these daemons, each when the one before is ready.
async fn start(
    machine: &Machine,
    daemons: &[&str],
    mode: &str,
) -> Outcome<BTreeMap<String, support::Process>> {
    let mut processes = BTreeMap::new();
    for daemon in daemons {
        let mut process = machine.start(daemon, mode)?;
        process.ready().await?;
        processes.insert((*daemon).to_owned(), process);
    }
    Ok(processes)
}

// === reports ===

/// Measures the time from a robot's message about its pose to the fact that follows from it.
pub(crate) async fn reports() -> Outcome<()> {
    for (wire, dialect) in WIRES {
        let interfaces = ros2_link::standard_interfaces();
        let (node, endpoint) = RobotNode::open(wire, None, "", interfaces).await?;
        let machine = office(&entry(&endpoint, dialect))?;
        let _processes = start(&machine, &[REASONING, "laptop"], "centralized").await?;
        let mut listener = Listener::open(&machine, ECOSYSTEM, REASONING).await?;
        tell(&node, true).await;
        until_told(&node, &mut listener).await?;
        let (mut figures, reports) = (Figures::default(), times(REPORTS));
        for number in 0..reports {
            tokio::time::sleep(BETWEEN).await;
            let is_localized = number % 2 == 1;
            let began = Instant::now();
            tell(&node, is_localized).await;
            let (at, ()) = listener.next(|message| says(message, is_localized)).await?;
            figures.push(at - began);
        }
        let what = format!("{dialect}, {reports} times: a robot's pose to the fact at `watch`");
        figures.tell(&what);
        support::judge("p99", figures.within(0.99), REPORT_MS);
    }
    Ok(())
}

/// Publishes the pose of a robot in the corridor, which is certain or not.
async fn tell(node: &RobotNode, is_localized: bool) {
    let mut covariance = [0.0; 36];
    covariance[0] = if is_localized { 0.05 } else { 25.0 };
    let pose = json!({ "position": { "x": 0.0, "y": 0.0 } });
    let message = json!({
        "header": { "frame_id": "map" },
        "pose": { "pose": pose, "covariance": covariance.to_vec() },
    });
    node.publish("amcl_pose", "geometry_msgs/msg/PoseWithCovarianceStamped", &message).await;
}

/// Whether the robot's agent reports that the robot stands in the corridor, or else is lost.
fn says(message: &Message, is_localized: bool) -> Option<()> {
    let fact = match is_localized {
        true => format!("(at {ROBOT} corridor)"),
        false => format!("(lost {ROBOT})"),
    };
    let is_its = message.sender.as_str() == ROBOT;
    let heartbeat = match message.content_as::<Inform>().ok().filter(|_| is_its)? {
        Inform::Heartbeat(heartbeat) => heartbeat,
        Inform::Model(announced) => announced.heartbeat,
        Inform::Epoch(_) | Inform::Answer(_) => return None,
    };
    heartbeat.facts.contains(&fact).then_some(())
}

/// Lets the robot report by turns that it is lost and that it is not, until its agent follows.
async fn until_told(node: &RobotNode, listener: &mut Listener) -> Outcome<()> {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        for is_localized in [false, true] {
            tell(node, is_localized).await;
            let heard = listener.next(|message| says(message, is_localized));
            let heard = tokio::time::timeout(BETWEEN * 4, heard).await;
            if is_localized && heard.is_ok_and(|heard| heard.is_ok()) {
                return Ok(());
            }
        }
    }
    Err("the robot's agent does not follow".into())
}

// === requests ===

/// Measures the time from the executor's request to the goal at Nav2.
pub(crate) async fn requests() -> Outcome<()> {
    for (wire, dialect) in WIRES {
        let building = Building::new(layout(&[(ROBOT, "corridor")])?, 0.0)?;
        let settings = Nav2Settings {
            robot: ROBOT.to_owned(),
            wire,
            listen: None,
            namespace: String::new(),
            places: PLACES.map(|(place, x, y)| (place.to_owned(), (x, y))).into(),
            battery_range: None,
        };
        let nav2 = SimulatedNav2::start(building.handle(), settings).await?;
        let machine = office(&entry(nav2.endpoint(), dialect))?;
        let _processes = start(&machine, &[REASONING, "laptop"], "centralized").await?;
        let mut listener = Listener::open(&machine, ECOSYSTEM, REASONING).await?;
        let mut person = enter(&machine, &[ROBOT]).await?;
        let (mut figures, requests) = (Figures::default(), times(REQUESTS));
        for number in 0..requests {
            let place = if number % 2 == 0 { "office1" } else { "corridor" };
            wish(&person, &format!("(at {ROBOT} {place})")).await?;
            let goals = u64::try_from(number + 1)?;
            let received = async {
                tokio::time::timeout(PATIENCE, nav2.until_goals(goals)).await?;
                Outcome::Ok(Instant::now())
            };
            let (asked, received) = tokio::join!(listener.next(act), received);
            figures.push(received?.saturating_duration_since(asked?.0));
            until_over(&mut person).await?;
        }
        let what = format!("{dialect}, {requests} times: requested to goal at Nav2");
        figures.tell(&what);
        support::judge("p99", figures.within(0.99), REQUEST_MS);
    }
    Ok(())
}

/// Returns the requested action of a message.
fn act(message: &Message) -> Option<Act> {
    match message.content_as::<Request>().ok()? {
        Request::Act(act) => Some(*act),
        _ => None,
    }
}

async fn wish(person: &Terminal, goal: &str) -> Outcome<()> {
    let wish = GoalRequest {
        goal: goal.to_owned(),
        keep: Keep::Achieve,
        priority: 0,
        partition: Partition::Pursue,
    };
    person.requests.send(UserRequest::RequestGoal(wish)).await?;
    Ok(())
}

/// Waits until the person's goal is reached.
async fn until_over(person: &mut Terminal) -> Outcome<()> {
    loop {
        let heard = tokio::time::timeout(PATIENCE, person.events.recv()).await?;
        match heard.ok_or("the keyboard has ended")? {
            UserEvent::Report(_, report) if report.outcome == acl::content::Outcome::Done => {
                return Ok(());
            }
            UserEvent::Report(_, report) if report.outcome == acl::content::Outcome::Holds => {
                return Ok(());
            }
            heard if heard.is_final() => return Err(format!("{heard:?}").into()),
            _ => (),
        }
    }
}

// === deaths ===

/// Measures the time from the death of a robot on the way to the first action of the next plan.
pub(crate) async fn deaths() -> Outcome<()> {
    for mode in ["centralized", "decentralized"] {
        let (mut figures, deaths) = (Figures::default(), times(DEATHS));
        for _ in 0..deaths {
            let took = death(mode).await?;
            let grace = AgentSettings::default().grace;
            let took = took.checked_sub(grace);
            figures.push(took.ok_or("it took less time than the grace")?);
        }
        let what = format!("{mode}, {deaths} times: a robot killed to another one's action");
        figures.tell(&format!("{what}, `grace` taken off"));
        support::judge("p50", figures.within(0.5), DEATH_MS);
    }
    Ok(())
}

async fn death(mode: &str) -> Outcome<Duration> {
    let robots = [(ROBOT, "corridor"), ("turtlebot-2", "conf-room")];
    let building = Building::new(layout(&robots)?, PACE)?;
    let entries = robots.iter().enumerate().map(|(number, (robot, place))| {
        let daemon = format!("laptop-{number}");
        format!(
            "[[agent]]\nname = \"{robot}\"\nplugin = \"turtlebot\"\ndriver = \"simulated\"\n\
             daemon = \"{daemon}\"\nconfig = {{ start = \"{place}\" }}\n\n\
             [[agent]]\nname = \"ir-{number}\"\nplugin = \"ir-temperature-sensor\"\n\
             driver = \"simulated\"\ndaemon = \"{daemon}\"\nconfig = {{ mounted-on = \"{robot}\" }}\n\n"
        )
    });
    let machine = office(&entries.collect::<String>())?;
    let _server = building::serve(building.handle(), &machine.building()).await?;
    let mut processes = start(&machine, &[REASONING, "laptop-0", "laptop-1"], mode).await?;
    let mut listener = Listener::open(&machine, ECOSYSTEM, REASONING).await?;
    let person = enter(&machine, &[ROBOT, "turtlebot-2", "ir-0", "ir-1"]).await?;
    wish(&person, "(known-temperature office1)").await?;
    let (_, first) = listener.next(act).await?;
    if !first.action.contains(ROBOT) {
        return Err(format!("the nearer robot was not chosen: {}", first.action).into());
    }
    let killed = Instant::now();
    processes.get_mut("laptop-0").ok_or("it runs")?.kill()?;
    let later = |message: &Message| act(message).filter(|act| act.token.round > first.token.round);
    let (at, next) = listener.next(later).await?;
    if next.action.contains(ROBOT) {
        return Err("the dead robot was asked again".into());
    }
    Ok(at - killed)
}

/// Returns the building of the map, with these robots, each with a thermometer.
fn layout(robots: &[(&str, &str)]) -> Outcome<Layout> {
    let mut layout = Layout::new();
    layout.add_corridor("corridor", 19.0)?;
    for (room, meters) in [("office1", 4.0), ("office2", 6.0), ("conf-room", 8.0)] {
        layout.add_room(room, 20.0)?;
        layout.connect("corridor", room, meters)?;
    }
    for (number, (robot, place)) in robots.iter().enumerate() {
        layout.add_robot(robot, place, 0.3)?;
        layout.mount(&format!("ir-{number}"), robot)?;
    }
    Ok(layout)
}
