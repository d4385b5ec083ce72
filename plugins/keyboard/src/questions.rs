//! Questions to a person that are open: numbered, each with its deadline.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::OpenQuestion;
use acl::{AgentId, Deadline, ReplyToken};
use agent::{Engagement, TimerId};
use tokio::time::Instant;

/// Questions kept at a time; a person answers a few, and what comes beyond is refused.
const QUESTIONS_MAX: usize = 64;

/// The open questions of one keyboard.
#[derive(Debug, Default)]
pub(crate) struct Questions {
    open: BTreeMap<u64, Question>,
    asked: u64,
}

/// One question.
#[derive(Debug)]
pub(crate) struct Question {
    /// To whom the answer goes.
    pub(crate) engagement: Engagement,
    /// What is asked.
    pub(crate) text: String,
    /// The key that the answer is sealed to.
    pub(crate) seal_to: Option<String>,
    /// How long its answer was to be waited for.
    pub(crate) patience: Duration,
    /// Ends it.
    pub(crate) timer: TimerId,
    until: Instant,
}

impl Questions {
    /// The number of the next question, if there is room for it.
    pub(crate) fn next_number(&self) -> Option<u64> {
        (self.open.len() < QUESTIONS_MAX).then_some(self.asked + 1)
    }

    /// Keeps a question under [`Questions::next_number`].
    pub(crate) fn keep(
        &mut self,
        engagement: Engagement,
        asked: acl::content::Question,
        patience: Duration,
        timer: TimerId,
        now: Instant,
    ) -> u64 {
        self.asked += 1;
        let until = now + patience;
        let acl::content::Question { text, seal_to } = asked;
        let question = Question { engagement, text, seal_to, patience, timer, until };
        self.open.insert(self.asked, question);
        self.asked
    }

    /// The key that the answer to a question is sealed to.
    pub(crate) fn seal_to(&self, number: u64) -> Option<&str> {
        self.open.get(&number)?.seal_to.as_deref()
    }

    /// Takes a question out: it is answered, or its time is over.
    pub(crate) fn take(&mut self, number: u64) -> Option<Question> {
        self.open.remove(&number)
    }

    /// Takes out the question that `asker` put in this exchange.
    pub(crate) fn take_of(
        &mut self,
        asker: &AgentId,
        exchange: &ReplyToken,
    ) -> Option<(u64, Question)> {
        let is_it = |question: &Question| {
            question.engagement.initiator == *asker && question.engagement.exchange == *exchange
        };
        let (number, _) = self.open.iter().find(|(_, question)| is_it(question))?;
        let number = *number;
        self.take(number).map(|question| (number, question))
    }

    /// Takes any question out.
    pub(crate) fn take_first(&mut self) -> Option<(u64, Question)> {
        self.open.pop_first()
    }

    /// The numbers of the open questions, for a person.
    pub(crate) fn numbers(&self) -> String {
        let numbers: Vec<_> = self.open.keys().map(ToString::to_string).collect();
        if numbers.is_empty() { "none is open".to_owned() } else { numbers.join(", ") }
    }

    /// All of them, as `keyboard` tells others.
    pub(crate) fn list(&self, keyboard: &AgentId, now: Instant) -> Vec<OpenQuestion> {
        let open = self.open.iter();
        open.map(|(number, question)| question.told(keyboard, *number, now)).collect()
    }

    /// One of them, as `keyboard` tells others.
    pub(crate) fn find(
        &self,
        keyboard: &AgentId,
        number: u64,
        now: Instant,
    ) -> Option<OpenQuestion> {
        self.open.get(&number).map(|question| question.told(keyboard, number, now))
    }
}

impl Question {
    fn told(&self, keyboard: &AgentId, number: u64, now: Instant) -> OpenQuestion {
        OpenQuestion {
            keyboard: keyboard.clone(),
            question: number,
            from: self.engagement.initiator.clone(),
            text: self.text.clone(),
            seal_to: self.seal_to.clone(),
            left: Deadline(self.until.saturating_duration_since(now)),
        }
    }
}
