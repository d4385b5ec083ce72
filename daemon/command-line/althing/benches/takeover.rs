//! The machine with the leading reasoning agents is killed in the middle of a plan: the time until
//! a standby continues it.
//!
//! ```text
//! cargo bench -p althing --bench takeover
//! ```
//!
//! A robot is on its way to measure a temperature, with a process for each machine, in both flows.
//! The machine that hosts the Plan Requester, the Plan Executor, or all reasoning agents gets a
//! SIGKILL; another machine hosts the standbys. The clock stops when the new leader requests the
//! plan or its action, as received by a listener on Zenoh. There is no waiting by design, so
//! nothing is subtracted. The goal must then be reached by the plan that was under way.
//!
//! In the centralised flow the machine of the Planning Agent is also killed while the plan is
//! requested from it: it is stopped before, so that it cannot answer earlier. Then the clock stops
//! at the first action.
//!
//! If the aim is missed, the exit code shows that.

mod support;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{Keep, Outcome as Ended, Partition, Record, Request};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
use agent::{AgentSettings, MessageRouter, Mode, Resource, ResourceQuery};
use bytes::Bytes;
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use substrate_zenoh::{Config, Tap};
use support::{Figures, Machine, Outcome, PATIENCE, Process};
use tokio::sync::mpsc;

/// Number of deaths of each kind in each flow.
const DEATHS: usize = 20;
const AIM_MS: f64 = 500.0;

const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../../domains/smart-office/map.pddl");
const GOAL: &str = "(known-temperature office2)";

const PLANNER: &str = "planning-agent";
const REASONING: [&str; 4] = ["domain-maintainer", "plan-requester", PLANNER, "plan-executor"];

/// Number of Journals that must have the plan before the machine is killed: as many as keep a goal.
const KEPT_BY: usize = 2;

/// Maximum number of requests that wait to be read; further ones are lost.
const HEARD_MAX: usize = 1_024;

#[tokio::main]
async fn main() -> Outcome<()> {
    let deaths = if support::is_whole() { DEATHS } else { 1 };
    for mode in [Mode::Centralized, Mode::Decentralized] {
        println!("{mode}");
        for who in [&["plan-requester"][..], &["plan-executor"], &REASONING, &[PLANNER]] {
            if who == [PLANNER] && mode == Mode::Decentralized {
                // In the decentralised flow each device plans for itself.
                continue;
            }
            let mut figures = Figures::default();
            for death in 0..deaths {
                let took = play(who, mode).await;
                figures.push(took.map_err(|error| format!("{who:?}, death {death}: {error}"))?);
            }
            let whose = if who.len() == 1 { who[0] } else { "all who reason" };
            figures.tell(&format!("{whose}, {deaths} times: killed to taken over"));
            support::judge("p99", figures.within(0.99), AIM_MS);
        }
    }
    support::reached()
}

/// A request, the incarnation of its sender, and its time.
struct Asked {
    at: Instant,
    by: (AgentId, Incarnation),
    what: What,
}

/// The kinds of requests that agents send while a goal is planned for and carried out.
#[derive(Clone, Copy, PartialEq, Eq)]
enum What {
    Plan,
    Execution,
    Action,
}

/// Plays one death. Returns the time until a standby continued.
async fn play(who: &[&str], mode: Mode) -> Outcome<Duration> {
    let machine = Machine::new()?;
    std::fs::write(machine.path().join("domain.pddl"), ONTOLOGY)?;
    std::fs::write(machine.path().join("map.pddl"), MAP)?;
    std::fs::write(&machine.file, ecosystem(who))?;
    let mut processes = BTreeMap::new();
    for daemon in ["alpha", "beta", "gamma"] {
        let mut process = machine.start(daemon, &mode.to_string())?;
        // One after the other, so that the first one becomes the leader.
        process.ready().await?;
        processes.insert(daemon, process);
    }
    let (tell, mut heard) = mpsc::channel(HEARD_MAX);
    let hear = move |payload: &Bytes| {
        if let Some(asked) = asked(payload) {
            // A request that does not fit is lost; the wait for it then ends with an error.
            let _ = tell.try_send(asked);
        }
    };
    let _tap: Tap = substrate_zenoh::tap(client(&machine, "listener")?, move |_, message| {
        hear(&message.payload)
    })
    .await?;
    let mut person = enter(&machine).await?;
    let mut dying = processes.remove("alpha").ok_or("it runs")?;
    let plans = who == [PLANNER];
    if plans {
        dying.stop()?;
    }
    let wish = GoalRequest {
        goal: GOAL.to_owned(),
        keep: Keep::Achieve,
        priority: 0,
        partition: Partition::Pursue,
    };
    person.terminal.requests.send(UserRequest::RequestGoal(wish)).await?;
    let took = if plans {
        death_of_planner(&mut dying, &mut heard).await?
    } else {
        let next_is = if who.contains(&"plan-executor") { What::Action } else { What::Execution };
        death_on_the_way(&mut dying, &mut heard, &person, next_is).await?
    };
    dying.ended().await?;
    let plans = until_done(&mut person.terminal).await?;
    if plans != 1 {
        return Err(format!("{plans} plans were made").into());
    }
    Ok(took)
}

/// Kills the stopped machine when the plan is requested from it. Returns the time until an action
/// is requested.
async fn death_of_planner(
    dying: &mut Process,
    heard: &mut mpsc::Receiver<Asked>,
) -> Outcome<Duration> {
    next(heard, |asked| asked.what == What::Plan).await?;
    let killed = Instant::now();
    dying.kill()?;
    Ok(next(heard, |asked| asked.what == What::Action).await?.at - killed)
}

/// Kills the machine when the plan is carried out and Journals have it. Returns the time until the
/// new leader sends the next request.
async fn death_on_the_way(
    dying: &mut Process,
    heard: &mut mpsc::Receiver<Asked>,
    person: &Person,
    next_is: What,
) -> Outcome<Duration> {
    let first = next(heard, |asked| asked.what == What::Action).await?;
    until_kept(person).await?;
    let killed = Instant::now();
    dying.kill()?;
    let taken_over =
        next(heard, |asked| asked.at > killed && asked.what == next_is && asked.by != first.by);
    Ok(taken_over.await?.at - killed)
}

/// Waits until enough Journals report that they have the plan.
async fn until_kept(person: &Person) -> Outcome<()> {
    let deadline = Instant::now() + PATIENCE;
    let has_plan = |answer: &Bytes| {
        let records: Vec<Record> = serde_json::from_slice(answer).unwrap_or_default();
        records.iter().any(|record| record.key.starts_with("plan/") && !record.body.is_null())
    };
    loop {
        let ask = ResourceQuery { daemon: None, resource: Resource::Journal, agent: None };
        let answers = person.router.ask(ask, Duration::from_secs(2)).await;
        if answers.iter().filter(|answer| has_plan(answer)).count() >= KEPT_BY {
            return Ok(());
        }
        if Instant::now() > deadline {
            return Err("the plan is not kept".into());
        }
    }
}

async fn next(heard: &mut mpsc::Receiver<Asked>, is_it: impl Fn(&Asked) -> bool) -> Outcome<Asked> {
    loop {
        let asked = tokio::time::timeout(PATIENCE, heard.recv()).await?;
        let asked = asked.ok_or("the listener has ended")?;
        if is_it(&asked) {
            return Ok(asked);
        }
    }
}

/// Waits until the goal is reached. Returns the number of plans that were made for it.
async fn until_done(terminal: &mut Terminal) -> Outcome<usize> {
    let mut plans = 0;
    loop {
        let heard = tokio::time::timeout(PATIENCE, terminal.events.recv()).await?;
        match heard.ok_or("the keyboard has ended")? {
            UserEvent::Report(_, report) if report.outcome == Ended::Done => return Ok(plans),
            UserEvent::Report(_, report) if !report.outcome.is_final() => {
                plans += usize::from(report.plan.is_some());
            }
            heard if heard.is_final() => return Err(format!("{heard:?}").into()),
            _ => (),
        }
    }
}

fn asked(payload: &Bytes) -> Option<Asked> {
    let at = Instant::now();
    let message = acl::decode(payload).ok()?;
    let what = match message.content_as::<Request>().ok()? {
        Request::Plan(_) => What::Plan,
        Request::Execute(_) => What::Execution,
        Request::Act(_) => What::Action,
        _ => return None,
    };
    Some(Asked { at, by: (message.sender, message.incarnation), what })
}

/// A user that requests goals, and can query the Journals.
struct Person {
    terminal: Terminal,
    router: Arc<MessageRouter>,
}

/// Launches a keyboard for the user, once the robot can be planned with.
async fn enter(machine: &Machine) -> Outcome<Person> {
    let config = client(machine, "person")?;
    let (ecosystem, daemon) = (config.ecosystem.clone(), config.daemon.clone());
    let router = MessageRouter::new(ecosystem, daemon, AgentSettings::default());
    router.connect(config.open(Arc::<MessageRouter>::clone(&router)).await?);
    let devices = ["turtlebot-1", "ir-1"].map(ToOwned::to_owned);
    support::await_offers(&router, &devices.into()).await?;
    let (keyboard, terminal) = Keyboard::with_terminal();
    support::launch(&AgentId::new("user")?, Box::new(keyboard), &router, "smart-office");
    Ok(Person { terminal, router })
}

/// Returns the configuration of a client of the daemon that is not killed.
fn client(machine: &Machine, name: &str) -> Outcome<Config> {
    let mut config = Config::new(EcosystemId::new("takeover")?, DaemonId::new(name)?);
    config.mode = substrate_zenoh::SessionMode::Client;
    config.connect = vec![machine.endpoint("takeover", "gamma")];
    Ok(config)
}

/// Returns an ecosystem in which `alpha` and `beta` host the given agents, and `gamma` hosts the
/// others and a robot that carries a thermometer.
fn ecosystem(who: &[&str]) -> String {
    let mut text = "[ecosystem]\nname = \"takeover\"\ndomain = \"domain.pddl\"\n\
                    problem = \"map.pddl\"\n\n[building]\ntime-scale = 0.05\n\n"
        .to_owned();
    let mut agent = |name: &str, plugin: &str, daemons: &str, config: &str| {
        text += &format!(
            "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\ndaemon = {daemons}\n\
             config = {config}\n\n"
        );
    };
    for plugin in REASONING {
        let dies = who.contains(&plugin);
        let daemons = if dies { "[\"alpha\", \"beta\"]" } else { "\"gamma\"" };
        agent(plugin, plugin, daemons, "{}");
    }
    for daemon in ["alpha", "beta", "gamma"] {
        agent(&format!("journal-{daemon}"), "journal", &format!("\"{daemon}\""), "{}");
    }
    agent("turtlebot-1", "turtlebot", "\"gamma\"", "{ start = \"conf-room\" }");
    let on_robot = "{ mounted-on = \"turtlebot-1\" }";
    agent("ir-1", "ir-temperature-sensor", "\"gamma\"", on_robot);
    text
}
