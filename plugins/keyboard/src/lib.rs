//! The Keyboard Agent (the paper, “User Interface”): a person's voice and ear in the ecosystem.
//!
//! - Forwards goals to the Plan Requester and passes back what becomes of them.
//! - Cancels a goal, also one that another keyboard asked for.
//! - Answers a `query-ref` with `refuse`: asking a person is not built yet, and it says so.
//!
//! Whoever holds the [`Terminal`] decides what is shown.

use acl::content::{Achieve, Keep, Outcome, Reason, Refusal, Report, Request, value};
use acl::{AgentId, ConversationId, Message, Performative, Protocol, ReplyToken};
use agent::{
    Agent, Answer, Blueprint, BuildError, Callbacks, Context, Engagement, Launch, Opening,
    PluginEntry, Work,
};
use serde::Deserialize;
use tokio::sync::mpsc;

/// Wishes and news that may wait for the other side of the terminal.
const TERMINAL_MAX: usize = 1_024;

/// How long a goal may go without any word. A maintained goal may hold for a year.
const PATIENCE: std::time::Duration = std::time::Duration::from_secs(365 * 24 * 3_600);

/// The line in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "keyboard",
    about: "asks for goals on behalf of a person, and tells what becomes of them",
    drivers: &[],
    build,
};

/// The entry's `config`.
#[derive(Debug, Default, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields, default)]
struct Config {
    /// Goals to ask for on activation.
    goals: Vec<Wish>,
}

/// What a person wants.
#[derive(Clone, Debug, Deserialize)]
#[serde(rename_all = "kebab-case", deny_unknown_fields)]
pub struct Wish {
    /// A PDDL condition.
    pub goal: String,
    /// Reach it once, or keep it.
    #[serde(default)]
    pub keep: Keep,
    /// Greater goes first.
    #[serde(default)]
    pub priority: i32,
}

/// What a person says.
#[derive(Clone, Debug)]
pub enum Said {
    /// I want this.
    Wish(Wish),
    /// Give this up.
    Cancel(ConversationId),
}

/// What a person hears.
#[derive(Clone, Debug)]
pub enum Heard {
    /// A goal was asked for; this is its conversation.
    Asked(ConversationId),
    /// How a goal stands.
    Report(ConversationId, Report),
    /// It was declined.
    Refused(ConversationId, Refusal),
    /// Nobody took it.
    Unanswered(ConversationId, String),
}

/// The person's side of a keyboard.
pub struct Terminal {
    /// What the person says.
    pub say: mpsc::Sender<Said>,
    /// What the person hears.
    pub hear: mpsc::Receiver<Heard>,
}

/// The agent.
pub struct Keyboard {
    plan_requester: AgentId,
    wishes: Vec<Wish>,
    said: Option<mpsc::Receiver<Said>>,
    listening: Option<Work>,
    heard: Option<mpsc::Sender<Heard>>,
}

fn build(blueprint: Blueprint) -> Result<Box<dyn Launch>, BuildError> {
    let Config { goals } = blueprint.config_as()?;
    Ok(Box::new(Keyboard { wishes: goals, ..Keyboard::deaf() }))
}

impl Keyboard {
    /// A keyboard and its terminal.
    pub fn with_terminal() -> (Keyboard, Terminal) {
        let (say, said) = mpsc::channel(TERMINAL_MAX);
        let (heard, hear) = mpsc::channel(TERMINAL_MAX);
        let keyboard = Keyboard { said: Some(said), heard: Some(heard), ..Keyboard::deaf() };
        (keyboard, Terminal { say, hear })
    }

    fn deaf() -> Keyboard {
        let plan_requester =
            AgentId::new("plan-requester").expect("invariant: a literal that is a name");
        Keyboard { plan_requester, wishes: Vec::new(), said: None, listening: None, heard: None }
    }
}

impl Agent for Keyboard {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
            .on(Performative::QueryRef, Self::queried)
            .on_broadcast(Performative::QueryRef, Self::queried)
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        for wish in std::mem::take(&mut self.wishes) {
            self.ask(wish, ctx);
        }
        self.listen(ctx);
    }
}

impl Keyboard {
    /// Waits for the next thing the person says.
    fn listen(&mut self, ctx: &mut Context<Self>) {
        let Some(mut said) = self.said.take() else { return };
        let next = async move {
            let next = said.recv().await;
            (next, said)
        };
        self.listening = Some(ctx.run(next, |keyboard: &mut Self, (next, said), ctx| {
            // Nobody holds the terminal any more: there is nobody to listen to.
            let Some(next) = next else { return };
            match next {
                Said::Wish(wish) => keyboard.ask(wish, ctx),
                Said::Cancel(conversation) => keyboard.cancel(conversation, ctx),
            }
            keyboard.said = Some(said);
            keyboard.listen(ctx);
        }));
    }

    fn ask(&mut self, wish: Wish, ctx: &mut Context<Self>) {
        let Wish { goal, keep, priority } = wish;
        let conversation = ctx.new_conversation();
        let content = value(&Request::Achieve(Achieve { goal, keep, priority }));
        self.open(Performative::Request, conversation.clone(), content, ctx);
        self.pass(Heard::Asked(conversation));
    }

    fn cancel(&mut self, conversation: ConversationId, ctx: &mut Context<Self>) {
        self.open(Performative::Cancel, conversation, serde_json::Value::Null, ctx);
    }

    fn open(
        &mut self,
        performative: Performative,
        conversation: ConversationId,
        content: serde_json::Value,
        ctx: &mut Context<Self>,
    ) -> ReplyToken {
        let opening = Opening {
            to: Some(self.plan_requester.clone()),
            performative,
            protocol: Protocol::Goal,
            conversation: conversation.clone(),
            content,
        };
        ctx.open(opening, PATIENCE, move |keyboard: &mut Self, answer, ctx| {
            keyboard.answered(&conversation, answer, ctx);
        })
    }

    fn answered(&mut self, about: &ConversationId, answer: Answer, ctx: &mut Context<Self>) {
        let about = about.clone();
        let heard = match answer {
            Answer::Message(message) => match read(&message) {
                Ok(heard) => heard,
                Err(error) => return ctx.not_understood(&message, error),
            },
            Answer::Silence => {
                Heard::Unanswered(about, "the Plan Requester said nothing for a year".to_owned())
            }
            Answer::Undelivered(why) => {
                Heard::Unanswered(about, format!("the Plan Requester could not be reached: {why}"))
            }
        };
        self.pass(heard);
    }

    fn pass(&mut self, heard: Heard) {
        match &heard {
            Heard::Asked(goal) => tracing::info!(conversation = %goal, "asked"),
            Heard::Report(goal, report) => {
                tracing::info!(conversation = %goal, outcome = %report.outcome, "{}", report.detail);
            }
            Heard::Refused(goal, refusal) => {
                tracing::warn!(conversation = %goal, "refused: {}", refusal.detail);
            }
            Heard::Unanswered(goal, why) => tracing::warn!(conversation = %goal, "{why}"),
        }
        if let Some(to) = &self.heard
            && to.try_send(heard).is_err()
        {
            tracing::warn!("the terminal does not keep up: a line is lost");
        }
    }

    fn queried(&mut self, message: Message, ctx: &mut Context<Self>) {
        let detail = "asking a person is not built yet";
        ctx.refuse(&Engagement::of(&message), Reason::NotBuilt, detail);
    }
}

/// What an answer of the Plan Requester says.
fn read(message: &Message) -> Result<Heard, String> {
    let about = message.conversation_id.clone();
    match message.performative {
        Performative::Confirm => {
            let report = message.content_as::<Report>().map_err(|error| error.to_string())?;
            Ok(Heard::Report(about, report))
        }
        _ => {
            let refusal = message.content_as::<Refusal>().map_err(|error| error.to_string())?;
            Ok(Heard::Refused(about, refusal))
        }
    }
}

impl Heard {
    /// Whether nothing more will be heard about its conversation.
    pub fn is_final(&self) -> bool {
        match self {
            Heard::Asked(_) => false,
            Heard::Report(_, report) => report.outcome.is_final(),
            Heard::Refused(..) | Heard::Unanswered(..) => true,
        }
    }

    /// Whether it is the good end of a goal, or the goal holds.
    pub fn is_success(&self) -> bool {
        matches!(self, Heard::Report(_, Report { outcome: Outcome::Done | Outcome::Holds, .. }))
    }
}
