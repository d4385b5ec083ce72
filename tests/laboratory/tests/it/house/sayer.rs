//! Agent that sends one request and passes on the answers.

use std::time::Duration;

use acl::content::{Achieve, Keep, Partition, Report, Request, value};
use acl::{AgentId, ConversationId, Performative, Protocol};
use agent::{Agent, Callbacks, Context, ExchangeEvent, ExchangeOpening};
use tokio::sync::mpsc;

use crate::house::name;

/// Time limit of every step.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

/// Time limit of the whole exchange.
const EXCHANGE_PATIENCE: Duration = Duration::from_secs(600);

/// Sends one request and passes on the answers.
pub(crate) struct Sayer {
    pub(crate) to: AgentId,
    pub(crate) protocol: Protocol,
    pub(crate) conversation: &'static str,
    pub(crate) says: Request,
    pub(crate) told: mpsc::UnboundedSender<Report>,
}

// === impl Sayer ===

impl Sayer {
    /// Creates an agent that requests a goal of the Plan Requester in the conversation `g`; returns
    /// it with the channel of its reports.
    pub(crate) fn of_goal(goal: &str, keep: Keep) -> (Sayer, mpsc::UnboundedReceiver<Report>) {
        let (goal, partition) = (goal.to_owned(), Partition::Pursue);
        let (told, heard) = mpsc::unbounded_channel();
        let sayer = Sayer {
            to: name("plan-requester"),
            protocol: Protocol::Goal,
            conversation: "g",
            says: Request::Achieve(Achieve { goal, keep, priority: 0, partition }),
            told,
        };
        (sayer, heard)
    }
}

impl Agent for Sayer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = ExchangeOpening {
            to: Some(self.to.clone()),
            performative: Performative::Request,
            protocol: self.protocol,
            conversation: ConversationId::new(self.conversation),
            content: value(&self.says),
        };
        ctx.open(opening, EXCHANGE_PATIENCE, |sayer: &mut Sayer, answer, _| {
            if let ExchangeEvent::Message(message) = answer
                && let Ok(report) = message.content_as::<Report>()
            {
                sayer.told.send(report).expect("the test listens");
            }
        });
    }
}
