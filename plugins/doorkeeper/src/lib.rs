//! The Doorkeeper: where the ecosystem's file says `admit = "ask"`, asks the people at all keyboards
//! whether those that no file names may take part, and keeps what they have said.
//!
//! - Who appears within a moment is asked about in one question (`question`).
//! - What people have said is on disk before it holds, and nobody is asked again after a restart.
//! - Where nobody answers, they are asked again; a keyboard that comes later is told what is open.

mod question;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use acl::content::{Inform, Question, Withdrawal};
use acl::{AgentId, Performative, Protocol, ReplyToken};
use agent::{
    Admissions, Admit, Agent, Answer, Applicant, Blueprint, BuildError, Callbacks, Context, Launch,
    Opening, PluginEntry, Presence, StateFolder, Work,
};
use serde::{Deserialize, Serialize};
use tokio::sync::watch;

/// How long is waited for more to appear: devices of one gateway come at once.
const GATHERING: Duration = Duration::from_millis(500);

/// How long a person has for an answer.
const PATIENCE: Duration = Duration::from_secs(600);

/// How long after nobody could be asked it is tried again.
const REST: Duration = Duration::from_secs(10);

/// Questions that are open at one time; who appears beyond waits.
const OPEN_MAX: usize = 8;

/// The line in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "doorkeeper",
    about: "asks people whether those that no file names may take part",
    drivers: &[],
    stands_by: false,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let resources = &blueprint.host.resources;
    let admissions = resources.get::<Admissions>();
    let folder = resources.get::<StateFolder>();
    Ok(Box::new(Doorkeeper {
        admissions: admissions.unwrap_or_else(|| Arc::new(Admissions::new(Admit::Ask))),
        file: folder.map(|folder| folder.0.join("admitted.json")),
        asking: BTreeMap::new(),
        asked: 0,
        is_due: false,
        hearing: None,
    }))
}

struct Doorkeeper {
    admissions: Arc<Admissions>,
    /// Where answers are kept; without it, until the daemon stops.
    file: Option<PathBuf>,
    /// The questions that are open, and about whom they are.
    asking: BTreeMap<u64, Asking>,
    asked: u64,
    /// Whether it is going to look who is to be asked about.
    is_due: bool,
    hearing: Option<Work>,
}

struct Asking {
    about: Vec<(Applicant, String)>,
    text: String,
    /// One with all keyboards, and one with each that has come since.
    exchanges: Vec<ReplyToken>,
}

/// One answer, as it is kept.
#[derive(Serialize, Deserialize)]
struct Kept {
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
        // It may be a keyboard; who is none says so.
        let open: Vec<_> = self.asking.keys().copied().collect();
        for id in open {
            self.put(id, Some(newcomer.agent.clone()), ctx);
        }
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        if let Some(file) = &self.file {
            match read(file) {
                Ok(answers) => self.admissions.answer(answers),
                Err(problem) => tracing::warn!(file = %file.display(), "failed to {problem}"),
            }
        }
        self.hear_of_admissions(self.admissions.changes(), ctx);
        self.look_soon(GATHERING, ctx);
    }
}

impl Doorkeeper {
    fn hear_of_admissions(&mut self, mut changes: watch::Receiver<()>, ctx: &mut Context<Self>) {
        let next = async move { changes.changed().await.is_ok().then_some(changes) };
        let work = ctx.run(next, |doorkeeper: &mut Self, changes, ctx| {
            let Some(changes) = changes else { return };
            doorkeeper.look_soon(GATHERING, ctx);
            doorkeeper.hear_of_admissions(changes, ctx);
        });
        self.hearing = Some(work);
    }

    fn look_soon(&mut self, wait: Duration, ctx: &mut Context<Self>) {
        if self.is_due {
            return;
        }
        self.is_due = true;
        ctx.after(wait, |doorkeeper: &mut Self, ctx| {
            doorkeeper.is_due = false;
            doorkeeper.look(ctx);
        });
    }

    /// Asks about those of whom nobody has been asked, and about nobody who has left.
    fn look(&mut self, ctx: &mut Context<Self>) {
        let open = self.admissions.open();
        let here: BTreeSet<_> = open.iter().map(|(applicant, _)| applicant).collect();
        let is_idle = |asking: &Asking| asking.about.iter().all(|(one, _)| !here.contains(one));
        let idle: Vec<_> =
            self.asking.iter().filter(|(_, asking)| is_idle(asking)).map(|(id, _)| *id).collect();
        for id in idle {
            self.end(id, "they have left".to_owned(), ctx);
        }
        let asked: BTreeSet<_> =
            self.asking.values().flat_map(|asking| &asking.about).map(|(one, _)| one).collect();
        let new: Vec<_> =
            open.iter().filter(|(applicant, _)| !asked.contains(applicant)).cloned().collect();
        if !new.is_empty() && self.asking.len() < OPEN_MAX {
            self.ask(new, None, ctx);
        }
    }

    fn ask(
        &mut self,
        about: Vec<(Applicant, String)>,
        mistake: Option<String>,
        ctx: &mut Context<Self>,
    ) {
        let text = question::text(&about, mistake.as_deref());
        self.asked += 1;
        let id = self.asked;
        self.asking.insert(id, Asking { about, text, exchanges: Vec::new() });
        self.put(id, None, ctx);
    }

    /// Puts an open question to an agent, or to all.
    fn put(&mut self, id: u64, to: Option<AgentId>, ctx: &mut Context<Self>) {
        let Some(asking) = self.asking.get_mut(&id) else { return };
        let is_to_all = to.is_none();
        let opening = Opening {
            to,
            performative: Performative::QueryRef,
            protocol: Protocol::Query,
            conversation: ctx.new_conversation(),
            content: serde_json::json!(Question::new(asking.text.clone())),
        };
        let exchange = ctx.open(opening, PATIENCE, move |doorkeeper: &mut Self, answer, ctx| {
            doorkeeper.answered(id, &answer, is_to_all, ctx);
        });
        asking.exchanges.push(exchange);
    }

    fn answered(&mut self, id: u64, answer: &Answer, is_of_all: bool, ctx: &mut Context<Self>) {
        let (said, by) = match answer {
            Answer::Message(message) if message.performative == Performative::Inform => {
                match message.content_as::<Inform>() {
                    Ok(Inform::Answer(answer)) => (answer.text, &message.sender),
                    Ok(_) => return ctx.not_understood(message, "this answers no question"),
                    Err(error) => return ctx.not_understood(message, error.to_string()),
                }
            }
            Answer::Message(message) => {
                tracing::debug!(from = %message.sender, "does not answer; somebody else may");
                return;
            }
            Answer::Silence | Answer::Undelivered(_) => {
                if is_of_all {
                    self.end(id, "nobody has answered".to_owned(), ctx);
                    self.look_soon(REST, ctx);
                }
                return;
            }
        };
        let Some(asking) = self.end(id, format!("answered at `{by}`"), ctx) else { return };
        match question::understand(&said, &asking.about) {
            Ok(answers) => {
                for (applicant, is_in) in &answers {
                    let name = &applicant.name;
                    tracing::info!(name, is_in, at = %by, "a person has said who takes part");
                }
                self.keep(answers);
            }
            Err(mistake) => self.ask(asking.about, Some(mistake), ctx),
        }
    }

    fn end(&mut self, id: u64, detail: String, ctx: &mut Context<Self>) -> Option<Asking> {
        let asking = self.asking.remove(&id)?;
        for exchange in &asking.exchanges {
            ctx.withdraw(exchange, &Withdrawal { detail: detail.clone() });
        }
        Some(asking)
    }

    /// What was said holds even where it cannot be kept; then people are asked again after a restart.
    fn keep(&self, answers: Vec<(Applicant, bool)>) {
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

/// What people have said until now. Completes “failed to …”.
fn read(file: &Path) -> Result<Vec<(Applicant, bool)>, String> {
    let text = match std::fs::read_to_string(file) {
        Ok(text) => text,
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => return Ok(Vec::new()),
        Err(error) => return Err(format!("read what people have said: {error}")),
    };
    let kept: Vec<Kept> = serde_json::from_str(&text)
        .map_err(|error| format!("understand what people have said: {error}"))?;
    Ok(kept
        .into_iter()
        .map(|Kept { by, name, admitted }| (Applicant { by, name }, admitted))
        .collect())
}

fn write(file: &Path, answers: BTreeMap<Applicant, bool>) -> Result<(), String> {
    let kept: Vec<_> = answers
        .into_iter()
        .map(|(Applicant { by, name }, admitted)| Kept { by, name, admitted })
        .collect();
    let text = serde_json::to_string_pretty(&kept).map_err(|error| error.to_string())?;
    // Whole or not at all: a machine may lose its power at any time.
    let beside = file.with_extension("json.new");
    let written = std::fs::write(&beside, text).and_then(|()| std::fs::rename(&beside, file));
    written.map_err(|error| format!("keep what people have said: {error}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_was_said_is_kept() {
        let folder = tempfile::tempdir().expect("a folder");
        let file = folder.path().join("admitted.json");
        assert_eq!(read(&file), Ok(Vec::new()), "nobody has said anything");
        let one = Applicant { by: "zigbee".to_owned(), name: "t-1".to_owned() };
        write(&file, BTreeMap::from([(one.clone(), false)])).expect("it is written");
        assert_eq!(read(&file), Ok(vec![(one, false)]));
        std::fs::write(&file, "{").expect("a file");
        assert!(read(&file).is_err_and(|problem| problem.starts_with("understand what")));
    }
}
