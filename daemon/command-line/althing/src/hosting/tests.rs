//! Tests of devices in the paper's office: goals in a whole ecosystem in memory, in paused time,
//! checked against the true state of the building.

use std::time::Duration;

use ::building::{Building, Truth};
use acl::content::{Keep, Outcome, Partition};
use acl::{AgentId, DaemonId};
use agent::Mode;
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use substrate::memory::Network;
use tempfile::TempDir;
use tokio::time::timeout;

use super::{DaemonNode, MessageTransport, NodeOptions, simulate};
use crate::config::{Ecosystem, Overrides, Variables};
use crate::plugins;

mod hardware_stops;
mod joining;
mod mistakes;
mod presenting;
mod renaming;
mod robots;
mod strangers;
mod succeeding;
mod taking_over;
mod watching;

const ONTOLOGY: &str = include_str!("../../../../../domains/smart-office/domain.pddl");
const MAP: &str = include_str!("../../../../../domains/smart-office/map.pddl");

/// Longest time that a test waits for anything. The clock is paused, so that waiting costs no real
/// time.
const PATIENCE: Duration = Duration::from_secs(3_600);

const MODES: [Mode; 2] = [Mode::Centralized, Mode::Decentralized];

/// The paper's office, running with the devices of one test.
struct Office {
    building: Building,
    node: DaemonNode,
    ecosystem: Ecosystem,
    folder: TempDir,
}

/// Returns the entry of one agent, as text of an ecosystem file.
fn entry(name: &str, plugin: &str, config: &str) -> String {
    format!("[[agent]]\nname = \"{name}\"\nplugin = \"{plugin}\"\nconfig = {config}\n\n")
}

/// Returns the paper's office with the agents of `entries`; its files are written into `folder`.
fn ecosystem(folder: &TempDir, entries: &str, mode: Mode) -> Ecosystem {
    let text = format!(
        "[ecosystem]\nname = \"office\"\ndomain = \"domain.pddl\"\nproblem = \"map.pddl\"\n\n{entries}"
    );
    let file = folder.path().join("althing.toml");
    let written = [("domain.pddl", ONTOLOGY), ("map.pddl", MAP), ("althing.toml", &text)];
    for (name, text) in written {
        std::fs::write(folder.path().join(name), text).expect("written");
    }
    let overrides = Overrides::default().mode(Some(mode));
    Ecosystem::load_with(&file, &Variables::new(), &overrides, &plugins::known())
        .unwrap_or_else(|error| panic!("{error:?}\n{text}"))
}

impl Office {
    /// Opens the office with the agents of `entries`; `{folder}` in an entry stands for a folder
    /// that the test creates.
    async fn open(entries: &[String], mode: Mode) -> Office {
        Office::open_on(Network::new(), entries, mode).await
    }

    /// Opens the office as [`Office::open`] does, on the network `network`.
    async fn open_on(network: Network, entries: &[String], mode: Mode) -> Office {
        let plugins = ["domain-maintainer", "plan-requester", "planning-agent", "plan-executor"];
        let reasoning = plugins.iter().map(|plugin| entry(plugin, plugin, "{}"));
        let entries: Vec<_> = reasoning.chain(entries.iter().cloned()).collect();
        Office::with_agents(network, &entries, mode).await
    }

    /// Opens the office with the agents of `entries` only, which include the reasoning agents.
    async fn with_agents(network: Network, entries: &[String], mode: Mode) -> Office {
        let folder = tempfile::tempdir().expect("a folder");
        let mut text = String::new();
        for entry in entries {
            text += &entry.replace("{folder}", &folder.path().display().to_string());
        }
        let ecosystem = ecosystem(&folder, &text, mode);
        let building = simulate(&ecosystem).unwrap_or_else(|error| panic!("failed to {error}"));
        let part = NodeOptions {
            ecosystem: &ecosystem,
            daemon: DaemonId::new("here").expect("a name"),
            agents: ecosystem.agents.clone(),
            mode,
            building: Some(building.handle()),
            state: None,
        };
        let node = DaemonNode::open(part, MessageTransport::Memory(network)).await;
        let node = node.unwrap_or_else(|error| panic!("failed to {error}"));
        // Waits for a heartbeat, so that all agents know each other.
        tokio::time::sleep(ecosystem.settings.heartbeat_period * 2).await;
        Office { building, node, ecosystem, folder }
    }

    /// Launches a keyboard named `name`, and returns the person at it.
    fn person(&self, name: &str) -> Person {
        let (keyboard, terminal) = Keyboard::with_terminal();
        let id = AgentId::new(name).expect("a name");
        self.node.launch(id, keyboard, self.ecosystem.domain.name.as_str());
        Person { terminal, lines: Vec::new() }
    }

    /// Waits until the true state of the building meets a condition, and returns that state.
    async fn until(&self, what: &str, is_so: impl FnMut(&Truth) -> bool) -> Truth {
        let truth = timeout(PATIENCE, self.building.wait_for(is_so)).await;
        truth.unwrap_or_else(|_| panic!("never so: {what}; {:#?}", self.building.truth()))
    }

    async fn close(self) {
        self.node.drain().await;
    }
}

struct Person {
    terminal: Terminal,
    /// The texts of all messages that the person has received; tests show them when they fail.
    lines: Vec<String>,
}

impl Person {
    async fn wish(&mut self, goal: &str, keep: Keep) {
        let wish =
            GoalRequest { goal: goal.to_owned(), keep, priority: 0, partition: Partition::Pursue };
        self.terminal
            .requests
            .send(UserRequest::RequestGoal(wish))
            .await
            .expect("the keyboard listens");
    }

    /// Requests a goal and waits for its end. Returns `true` if the goal was reached.
    async fn reaches(&mut self, goal: &str) -> bool {
        self.wish(goal, Keep::Achieve).await;
        self.hears().await
    }

    /// Waits until an agent asks this person a question. Returns the number of the question.
    async fn is_asked(&mut self) -> u64 {
        self.waits(|heard| match heard {
            UserEvent::Question(open) => Some(open.question),
            _ => None,
        })
        .await
    }

    /// Waits until an agent asks this person a question, and answers it.
    async fn answers(&mut self, answer: &str) {
        let (keyboard, question) = self
            .waits(|heard| match heard {
                UserEvent::Question(open) => Some((open.keyboard, open.question)),
                _ => None,
            })
            .await;
        let text = answer.to_owned();
        let said = UserRequest::Answer { keyboard, question, text, seal_to: None };
        self.terminal.requests.send(said).await.expect("the keyboard listens");
    }

    /// Waits until a question to this person is closed. Returns the number of the question and the
    /// reason.
    async fn hears_closed(&mut self) -> (u64, String) {
        self.waits(|heard| match heard {
            UserEvent::QuestionClosed(number, why) => Some((number, why)),
            _ => None,
        })
        .await
    }

    /// Waits until this person receives a report that contains `words`. Returns the text of the
    /// report.
    async fn hears_of(&mut self, words: &str) -> String {
        let report = |heard| match heard {
            UserEvent::Report(_, report) => Some(report.detail),
            _ => None,
        };
        loop {
            let detail = self.waits(report).await;
            self.lines.push(detail.clone());
            if detail.contains(words) {
                return detail;
            }
        }
    }

    async fn waits<T>(&mut self, is_it: impl Fn(UserEvent) -> Option<T>) -> T {
        loop {
            let heard = timeout(PATIENCE, self.terminal.events.recv()).await;
            if let Some(it) = is_it(heard.expect("in time").expect("the keyboard lives")) {
                return it;
            }
        }
    }

    /// Waits for the next report that decides about a goal. Returns `true` if the goal holds, and
    /// `false` if it does not hold and is not pursued further.
    async fn hears(&mut self) -> bool {
        loop {
            let heard = timeout(PATIENCE, self.terminal.events.recv()).await;
            match heard.expect("a word in time").expect("the keyboard lives") {
                UserEvent::Report(_, report) => {
                    self.lines.push(report.detail);
                    match report.outcome {
                        Outcome::Progress => (),
                        Outcome::Holds | Outcome::Done => return true,
                        Outcome::Failed | Outcome::Cancelled => return false,
                    }
                }
                UserEvent::Refused(_, refusal) => {
                    self.lines.push(refusal.detail);
                    return false;
                }
                UserEvent::Unanswered(_, why) => panic!("{why}"),
                _ => (),
            }
        }
    }
}
