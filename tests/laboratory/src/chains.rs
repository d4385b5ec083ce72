//! The history of a trial: every chain of causes ends at a person, a sensor, a clock, or an agent
//! that left or joined; and steps lead to the goals that they are for.

use std::collections::{BTreeMap, BTreeSet};
use std::time::Duration;

use acl::content::{
    HISTORY_EVENTS_MAX, HistoryEvent, HistoryKind, HistoryPage, HistoryQuery, HistoryRoot,
    ReadHistory, Report, Request, value,
};
use acl::{AgentId, Performative, Protocol};
use keyboard::{MessageDraft, Terminal, UserEvent, UserRequest};

use crate::cluster::PEOPLE;
use crate::commands::Begun;
use crate::script::AgentPlacement;

/// Name of the history agent.
const HISTORY: &str = "history";

/// Name of the keyboard that reads the history.
pub(crate) const READER: &str = "historian";

/// Time limit for one page.
const ANSWERED_WITHIN: Duration = Duration::from_secs(20);

/// Maximum number of pages, so that a history that repeats itself ends the trial.
const PAGES_MAX: usize = 1_000;

/// The whole history of a trial.
#[derive(Debug, Default)]
pub struct RecordedHistory {
    /// All events, by their numbers.
    pub events: BTreeMap<u64, HistoryEvent>,
    /// Number of messages that the history agent missed.
    pub lost: u64,
    /// Number of events that the history withheld: they are about private facts, or about facts
    /// whose declaration it did not know yet.
    pub withheld: u64,
}

impl RecordedHistory {
    /// Returns the numbers of the events that exist and are withheld: events are numbered without
    /// gaps, and a trial is too short for the oldest to be deleted.
    fn unseen(&self) -> BTreeSet<u64> {
        let newest = self.events.keys().next_back().copied().unwrap_or(0);
        (1..newest).filter(|number| !self.events.contains_key(number)).collect()
    }
}

/// Counts of what the chains of a history lead to.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ChainCounts {
    /// Number of chains by the roots that they end at.
    pub roots: BTreeMap<HistoryRoot, usize>,
    /// Number of events by their kinds.
    pub kinds: BTreeMap<HistoryKind, usize>,
    /// Commands that actuators have begun, and those of them that the history has.
    pub commands: [usize; 2],
}

/// Returns the placement of a history agent, on the daemon whose process never dies.
pub(crate) fn placement() -> AgentPlacement {
    AgentPlacement {
        name: HISTORY.to_owned(),
        plugin: history::PLUGIN.name,
        daemons: vec![0],
        config: serde_json::Value::Null,
    }
}

/// Reads the whole history at a terminal.
///
/// # Errors
///
/// Returns the reason if the history agent does not answer.
pub async fn read(mut terminal: Terminal) -> Result<RecordedHistory, String> {
    let mut history = RecordedHistory::default();
    let query = || HistoryQuery::Events { about: None, kinds: vec![], from_ms: None, to_ms: None };
    let mut before = None;
    for _ in 0..PAGES_MAX {
        let read = ReadHistory { limit: HISTORY_EVENTS_MAX, before, ..ReadHistory::new(query()) };
        let page = page(&mut terminal, read).await?;
        history.lost = page.lost;
        history.withheld += page.withheld;
        history.events.extend(page.events.into_iter().map(|event| (event.number, event)));
        match page.next {
            Some(next) => before = Some(next),
            None => return Ok(history),
        }
    }
    Err(format!("the history has no end after {PAGES_MAX} pages"))
}

async fn page(terminal: &mut Terminal, read: ReadHistory) -> Result<HistoryPage, String> {
    let draft = MessageDraft {
        to: Some(AgentId::new(HISTORY).map_err(|error| error.to_string())?),
        performative: Performative::Request,
        protocol: Protocol::StateChange,
        conversation: None,
        content: value(&Request::ReadHistory(read)),
        patience: ANSWERED_WITHIN,
    };
    let sent = terminal.requests.try_send(UserRequest::Send(draft));
    sent.map_err(|_| "the keyboard takes no request".to_owned())?;
    loop {
        let heard = tokio::time::timeout(ANSWERED_WITHIN, terminal.events.recv()).await;
        match heard.map_err(|_| "the history does not answer".to_owned())? {
            Some(UserEvent::Answered(_, message)) => {
                let report = message.content_as::<Report>().map_err(|_| {
                    format!("the history answers `{}`: {}", message.performative, message.content)
                })?;
                let page = report.history_page.ok_or("the history answers without a page")?;
                return Ok(*page);
            }
            Some(UserEvent::Unanswered(_, why)) => return Err(why),
            Some(_) => (),
            None => return Err("the keyboard has ended".to_owned()),
        }
    }
}

/// Walks all chains of a history, and returns what is wrong with them.
pub fn violations(history: &RecordedHistory) -> Vec<String> {
    let mut broken = Vec::new();
    let unseen = history.unseen();
    // What is withheld after the newest event that is shown has no number here.
    if unseen.len() as u64 > history.withheld {
        let (missing, withheld) = (unseen.len(), history.withheld);
        broken.push(format!("{missing} numbers are missing, and {withheld} events are withheld"));
    }
    for event in history.events.values() {
        let told = || format!("event {} ({}, {})", event.number, event.kind, event.text);
        match (event.cause, event.root) {
            (None, None | Some(HistoryRoot::Other)) => {
                broken.push(format!("{} has neither a cause nor a root", told()));
            }
            (None, Some(HistoryRoot::Person)) if !is_of_person(event) => {
                broken.push(format!("{} is said to come from a person", told()));
            }
            (Some(cause), _) if cause >= event.number => {
                broken.push(format!("{} is caused by the later {cause}", told()));
            }
            (Some(cause), _)
                if !history.events.contains_key(&cause) && !unseen.contains(&cause) =>
            {
                broken.push(format!("{} is caused by {cause}, which is not there", told()));
            }
            _ => (),
        }
        if event.kind == HistoryKind::Step && !leads_to_goal(event, history, &unseen) {
            let chain = chain_text(event, history);
            broken.push(format!("{} does not lead to its goal: {chain}", told()));
        }
    }
    broken
}

/// Whether the agent of an event speaks for a person.
fn is_of_person(event: &HistoryEvent) -> bool {
    let people: BTreeSet<_> = PEOPLE.into_iter().chain(["clerk", READER]).collect();
    // A proxy agent speaks for the people of the other ecosystem.
    event
        .agent
        .as_ref()
        .is_some_and(|agent| people.iter().any(|person| agent.as_str().contains(person)))
}

/// Whether a step that belongs to a conversation is caused, in the end, by the goal of that
/// conversation.
fn leads_to_goal(step: &HistoryEvent, history: &RecordedHistory, unseen: &BTreeSet<u64>) -> bool {
    let mut event = step;
    while let Some(cause) = event.cause.and_then(|cause| history.events.get(&cause)) {
        if cause.number >= event.number {
            return false;
        }
        if cause.kind == HistoryKind::Goal && cause.conversation == step.conversation {
            return true;
        }
        event = cause;
    }
    // The chain goes on with an event that is withheld.
    event.cause.is_some_and(|cause| unseen.contains(&cause))
}

/// Returns the chain of causes of an event, for diagnosis.
fn chain_text(event: &HistoryEvent, history: &RecordedHistory) -> String {
    let mut links = Vec::new();
    let mut next = Some(event);
    while let Some(link) = next.filter(|_| links.len() < history.events.len()) {
        let conversation = link.conversation.as_ref().map_or("", |id| id.as_str());
        links.push(format!("{} {} ({conversation}) {}", link.number, link.kind, link.text));
        next = link.cause.and_then(|cause| history.events.get(&cause));
    }
    links.join(" <- ")
}

/// Counts what the chains lead to, and which of the commands that actuators have begun are steps of
/// the history.
pub fn counts(history: &RecordedHistory, begun: &Begun) -> ChainCounts {
    let mut counts = ChainCounts::default();
    let mut steps = BTreeSet::new();
    for event in history.events.values() {
        *counts.kinds.entry(event.kind).or_default() += 1;
        if let (None, Some(root)) = (event.cause, event.root) {
            *counts.roots.entry(root).or_default() += 1;
        }
        if let (HistoryKind::Step, Some(conversation)) = (event.kind, &event.conversation) {
            steps.insert(conversation.as_str().to_owned());
        }
    }
    for token in begun.values().flatten() {
        counts.commands[0] += 1;
        counts.commands[1] += usize::from(steps.contains(token.conversation.as_str()));
    }
    counts
}
