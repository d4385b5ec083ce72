//! The prompt: an interactive session in an ecosystem, in which the user types the verbs of the
//! command line.
//!
//! - [`input`] reads lines. At a terminal there are history, completion and editing; otherwise each
//!   line is read when the request of the previous line has ended.
//! - [`verbs`] parses a line, and [`completion`] completes the word before the cursor.
//! - [`requests`] numbers the user's requests, so that the user can refer to them.
//!
//! Messages are printed above the line that is being edited.

mod completion;
mod input;
mod requests;
mod verbs;

use std::future::Future;
use std::sync::{Arc, PoisonError, RwLock};
use std::time::Duration;

use acl::AgentId;
use acl::content::Snapshot;
use agent::Resource;
use keyboard::{RequestSender, Terminal, UserEvent, UserRequest};
use tokio::sync::{mpsc, watch as watch_channel};
use tokio::task::JoinHandle;

use crate::asking::{goal_numbers, questions};
use crate::cli::{ReplyArgs, WatchWords, WishArgs};
use crate::commands::client::EcosystemView;
use crate::commands::{
    act, agents, answer, domain, event_output, goal, goals, mailbox, set, state, stop, watch,
};
use crate::interruption;
use completion::CompletionWords;
use input::{InputEvent, LineSource};
use requests::PromptRequests;
use terminal::styled::Styled;
use terminal::{exit, output};
use verbs::Verb;

/// Maximum time that the prompt waits for the words of the domain before the first line. After
/// that, the user types without completion of these words.
const WORDS_WITHIN: Duration = Duration::from_secs(2);

/// Delay between a presence change and reading the words for completion again. An agent is seen
/// before its action model arrives.
const SETTLING: Duration = Duration::from_millis(300);

/// The user at a prompt, and the ecosystem that the prompt is in.
pub(crate) struct PromptSession {
    pub(crate) view: EcosystemView,
    /// The name of the prompt's keyboard agent.
    pub(crate) id: AgentId,
    pub(crate) terminal: Terminal,
    pub(crate) json: bool,
}

/// Reads and carries out lines until the input ends, the user types `quit`, or `end` completes.
/// Returns `false` if the input is not a terminal and a request failed, otherwise `true`.
pub(crate) async fn run(guest: PromptSession, end: impl Future) -> bool {
    let PromptSession { view, id, terminal, json } = guest;
    let Terminal { requests: say, events: mut hear } = terminal;
    let words = Arc::new(RwLock::new(CompletionWords::default()));
    let mut input = LineSource::open(&words, &view.name);
    let refresher = Refresher::start(&view, &words);
    if input.is_terminal {
        // Only a terminal has completion.
        refresher.first().await;
    }
    let mut prompt =
        Prompt { view, id, json, say, words, requests: PromptRequests::default(), watching: None };
    if input.is_terminal {
        prompt.print_welcome();
    }
    input.next();
    let reader_gone = interruption::reader_gone();
    tokio::pin!(end, reader_gone);
    let mut is_idle = false;
    let mut has_ended = false;
    loop {
        tokio::select! {
            _ = &mut end => break,
            () = &mut reader_gone => break,
            heard = hear.recv() => match heard {
                Some(heard) => prompt.hear(&heard),
                None => break,
            },
            typed = input.next_event(), if !is_idle && !has_ended => match typed {
                InputEvent::Line(line) => {
                    // The first request of a script needs the agents to be known; `quit` needs
                    // nothing.
                    if !input.is_terminal && line.trim() != "quit" {
                        refresher.first().await;
                    }
                    has_ended = prompt.execute_line(&line).await == PromptStep::End;
                    is_idle = true;
                    refresher.again();
                }
                InputEvent::Interrupted => {
                    output::print_note("Ctrl-D ends, `cancel N` cancels a goal or an action");
                    is_idle = true;
                }
                InputEvent::End => has_ended = true,
            },
        }
        // At a terminal the next line is read at once. In a script it is read after the request has
        // ended.
        let may_go_on = input.is_terminal || prompt.requests.are_settled();
        if may_go_on && has_ended {
            break;
        }
        if may_go_on && std::mem::take(&mut is_idle) {
            input.next();
        }
    }
    let is_terminal = input.is_terminal;
    input.close().await;
    // At a terminal the user has seen the failures, so they do not count.
    is_terminal || prompt.requests.went_well()
}

/// The action of the prompt after it has carried out a line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum PromptStep {
    Proceed,
    End,
}

struct Prompt {
    view: EcosystemView,
    id: AgentId,
    json: bool,
    say: RequestSender,
    words: Arc<RwLock<CompletionWords>>,
    requests: PromptRequests,
    watching: Option<JoinHandle<()>>,
}

impl Drop for Prompt {
    fn drop(&mut self) {
        if let Some(watching) = self.watching.take() {
            watching.abort();
        }
    }
}

impl Prompt {
    fn print_welcome(&self) {
        let Prompt { view, id, .. } = self;
        output::print_note(&format!("You are `{id}` in `{}`.", view.name));
        output::print_note(
            "Type a goal, or a verb: `help` lists them, Tab completes, Ctrl-D ends.",
        );
    }

    // === received messages ===

    fn hear(&mut self, heard: &UserEvent) {
        let number = self.requests.hear(heard);
        self.note_words(heard);
        if self.json {
            let _ = output::print_json(&event_output::object(heard), exit::DONE);
            return;
        }
        let mark = number.map(|number| format!("[{number}] ")).unwrap_or_default();
        let lines = event_output::lines(heard);
        let text: Styled =
            lines.iter().map(|line| Styled::line(&mark).and_styled(line).end()).collect();
        let _ = output::print_styled(&text, exit::DONE);
    }

    /// Updates the numbers of requests and questions that Tab can complete.
    fn note_words(&self, heard: &UserEvent) {
        let mut words = self.words.write().unwrap_or_else(PoisonError::into_inner);
        words.requests = self.requests.numbers();
        match heard {
            UserEvent::Question(open) => words.questions.push(open.question.to_string()),
            UserEvent::QuestionClosed(question, _) => {
                words.questions.retain(|open| *open != question.to_string());
            }
            _ => (),
        }
    }

    // === lines of the user ===

    async fn execute_line(&mut self, line: &str) -> PromptStep {
        match verbs::read(line) {
            Ok(Some(verb)) => self.execute_verb(verb).await,
            Ok(None) => PromptStep::Proceed,
            Err(problem) => self.decline(&problem),
        }
    }

    fn decline(&mut self, problem: &str) -> PromptStep {
        self.requests.fail();
        output::print_note(problem.trim_end());
        PromptStep::Proceed
    }

    async fn execute_verb(&mut self, verb: Verb) -> PromptStep {
        let (view, json) = (self.view.clone(), self.json);
        let shown = match verb {
            Verb::Goal(wish) if wish.dry_run => goal::print_dry_run(&view, &wish, json).await,
            Verb::Goal(wish) => {
                let wish = match wish.cancel.as_deref().map(|id| self.meant(id)) {
                    Some(Ok(meant)) => WishArgs { cancel: Some(meant), ..wish },
                    Some(Err(problem)) => return self.decline(&format!("error: {problem}")),
                    None => wish,
                };
                let said = goal::said(&view, &wish).await;
                return self.say(said).await;
            }
            Verb::Act(action) => return self.say(act::said(&action)).await,
            Verb::Set(facts) => return self.say(set::said(&facts)).await,
            Verb::Mode { mode } => return self.say(Ok(UserRequest::Mode(mode.into()))).await,
            Verb::Cancel { id } => {
                let said = match self.meant(&id) {
                    Ok(meant) => goal_numbers::conversation(&view, &meant).await,
                    Err(problem) => Err(problem),
                };
                return self.say(said.map(UserRequest::Cancel)).await;
            }
            Verb::Answer(ReplyArgs { id: None, .. }) => answer::list(&view, json).await,
            Verb::Answer(ReplyArgs { id: Some(id), text }) if text.is_empty() => {
                return self.decline(&format!("error: say what to answer: answer {id} TEXT"));
            }
            Verb::Answer(ReplyArgs { id: Some(id), text }) => {
                let said = self.answer(&id, text.join(" ")).await;
                return self.say(said).await;
            }
            Verb::Stop { names } => stop::stop(&view, &names, None, json).await,
            Verb::Release { ids } => stop::release(&view, &ids, json).await,
            Verb::Goals => goals::print_with(&view, json, &|goal| self.requests.label(goal)).await,
            Verb::Agents => agents::print(&view, json).await,
            Verb::Domain => domain::print(&view, json).await,
            Verb::State => state::print(&view, json).await,
            Verb::Mailbox(whose) => mailbox::print(&view, &whose, json).await,
            Verb::Watch(words) => return self.watch(words).await,
            Verb::Help { verb } => output::print(verbs::help(verb.as_deref()), exit::DONE),
            Verb::Quit => return PromptStep::End,
        };
        if shown != exit::with(exit::DONE) {
            self.requests.fail();
        }
        PromptStep::Proceed
    }

    /// Returns the name of the goal or action that the user meant: for a number of this prompt, the
    /// conversation; any other name as it is. A number after `#` is that of a goal of the ecosystem.
    fn meant(&self, id: &str) -> Result<String, String> {
        if let Some(conversation) = self.requests.find(id) {
            return Ok(conversation.as_str().to_owned());
        }
        match goal_numbers::number(id) {
            Some(number) if !id.starts_with('#') => Err(format!(
                "nothing was asked for as [{number}] at this prompt; goal {number} of `goals` is \
                 written #{number}"
            )),
            _ => Ok(id.to_owned()),
        }
    }

    async fn answer(&self, id: &str, text: String) -> Result<UserRequest, String> {
        let is_own = {
            let words = self.words.read().unwrap_or_else(PoisonError::into_inner);
            words.questions.iter().any(|open| open == id)
        };
        match id.parse() {
            Ok(question) if is_own => {
                let (keyboard, seal_to) = (self.id.clone(), None);
                Ok(UserRequest::Answer { keyboard, question, text, seal_to })
            }
            _ => questions::said(&self.view, id, text).await,
        }
    }

    async fn say(&mut self, said: Result<UserRequest, String>) -> PromptStep {
        let said = match said {
            Ok(said) => said,
            Err(problem) => return self.decline(&format!("error: {problem}")),
        };
        if let UserRequest::Answer { question, .. } = &said {
            let mut words = self.words.write().unwrap_or_else(PoisonError::into_inner);
            words.questions.retain(|open| *open != question.to_string());
        }
        let Ok(place) = self.say.reserve().await else { return PromptStep::End };
        self.requests.say(place.id(), &said);
        place.send(said);
        PromptStep::Proceed
    }

    async fn watch(&mut self, words: WatchWords) -> PromptStep {
        if let Some(watching) = self.watching.take() {
            watching.abort();
        }
        if words.off {
            return PromptStep::Proceed;
        }
        let (view, json) = (self.view.clone(), self.json);
        let mut conversation = None;
        if let Some(asked) = words.id.or(words.conversation) {
            let found = match self.meant(&asked) {
                Ok(meant) => goal_numbers::conversation(&view, &meant).await,
                Err(problem) => Err(problem),
            };
            match found {
                Ok(found) => conversation = Some(found.as_str().to_owned()),
                Err(problem) => return self.decline(&format!("error: {problem}")),
            }
        }
        self.watching = Some(tokio::spawn(async move {
            let EcosystemView { name: ecosystem, endpoints, keys, .. } = view;
            let listening = watch::WatchOptions { ecosystem, endpoints, keys, role: "watch" };
            let heard = watch::listen(&listening, conversation, json);
            if let Err(problem) = heard.await {
                output::print_note(&format!("error: failed to {problem}"));
            }
        }));
        PromptStep::Proceed
    }
}

/// Keeps the words for completion up to date, in a task.
struct Refresher {
    wake: mpsc::Sender<()>,
    is_read: watch_channel::Receiver<bool>,
}

impl Refresher {
    /// Starts a task that reads the words for completion, and reads them again after each presence
    /// change and each call of [`Refresher::again`].
    fn start(view: &EcosystemView, words: &Arc<RwLock<CompletionWords>>) -> Refresher {
        let (wake, mut woken) = mpsc::channel::<()>(1);
        let (read, is_read) = watch_channel::channel(false);
        let (view, words) = (view.clone(), Arc::clone(words));
        let (_, mut changes) = view.router.presence_changes();
        tokio::spawn(async move {
            read_words(&view, &words).await;
            // The receiver is gone if the prompt has ended.
            let _ = read.send(true);
            loop {
                tokio::select! {
                    _ = changes.recv() => tokio::time::sleep(SETTLING).await,
                    woken = woken.recv() => if woken.is_none() { return },
                }
                changes = changes.resubscribe();
                read_words(&view, &words).await;
            }
        });
        Refresher { wake, is_read }
    }

    /// Waits until the words for completion have been read once, up to [`WORDS_WITHIN`].
    async fn first(&self) {
        let mut is_read = self.is_read.clone();
        let _ = tokio::time::timeout(WORDS_WITHIN, is_read.wait_for(|is_read| *is_read)).await;
    }

    fn again(&self) {
        // One pending wake-up is enough for several calls.
        let _ = self.wake.try_send(());
    }
}

async fn read_words(view: &EcosystemView, words: &RwLock<CompletionWords>) {
    let maintainer = Some(view.roles().domain_maintainer.clone());
    let answers = view.ask(Resource::Domain, maintainer).await;
    let snapshot = answers.first().and_then(|bytes| serde_json::from_slice::<Snapshot>(bytes).ok());
    let goals = view.ecosystem.iter().flat_map(|ecosystem| ecosystem.goals.keys());
    let goals = goals.cloned().collect();
    let directory = view.router.directory();
    let agents = directory.iter().map(|resident| resident.agent.to_string()).collect();
    let mut words = words.write().unwrap_or_else(PoisonError::into_inner);
    words.renew(snapshot.as_ref(), goals, agents);
}
