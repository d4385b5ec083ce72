//! Scenario 1 of the paper, from the goal to the verdict of the building's truth.
//!
//! “When the temperature sensor in office2 goes down, the system detects this and re-evaluates
//! its capabilities automatically and dispatches the TurtleBot to office2 instead.”

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use ::building::{Dies, Fault, Layout, SeededScenario, check_scenario_1};
use acl::AgentId;
use acl::content::{Inform, Keep, Outcome, Report, Snapshot};
use agent::{Agent, Ask, Callbacks, Context, Mode, Presence, Resource, Work};
use keyboard::{Heard, Keyboard, Said, Terminal, Wish};
use pddl::{InitElement, Term};
use tokio::sync::oneshot;
use tokio::time::{Instant, timeout_at};

use super::files::GOAL;
use super::stage::{self, Set, Stage};
use crate::hosting::Node;

/// How long a whole scenario may take. A building of seven rooms takes seconds.
const PLAYED_WITHIN: Duration = Duration::from_secs(60);

/// What is to be played.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    pub(crate) seed: u64,
    pub(crate) mode: Mode,
    pub(crate) stage: Stage,
    /// Off only to show that the check can fail.
    pub(crate) replanning: bool,
    /// Whether the agent of the dying sensor dies with it. If not, the sensor hangs and its
    /// agent has to notice.
    pub(crate) kills: bool,
    /// Lets others in, whom no building knows.
    pub(crate) guests: Option<fn(&Node)>,
}

/// A line of the play.
#[derive(Clone, Debug)]
pub(crate) struct Event {
    /// Since the stage was set.
    pub(crate) at: Duration,
    pub(crate) text: String,
}

/// How it went.
#[derive(Clone, Debug)]
pub(crate) struct Played {
    pub(crate) scenario: SeededScenario,
    /// What the user was told last of each room, in °C.
    pub(crate) told: BTreeMap<String, f64>,
    /// Every way in which it failed; none, if the building's truth is what the scenario wants.
    pub(crate) problems: Vec<String>,
}

/// Plays a script; `tell` hears every line as it happens. The error is for a person: the stage
/// could not even be set.
pub(crate) async fn play(script: &Script, tell: impl FnMut(Event)) -> Result<Played, String> {
    let scenario = Layout::seeded(script.seed);
    let set = stage::set(&scenario, script.stage, script.mode, script.replanning).await?;
    if let Some(guests) = script.guests {
        guests(&set.node);
    }
    let mut play = Play {
        scenario,
        kills: script.kills,
        terminal: enter_user(&set)?,
        set,
        began: Instant::now(),
        told: BTreeMap::new(),
        death: None,
        tell,
    };
    let deadline = play.began + PLAYED_WITHIN;
    let ended = match timeout_at(deadline, play.run()).await {
        Ok(ended) => ended,
        Err(_) => Err(format!("the curtain fell after {PLAYED_WITHIN:?}")),
    };
    Ok(play.judge(ended).await)
}

struct Play<T: FnMut(Event)> {
    scenario: SeededScenario,
    kills: bool,
    set: Set,
    terminal: Terminal,
    began: Instant,
    told: BTreeMap<String, f64>,
    /// Which occurrence in the building's log is the death of the sensor, once it is.
    death: Option<u64>,
    tell: T,
}

/// Launches the user's keyboard.
fn enter_user(set: &Set) -> Result<Terminal, String> {
    let (keyboard, terminal) = Keyboard::with_terminal();
    let id = AgentId::new("user").map_err(|error| error.to_string())?;
    set.node.launch(id, keyboard, set.ecosystem.domain.name.as_str());
    Ok(terminal)
}

impl<T: FnMut(Event)> Play<T> {
    fn say(&mut self, text: impl Into<String>) {
        (self.tell)(Event { at: self.began.elapsed(), text: text.into() });
    }

    /// The play. The error is for a person.
    async fn run(&mut self) -> Result<(), String> {
        self.await_agents().await?;
        let building = self.set.building.clone();
        let fault = Fault::Hangs;
        self.scenario.arm(&building, fault).map_err(|error| error.to_string())?;
        self.ask().await?;
        if self.scenario.dies == Dies::AfterReport {
            self.until_it_holds().await?;
        }
        let scenario = self.scenario.clone();
        let death = scenario.death(&building, fault).await.map_err(|error| error.to_string())?;
        self.death = Some(death);
        let dying = AgentId::new(&scenario.dying_sensor).map_err(|error| error.to_string())?;
        let how = match (self.kills, self.set.processes.is_empty()) {
            (false, _) => "hangs",
            (true, true) => "is gone",
            (true, false) => "was killed (SIGKILL)",
        };
        if self.kills {
            self.set.kill(&dying).await?;
        }
        self.say(format!("✗ {dying} {how}"));
        self.until_it_holds().await
    }

    async fn ask(&mut self) -> Result<(), String> {
        let goal = self.set.ecosystem.goal_text(GOAL)?.to_owned();
        self.say(format!("goal, to be kept: {goal}"));
        let wish = Wish { goal, keep: Keep::Maintain, priority: 0 };
        let said = self.terminal.say.send(Said::Wish(wish)).await;
        said.map_err(|_| "the user's keyboard has ended".to_owned())
    }

    /// Listens until the goal is said to hold.
    async fn until_it_holds(&mut self) -> Result<(), String> {
        loop {
            let heard = self.terminal.hear.recv().await;
            match heard.ok_or("the user's keyboard has ended")? {
                // Nobody asks this user, and this user sends nothing but the goal.
                Heard::Asked(_)
                | Heard::Answered(_)
                | Heard::Question(_)
                | Heard::QuestionClosed(..) => (),
                Heard::Report(_, report) => {
                    self.hear(&report);
                    match report.outcome {
                        Outcome::Progress => (),
                        Outcome::Holds | Outcome::Done => return Ok(()),
                        Outcome::Failed | Outcome::Cancelled => {
                            return Err(format!("the goal was given up: {}", report.detail));
                        }
                    }
                }
                Heard::Refused(_, refusal) => {
                    return Err(format!("the goal was refused: {}", refusal.detail));
                }
                Heard::Unanswered(_, why) => return Err(why),
            }
        }
    }

    fn hear(&mut self, report: &Report) {
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

    /// Waits until every device of the building can be planned with.
    async fn await_agents(&mut self) -> Result<(), String> {
        let devices = self.scenario.layout.devices().iter();
        let expected: BTreeSet<String> = devices.map(|device| device.name().to_owned()).collect();
        let count = expected.len();
        let (seen, all) = oneshot::channel();
        let usher = Usher { expected, seen: Some(seen), asking: None };
        let id = AgentId::new("usher").map_err(|error| error.to_string())?;
        self.set.node.launch(id, usher, self.set.ecosystem.domain.name.as_str());
        all.await.map_err(|_| "nobody watches the door".to_owned())?;
        let processes = self.set.processes.len();
        let place = if processes == 0 {
            "in one process".to_owned()
        } else {
            format!("in {processes} processes")
        };
        self.say(format!("{count} devices can be planned with, {place}"));
        Ok(())
    }

    /// What went wrong on the stage, and what the building's truth has against it.
    async fn judge(self, ended: Result<(), String>) -> Played {
        let Play { scenario, set, told, death, .. } = self;
        let truth = set.building.truth();
        let mut problems: Vec<_> = ended.err().into_iter().collect();
        match death {
            Some(death) => {
                let checked = check_scenario_1(&scenario, &truth, death, &told);
                problems.extend(checked.err().unwrap_or_default());
            }
            None => problems.push(format!("`{}` never died", scenario.dying_sensor)),
        }
        set.strike().await;
        Played { scenario, told, problems }
    }
}

/// Stands at the door and says when all who are expected can be planned with.
struct Usher {
    expected: BTreeSet<String>,
    seen: Option<oneshot::Sender<()>>,
    asking: Option<Work>,
}

impl Agent for Usher {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on_broadcast(acl::Performative::Inform, Self::informed)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.look(ctx);
    }

    fn presence(&mut self, _presence: &Presence, ctx: &mut Context<Self>) {
        self.look(ctx);
    }
}

impl Usher {
    fn informed(&mut self, message: acl::Message, ctx: &mut Context<Self>) {
        if let Ok(Inform::Epoch(_)) = message.content_as::<Inform>() {
            self.look(ctx);
        }
    }

    /// Asks who can be planned with.
    fn look(&mut self, ctx: &mut Context<Self>) {
        if self.seen.is_none() {
            return;
        }
        let ask = Ask {
            daemon: None,
            resource: Resource::Domain,
            agent: AgentId::new("domain-maintainer").ok(),
        };
        let asked = ctx.switchboard().ask(ask, ctx.settings().answer_deadline);
        self.asking = Some(ctx.run(asked, |usher: &mut Self, answers, _| {
            let snapshot =
                answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
            let Some(snapshot) = snapshot else { return };
            let is_here = |name: &String| snapshot.offers.contains_key(name.as_str());
            // A sensor mounted on a robot can act once its robot is there too.
            if usher.expected.iter().all(is_here)
                && let Some(seen) = usher.seen.take()
            {
                // The play may be over.
                let _ = seen.send(());
            }
        }));
    }
}
