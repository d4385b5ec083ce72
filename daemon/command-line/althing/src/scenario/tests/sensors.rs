//! Tests in a laboratory room with a sensor of every quantity: reported values are true, motion is
//! reported at once, and a sensor that has failed recovers.

use std::time::Duration;

use ::building::{Building, DeviceFault, Quantity};
use acl::content::{Keep, Outcome, Partition};
use acl::{AgentId, DaemonId};
use agent::Mode;
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use substrate::memory::Network;
use tempfile::TempDir;
use tokio::time::{Instant, timeout};

use super::MODES;
use crate::config::{Ecosystem, Overrides, Variables};
use crate::hosting::{self, DaemonNode, MessageTransport, NodeOptions};
use crate::plugins;

const ONTOLOGY: &str = include_str!("../../../../../../domains/smart-office/domain.pddl");

const MAP: &str = "(define (problem lab) (:domain smart-office) (:objects lab den - room)
    (:init (= (total-cost) 0)) (:goal (and)) (:metric minimize (total-cost)))";

/// How long a test waits for a report: longer than a failed sensor rests, and longer than its
/// action is avoided.
const PATIENCE: Duration = Duration::from_secs(120);

struct Lab {
    building: Building,
    node: DaemonNode,
    terminal: Terminal,
    _folder: TempDir,
}

fn file() -> String {
    let mut text = String::from(
        "[ecosystem]\nname = \"lab\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\
         [building]\ntime-scale = 0.01\nconditions = { lab = { co2 = 777 } }\n",
    );
    let mut agent = |name: &str, plugin: &str, config: &str| {
        text += &format!(
            "[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\nconfig = {{ {config} }}\n"
        );
    };
    for plugin in ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"] {
        agent(plugin, plugin, "");
    }
    agent("thermometer", "temperature-sensor", "location = \"lab\", humidity = true");
    for quantity in Quantity::all().filter(|quantity| *quantity != Quantity::Humidity) {
        let name = quantity.name();
        let config = format!("location = \"lab\", quantity = \"{name}\"");
        agent(&format!("{name}-1"), "sensor", &config);
    }
    text
}

async fn open(mode: Mode) -> Lab {
    let folder = tempfile::tempdir().expect("a folder");
    for (name, text) in [("domain.pddl", ONTOLOGY), ("map.pddl", MAP), ("lab.toml", &file())] {
        std::fs::write(folder.path().join(name), text).expect("a file");
    }
    let path = folder.path().join("lab.toml");
    let overrides = Overrides::default().mode(Some(mode));
    let ecosystem = Ecosystem::load_with(&path, &Variables::new(), &overrides, &plugins::known());
    let ecosystem = ecosystem.unwrap_or_else(|report| panic!("{report:?}"));
    let building = hosting::simulate(&ecosystem).expect("a building");
    let part = NodeOptions {
        ecosystem: &ecosystem,
        daemon: DaemonId::new("lab").expect("a name"),
        agents: ecosystem.agents.clone(),
        mode,
        building: Some(building.handle()),
        state: None,
    };
    let node =
        DaemonNode::open(part, MessageTransport::Memory(Network::new())).await.expect("a node");
    let (keyboard, terminal) = Keyboard::with_terminal();
    node.launch(AgentId::new("user").expect("a name"), keyboard, "smart-office");
    // Waits until all action models have been received.
    tokio::time::sleep(Duration::from_secs(2)).await;
    Lab { building, node, terminal, _folder: folder }
}

impl Lab {
    async fn wish(&self, goal: &str, keep: Keep) {
        let wish =
            GoalRequest { goal: goal.to_owned(), keep, priority: 0, partition: Partition::Pursue };
        self.terminal.requests.send(UserRequest::RequestGoal(wish)).await.expect("a keyboard");
    }

    /// Receives reports until the goal is reached or holds. Returns the observations in all these
    /// reports.
    async fn until_it_holds(&mut self) -> Result<String, String> {
        let mut observed = String::new();
        loop {
            let heard = timeout(PATIENCE, self.terminal.events.recv()).await;
            let heard = heard.map_err(|_| format!("silence after {observed}"))?;
            match heard.ok_or("the keyboard has ended")? {
                UserEvent::Report(_, report) => {
                    observed += &report.observations;
                    match report.outcome {
                        Outcome::Progress => (),
                        Outcome::Holds | Outcome::Done => return Ok(observed),
                        Outcome::Failed | Outcome::Cancelled => return Err(report.detail),
                    }
                }
                UserEvent::Refused(_, refusal) => return Err(refusal.detail),
                UserEvent::Unanswered(_, why) => return Err(why),
                _ => (),
            }
        }
    }
}

#[tokio::test(start_paused = true)]
async fn every_requested_quantity_is_reported_truly() {
    for mode in MODES {
        let mut lab = open(mode).await;
        for quantity in Quantity::all() {
            let name = quantity.name();
            let truly = match quantity {
                // The value in the ecosystem file.
                Quantity::Co2 => 777.0,
                // A true value of these would be announced before the request.
                Quantity::Motion | Quantity::Reflection | Quantity::Contact => 0.0,
                _ => 12.5,
            };
            if quantity != Quantity::Co2 {
                lab.building.set("lab", quantity, truly).expect("a possible value");
            }
            lab.wish(&format!("(known-{name} lab)"), Keep::Achieve).await;
            let observed = lab.until_it_holds().await;
            let function = if name == "distance" { "free-distance" } else { name };
            let expected = match quantity {
                Quantity::Motion | Quantity::Reflection | Quantity::Contact => {
                    format!("(known-{name} lab)")
                }
                _ => format!("(= ({function} lab) {truly})"),
            };
            assert!(observed.as_ref().is_ok_and(|facts| facts.contains(&expected)), "{observed:?}");
            assert_eq!(lab.building.truth().value("lab", quantity), Some(truly));
        }
        lab.node.drain().await;
    }
}

#[tokio::test(start_paused = true)]
async fn motion_is_reported_at_once_without_a_request() {
    for mode in MODES {
        let mut lab = open(mode).await;
        lab.wish("(motion lab)", Keep::Maintain).await;
        // Shortly after a heartbeat, so that only an immediate announcement is fast enough.
        tokio::time::sleep(Duration::from_millis(3_050)).await;
        lab.building.set("den", Quantity::Motion, 1.0).expect("a possible value");
        let begun = Instant::now();
        lab.building.set("lab", Quantity::Motion, 1.0).expect("a possible value");
        let holds = lab.until_it_holds().await;
        assert!(holds.is_ok(), "{mode:?}: {holds:?}");
        assert!(begun.elapsed() < Duration::from_millis(200), "{mode:?}: {:?}", begun.elapsed());
        lab.node.drain().await;
    }
}

#[tokio::test(start_paused = true)]
async fn a_sensor_that_failed_comes_back() {
    for mode in MODES {
        let mut lab = open(mode).await;
        lab.building.break_device("light-1", DeviceFault::Fails).expect("a device");
        let begun = Instant::now();
        lab.wish("(known-light lab)", Keep::Maintain).await;
        tokio::time::sleep(Duration::from_secs(5)).await;
        lab.building.repair("light-1").expect("a device");
        let holds = lab.until_it_holds().await;
        assert!(holds.is_ok(), "{mode:?}: {holds:?}");
        let rested = Duration::from_secs(30)..Duration::from_secs(60);
        assert!(rested.contains(&begun.elapsed()), "{mode:?}: {:?}", begun.elapsed());
        lab.node.drain().await;
    }
}
