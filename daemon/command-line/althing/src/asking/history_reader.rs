//! Reads from the history agents of a running ecosystem. If there are several, all are asked, and
//! the answer of the best one is used: it is whole, and goes back farthest.

use std::collections::{BTreeMap, BTreeSet};
use std::pin::pin;
use std::time::Duration;

use acl::content::{
    HISTORY_EVENTS_MAX, HistoryEvent, HistoryPage, HistoryQuery, ReadHistory, Refusal, Report,
    Request, value,
};
use acl::{AgentId, Message, Performative, Protocol};
use credentials::AnswerKey;
use keyboard::{Keyboard, MessageDraft, Terminal, UserEvent, UserRequest};
use tokio_util::sync::DropGuard;

use crate::asking::stops;
use crate::ecosystem_view::EcosystemView;
use crate::hosting;

/// Name of the plugin whose agents keep the history.
const PLUGIN: &str = "history";

/// How long the answers of history agents are awaited.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// Maximum number of pages of one answer, so that a history that repeats itself is not read for
/// ever. A page may have no events: the history then looks on.
const PAGES_MAX: usize = 2_000;

/// By how much the beginnings of two histories may differ without a note. Two history agents of one
/// ecosystem never start at the same instant.
const SAME_BEGINNING_MS: u64 = 10 * 60 * 1_000;

/// Reason why the history cannot be read. The message completes “failed to …”.
#[derive(Debug, PartialEq, Eq, thiserror::Error)]
pub(crate) enum HistoryReadError {
    /// No agent of the ecosystem keeps the history.
    #[error("{0}")]
    NotKept(String),
    /// No history agent is present, or none answers.
    #[error("read the history: {0}")]
    Silent(String),
    /// Every history agent that answered has refused.
    #[error("read the history: {0}")]
    Refused(String),
}

/// The answer of the history agent that was chosen.
#[derive(Debug, PartialEq)]
pub(crate) struct HistoryAnswer {
    /// The history agent.
    pub(crate) from: AgentId,
    /// Its page. Private events that were sealed are among the others.
    pub(crate) page: HistoryPage,
    /// How the other histories differ, as texts for a person.
    pub(crate) differences: Vec<String>,
}

/// A guest that asks history agents.
pub(crate) struct HistoryReader {
    view: EcosystemView,
    terminal: Terminal,
    /// The key that private events are sealed to.
    key: AnswerKey,
    _guest: DropGuard,
}

// === impl HistoryReader ===

impl HistoryReader {
    /// Launches the guest, with the name `own`.
    ///
    /// # Errors
    ///
    /// Returns an error if the ecosystem file names no history agent.
    pub(crate) fn open(
        view: &EcosystemView,
        own: AgentId,
    ) -> Result<HistoryReader, HistoryReadError> {
        if named(view).is_some_and(|named| named.is_empty()) {
            return Err(HistoryReadError::NotKept(advice(view)));
        }
        let (keyboard, terminal) = Keyboard::for_requests();
        let guest = hosting::launch_guest(&view.router, own, keyboard, view.ontology());
        Ok(HistoryReader { view: view.clone(), terminal, key: AnswerKey::new(), _guest: guest })
    }

    /// Whether the guest has ended, so that it cannot read any more.
    pub(crate) fn has_ended(&self) -> bool {
        self.terminal.events.is_closed()
    }

    /// Reads all pages of a query, up to `limit` events, with private events only if
    /// `reads_private`.
    pub(crate) async fn read(
        &mut self,
        query: &HistoryQuery,
        limit: u32,
        reads_private: bool,
    ) -> Result<HistoryAnswer, HistoryReadError> {
        let first = ReadHistory {
            limit: limit.min(HISTORY_EVENTS_MAX),
            seal_to: reads_private.then(|| self.key.public()),
            ..ReadHistory::new(query.clone())
        };
        let mut answer = best(self.ask_all(&first).await?)?;
        for _ in 0..PAGES_MAX {
            let Some(before) = answer.page.next else { break };
            if answer.page.events.len() >= limit as usize {
                break;
            }
            let next = ReadHistory { before: Some(before), ..first.clone() };
            let only = [answer.from.clone()].into();
            let page = best(self.ask(only, &next).await?)?.page;
            let so_far = &mut answer.page;
            so_far.withheld = so_far.withheld.saturating_add(page.withheld);
            so_far.next = page.next.filter(|next| *next != before);
            so_far.events.extend(page.events);
        }
        sort(query, &mut answer.page.events);
        answer.page.events.truncate(limit as usize);
        Ok(answer)
    }

    /// Asks every history agent that is present, or becomes visible while the guest joins.
    async fn ask_all(
        &mut self,
        request: &ReadHistory,
    ) -> Result<BTreeMap<AgentId, PageOrRefusal>, HistoryReadError> {
        let view = self.view.clone();
        let named = named(&view);
        let router = &view.router;
        let (_, mut changes) = router.presence_changes();
        let deadline = tokio::time::sleep(ANSWERED_WITHIN);
        let (mut deadline, mut sees_all) = (pin!(deadline), pin!(stops::sees_all(&view)));
        // All agents are visible after a moment. A history that the file names may be absent.
        let mut present = self.present(named.as_ref());
        while named.as_ref().is_none_or(|named| present.len() < named.len()) {
            tokio::select! {
                _ = changes.recv() => (),
                () = &mut sees_all => break,
                () = &mut deadline => break,
            }
            present = self.present(named.as_ref());
        }
        present = self.present(named.as_ref());
        match (&named, present.is_empty()) {
            (None, true) => Err(HistoryReadError::NotKept(advice(&self.view))),
            (Some(named), true) => {
                let names: Vec<_> = named.iter().map(|name| format!("`{name}`")).collect();
                Err(HistoryReadError::Silent(format!("{} is not present", names.join(" or "))))
            }
            (_, false) => self.ask(present, request).await,
        }
    }

    /// Returns the history agents that are present. Without the ecosystem file, they are found by
    /// their name: `history`, or `history-` and more.
    fn present(&self, named: Option<&BTreeSet<AgentId>>) -> BTreeSet<AgentId> {
        let directory = self.view.router.directory();
        let is_history = |agent: &AgentId| match named {
            Some(named) => named.contains(agent),
            None => agent.as_str() == PLUGIN || agent.as_str().starts_with("history-"),
        };
        let hosted = directory.iter().filter(|resident| !resident.daemon.is_guest());
        hosted.map(|resident| &resident.agent).filter(|agent| is_history(agent)).cloned().collect()
    }

    /// Sends the request to the agents, and returns the answers that come in time.
    async fn ask(
        &mut self,
        agents: BTreeSet<AgentId>,
        request: &ReadHistory,
    ) -> Result<BTreeMap<AgentId, PageOrRefusal>, HistoryReadError> {
        let ended = || HistoryReadError::Silent("the keyboard agent has ended".to_owned());
        // Answers to earlier requests may still come.
        let mut sent = BTreeSet::new();
        for agent in &agents {
            let draft = MessageDraft {
                to: Some(agent.clone()),
                performative: Performative::Request,
                protocol: Protocol::StateChange,
                conversation: None,
                content: value(&Request::ReadHistory(request.clone())),
                patience: ANSWERED_WITHIN,
            };
            let id = self.terminal.requests.send(UserRequest::Send(draft)).await;
            sent.insert(id.map_err(|_| ended())?);
        }
        let (mut answers, deadline) = (BTreeMap::new(), tokio::time::sleep(ANSWERED_WITHIN));
        let mut deadline = pin!(deadline);
        while answers.len() < agents.len() {
            tokio::select! {
                heard = self.terminal.events.recv() => match heard {
                    Some(UserEvent::Answered(id, message))
                        if id.is_some_and(|id| sent.contains(&id))
                            && agents.contains(&message.sender) =>
                    {
                        let answer = answer_of(&message, &self.key);
                        answers.insert(message.sender.clone(), answer);
                    }
                    Some(_) => (),
                    None => return Err(ended()),
                },
                () = &mut deadline => break,
            }
        }
        if answers.is_empty() {
            let names: Vec<_> = agents.iter().map(|name| format!("`{name}`")).collect();
            return Err(HistoryReadError::Silent(format!(
                "{} does not answer",
                names.join(" or ")
            )));
        }
        Ok(answers)
    }
}

/// Returns the history agents that the ecosystem file names; `None` if the file is not known.
fn named(view: &EcosystemView) -> Option<BTreeSet<AgentId>> {
    let ecosystem = view.ecosystem.as_ref()?;
    let keeps = ecosystem.agents.iter().filter(|entry| entry.plugin == PLUGIN);
    Some(keeps.map(|entry| entry.name.clone()).collect())
}

/// Returns what a user can do to have a history.
fn advice(view: &EcosystemView) -> String {
    let daemons = view.ecosystem.iter().flat_map(|known| &known.agents);
    let daemon = daemons.flat_map(|entry| &entry.daemons).next();
    let daemon = daemon.map_or("DAEMON", |daemon| daemon.as_str());
    format!(
        "read the history: no agent of `{}` keeps it. Add these lines to the file of the \
         ecosystem, on every machine, and start the daemon `{daemon}` anew:\n\n\
         [[agent]]\n\
         name = \"history\"\n\
         plugin = \"history\"\n\
         daemon = \"{daemon}\"\n\
         config = {{ keep = \"30days\", max-size = \"1GiB\" }}\n",
        view.name
    )
}

/// Answer of one history agent: its page, or the reason why it declined.
type PageOrRefusal = Result<HistoryPage, String>;

/// Reads the answer of a history agent. Private events are unsealed, and put among the others.
fn answer_of(message: &Message, key: &AnswerKey) -> PageOrRefusal {
    if message.performative != Performative::Confirm {
        let refusal = message.content_as::<Refusal>().map(|refusal| refusal.detail);
        return Err(refusal.unwrap_or_else(|error| error.to_string()));
    }
    let report = message.content_as::<Report>().map_err(|error| error.to_string())?;
    let mut page = *report.history_page.ok_or("the answer has no events")?;
    for sealed in std::mem::take(&mut page.sealed) {
        let opened = key.open(&sealed).ok();
        match opened.and_then(|text| serde_json::from_str::<HistoryEvent>(&text).ok()) {
            Some(event) => page.events.push(event),
            None => page.withheld = page.withheld.saturating_add(1),
        }
    }
    Ok(page)
}

/// Chooses the answer that has events, is whole, and goes back farthest.
fn best(answers: BTreeMap<AgentId, PageOrRefusal>) -> Result<HistoryAnswer, HistoryReadError> {
    let mut pages = Vec::new();
    let mut refusals = Vec::new();
    for (agent, answer) in answers {
        match answer {
            Ok(page) => pages.push((agent, page)),
            Err(why) => refusals.push(format!("`{agent}`: {why}")),
        }
    }
    let rank = |page: &HistoryPage| {
        let is_whole = page.lost == 0 && page.notices.is_empty();
        (page.events.is_empty(), !is_whole, page.oldest_ms.unwrap_or(u64::MAX))
    };
    pages.sort_by_key(|(_, page)| rank(page));
    let mut pages = pages.into_iter();
    let Some((from, page)) = pages.next() else {
        return Err(HistoryReadError::Refused(refusals.join("; ")));
    };
    let mut differences: Vec<_> =
        pages.filter_map(|(other, its)| difference(&from, &page, &other, &its)).collect();
    differences.extend(refusals.into_iter().map(|refusal| format!("not asked further: {refusal}")));
    Ok(HistoryAnswer { from, page, differences })
}

/// Returns how the page of another history agent differs from the one that is used, as a text for a
/// person; `None` if it hardly does.
fn difference(
    from: &AgentId,
    page: &HistoryPage,
    other: &AgentId,
    its: &HistoryPage,
) -> Option<String> {
    let mut parts = Vec::new();
    let beginning = |page: &HistoryPage| page.oldest_ms.unwrap_or(u64::MAX);
    if beginning(its) > beginning(page).saturating_add(SAME_BEGINNING_MS) {
        parts.push("goes back less far".to_owned());
    } else if beginning(page) > beginning(its).saturating_add(SAME_BEGINNING_MS) {
        parts.push("goes back farther".to_owned());
    }
    if its.lost > page.lost {
        parts.push(format!("has missed {} messages", its.lost));
    }
    if its.events.is_empty() && !page.events.is_empty() {
        parts.push("knows nothing of it".to_owned());
    }
    parts.extend(its.notices.iter().cloned());
    (!parts.is_empty()).then(|| format!("`{from}` answers; `{other}` {}", parts.join(", ")))
}

/// Puts the events of a query into their order: effects by growing numbers, all others by falling
/// numbers. Private events come after the others in an answer.
fn sort(query: &HistoryQuery, events: &mut Vec<HistoryEvent>) {
    events.sort_by_key(|event| event.number);
    events.dedup_by_key(|event| event.number);
    if !matches!(query, HistoryQuery::Effects { .. }) {
        events.reverse();
    }
}

#[cfg(test)]
mod tests {
    use acl::content::HistoryKind;

    use super::*;

    fn agent(name: &str) -> AgentId {
        AgentId::new(name).expect("a name")
    }

    fn event(number: u64) -> HistoryEvent {
        HistoryEvent {
            number,
            at_ms: number,
            kind: HistoryKind::Fact,
            subject: "(lit hall)".to_owned(),
            agent: None,
            text: "`(lit hall)` holds".to_owned(),
            conversation: None,
            cause: None,
            root: None,
            value: None,
            private: false,
        }
    }

    fn page(numbers: &[u64], oldest_ms: u64, lost: u64) -> HistoryPage {
        let events = numbers.iter().copied().map(event).collect();
        HistoryPage { events, oldest_ms: Some(oldest_ms), lost, ..HistoryPage::default() }
    }

    #[test]
    fn the_history_that_is_whole_and_goes_back_farthest_answers() {
        const HOUR: u64 = 3_600_000;
        let answers = [
            ("history-a", Ok(page(&[9, 8], 3 * HOUR, 0))),
            ("history-b", Ok(page(&[5, 4], 2 * HOUR, 0))),
            ("history-c", Ok(page(&[5, 4], HOUR, 7))),
            ("history-d", Ok(page(&[], 0, 0))),
            ("history-e", Err("forbidden".to_owned())),
        ];
        let answers = answers.map(|(name, answer)| (agent(name), answer));
        let answer = best(answers.into()).expect("pages");
        assert_eq!(answer.from, agent("history-b"));
        assert_eq!(
            answer.differences,
            [
                "`history-b` answers; `history-a` goes back less far",
                "`history-b` answers; `history-c` goes back farther, has missed 7 messages",
                "`history-b` answers; `history-d` goes back farther, knows nothing of it",
                "not asked further: `history-e`: forbidden",
            ]
        );
        let refused = [(agent("history"), Err("not allowed".to_owned()))];
        let error = best(refused.into()).expect_err("a refusal");
        assert_eq!(error, HistoryReadError::Refused("`history`: not allowed".to_owned()));
    }

    #[test]
    fn private_events_are_unsealed_and_take_their_places() {
        let key = AnswerKey::new();
        let seal = |event: &HistoryEvent| {
            let text = serde_json::to_string(event).expect("plain data");
            credentials::seal_answer(&key.public(), &text).expect("a key")
        };
        let sealed = vec![seal(&event(2)), "rubbish".to_owned()];
        let sent = HistoryPage { sealed, ..page(&[3, 1], 0, 0) };
        let report = Report {
            history_page: Some(Box::new(sent)),
            ..Report::new(acl::content::Outcome::Done, "3 events")
        };
        let text = format!(
            r#"{{"version": {}, "id": "m", "performative": "confirm", "sender": "history",
                 "incarnation": 1, "conversation_id": "c", "content": {}}}"#,
            acl::SCHEMA_VERSION,
            value(&report)
        );
        let message = acl::decode(text.as_bytes()).expect("a message");
        let mut page = answer_of(&message, &key).expect("a page");
        assert_eq!((page.withheld, page.sealed.len()), (1, 0));
        let query = HistoryQuery::Last { about: "hall".to_owned() };
        sort(&query, &mut page.events);
        let numbers: Vec<_> = page.events.iter().map(|event| event.number).collect();
        assert_eq!(numbers, [3, 2, 1]);
    }
}
