//! Who asks for goals, and what they hear.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::ConversationId;
use acl::content::{Keep, Outcome};
use keyboard::{Heard, Said, Terminal};
use tokio::time::Instant;

use crate::script::Wish;

/// A person at a terminal, who writes down what is heard.
pub struct Person {
    /// Under this name.
    pub name: String,
    terminal: Option<Terminal>,
    /// What was wished for at this terminal, whose conversation is not known yet.
    unnamed: Vec<(usize, Wish)>,
    /// What became of each wish, by its number.
    pub stories: BTreeMap<usize, Story>,
    since: Instant,
}

/// What a person knows of a goal.
#[derive(Clone, Debug)]
pub struct Story {
    /// What was wished for.
    pub wish: Wish,
    /// By which name others know it, once it was said.
    pub conversation: Option<ConversationId>,
    /// What was heard, and when.
    pub heard: Vec<(Duration, String)>,
    /// How many reports were heard.
    pub reports: usize,
    /// Whether it was said that so many Journals have it.
    pub is_accepted: bool,
    /// Whether it was ever said to come to nothing, without a word why.
    pub has_no_reason: bool,
    /// How it ended, if it has; a goal to be kept has come to its end when it holds.
    pub end: Option<Outcome>,
    /// Whether the terminal where it was asked for is still there to hear of it.
    pub is_listening: bool,
}

// === impl Person ===

impl Person {
    /// Somebody who has no terminal yet.
    pub fn new(name: &str, since: Instant) -> Person {
        let name = name.to_owned();
        let (unnamed, stories) = (Vec::new(), BTreeMap::new());
        Person { name, terminal: None, unnamed, stories, since }
    }

    /// Sits down at a terminal.
    pub fn sit(&mut self, terminal: Terminal) {
        self.terminal = Some(terminal);
    }

    /// The terminal is gone, with the process behind it.
    pub fn lose(&mut self) {
        self.hear();
        self.terminal = None;
        self.unnamed.clear();
        self.stories.values_mut().for_each(|story| story.is_listening = false);
    }

    /// Wishes for something; whether there was anybody to hear it.
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

    /// Takes in what was said since.
    pub fn hear(&mut self) {
        let at = self.since.elapsed();
        let Some(terminal) = &mut self.terminal else { return };
        while let Ok(heard) = terminal.hear.try_recv() {
            if let Heard::Asked(conversation) = &heard {
                // A keyboard takes wishes in their order.
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

    /// Whether its asker waits for nothing any more.
    pub fn is_settled(&self) -> bool {
        match self.wish.keep {
            Keep::Achieve => self.end.is_some_and(Outcome::is_final),
            Keep::Maintain => self.end.is_some(),
        }
    }
}
