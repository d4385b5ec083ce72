//! Who says one thing to an agent, and tells what is answered.

use std::time::Duration;

use acl::content::{Report, Request, value};
use acl::{AgentId, ConversationId, Performative, Protocol};
use agent::{Agent, Answer, Callbacks, Context, Opening};
use tokio::sync::mpsc;

/// How long anything may take.
pub(crate) const PATIENCE: Duration = Duration::from_secs(30);

/// Says something once, and tells what is answered.
pub(crate) struct Sayer {
    pub(crate) to: AgentId,
    pub(crate) protocol: Protocol,
    pub(crate) conversation: &'static str,
    pub(crate) says: Request,
    pub(crate) told: mpsc::UnboundedSender<Report>,
}

impl Agent for Sayer {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        let opening = Opening {
            to: Some(self.to.clone()),
            performative: Performative::Request,
            protocol: self.protocol,
            conversation: ConversationId::new(self.conversation),
            content: value(&self.says),
        };
        ctx.open(opening, PATIENCE, |sayer: &mut Sayer, answer, _| {
            if let Answer::Message(message) = answer
                && let Ok(report) = message.content_as::<Report>()
            {
                sayer.told.send(report).expect("the test listens");
            }
        });
    }
}
