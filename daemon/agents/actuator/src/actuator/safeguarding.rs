//! Safeguards of an actuator: people are asked before an action begins, and an action that has
//! begun too often is refused for a while.

use std::time::Duration;

use acl::Millis;
use acl::content::{Question, Reason, Refusal};
use agent::Context;
use substrate::BoxFuture;
use tokio::sync::oneshot;
use tokio::time::Instant;

use super::{Actuator, on_disk};
use crate::device::{Description, MethodCall, MethodFailure};
use crate::initiative::InitiativeUpdate;

/// Name of the question whether an action may begin. No device uses it: names of devices have no
/// space.
const QUESTION: &str = "may begin";

/// Answers that allow an action, in lower case. Every other answer forbids it.
const CONSENT: [&str; 2] = ["yes", "y"];

/// Returns the name of the action of a step.
fn action_name(step: &str) -> String {
    let step = pddl::parse_step(step).into_result().ok();
    step.map(|step| step.action.as_str().to_owned()).unwrap_or_default()
}

impl Actuator {
    /// Adds the time for asking people to the time limits of the methods that they have to allow. An
    /// action that has begun too often stays offered, so that its refusal tells the reason.
    pub(super) fn add_patience(&self, offer: &mut Description) {
        for (action, method) in &mut offer.methods {
            let patience = self.safeguarded.asks_people(action).unwrap_or_default();
            method.timeout = Millis(method.timeout.0 + patience);
        }
    }

    /// Returns the time limit of the method itself: `announced` without the time for asking people.
    pub(super) fn without_patience(&self, call: &MethodCall, announced: Duration) -> Duration {
        let patience = self.safeguarded.asks_people(&action_name(&call.action)).unwrap_or_default();
        announced.saturating_sub(patience)
    }

    /// Whether people have to allow the action that a call carries out, and were asked about another
    /// one: the `requested` action.
    pub(super) fn needs_other_leave(&self, call: &MethodCall, requested: &str) -> bool {
        let name = action_name(&call.action);
        name != action_name(requested) && self.safeguarded.asks_people(&name).is_some()
    }

    /// Returns a refusal if an action has begun too often.
    pub(super) fn rate_objection(&self, action: &str) -> Option<Refusal> {
        let step = pddl::parse_step(action).into_result().ok()?;
        let why = self.safeguarded.objection(step.action.as_str(), Instant::now())?;
        Some(Refusal::new(Reason::Incapable, why))
    }

    /// Counts that an action begins. Returns a future that ends when this is on disk; the method may
    /// run only after that. Called when people have allowed the action, because an action that they
    /// forbid has not begun.
    pub(super) fn count_beginning(
        &mut self,
        call: &MethodCall,
        ctx: &Context<Self>,
    ) -> BoxFuture<Result<(), MethodFailure>> {
        match self.safeguarded.begins(&action_name(&call.action), ctx.wall_clock(), ctx.now()) {
            Some(record) => on_disk("how often it has begun", record, ctx),
            None => Box::pin(std::future::ready(Ok(()))),
        }
    }

    /// If people have to allow an action, asks them, and returns a future that ends with their answer.
    pub(super) fn ask_leave(
        &mut self,
        action: &str,
        ctx: &mut Context<Self>,
    ) -> BoxFuture<Result<(), MethodFailure>> {
        let Some(patience) = self.safeguarded.asks_people(&action_name(action)) else {
            return Box::pin(std::future::ready(Ok(())));
        };
        let text = format!("`{}` is about to do {action}. May it? yes, no", ctx.id());
        let (answer, answered) = oneshot::channel();
        self.consent = Some(answer);
        self.ask_people(QUESTION.to_owned(), &Question::new(text), patience, ctx);
        Box::pin(async move {
            // The actuator drops the sender if it gives the action up.
            answered.await.unwrap_or(Err(MethodFailure::GivenUp))
        })
    }

    /// Passes an answer to the action that waits for consent. Returns `false` if the news is about
    /// something else.
    pub(super) fn receive_consent(&mut self, name: &str, news: &InitiativeUpdate) -> bool {
        if name != QUESTION {
            return false;
        }
        let consent = match news {
            InitiativeUpdate::Answer(answer) => {
                match CONSENT.contains(&answer.trim().to_lowercase().as_str()) {
                    true => Ok(()),
                    false => Err(MethodFailure::Forbidden("get leave: a person said no".into())),
                }
            }
            InitiativeUpdate::Unanswered(why) => {
                Err(MethodFailure::Unanswered(format!("get leave from a person: {why}")))
            }
            InitiativeUpdate::Refused(refusal) => {
                let why = &refusal.detail;
                Err(MethodFailure::Unanswered(format!("ask a person for leave: {why}")))
            }
            InitiativeUpdate::Report(_) => return true,
        };
        if let Some(waiting) = self.consent.take() {
            // An action that was given up meanwhile needs no answer.
            drop(waiting.send(consent));
        }
        true
    }

    /// Withdraws the question whether the action may begin, because the action is given up. Returns
    /// whether the action waited for consent, and so has not begun.
    pub(super) fn withdraw_consent(&mut self, ctx: &mut Context<Self>) -> bool {
        let waited = self.consent.take().is_some();
        if waited {
            self.withdraw_question(QUESTION, "the action was given up".to_owned(), ctx);
        }
        waited
    }
}
