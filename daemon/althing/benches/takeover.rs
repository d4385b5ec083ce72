//! The machine that reasons is killed in the middle of a plan: the time until another goes on with
//! it.
//!
//! ```text
//! cargo bench -p althing --bench takeover
//! ```
//!
//! A robot is on its way to measure a temperature, a process for each machine, in both flows. The
//! machine that hosts the Plan Requester, the Plan Executor, or all who reason gets a SIGKILL;
//! another machine stands by. The clock stops when who took over asks for the plan, or for its
//! action, as a listener on Zenoh hears it. Nothing is waited for by design, so nothing is taken
//! off. The goal must then be reached by the plan that was under way.

mod support;

use std::collections::BTreeMap;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::{Keep, Outcome as Ended, Partition, Request};
use acl::{AgentId, DaemonId, EcosystemId, Incarnation};
use agent::{Mode, Settings, Switchboard};
use bytes::Bytes;
use keyboard::{Heard, Keyboard, Said, Terminal, Wish};
use substrate_zenoh::{Config, Tap};
use support::{Figures, Machine, Outcome, PATIENCE};
use tokio::sync::mpsc;

/// Deaths of each kind in each flow.
const DEATHS: usize = 20;
const AIM_MS: f64 = 500.0;

const ONTOLOGY: &str = include_str!("../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../domains/smart-office/map.pddl");
const GOAL: &str = "(known-temperature office2)";

const REASONING: [&str; 4] =
    ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];

/// Requests that wait to be read.
const HEARD_MAX: usize = 1_024;

#[tokio::main]
async fn main() -> Outcome<()> {
    let deaths = if support::is_whole() { DEATHS } else { 1 };
    for mode in [Mode::Centralized, Mode::Decentralized] {
        println!("{mode}");
        for who in [&["plan-requester"][..], &["plan-executor"], &REASONING] {
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
    Ok(())
}

/// What was asked of whom, by which life of whom, and when.
struct Asked {
    at: Instant,
    by: (AgentId, Incarnation),
    is_action: bool,
}

/// Plays one death; how long until somebody went on.
async fn play(who: &[&str], mode: Mode) -> Outcome<Duration> {
    let machine = Machine::new()?;
    std::fs::write(machine.path().join("domain.pddl"), ONTOLOGY)?;
    std::fs::write(machine.path().join("map.pddl"), MAP)?;
    std::fs::write(&machine.file, ecosystem(who))?;
    let mut processes = BTreeMap::new();
    for daemon in ["alpha", "beta", "gamma"] {
        let mut process = machine.start(daemon, &mode.to_string())?;
        // One after the other: who comes first acts.
        process.ready().await?;
        processes.insert(daemon, process);
    }
    let (tell, mut heard) = mpsc::channel(HEARD_MAX);
    let hear = move |payload: &Bytes| {
        if let Some(asked) = asked(payload) {
            // What does not fit is missed, and then waited for in vain: the benchmark says so.
            let _ = tell.try_send(asked);
        }
    };
    let _tap: Tap =
        substrate_zenoh::tap(client(&machine, "listener")?, move |_, payload| hear(&payload))
            .await?;
    let mut terminal = enter(&machine).await?;
    let wish = Wish {
        goal: GOAL.to_owned(),
        keep: Keep::Achieve,
        priority: 0,
        partition: Partition::Pursue,
    };
    terminal.say.send(Said::Wish(wish)).await?;
    // It is carried out, and those who keep the plan have had the time to write it down.
    let first = next(&mut heard, |asked| asked.is_action).await?;
    tokio::time::sleep(Duration::from_millis(100)).await;
    let mut process = processes.remove("alpha").ok_or("it runs")?;
    let killed = Instant::now();
    process.kill()?;
    let wants_action = who.contains(&"plan-executor");
    let taken_over = next(&mut heard, |asked| {
        asked.at > killed && asked.is_action == wants_action && asked.by != first.by
    });
    let took = taken_over.await?.at - killed;
    process.ended().await?;
    let plans = until_done(&mut terminal).await?;
    if plans != 1 {
        return Err(format!("{plans} plans were made").into());
    }
    Ok(took)
}

async fn next(heard: &mut mpsc::Receiver<Asked>, is_it: impl Fn(&Asked) -> bool) -> Outcome<Asked> {
    loop {
        let asked = tokio::time::timeout(PATIENCE, heard.recv()).await?;
        let asked = asked.ok_or("nobody listens")?;
        if is_it(&asked) {
            return Ok(asked);
        }
    }
}

/// Waits until the goal is reached; how many plans were made for it.
async fn until_done(terminal: &mut Terminal) -> Outcome<usize> {
    let mut plans = 0;
    loop {
        let heard = tokio::time::timeout(PATIENCE, terminal.hear.recv()).await?;
        match heard.ok_or("the keyboard has ended")? {
            Heard::Report(_, report) if report.outcome == Ended::Done => return Ok(plans),
            Heard::Report(_, report) if !report.outcome.is_final() => {
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
    let is_action = match message.content_as::<Request>().ok()? {
        Request::Act(_) => true,
        Request::Execute(_) => false,
        _ => return None,
    };
    Some(Asked { at, by: (message.sender, message.incarnation), is_action })
}

/// A keyboard for the person, when the robot can be planned with.
async fn enter(machine: &Machine) -> Outcome<Terminal> {
    let config = client(machine, "person")?;
    let (ecosystem, daemon) = (config.ecosystem.clone(), config.daemon.clone());
    let switchboard = Switchboard::new(ecosystem, daemon, Settings::default());
    switchboard.connect(config.open(Arc::<Switchboard>::clone(&switchboard)).await?);
    let devices = ["turtlebot-1", "ir-1"].map(ToOwned::to_owned);
    support::await_offers(&switchboard, &devices.into()).await?;
    let (keyboard, terminal) = Keyboard::with_terminal();
    support::launch(&AgentId::new("user")?, Box::new(keyboard), &switchboard, "smart-office");
    Ok(terminal)
}

/// A client of the daemon that lives.
fn client(machine: &Machine, name: &str) -> Outcome<Config> {
    let mut config = Config::new(EcosystemId::new("takeover")?, DaemonId::new(name)?);
    config.mode = substrate_zenoh::Mode::Client;
    config.connect = vec![machine.endpoint("takeover", "gamma")];
    Ok(config)
}

/// `alpha` and `beta` host those who are to die, `gamma` the others, and a robot that carries a
/// thermometer.
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
