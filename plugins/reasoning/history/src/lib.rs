//! The history: keeps what happened in an ecosystem, each event with its cause, and answers
//! questions about it (docs/history.md).
//!
//! - The agent overhears all messages. `recorder` makes events with causes out of them, without a
//!   clock or a file.
//! - `store` keeps the events in a folder of files, compressed and indexed, within limits of time
//!   and size. `writer` writes them in batches.
//! - `query` answers `read-history` requests.
//! - Answers of people are never recorded. Events about what a model declares `:private` are
//!   marked, and shown only to readers that `[rights]` names.

mod answers;
mod config;
mod event;
mod past;
mod query;
mod recorder;
#[cfg(test)]
mod samples;
mod store;
mod words;
mod writer;

use std::collections::{HashMap, VecDeque};
use std::path::PathBuf;
use std::time::{Duration, UNIX_EPOCH};

use crate::config::HistoryConfig;
pub use crate::event::{EventDescription, FALSE, RecordedEvent, TRUE, UNKNOWN};
use crate::past::PastHistory;
pub use crate::query::{QueryAnswer, answer};
pub use crate::recorder::EventRecorder;
pub use crate::store::{FORMAT, HistoryLimits, HistoryStore, HistoryStoreError, OpenedHistory};
use crate::writer::{HistoryDisk, PendingEvents};
use acl::content::{GoalStatus, Inform, ReadHistory, Reason, Request};
use acl::{AgentId, Message, Performative};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, OverheardBatch,
    Participation, PluginEntry, Presence, Resource, ResourceQuery, StateFolder, WorkHandle,
};

/// Maximum number of overheard messages that wait for the agent; further ones are lost and counted.
const OVERHEARD_MAX: usize = 8_192;

/// Maximum number of messages and changes of presence that wait until the files are open.
const EARLY_MAX: usize = 8_192;

/// Maximum number of questions that wait for the disk; further ones are refused.
const QUESTIONS_MAX: usize = 32;

/// Time between two batches of events.
const WRITE_INTERVAL: Duration = Duration::from_millis(500);

/// Time after the start in which agents that appear were present before.
const START: Duration = Duration::from_secs(2);

/// The entry of the history in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "history",
    about: "keeps what happened and why, for `althing history` and `althing why`",
    drivers: &[],
    has_replicas: false,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let config: HistoryConfig = blueprint.config_as()?;
    let limits = config.limits().map_err(|problem| blueprint.problem(problem))?;
    let folder = blueprint.host.resources.get::<StateFolder>();
    let folder = folder.map(|folder| folder.0.join(format!("{}.history", blueprint.id)));
    let ontology_names = public_names(&blueprint.host.ontology);
    Ok(Box::new(HistoryAgent::new(folder, limits, ontology_names)))
}

/// Returns the predicates and functions of the ontology that are not private.
fn public_names(ontology: &pddl::Domain) -> Vec<String> {
    let predicates = ontology.predicates.iter().map(|it| (&it.name, &it.privacy));
    let functions = ontology.functions.iter().map(|it| (&it.name, &it.privacy));
    let public = predicates.chain(functions).filter(|(_, it)| **it == pddl::Privacy::Public);
    public.map(|(name, _)| name.to_string()).collect()
}

/// The agent.
struct HistoryAgent {
    /// Names that the ontology declares, and not as private.
    ontology_names: Vec<String>,
    folder: Option<PathBuf>,
    limits: HistoryLimits,
    disk: HistoryDisk,
    recorder: EventRecorder,
    /// What has come before the files were open.
    early: VecDeque<EarlyNews>,
    pending: PendingEvents,
    /// Questions that wait for the disk.
    questions: Vec<(Participation, Box<ReadHistory>)>,
    is_write_scheduled: bool,
    /// Whether a disk that has failed is to be tried again.
    is_retry_scheduled: bool,
    is_starting: bool,
    /// The running write, or the opening of the files.
    work: Option<WorkHandle>,
    goals_query: Option<WorkHandle>,
    model_queries: HashMap<AgentId, WorkHandle>,
}

/// News that has come before the files were open.
enum EarlyNews {
    Heard(Box<Message>, u64),
    Seen(Box<Presence>, u64),
}

impl Agent for HistoryAgent {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new().on(Performative::Request, Self::requested)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        if let Err(error) = ctx.overhear(OVERHEARD_MAX, Self::overheard) {
            tracing::error!(agent = %ctx.id(), %error, "the history hears nothing");
        }
        ctx.after(START, |history: &mut Self, _| history.is_starting = false);
        self.open(ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let at_ms = wall_ms(ctx);
        match self.disk.is_open() {
            true => {
                self.recorder.presence(presence, self.is_starting, at_ms);
                self.schedule_write(ctx);
            }
            false => self.keep_early(EarlyNews::Seen(Box::new(presence.clone()), at_ms)),
        }
    }

    fn drain(&mut self, ctx: &mut Context<Self>) -> bool {
        if !self.disk.is_open() {
            return true;
        }
        self.write(ctx);
        self.work.is_none() && (self.pending.is_empty() || self.pending.has_failed())
    }
}

impl HistoryAgent {
    fn new(
        folder: Option<PathBuf>,
        limits: HistoryLimits,
        ontology_names: Vec<String>,
    ) -> HistoryAgent {
        HistoryAgent {
            ontology_names,
            folder,
            limits,
            disk: HistoryDisk::Opening,
            recorder: EventRecorder::new(0),
            early: VecDeque::new(),
            pending: PendingEvents::default(),
            questions: Vec::new(),
            is_write_scheduled: false,
            is_retry_scheduled: false,
            is_starting: true,
            work: None,
            goals_query: None,
            model_queries: HashMap::new(),
        }
    }

    fn overheard(&mut self, batch: OverheardBatch, ctx: &mut Context<Self>) {
        let at_ms = wall_ms(ctx);
        self.pending.add_lost(batch.lost);
        for heard in batch.messages {
            match self.disk.is_open() {
                true => self.recorder.hear(heard.message, at_ms),
                false => self.keep_early(EarlyNews::Heard(Box::new(heard.message), at_ms)),
            }
        }
        for agent in self.recorder.take_unknown_models() {
            self.fetch_model(agent, ctx);
        }
        self.schedule_write(ctx);
    }

    fn keep_early(&mut self, news: EarlyNews) {
        if self.early.len() >= EARLY_MAX {
            self.early.pop_front();
            self.pending.add_lost(1);
        }
        self.early.push_back(news);
    }

    /// Begins to record, behind the events of the files.
    fn begin(&mut self, newest: u64, past: PastHistory, ctx: &mut Context<Self>) {
        self.recorder = EventRecorder::new(newest);
        self.recorder.resume(past, ctx.id().as_str(), wall_ms(ctx));
        self.recorder.learn_ontology(self.ontology_names.iter().cloned());
        self.fetch_goals(ctx);
        for news in std::mem::take(&mut self.early) {
            match news {
                EarlyNews::Heard(message, at_ms) => self.recorder.hear(*message, at_ms),
                EarlyNews::Seen(presence, at_ms) => {
                    self.recorder.presence(&presence, true, at_ms);
                }
            }
        }
        for agent in self.recorder.take_unknown_models() {
            self.fetch_model(agent, ctx);
        }
        self.schedule_write(ctx);
    }

    /// Asks for the goals that are pursued already.
    fn fetch_goals(&mut self, ctx: &mut Context<Self>) {
        let query = ResourceQuery { daemon: None, resource: Resource::Goals, agent: None };
        let asked = ctx.query(query);
        self.goals_query = Some(ctx.run(asked, |history: &mut Self, answers, ctx| {
            let at_ms = wall_ms(ctx);
            for answer in answers {
                let goals: Vec<GoalStatus> = serde_json::from_slice(&answer).unwrap_or_default();
                goals.iter().for_each(|goal| history.recorder.goal_known(goal, at_ms));
            }
            history.schedule_write(ctx);
        }));
    }

    /// Asks for the model of an agent, which says what is private.
    fn fetch_model(&mut self, agent: AgentId, ctx: &mut Context<Self>) {
        if self.model_queries.contains_key(&agent) {
            return;
        }
        let (asked, name) = (ctx.ask(Resource::Model, &agent), agent.clone());
        let query = ctx.run(asked, move |history: &mut Self, answers, ctx| {
            history.model_queries.remove(&agent);
            let models = answers.iter().filter_map(|answer| acl::decode(answer).ok());
            for model in models.filter(|model| model.sender == agent) {
                if let Ok(Inform::Model(announcement)) = model.content_as() {
                    history.recorder.learn_model(&agent, &announcement.model);
                }
            }
            history.recorder.tick(wall_ms(ctx));
            history.schedule_write(ctx);
        });
        self.model_queries.insert(name, query);
    }

    fn requested(&mut self, message: Message, ctx: &mut Context<Self>) {
        let participation = Participation::of(&message);
        let read = match message.content_as::<Request>() {
            Ok(Request::ReadHistory(read)) => read,
            Ok(_) => {
                let detail = "a history takes `read-history`";
                return ctx.refuse(&participation, Reason::Incapable, detail);
            }
            Err(error) => return ctx.not_understood(&message, error.to_string()),
        };
        match &self.disk {
            HistoryDisk::Unusable(why) => {
                ctx.refuse(&participation, Reason::Incapable, format!("failed to {why}"));
            }
            _ if self.questions.len() >= QUESTIONS_MAX => {
                let detail = "too many ask what happened; ask again later";
                ctx.refuse(&participation, Reason::Busy, detail);
            }
            _ => {
                self.questions.push((participation, Box::new(read)));
                self.write(ctx);
            }
        }
    }

    /// Writes the events a little later, in one batch with others.
    fn schedule_write(&mut self, ctx: &mut Context<Self>) {
        if self.is_write_scheduled || !self.disk.is_open() {
            return;
        }
        self.pending.take(&mut self.recorder);
        if self.pending.is_empty() && !self.recorder.is_waiting() {
            return;
        }
        self.is_write_scheduled = true;
        ctx.after(WRITE_INTERVAL, |history: &mut Self, ctx| {
            history.is_write_scheduled = false;
            history.recorder.tick(wall_ms(ctx));
            history.write(ctx);
            history.schedule_write(ctx);
        });
    }
}

/// Returns the time of day, in milliseconds since 1970-01-01 UTC.
fn wall_ms(ctx: &Context<HistoryAgent>) -> u64 {
    let since = ctx.wall_clock().duration_since(UNIX_EPOCH).unwrap_or_default();
    u64::try_from(since.as_millis()).unwrap_or(u64::MAX)
}
