//! The Doorkeeper. If the ecosystem file contains `admit = "ask"`, this agent asks people at all
//! keyboards whether discovered agents may take part, and stores the answers.
//!
//! - Agents that appear shortly after each other are combined in one question (`question`).
//! - An answer is on disk before it takes effect, so that an answered question is not asked again
//!   after a restart.
//! - A question without an answer is asked again. A keyboard that joins later receives the open
//!   questions.

mod question;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Inform, Question, Withdrawal};
use acl::{AgentId, Performative, Protocol, ReplyToken};
use agent::{
    AdmissionPolicy, Admissions, Agent, Applicant, Blueprint, BuildError, Callbacks, Context,
    ExchangeEvent, ExchangeOpening, LaunchableAgent, PluginEntry, Presence, StateFolder,
    WorkHandle, replace_file,
};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

/// Delay between the appearance of an agent and the question about it, during which more agents may
/// appear. The devices of a gateway appear within this time of each other.
const APPLICANT_DELAY: Duration = Duration::from_millis(500);

/// Time that a person has for answering a question.
const ANSWER_TIMEOUT: Duration = Duration::from_secs(600);

/// Delay before a question is asked again that no person has answered.
const REASK_DELAY: Duration = Duration::from_secs(10);

/// Maximum number of open questions. Agents that appear while so many questions are open must wait.
const OPEN_QUESTIONS_MAX: usize = 8;

/// The entry of the Doorkeeper in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "doorkeeper",
    about: "asks a person whether agents that no file names may take part",
    drivers: &[],
    has_replicas: false,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let resources = &blueprint.host.resources;
    let admissions = resources.get::<Admissions>();
    let folder = resources.get::<StateFolder>();
    Ok(Box::new(Doorkeeper {
        admissions: admissions.unwrap_or_else(|| Arc::new(Admissions::new(AdmissionPolicy::Ask))),
        file: folder.map(|folder| folder.0.join("admitted.json")),
        open_questions: BTreeMap::new(),
        last_question_id: 0,
        is_check_scheduled: false,
        admission_watch: None,
    }))
}

struct Doorkeeper {
    admissions: Arc<Admissions>,
    /// File in which the answers are stored; `None` if they are kept only until the daemon stops.
    file: Option<PathBuf>,
    /// Open questions by number, each with its agents.
    open_questions: BTreeMap<u64, AdmissionQuestion>,
    last_question_id: u64,
    /// Whether a check for agents that wait for admission is scheduled.
    is_check_scheduled: bool,
    admission_watch: Option<WorkHandle>,
}

struct AdmissionQuestion {
    applicants: Vec<(Applicant, String)>,
    text: String,
    /// Exchanges about the question: one with all keyboards, and one with each keyboard that has
    /// joined since.
    exchanges: Vec<ReplyToken>,
}

/// The answer about one agent, in the form in which it is stored on disk.
#[derive(Serialize, Deserialize)]
struct StoredAnswer {
    by: String,
    name: String,
    admitted: bool,
}

impl Agent for Doorkeeper {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let Presence::Joined(newcomer) = presence else { return };
        // The new agent may be a keyboard; any other agent refuses the question.
        let open: Vec<_> = self.open_questions.keys().copied().collect();
        for id in open {
            self.send_question(id, Some(newcomer.agent.clone()), ctx);
        }
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        if let Some(file) = &self.file {
            match read(file) {
                Ok(answers) => self.admissions.answer(answers),
                Err(problem) => tracing::warn!(file = %file.display(), "failed to {problem}"),
            }
        }
        self.watch_admissions(self.admissions.changes(), ctx);
        self.schedule_check(APPLICANT_DELAY, ctx);
    }
}

impl Doorkeeper {
    fn watch_admissions(&mut self, mut changes: watch::Receiver<()>, ctx: &mut Context<Self>) {
        let next = async move { changes.changed().await.is_ok().then_some(changes) };
        let work = ctx.run(next, |doorkeeper: &mut Self, changes, ctx| {
            let Some(changes) = changes else { return };
            doorkeeper.schedule_check(APPLICANT_DELAY, ctx);
            doorkeeper.watch_admissions(changes, ctx);
        });
        self.admission_watch = Some(work);
    }

    fn schedule_check(&mut self, wait: Duration, ctx: &mut Context<Self>) {
        if self.is_check_scheduled {
            return;
        }
        self.is_check_scheduled = true;
        ctx.after(wait, |doorkeeper: &mut Self, ctx| {
            doorkeeper.is_check_scheduled = false;
            doorkeeper.check_applicants(ctx);
        });
    }

    /// Asks people about the applicants (agents that wait for admission) without an open question.
    /// Withdraws each question with no agent left that waits for admission.
    fn check_applicants(&mut self, ctx: &mut Context<Self>) {
        let open = self.admissions.open();
        let here: BTreeSet<_> = open.iter().map(|(applicant, _)| applicant).collect();
        let is_idle = |asking: &AdmissionQuestion| {
            asking.applicants.iter().all(|(one, _)| !here.contains(one))
        };
        let idle: Vec<_> = self
            .open_questions
            .iter()
            .filter(|(_, asking)| is_idle(asking))
            .map(|(id, _)| *id)
            .collect();
        for id in idle {
            self.close_question(id, "the agents have left".to_owned(), ctx);
        }
        let asked: BTreeSet<_> = self
            .open_questions
            .values()
            .flat_map(|asking| &asking.applicants)
            .map(|(one, _)| one)
            .collect();
        let new: Vec<_> =
            open.iter().filter(|(applicant, _)| !asked.contains(applicant)).cloned().collect();
        if !new.is_empty() && self.open_questions.len() < OPEN_QUESTIONS_MAX {
            self.open_question(new, None, ctx);
        }
    }

    fn open_question(
        &mut self,
        about: Vec<(Applicant, String)>,
        mistake: Option<String>,
        ctx: &mut Context<Self>,
    ) {
        let text = question::question_text(&about, mistake.as_deref());
        self.last_question_id += 1;
        let id = self.last_question_id;
        self.open_questions
            .insert(id, AdmissionQuestion { applicants: about, text, exchanges: Vec::new() });
        self.send_question(id, None, ctx);
    }

    /// Sends an open question to the agent `to`, or to all agents if `to` is `None`.
    fn send_question(&mut self, id: u64, to: Option<AgentId>, ctx: &mut Context<Self>) {
        let Some(asking) = self.open_questions.get_mut(&id) else { return };
        let is_to_all = to.is_none();
        let opening = ExchangeOpening {
            to,
            performative: Performative::QueryRef,
            protocol: Protocol::Query,
            conversation: ctx.new_conversation(),
            content: serde_json::json!(Question::new(asking.text.clone())),
        };
        let exchange =
            ctx.open(opening, ANSWER_TIMEOUT, move |doorkeeper: &mut Self, answer, ctx| {
                doorkeeper.answered(id, &answer, is_to_all, ctx);
            });
        asking.exchanges.push(exchange);
    }

    fn answered(
        &mut self,
        id: u64,
        answer: &ExchangeEvent,
        is_of_all: bool,
        ctx: &mut Context<Self>,
    ) {
        let (said, by) = match answer {
            ExchangeEvent::Message(message) if message.performative == Performative::Inform => {
                match message.content_as::<Inform>() {
                    Ok(Inform::Answer(answer)) => (answer.text, &message.sender),
                    Ok(_) => return ctx.not_understood(message, "this does not answer a question"),
                    Err(error) => return ctx.not_understood(message, error.to_string()),
                }
            }
            ExchangeEvent::Message(message) => {
                tracing::debug!(from = %message.sender, "declines; another may answer");
                return;
            }
            ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) => {
                if is_of_all {
                    self.close_question(id, "no answer came in time".to_owned(), ctx);
                    self.schedule_check(REASK_DELAY, ctx);
                }
                return;
            }
        };
        let Some(asking) = self.close_question(id, format!("answered at `{by}`"), ctx) else {
            return;
        };
        match question::parse_answer(&said, &asking.applicants) {
            Ok(answers) => {
                for (applicant, is_in) in &answers {
                    let name = &applicant.name;
                    tracing::info!(name, is_in, at = %by, "a person has admitted or refused it");
                }
                self.store_answers(answers);
            }
            Err(mistake) => self.open_question(asking.applicants, Some(mistake), ctx),
        }
    }

    fn close_question(
        &mut self,
        id: u64,
        detail: String,
        ctx: &mut Context<Self>,
    ) -> Option<AdmissionQuestion> {
        let asking = self.open_questions.remove(&id)?;
        for exchange in &asking.exchanges {
            ctx.cancel(exchange, &Withdrawal { detail: detail.clone() });
        }
        Some(asking)
    }

    /// Stores answers on disk and applies them. Answers that cannot be stored apply until the
    /// daemon stops; after a restart people are asked again.
    fn store_answers(&self, answers: Vec<(Applicant, bool)>) {
        if let Some(file) = &self.file {
            let mut all: BTreeMap<_, _> = self.admissions.answers().into_iter().collect();
            all.extend(answers.iter().cloned());
            if let Err(problem) = write(file, all) {
                tracing::warn!(file = %file.display(), "failed to {problem}");
            }
        }
        self.admissions.answer(answers);
    }
}

/// Reads the stored answers. The text of an error completes “failed to …”.
fn read(file: &Path) -> Result<Vec<(Applicant, bool)>, String> {
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(format!("read the decisions: {error}")),
    };
    let kept: Vec<StoredAnswer> = serde_json::from_str(&text)
        .map_err(|error| format!("understand the decisions: {error}"))?;
    Ok(kept
        .into_iter()
        .map(|StoredAnswer { by, name, admitted }| (Applicant { by, name }, admitted))
        .collect())
}

fn write(file: &Path, answers: BTreeMap<Applicant, bool>) -> Result<(), String> {
    let kept: Vec<_> = answers
        .into_iter()
        .map(|(Applicant { by, name }, admitted)| StoredAnswer { by, name, admitted })
        .collect();
    let text = serde_json::to_string_pretty(&kept).map_err(|error| error.to_string())?;
    replace_file(file, text.as_bytes()).map_err(|error| format!("keep the decisions: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answers_are_stored_on_disk() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("admitted.json");
        assert_eq!(read(&file), Ok(Vec::new()), "no decisions yet");
        let one = Applicant { by: "zigbee".to_owned(), name: "t-1".to_owned() };
        write(&file, BTreeMap::from([(one.clone(), false)])).expect("it is written");
        assert_eq!(read(&file), Ok(vec![(one, false)]));
        std::fs::write(&file, "{").expect("a file");
        assert!(read(&file).is_err_and(|problem| problem.starts_with("understand the")));
    }
}
