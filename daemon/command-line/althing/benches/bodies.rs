//! Robots, cameras and stops: the times between a body and the messages of agents.
//!
//! ```text
//! cargo bench -p althing --bench bodies
//! ```
//!
//! - A robot reports that it does not know where it is, or knows it again: the time until a listener on
//!   Zenoh, such as `althing watch`, receives the new fact.
//! - The Plan Executor requests a move: the time from the request on Zenoh to the goal at a simulated
//!   Nav2, with the record on disk before.
//! - The process of a robot gets a SIGKILL on the way: the time until the first action of the next
//!   plan, without the grace.
//! - A stand-in for an ONVIF camera reports motion: the time until the camera's agent requests a goal.
//! - `althing stop` with a hundred devices: the time from the start of the command to the last
//!   confirmation, that from its first request, and the whole command.
//!
//! Robots and cameras are reached over loopback, in both dialects of ROS 2. If an aim is missed, the
//! exit code shows that.

#[path = "../../../../tests/support/onvif_camera.rs"]
#[allow(dead_code, reason = "what the tests of cameras need besides")]
mod onvif_camera;
#[path = "bodies/robots.rs"]
mod robots;
#[path = "bodies/stopping.rs"]
mod stopping;
mod support;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, Instant};

use acl::content::Request;
use acl::{AgentId, DaemonId, EcosystemId, Message};
use agent::{AgentSettings, MessageRouter};
use keyboard::{Keyboard, Terminal};
use onvif_camera::StandIn;
use substrate_zenoh::{Config, Tap};
use support::{Figures, Machine, Outcome, PATIENCE};
use tokio::sync::mpsc;

/// Number of times that motion is reported, and the aim for the delay.
const MOTIONS: usize = 50;
const MOTION_MS: f64 = 150.0;

/// Pause between the end of motion and the next motion. The camera's agent announces motion in one
/// place at most every hundred milliseconds, as the file of this benchmark says.
const QUIET: Duration = Duration::from_millis(400);

/// Time after which motion is reported once more, as long as the camera is not connected.
const REPORT_AGAIN: Duration = Duration::from_millis(500);

/// Maximum number of messages that wait to be read; further ones are lost.
const HEARD_MAX: usize = 16_384;

pub(crate) const ONTOLOGY: &str = include_str!("../../../../domains/smart-office/domain.pddl");
pub(crate) const MAP: &str = include_str!("../../../../domains/smart-office/map.pddl");

/// Name of the ecosystem, and of the daemon with the reasoning agents.
pub(crate) const ECOSYSTEM: &str = "bodies";
pub(crate) const REASONING: &str = "reasoning";

#[tokio::main]
async fn main() -> Outcome<()> {
    robots::reports().await?;
    robots::requests().await?;
    robots::deaths().await?;
    motions().await?;
    stopping::stops().await?;
    support::reached()
}

/// Returns how often something is measured: `whole` times, or twice if Cargo only checks that the
/// benchmark runs.
pub(crate) fn times(whole: usize) -> usize {
    if support::is_whole() { whole } else { 2 }
}

/// Writes the file of an office with the reasoning agents and these entries.
pub(crate) fn office(entries: &str) -> Outcome<Machine> {
    let machine = Machine::new()?;
    std::fs::write(machine.path().join("domain.pddl"), ONTOLOGY)?;
    std::fs::write(machine.path().join("map.pddl"), MAP)?;
    let plugins = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];
    let reasoning = plugins.map(|plugin| {
        format!(
            "[[agent]]\nname = \"{plugin}\"\nplugin = \"{plugin}\"\ndaemon = \"{REASONING}\"\n\n"
        )
    });
    let file = format!(
        "[ecosystem]\nname = \"{ECOSYSTEM}\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\n\
         {}{entries}",
        reasoning.concat()
    );
    std::fs::write(&machine.file, file)?;
    Ok(machine)
}

/// Returns the configuration of a client of a daemon.
fn client(machine: &Machine, ecosystem: &str, daemon: &str, name: &str) -> Outcome<Config> {
    let mut config = Config::new(EcosystemId::new(ecosystem)?, DaemonId::new(name)?);
    config.mode = substrate_zenoh::SessionMode::Client;
    config.connect = vec![machine.endpoint(ecosystem, daemon)];
    Ok(config)
}

/// Launches a keyboard, once all these devices can be planned with.
pub(crate) async fn enter(machine: &Machine, devices: &[&str]) -> Outcome<Terminal> {
    let config = client(machine, ECOSYSTEM, REASONING, "person")?;
    let (ecosystem, daemon) = (config.ecosystem.clone(), config.daemon.clone());
    let router = MessageRouter::new(ecosystem, daemon, AgentSettings::default());
    router.connect(config.open(Arc::<MessageRouter>::clone(&router)).await?);
    let devices: BTreeSet<String> = devices.iter().map(|name| (*name).to_owned()).collect();
    support::await_offers(&router, &devices).await?;
    let (keyboard, terminal) = Keyboard::with_terminal();
    support::launch(&AgentId::new("user")?, Box::new(keyboard), &router, "smart-office");
    Ok(terminal)
}

/// A listener on Zenoh that takes no part.
pub(crate) struct Listener {
    heard: mpsc::Receiver<(Instant, Message)>,
    _tap: Tap,
}

impl Listener {
    pub(crate) async fn open(
        machine: &Machine,
        ecosystem: &str,
        daemon: &str,
    ) -> Outcome<Listener> {
        let (tell, heard) = mpsc::channel(HEARD_MAX);
        let hear = move |_: &str, message: substrate::OverheardMessage| {
            let at = Instant::now();
            if let Ok(message) = acl::decode(&message.payload) {
                // A message that does not fit is lost; the wait for it then ends with an error.
                let _ = tell.try_send((at, message));
            }
        };
        let config = client(machine, ecosystem, daemon, "listener")?;
        Ok(Listener { heard, _tap: substrate_zenoh::tap(config, hear).await? })
    }

    /// Waits for a message for which `is_it` returns something. Returns that, and the time at which
    /// the message was received.
    pub(crate) async fn next<T>(
        &mut self,
        is_it: impl Fn(&Message) -> Option<T>,
    ) -> Outcome<(Instant, T)> {
        let wait = async {
            while let Some((at, message)) = self.heard.recv().await {
                if let Some(it) = is_it(&message) {
                    return Ok((at, it));
                }
            }
            Err("the listener has ended".into())
        };
        tokio::time::timeout(PATIENCE, wait).await?
    }

    /// Returns all messages since the last call, with their times.
    pub(crate) fn rest(&mut self) -> Vec<(Instant, Message)> {
        std::iter::from_fn(|| self.heard.try_recv().ok()).collect()
    }
}

/// Measures the time from motion at a camera to the goal that its agent requests.
async fn motions() -> Outcome<()> {
    let camera = StandIn::start();
    // The camera looks at one of its presets.
    camera.behavior().position = (0.5, 0.1);
    let entry = format!(
        "[[agent]]\nname = \"camera-1\"\nplugin = \"ptz-camera\"\ndriver = \"onvif\"\ndaemon = \"hall\"\n\n\
         [agent.config]\naddress = \"http://{}\"\nlocation = \"corridor\"\nmotion-for = \"300ms\"\n\
         presets.hall = {{ shows = \"corridor\", preset = \"Hall\" }}\n\
         on-motion = {{ goal = \"(known-picture ?l)\" }}\n",
        camera.address
    );
    let machine = office(&entry)?;
    let mut processes = Vec::new();
    for daemon in [REASONING, "hall"] {
        let mut process = machine.start(daemon, "centralized")?;
        process.ready().await?;
        processes.push(process);
    }
    let mut listener = Listener::open(&machine, ECOSYSTEM, REASONING).await?;
    let requested = |message: &Message| {
        let is_its = message.sender.as_str() == "camera-1";
        let request = message.content_as::<Request>().ok().filter(|_| is_its)?;
        matches!(request, Request::Achieve(_)).then_some(())
    };
    connected(&camera, &mut listener, requested).await?;
    let (mut figures, motions) = (Figures::default(), times(MOTIONS));
    for _ in 0..motions {
        camera.report_motion(false);
        tokio::time::sleep(QUIET).await;
        listener.rest();
        let began = Instant::now();
        camera.report_motion(true);
        let (at, ()) = listener.next(requested).await?;
        figures.push(at - began);
    }
    figures
        .tell(&format!("motion at an ONVIF camera, {motions} times: reported to goal requested"));
    support::judge("p99", figures.within(0.99), MOTION_MS);
    Ok(())
}

/// Reports motion until the camera's agent requests a goal: then the camera is connected.
async fn connected(
    camera: &StandIn,
    listener: &mut Listener,
    requested: impl Fn(&Message) -> Option<()>,
) -> Outcome<()> {
    let deadline = Instant::now() + PATIENCE;
    while Instant::now() < deadline {
        camera.report_motion(true);
        let heard = tokio::time::timeout(REPORT_AGAIN, listener.next(&requested)).await;
        if heard.is_ok_and(|heard| heard.is_ok()) {
            return Ok(());
        }
        camera.report_motion(false);
    }
    Err("the camera is not connected".into())
}
