//! Scenario 3 of the paper: “the camera detects movement at the entry and requests for the person
//! entering to be validated. The system dispatches the TurtleBot to the location so that the
//! person can log in through the on-board screen.”
//!
//! Four people come, one after another. Only the camera requests a goal. The robot's question is
//! sent to two keyboards. Per person, the answers are: right from both at once, at first wrong,
//! none, or only wrong ones.

use ::building::{AccessScenario, AnswerPattern, BuildingDevice, Visit, VisitOutcome};
use acl::content::{Inform, OpenQuestion, Outcome, Report};
use acl::{Message, Performative};
use keyboard::{Terminal, UserEvent, UserRequest};

use super::launched::MessageListener;
use super::scenario_run::{ScenarioRun, with_time_limit};
use super::setting::Setting;
use super::{ScenarioEvent, ScenarioOptions, ScenarioResult};

/// The answer of a person with the right to enter.
const PIN: &str = "2718";
/// A wrong answer, which is not the PIN.
const WRONG: &str = "0000";

/// How long a person counts as validated. The time is short, so that the robot validates the next
/// visitor again.
const VALID_FOR: &str = "2s";
/// How long the robot waits for an answer to its question.
const PATIENCE: &str = "3s";

fn setting(access: &AccessScenario) -> Setting {
    let entry = access.entry.clone();
    let more = move |device: &BuildingDevice| match device {
        BuildingDevice::Camera { .. } => format!(
            ", presets = {{ door = {{ shows = \"{entry}\" }} }}, folder = \"{{folder}}\", \
             motion-for = \"1s\", on-motion = {{ goal = \"(validated ?l)\", priority = 5 }}"
        ),
        BuildingDevice::Robot { .. } => format!(
            ", login = {{ pin = \"{PIN}\", attempts = 2, patience = \"{PATIENCE}\", \
             valid-for = \"{VALID_FOR}\" }}"
        ),
        _ => String::new(),
    };
    Setting::new("scenario-3", &access.layout).more(more)
}

pub(super) async fn play(
    script: &ScenarioOptions,
    tell: &mut dyn FnMut(ScenarioEvent),
) -> Result<ScenarioResult, String> {
    let access = AccessScenario::seeded(script.seed);
    let setting = setting(&access);
    let performance = ScenarioRun::open(&setting, script, tell).await?;
    let (desk, ear) = (performance.seat("front-desk")?, performance.set.listen().await?);
    let (admissions, validity) = (Vec::new(), Vec::new());
    let mut play = AccessRun { performance, desk, ear, access: &access, admissions, validity };
    let ended = with_time_limit(play.acts(&setting)).await;
    let AccessRun { performance: ScenarioRun { set, building, .. }, admissions, .. } = play;
    let mut problems: Vec<_> = ended.err().into_iter().collect();
    problems.extend(access.check(&building.truth(), &admissions).err().unwrap_or_default());
    set.shut_down().await;
    let verdict = format!(
        "the robot came to {} when a person had come there, asked nowhere else, and let in \
         those that gave the right answer, and no others",
        access.entry
    );
    Ok(ScenarioResult { problems, verdict, admissions, ..ScenarioResult::default() })
}

struct AccessRun<'t> {
    performance: ScenarioRun<'t>,
    /// A second keyboard, which receives the same questions as the user's.
    desk: Terminal,
    ear: MessageListener,
    access: &'t AccessScenario,
    admissions: Vec<VisitOutcome>,
    /// The values of the robot's fact that a person is validated, since the current visitor came.
    /// There is one value per change.
    validity: Vec<bool>,
}

/// An event at the entry during a visit.
enum EntryEvent {
    AskedUser(OpenQuestion),
    AskedDesk(OpenQuestion),
    /// The final report about the camera's goal has come.
    Ended(Report),
    Other,
}

impl AccessRun<'_> {
    async fn acts(&mut self, setting: &Setting) -> Result<(), String> {
        self.performance.await_agents(setting).await?;
        // The camera detects movement only after it has looked once.
        let camera = self.access.camera();
        self.until_informs(camera, |inform| facts(inform).contains("(looks-at ")).await?;
        let robot = self.access.robot();
        for visit in &self.access.visits {
            let admission = self.visit(visit).await?;
            self.admissions.push(admission);
            match visit.manner {
                // While the validation counts, the camera would not request one for the next
                // visitor.
                manner if manner.is_valid() => {
                    while self.validity != [true, false] {
                        self.hear().await?;
                    }
                }
                // After an unanswered question, the robot does not offer `validate-person` for a
                // while.
                AnswerPattern::NobodyAnswers => {
                    let offers = |inform: &Inform| matches!(inform, Inform::Model(of) if of.model.contains("validate-person"));
                    self.until_informs(robot, offers).await?;
                }
                _ => (),
            }
        }
        Ok(())
    }

    async fn visit(&mut self, visit: &Visit) -> Result<VisitOutcome, String> {
        let Visit { person, manner } = visit;
        let entry = &self.access.entry;
        self.performance.say(format!("{person} comes to {entry}"));
        self.validity.clear();
        let building = self.performance.building.clone();
        building.enter(person, entry).map_err(|error| error.to_string())?;
        let mut admission =
            VisitOutcome { person: person.clone(), asked: Vec::new(), validated: false };
        loop {
            match self.next().await? {
                EntryEvent::AskedUser(question) => {
                    let place = building.place_of(self.access.robot());
                    let place = place.map_err(|error| error.to_string())?;
                    self.performance.say(format!("  robot at {place}: {}", question.text));
                    let first = admission.asked.is_empty();
                    admission.asked.push(building.truth().next_sequence());
                    self.answer_user(*manner, first, &question).await?;
                }
                EntryEvent::AskedDesk(question) if *manner == AnswerPattern::TwoAtOnce => {
                    answer(&self.desk, &question, PIN).await?;
                }
                EntryEvent::Ended(report) => {
                    admission.validated = report.outcome == Outcome::Done;
                    let verdict = if admission.validated { "let in" } else { "not let in" };
                    self.performance.say(format!("  {person} is {verdict}: {}", report.detail));
                    return Ok(admission);
                }
                EntryEvent::AskedDesk(_) | EntryEvent::Other => (),
            }
        }
    }

    async fn answer_user(
        &mut self,
        manner: AnswerPattern,
        is_first: bool,
        question: &OpenQuestion,
    ) -> Result<(), String> {
        let (text, how) = match manner {
            AnswerPattern::NobodyAnswers => {
                self.performance.say("  no answer");
                return Ok(());
            }
            AnswerPattern::TwoAtOnce => (PIN, "two keyboards answer at once"),
            AnswerPattern::WrongThenRight if !is_first => (PIN, "the answer is right"),
            AnswerPattern::WrongThenRight | AnswerPattern::OnlyWrong => {
                (WRONG, "the answer is wrong")
            }
        };
        self.performance.say(format!("  {how}"));
        answer(&self.performance.user, question, text).await
    }

    async fn next(&mut self) -> Result<EntryEvent, String> {
        let ended = || "a keyboard has ended".to_owned();
        tokio::select! {
            heard = self.performance.user.events.recv() => match heard.ok_or_else(ended)? {
                UserEvent::Question(question) => Ok(EntryEvent::AskedUser(question)),
                _ => Ok(EntryEvent::Other),
            },
            heard = self.desk.events.recv() => match heard.ok_or_else(ended)? {
                UserEvent::Question(question) => Ok(EntryEvent::AskedDesk(question)),
                _ => Ok(EntryEvent::Other),
            },
            message = hear(&mut self.ear, &mut self.validity, self.access.robot()) => {
                let message = message?;
                Ok(last_word(&message, self.access.camera()).map_or(EntryEvent::Other, EntryEvent::Ended))
            }
        }
    }

    async fn hear(&mut self) -> Result<Message, String> {
        hear(&mut self.ear, &mut self.validity, self.access.robot()).await
    }

    /// Waits until the agent named `agent` sends an `inform` that meets a condition.
    async fn until_informs(
        &mut self,
        agent: &str,
        is_so: impl Fn(&Inform) -> bool,
    ) -> Result<(), String> {
        loop {
            let message = self.hear().await?;
            let is_its = message.sender.as_str() == agent;
            if is_its && message.content_as().is_ok_and(|inform| is_so(&inform)) {
                return Ok(());
            }
        }
    }
}

/// Returns the next message on the network. If the message changes the robot's fact that a person
/// is validated, the new value is added to `validity`.
async fn hear(
    ear: &mut MessageListener,
    validity: &mut Vec<bool>,
    robot: &str,
) -> Result<Message, String> {
    let message = ear.heard.recv().await.ok_or("the listener has ended")?;
    if message.sender.as_str() == robot
        && let Ok(inform @ Inform::Heartbeat(_)) = message.content_as::<Inform>()
    {
        let is_valid = facts(&inform).contains("(validated ");
        if validity.last().map_or(is_valid, |last| *last != is_valid) {
            validity.push(is_valid);
        }
    }
    Ok(message)
}

/// Returns the facts in a heartbeat, both the lasting and the temporary ones.
fn facts(inform: &Inform) -> String {
    let Inform::Heartbeat(beat) = inform else { return String::new() };
    let passing: Vec<_> = beat.known_for.keys().map(String::as_str).collect();
    format!("{} {}", beat.facts, passing.join(" "))
}

/// Returns the report in a message if it is the final report about the camera's goal.
fn last_word(message: &Message, camera: &str) -> Option<Report> {
    let to_camera = message.receiver.first().is_some_and(|to| to.as_str() == camera);
    let is_report = message.performative == Performative::Confirm;
    let from_requester = message.sender.as_str() == "plan-requester";
    let report = (to_camera && is_report && from_requester).then(|| message.content_as::<Report>());
    report?.ok().filter(|report| report.outcome.is_final())
}

async fn answer(terminal: &Terminal, question: &OpenQuestion, text: &str) -> Result<(), String> {
    let OpenQuestion { keyboard, question, seal_to, .. } = question.clone();
    let said = UserRequest::Answer { keyboard, question, text: text.to_owned(), seal_to };
    let sent = terminal.requests.send(said).await;
    sent.map(drop).map_err(|_| "a keyboard has ended".to_owned())
}
