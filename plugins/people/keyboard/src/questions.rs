//! Open questions to a person. Each question has a number and a deadline.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::OpenQuestion;
use acl::{AgentId, Millis, ReplyToken};
use agent::{Participation, TimerId};
use tokio::time::Instant;

/// Maximum number of open questions; further questions are refused. A person can answer only a few.
const QUESTIONS_MAX: usize = 64;

/// The open questions that one keyboard keeps.
#[derive(Debug, Default)]
pub(crate) struct Questions {
    open: BTreeMap<u64, PendingQuestion>,
    last_number: u64,
}

/// A question that waits for a person's answer.
#[derive(Debug)]
pub(crate) struct PendingQuestion {
    /// Exchange in which the asking agent put the question, and to which the answer is sent.
    pub(crate) participation: Participation,
    /// Text of the question.
    pub(crate) text: String,
    /// Key for encrypting the answer; `None` if the answer is sent as plain text.
    pub(crate) seal_to: Option<String>,
    /// Total time for which the question stays open, from its arrival on.
    pub(crate) patience: Duration,
    /// Timer that closes the question at the end of its time.
    pub(crate) timer: TimerId,
    until: Instant,
}

impl Questions {
    /// Returns the number of the next question; `None` if the maximum number of questions is open.
    pub(crate) fn next_number(&self) -> Option<u64> {
        (self.open.len() < QUESTIONS_MAX).then_some(self.last_number + 1)
    }

    /// Stores a question under the number from [`Questions::next_number`], and returns that number.
    pub(crate) fn store(
        &mut self,
        participation: Participation,
        asked: acl::content::Question,
        patience: Duration,
        timer: TimerId,
        now: Instant,
    ) -> u64 {
        self.last_number += 1;
        let until = now + patience;
        let acl::content::Question { text, seal_to } = asked;
        let question = PendingQuestion { participation, text, seal_to, patience, timer, until };
        self.open.insert(self.last_number, question);
        self.last_number
    }

    /// Returns the key for encrypting the answer to a question; `None` if there is no such question
    /// or key.
    pub(crate) fn seal_to(&self, number: u64) -> Option<&str> {
        self.open.get(&number)?.seal_to.as_deref()
    }

    /// Removes and returns the question `number`, because it is answered or has expired; `None` if
    /// it is not open.
    pub(crate) fn take(&mut self, number: u64) -> Option<PendingQuestion> {
        self.open.remove(&number)
    }

    /// Removes and returns the question that `asker` put in this exchange, with its number; `None`
    /// if there is none.
    pub(crate) fn take_by_exchange(
        &mut self,
        asker: &AgentId,
        exchange: &ReplyToken,
    ) -> Option<(u64, PendingQuestion)> {
        let is_it = |question: &PendingQuestion| {
            question.participation.initiator == *asker
                && question.participation.exchange == *exchange
        };
        let (number, _) = self.open.iter().find(|(_, question)| is_it(question))?;
        let number = *number;
        self.take(number).map(|question| (number, question))
    }

    /// Removes and returns the oldest open question, with its number; `None` if no question is
    /// open.
    pub(crate) fn take_first(&mut self) -> Option<(u64, PendingQuestion)> {
        self.open.pop_first()
    }

    /// Returns the numbers of the open questions, as text for a person.
    pub(crate) fn numbers(&self) -> String {
        let numbers: Vec<_> = self.open.keys().map(ToString::to_string).collect();
        if numbers.is_empty() { "none is open".to_owned() } else { numbers.join(", ") }
    }

    /// Returns all open questions, in the form in which they are sent to other agents.
    pub(crate) fn list(&self, keyboard: &AgentId, now: Instant) -> Vec<OpenQuestion> {
        let open = self.open.iter();
        open.map(|(number, question)| question.to_content(keyboard, *number, now)).collect()
    }

    /// Returns one open question, in the form in which it is sent to other agents; `None` if it is
    /// not open.
    pub(crate) fn find(
        &self,
        keyboard: &AgentId,
        number: u64,
        now: Instant,
    ) -> Option<OpenQuestion> {
        self.open.get(&number).map(|question| question.to_content(keyboard, number, now))
    }
}

impl PendingQuestion {
    fn to_content(&self, keyboard: &AgentId, number: u64, now: Instant) -> OpenQuestion {
        OpenQuestion {
            keyboard: keyboard.clone(),
            question: number,
            from: self.participation.initiator.clone(),
            text: self.text.clone(),
            seal_to: self.seal_to.clone(),
            remaining: Millis(self.until.saturating_duration_since(now)),
        }
    }
}
