//! The pages: their names, the numbers that open them, and what each shows.

use std::fmt;
use std::str::FromStr;

/// A page.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Hash)]
pub enum PageName {
    /// Whether all is well, and why not.
    #[default]
    Overview,
    /// All goals.
    Goals,
    /// One goal: its plan as a Gantt chart, the bids of its calls, its history.
    Goal,
    /// All agents.
    Agents,
    /// One agent.
    Agent,
    /// All facts.
    World,
    /// The floor plan.
    Floor,
    /// The questions to people.
    Questions,
    /// What happened, in sentences.
    Activity,
    /// All conversations.
    Conversations,
    /// One conversation as a sequence diagram.
    Conversation,
    /// The daemons.
    Topology,
}

/// Everything that is fixed about a page.
pub(crate) struct PageFacts {
    /// The page.
    pub(crate) page: PageName,
    /// The digit that opens the page.
    pub(crate) digit: Option<char>,
    /// Name of the page, as `:` and the command line take it.
    pub(crate) name: &'static str,
    /// Name for a narrow row of tabs.
    pub(crate) short: &'static str,
    /// Title and purpose in one sentence, for the help and the document.
    pub(crate) shows: &'static str,
}

/// All pages, in the order of the tabs.
pub(crate) const PAGES: &[PageFacts] = &[
    facts(
        PageName::Overview,
        Some('1'),
        "overview",
        "home",
        "whether all is well, what is not, the goals and the last activities",
    ),
    facts(
        PageName::Goals,
        Some('2'),
        "goals",
        "goals",
        "all goals: how each stands, who asked, what is done now, and why it waits",
    ),
    facts(
        PageName::Agents,
        Some('3'),
        "agents",
        "agents",
        "all agents: who is present, what each does now, its mailbox and its problems",
    ),
    facts(
        PageName::World,
        Some('4'),
        "world",
        "world",
        "all facts: who says so, since when, for how long it is known, who contradicts",
    ),
    facts(
        PageName::Floor,
        Some('5'),
        "floor",
        "floor",
        "the rooms and the ways between them, with the robots and the paths of running plans",
    ),
    facts(
        PageName::Questions,
        Some('6'),
        "questions",
        "asks",
        "the questions to people that have no answer yet",
    ),
    facts(
        PageName::Activity,
        Some('7'),
        "activity",
        "events",
        "what happened, in sentences, newest last",
    ),
    facts(
        PageName::Conversations,
        Some('8'),
        "conversations",
        "talks",
        "all conversations, with the messages that broke their protocol",
    ),
    facts(
        PageName::Topology,
        Some('9'),
        "topology",
        "daemons",
        "the daemons: round trips, who leads and stands by, certificates, mailboxes",
    ),
    facts(
        PageName::Goal,
        Some('0'),
        "goal",
        "goal",
        "one goal: its plans as Gantt charts with done, now and next, the bids, the history",
    ),
    facts(
        PageName::Agent,
        None,
        "agent",
        "agent",
        "one agent: replicas, actions with their usual times, facts, mailbox, activities",
    ),
    facts(
        PageName::Conversation,
        None,
        "conversation",
        "talk",
        "one conversation as a sequence diagram",
    ),
];

const fn facts(
    page: PageName,
    digit: Option<char>,
    name: &'static str,
    short: &'static str,
    shows: &'static str,
) -> PageFacts {
    PageFacts { page, digit, name, short, shows }
}

impl PageName {
    /// Iterates over all pages, in the order of the tabs.
    pub fn all() -> impl Iterator<Item = PageName> {
        PAGES.iter().map(|facts| facts.page)
    }

    /// Returns the name of the page, as `:` and the command line take it.
    pub fn name(self) -> &'static str {
        self.facts().name
    }

    /// Returns the name of the page in a narrow row of tabs, which is taken as well.
    pub fn short_name(self) -> &'static str {
        self.facts().short
    }

    /// Returns what the page shows, as a part of a sentence.
    pub fn shows(self) -> &'static str {
        self.facts().shows
    }

    /// Whether the page is about one thing, which a name chooses.
    pub fn takes_name(self) -> bool {
        matches!(self, Self::Goal | Self::Agent | Self::Conversation)
    }

    pub(crate) fn facts(self) -> &'static PageFacts {
        let facts = PAGES.iter().find(|facts| facts.page == self);
        facts.unwrap_or(&PAGES[0])
    }
}

impl fmt::Display for PageName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

impl FromStr for PageName {
    type Err = UnknownPage;

    /// Returns the page of this name, or the only one whose name begins with it.
    fn from_str(text: &str) -> Result<Self, UnknownPage> {
        let is_named = |facts: &&PageFacts| facts.name == text || facts.short == text;
        if let Some(facts) = PAGES.iter().find(is_named) {
            return Ok(facts.page);
        }
        let mut begun = PAGES.iter().filter(|facts| facts.name.starts_with(text));
        match (begun.next(), begun.next()) {
            (Some(facts), None) if !text.is_empty() => Ok(facts.page),
            _ => Err(UnknownPage { text: text.to_owned() }),
        }
    }
}

/// A text that is the name of no page.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct UnknownPage {
    text: String,
}

impl fmt::Display for UnknownPage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let names: Vec<_> = PageName::all().map(PageName::name).collect();
        write!(f, "there is no page `{}`; there are {}", self.text, names.join(", "))
    }
}

impl std::error::Error for UnknownPage {}

/// A page, and the thing that it is about.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct PageAt {
    /// The page.
    pub page: PageName,
    /// The goal or conversation (its identifier, the beginning of it, or a part of the goal), or the
    /// agent; `None` chooses the one that is of most interest now.
    pub name: Option<String>,
}

impl PageAt {
    /// Names a page that is about everything.
    pub fn of(page: PageName) -> Self {
        Self { page, name: None }
    }

    /// Names the page of one thing.
    pub fn named(page: PageName, name: impl Into<String>) -> Self {
        Self { page, name: Some(name.into()) }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn a_page_is_found_by_the_beginning_of_its_name() {
        assert_eq!("topology".parse(), Ok(PageName::Topology));
        assert_eq!("top".parse(), Ok(PageName::Topology));
        assert_eq!("goal".parse(), Ok(PageName::Goal));
        assert_eq!("talks".parse(), Ok(PageName::Conversations));
        let error = "a".parse::<PageName>().expect_err("three pages begin so");
        assert!(error.to_string().starts_with("there is no page `a`; there are overview, goals"));
        assert!("".parse::<PageName>().is_err());
    }

    #[test]
    fn the_names_of_tabs_are_names_of_pages() {
        let shorts: BTreeSet<_> = PageName::all().map(PageName::short_name).collect();
        assert_eq!(shorts.len(), PageName::all().count(), "each names one page");
        for page in PageName::all() {
            assert_eq!(page.short_name().parse(), Ok(page));
        }
    }

    #[test]
    fn every_page_is_in_the_table_once() {
        for page in PageName::all() {
            assert_eq!(page.facts().page, page);
            assert_eq!(page.name().parse(), Ok(page));
            assert_eq!(PageName::all().filter(|other| *other == page).count(), 1);
        }
        assert_eq!(PageName::all().count(), PageName::Topology as usize + 1);
    }
}
