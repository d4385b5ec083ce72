//! Initiatives of a device: goals that the device requests and questions that it asks people, both
//! by itself. News about goals and questions is passed back to the device.

use std::time::Duration;

use acl::content::{Achieve, Outcome, Question, Refusal, Report};

/// An event of a device: a function that changes the device, and returns the requests to other
/// agents that the device makes because of the event.
pub type DeviceEvent<D> = Box<dyn FnOnce(&mut D) -> Vec<Initiative> + Send>;

/// Initiative of a device: a request for a goal, a question to people, or the withdrawal of either.
/// The device chooses the names, which identify its goals and its questions.
#[derive(Clone, Debug, PartialEq)]
pub enum Initiative {
    /// Requests a goal from the Plan Requester. If the device requests the same goal under the same
    /// name again, nothing happens; another goal under this name replaces the former one.
    RequestGoal {
        /// Name of the goal, chosen by the device.
        name: String,
        /// The goal that is requested.
        goal: Achieve,
        /// Whether the goal is requested again after a failure, at growing intervals, until it is
        /// withdrawn.
        insists: bool,
    },
    /// Withdraws the goal and the question of this name, if there are any. No more news
    /// about either follows.
    Withdraw {
        /// Name under which the goal was requested or the question was asked.
        name: String,
    },
    /// Asks people at all keyboards a question, and takes the first answer. The answer may be a
    /// secret, and is encrypted on its way to the device. A later question under the same name
    /// replaces the question.
    AskPeople {
        /// Name of the question, chosen by the device.
        name: String,
        /// The question that people are asked.
        question: Question,
        /// How long to wait for an answer to the question.
        patience: Duration,
    },
}

/// News about a goal or a question that a device requested, passed to the device.
#[derive(Clone, Debug, PartialEq)]
pub enum InitiativeUpdate {
    /// A report about the requested goal: progress or outcome.
    Report(Report),
    /// The Plan Requester refused the goal.
    Refused(Refusal),
    /// The text with which a person answered the question.
    Answer(String),
    /// No agent took the goal, or no person answered the question in time. The text is the reason.
    Unanswered(String),
}

impl InitiativeUpdate {
    /// Whether no more news about the goal or question follows, so that its name is free again.
    pub fn is_final(&self) -> bool {
        match self {
            InitiativeUpdate::Report(report) => report.outcome.is_final(),
            InitiativeUpdate::Refused(_)
            | InitiativeUpdate::Answer(_)
            | InitiativeUpdate::Unanswered(_) => true,
        }
    }

    /// Whether the goal failed, was refused, or was not taken by any agent. A cancelled goal has
    /// not failed.
    pub(crate) fn has_failed(&self) -> bool {
        match self {
            InitiativeUpdate::Report(report) => report.outcome == Outcome::Failed,
            InitiativeUpdate::Refused(_) | InitiativeUpdate::Unanswered(_) => true,
            InitiativeUpdate::Answer(_) => false,
        }
    }

    pub(crate) fn holds(&self) -> bool {
        matches!(self, InitiativeUpdate::Report(report) if report.outcome == Outcome::Holds)
    }
}
