//! People that request goals, and the reports that they receive.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::ConversationId;
use acl::content::{Keep, Outcome};
use keyboard::{Heard, Said, Terminal};
use tokio::time::Instant;

use crate::script::Wish;

/// A person at a terminal, with a record of all reports.
pub struct Person {
    /// Name of the person and of the keyboard.
    pub name: String,
    terminal: Option<Terminal>,
    /// Goals requested at this terminal that have no conversation yet.
    unnamed: Vec<(usize, Wish)>,
    /// History of each goal, by its number.
    pub stories: BTreeMap<usize, Story>,
    since: Instant,
}

/// History of a goal, as its person knows it.
#[derive(Clone, Debug)]
pub struct Story {
    /// The request.
    pub wish: Wish,
    /// Conversation of the goal, once it is known.
    pub conversation: Option<ConversationId>,
    /// Reports received, with their times.
    pub heard: Vec<(Duration, String)>,
    /// Number of reports received.
    pub reports: usize,
    /// Whether a report said that Journals have the goal.
    pub is_accepted: bool,
    /// Whether a report of a failure had no reason.
    pub has_no_reason: bool,
    /// The outcome, if it has ended. A kept goal has ended when it holds.
    pub end: Option<Outcome>,
    /// Whether the terminal that requested the goal still runs.
    pub is_listening: bool,
}

// === impl Person ===

impl Person {
    /// Creates a person without a terminal.
    pub fn new(name: &str, since: Instant) -> Person {
        let name = name.to_owned();
        let (unnamed, stories) = (Vec::new(), BTreeMap::new());
        Person { name, terminal: None, unnamed, stories, since }
    }

    /// Gives the person a terminal.
    pub fn sit(&mut self, terminal: Terminal) {
        self.terminal = Some(terminal);
    }

    /// Takes the terminal away, because its process died.
    pub fn lose(&mut self) {
        self.hear();
        self.terminal = None;
        self.unnamed.clear();
        self.stories.values_mut().for_each(|story| story.is_listening = false);
    }

    /// Requests a goal; returns whether there was a keyboard to take it.
    pub fn wish(&mut self, number: usize, wish: &Wish) -> bool {
        let Some(terminal) = &self.terminal else { return false };
        let said = keyboard::Wish {
            goal: wish.goal.clone(),
            keep: wish.keep,
            priority: 0,
            partition: wish.partition,
        };
        if terminal.say.try_send(Said::Wish(said)).is_err() {
            return false;
        }
        let story = Story {
            wish: wish.clone(),
            conversation: None,
            heard: Vec::new(),
            reports: 0,
            is_accepted: false,
            has_no_reason: false,
            end: None,
            is_listening: true,
        };
        self.unnamed.push((number, wish.clone()));
        self.stories.insert(number, story);
        true
    }

    /// Reads the reports that have arrived.
    pub fn hear(&mut self) {
        let at = self.since.elapsed();
        let Some(terminal) = &mut self.terminal else { return };
        while let Ok(heard) = terminal.hear.try_recv() {
            if let Heard::Asked(conversation) = &heard {
                // A keyboard handles requests in order.
                if !self.unnamed.is_empty() {
                    let (number, _) = self.unnamed.remove(0);
                    if let Some(story) = self.stories.get_mut(&number) {
                        story.conversation = Some(conversation.clone());
                    }
                }
                continue;
            }
            let about = heard.conversation().cloned();
            let is_it = |story: &&mut Story| story.conversation == about;
            if let Some(story) = self.stories.values_mut().find(is_it) {
                story.hear(at, &heard);
            }
        }
    }
}

// === impl Story ===

impl Story {
    fn hear(&mut self, at: Duration, heard: &Heard) {
        let line = match heard {
            Heard::Report(_, report) => format!("{}: {}", report.outcome, report.detail),
            Heard::Refused(_, refusal) => format!("refused: {}", refusal.detail),
            Heard::Unanswered(_, why) => format!("unanswered: {why}"),
            other => format!("{other:?}"),
        };
        self.is_accepted |= line.contains("accepted; kept by");
        let why = match heard {
            Heard::Report(_, report) if report.outcome.is_final() => Some(&report.detail),
            Heard::Refused(_, refusal) => Some(&refusal.detail),
            Heard::Unanswered(_, why) => Some(why),
            _ => None,
        };
        self.has_no_reason |= why.is_some_and(|why| why.trim().is_empty());
        self.heard.push((at, line));
        match heard {
            Heard::Report(_, report) => {
                self.reports += 1;
                if report.outcome.is_final() || report.outcome == Outcome::Holds {
                    self.end = Some(report.outcome);
                }
            }
            Heard::Refused(..) | Heard::Unanswered(..) => self.end = Some(Outcome::Failed),
            _ => (),
        }
    }

    /// Whether the person waits for no further report.
    pub fn is_settled(&self) -> bool {
        match self.wish.keep {
            Keep::Achieve => self.end.is_some_and(Outcome::is_final),
            Keep::Maintain => self.end.is_some(),
        }
    }
}
