//! A scenario while it is played, and the steps that all scenarios share.
//!
//! - The steps report events, with their times, and receive the user's messages.
//! - They wait until the true state of the building meets a condition, never for a fixed time.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use ::building::{Building, Truth};
use acl::AgentId;
use acl::content::{Keep, Outcome, Partition, Report};
use keyboard::{GoalRequest, Keyboard, Terminal, UserEvent, UserRequest};
use pddl::{InitElement, Term};
use tokio::sync::oneshot;
use tokio::time::Instant;

use super::launched::{self, LaunchedScenario};
use super::readiness::ReadinessProbe;
use super::setting::Setting;
use super::{ScenarioEvent, ScenarioOptions};

/// Longest time that a whole scenario may take; after it, the scenario has failed. A building of
/// seven rooms takes seconds.
const PLAYED_WITHIN: Duration = Duration::from_secs(60);

/// A scenario while it is played.
pub(super) struct ScenarioRun<'t> {
    pub(super) set: LaunchedScenario,
    pub(super) building: Building,
    /// The terminal of the user's keyboard.
    pub(super) user: Terminal,
    /// The last temperature of each room that was reported to the user, in °C.
    pub(super) told: BTreeMap<String, f64>,
    began: Instant,
    tell: &'t mut dyn FnMut(ScenarioEvent),
}

/// Plays a scenario to its end, for at most [`PLAYED_WITHIN`]. The error is a message for the user.
pub(super) async fn with_time_limit(
    play: impl Future<Output = Result<(), String>>,
) -> Result<(), String> {
    match tokio::time::timeout(PLAYED_WITHIN, play).await {
        Ok(ended) => ended,
        Err(_) => Err(format!("the scenario did not end within {PLAYED_WITHIN:?}")),
    }
}

impl<'t> ScenarioRun<'t> {
    /// Launches the agents of a scenario. The error is a message for the user.
    pub(super) async fn open(
        setting: &Setting,
        script: &ScenarioOptions,
        tell: &'t mut dyn FnMut(ScenarioEvent),
    ) -> Result<ScenarioRun<'t>, String> {
        let ScenarioOptions { stage, mode, replacement, ref listener, .. } = *script;
        let set =
            launched::launch_scenario(setting, stage, mode, replacement, listener.as_ref()).await?;
        let user = seat(&set, "user")?;
        let (building, began) = (set.building.clone(), Instant::now());
        Ok(ScenarioRun { set, building, user, told: BTreeMap::new(), began, tell })
    }

    /// Reports an event as a line of output.
    pub(super) fn say(&mut self, text: impl Into<String>) {
        (self.tell)(ScenarioEvent { at: self.began.elapsed(), text: text.into() });
    }

    /// Launches the keyboard of another person, and returns its terminal.
    pub(super) fn seat(&self, name: &str) -> Result<Terminal, String> {
        seat(&self.set, name)
    }

    /// Whether the agents run in several processes.
    pub(super) fn is_in_processes(&self) -> bool {
        !self.set.processes.is_empty()
    }

    // === the agents ===

    /// Waits until every device that is there from the start is in the composite domain.
    pub(super) async fn await_agents(&mut self, setting: &Setting) -> Result<(), String> {
        let expected = setting.devices_at_first();
        let count = expected.len();
        let expected = expected.into_iter().map(|agent| (agent, Vec::new())).collect();
        self.await_domain("usher", expected, setting.parcels()).await?;
        let place = match self.set.processes.len() {
            0 => "in one process".to_owned(),
            processes => format!("in {processes} processes"),
        };
        let devices = if count == 1 { "device" } else { "devices" };
        self.say(format!("{count} {devices} can be planned with, {place}"));
        Ok(())
    }

    /// Waits until plans can use an action of an agent.
    pub(super) async fn await_action(&mut self, agent: &str, action: &str) -> Result<(), String> {
        let expected = BTreeMap::from([(agent.to_owned(), vec![action.to_owned()])]);
        self.await_domain(&format!("usher-of-{agent}"), expected, BTreeSet::new()).await
    }

    /// Waits for agents, their actions and objects in the composite domain, by an agent named
    /// `usher`.
    async fn await_domain(
        &mut self,
        usher: &str,
        expected: BTreeMap<String, Vec<String>>,
        objects: BTreeSet<String>,
    ) -> Result<(), String> {
        let (seen, all) = oneshot::channel();
        let probe = ReadinessProbe::new(expected, objects, seen);
        self.set.node.launch(name(usher)?, probe, self.set.ecosystem.domain.name.as_str());
        all.await.map_err(|_| "the agent that waits for the devices has ended".to_owned())
    }

    /// Kills an agent or, if the agents run in several processes, the process that hosts it.
    pub(super) async fn kill(&mut self, agent: &str) -> Result<(), String> {
        self.set.kill(&name(agent)?).await?;
        let how = if self.is_in_processes() { "was killed (SIGKILL)" } else { "is gone" };
        self.say(format!("✗ {agent} {how}"));
        Ok(())
    }

    /// Launches an agent that was not there from the start.
    pub(super) async fn plug_in(&mut self, agent: &str) -> Result<(), String> {
        self.say(format!("＋ {agent} is plugged in"));
        self.set.plug_in(&name(agent)?).await
    }

    // === the user ===

    /// Requests a goal from the user's keyboard.
    pub(super) async fn ask(&mut self, goal: &str, keep: Keep) -> Result<(), String> {
        let goal = goal.to_owned();
        let kept = if keep == Keep::Maintain { ", to be kept" } else { "" };
        self.say(format!("goal{kept}: {goal}"));
        let wish = GoalRequest { goal, keep, priority: 0, partition: Partition::Pursue };
        let said = self.user.requests.send(UserRequest::RequestGoal(wish)).await;
        said.map(drop).map_err(|_| "the user's keyboard has ended".to_owned())
    }

    /// Receives the user's messages until the goal holds.
    pub(super) async fn until_it_holds(&mut self) -> Result<(), String> {
        while !self.hear_next().await? {}
        Ok(())
    }

    /// Receives the user's messages until the temperatures reported to the user meet a condition.
    pub(super) async fn until_told(
        &mut self,
        is_so: impl Fn(&BTreeMap<String, f64>) -> bool,
    ) -> Result<(), String> {
        while !is_so(&self.told) {
            self.hear_next().await?;
        }
        Ok(())
    }

    /// Receives the user's messages until the true state of the building meets a condition.
    pub(super) async fn until(&mut self, is_so: impl FnMut(&Truth) -> bool) -> Result<(), String> {
        let building = self.building.clone();
        let wait = building.wait_for(is_so);
        tokio::pin!(wait);
        loop {
            tokio::select! {
                _ = &mut wait => return Ok(()),
                heard = self.user.events.recv() => {
                    self.hear(heard)?;
                }
            }
        }
    }

    async fn hear_next(&mut self) -> Result<bool, String> {
        let heard = self.user.events.recv().await;
        self.hear(heard)
    }

    /// Handles a message to the user. Returns `true` if it reports that the goal holds.
    fn hear(&mut self, heard: Option<UserEvent>) -> Result<bool, String> {
        match heard.ok_or("the user's keyboard has ended")? {
            UserEvent::Sent(_)
            | UserEvent::Answered(..)
            | UserEvent::Question(_)
            | UserEvent::QuestionClosed(..) => Ok(false),
            UserEvent::Report(_, report) => {
                self.note(&report);
                match report.outcome {
                    Outcome::Progress => Ok(false),
                    Outcome::Holds | Outcome::Done => Ok(true),
                    Outcome::Failed | Outcome::Cancelled => {
                        Err(format!("the goal was given up: {}", report.detail))
                    }
                }
            }
            UserEvent::Refused(_, refusal) => {
                Err(format!("the goal was refused: {}", refusal.detail))
            }
            UserEvent::Unanswered(_, why) => Err(why),
        }
    }

    fn note(&mut self, report: &Report) {
        let observed = pddl::parse_init_elements(&report.observations).value;
        for element in observed.into_iter().flatten() {
            if let InitElement::Assign(fluent, celsius) = element
                && fluent.function == "temperature"
                && let [Term::Object(room)] = fluent.arguments.as_slice()
            {
                self.told.insert(room.as_str().to_owned(), celsius.0);
            }
        }
        self.say(report.detail.clone());
        for step in report.plan.iter().flat_map(|plan| plan.lines()) {
            if step.starts_with('(') {
                self.say(format!("  {step}"));
            }
        }
    }
}

fn name(text: &str) -> Result<AgentId, String> {
    AgentId::new(text).map_err(|error| error.to_string())
}

/// Launches a keyboard agent named `person`, and returns its terminal.
fn seat(set: &LaunchedScenario, person: &str) -> Result<Terminal, String> {
    let (keyboard, terminal) = Keyboard::with_terminal();
    set.node.launch(name(person)?, keyboard, set.ecosystem.domain.name.as_str());
    Ok(terminal)
}
