//! People that request goals, and the reports that they receive.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{Keep, Outcome};
use acl::{ConversationId, Message};
use keyboard::{RequestId, Terminal, UserEvent, UserRequest};
use tokio::time::Instant;

use crate::script::ScriptedGoal;

/// A person at a terminal, with a record of all reports.
pub struct Person {
    /// Name of the person and of the keyboard.
    pub name: String,
    terminal: Option<Terminal>,
    /// Goals requested at this terminal that have no conversation yet, by their numbers there.
    without_conversation: BTreeMap<RequestId, usize>,
    /// History of each goal, by its number.
    pub traces: BTreeMap<usize, GoalTrace>,
    since: Instant,
    /// Answers to messages that the person wrote, as they were received.
    answers: Vec<Message>,
}

/// History of a goal, from the reports that its person has received.
#[derive(Clone, Debug)]
pub struct GoalTrace {
    /// The request for the goal.
    pub wish: ScriptedGoal,
    /// Conversation of the goal, once it is known.
    pub conversation: Option<ConversationId>,
    /// Reports received, with their times.
    pub received: Vec<(Duration, String)>,
    /// Number of reports received.
    pub reports: usize,
    /// Whether a report said that Journals have the goal.
    pub is_accepted: bool,
    /// Whether a report of a failure had no reason.
    pub has_no_reason: bool,
    /// The outcome of the goal; `None` before the end. A kept goal has ended when it holds.
    pub final_outcome: Option<Outcome>,
    /// Whether the terminal that requested the goal still runs.
    pub is_listening: bool,
}

// === impl Person ===

impl Person {
    /// Creates a person without a terminal.
    pub fn new(name: &str, since: Instant) -> Person {
        let name = name.to_owned();
        let (unnamed, stories) = (BTreeMap::new(), BTreeMap::new());
        Person {
            name,
            terminal: None,
            without_conversation: unnamed,
            traces: stories,
            since,
            answers: Vec::new(),
        }
    }

    /// Gives the person a terminal.
    pub fn give_terminal(&mut self, terminal: Terminal) {
        self.terminal = Some(terminal);
    }

    /// Takes the terminal away, because its process died.
    pub fn remove_terminal(&mut self) {
        self.read_reports();
        self.terminal = None;
        self.without_conversation.clear();
        self.traces.values_mut().for_each(|story| story.is_listening = false);
    }

    /// Requests a goal. Returns `false` if the person has no terminal, or if the terminal does not
    /// take the request.
    pub fn request_goal(&mut self, number: usize, wish: &ScriptedGoal) -> bool {
        let Some(terminal) = &self.terminal else { return false };
        let said = keyboard::GoalRequest {
            goal: wish.goal.clone(),
            keep: wish.keep,
            priority: 0,
            partition: wish.partition,
        };
        let Ok(id) = terminal.requests.try_send(UserRequest::RequestGoal(said)) else {
            return false;
        };
        let story = GoalTrace {
            wish: wish.clone(),
            conversation: None,
            received: Vec::new(),
            reports: 0,
            is_accepted: false,
            has_no_reason: false,
            final_outcome: None,
            is_listening: true,
        };
        self.without_conversation.insert(id, number);
        self.traces.insert(number, story);
        true
    }

    /// Writes a message. Nothing is sent if the person has no terminal.
    pub fn send(&self, said: UserRequest) {
        if let Some(terminal) = &self.terminal {
            // A full queue is as good as a terminal that is away: the request does not arrive.
            let _ = terminal.requests.try_send(said);
        }
    }

    /// Returns the answers to written messages since the last call.
    pub fn take_answers(&mut self) -> Vec<Message> {
        std::mem::take(&mut self.answers)
    }

    /// Reads the reports that have arrived.
    pub fn read_reports(&mut self) {
        let at = self.since.elapsed();
        let Some(terminal) = &mut self.terminal else { return };
        while let Ok(heard) = terminal.events.try_recv() {
            let asked = heard.request().and_then(|id| self.without_conversation.remove(&id));
            if let Some(story) = asked.and_then(|number| self.traces.get_mut(&number)) {
                story.conversation = heard.conversation().cloned();
            }
            let heard = match heard {
                UserEvent::Sent(_) => continue,
                UserEvent::Answered(_, message) => {
                    self.answers.push(*message);
                    continue;
                }
                other => other,
            };
            let about = heard.conversation().cloned();
            let is_it = |story: &&mut GoalTrace| story.conversation == about;
            if let Some(story) = self.traces.values_mut().find(is_it) {
                story.add_report(at, &heard);
            }
        }
    }
}

// === impl GoalTrace ===

impl GoalTrace {
    fn add_report(&mut self, at: Duration, heard: &UserEvent) {
        let line = match heard {
            UserEvent::Report(_, report) => format!("{}: {}", report.outcome, report.detail),
            UserEvent::Refused(_, refusal) => format!("refused: {}", refusal.detail),
            UserEvent::Unanswered(_, why) => format!("unanswered: {why}"),
            other => format!("{other:?}"),
        };
        self.is_accepted |= line.contains("accepted; kept by");
        let why = match heard {
            UserEvent::Report(_, report) if report.outcome.is_final() => Some(&report.detail),
            UserEvent::Refused(_, refusal) => Some(&refusal.detail),
            UserEvent::Unanswered(_, why) => Some(why),
            _ => None,
        };
        self.has_no_reason |= why.is_some_and(|why| why.trim().is_empty());
        self.received.push((at, line));
        match heard {
            UserEvent::Report(_, report) => {
                self.reports += 1;
                if report.outcome.is_final() || report.outcome == Outcome::Holds {
                    self.final_outcome = Some(report.outcome);
                }
            }
            UserEvent::Refused(..) | UserEvent::Unanswered(..) => {
                self.final_outcome = Some(Outcome::Failed)
            }
            _ => (),
        }
    }

    /// Whether the person waits for no further report.
    pub fn is_settled(&self) -> bool {
        match self.wish.keep {
            Keep::Achieve => self.final_outcome.is_some_and(Outcome::is_final),
            Keep::Maintain => self.final_outcome.is_some(),
        }
    }
}
