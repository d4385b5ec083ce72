//! The host of the page: this daemon, which observes the ecosystem and acts for people.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use accounts::{Accounts, Person, PersonRight};
use acl::AgentId;
use acl::content::{HistoryEvent, HistoryQuery, ReadHistory, Request};
use live_view::{LiveView, Moment};
use serde_json::{Value, json};
use tokio::sync::watch;
use web_page::{
    ActOutcome, BoxFuture, HistoryProblem, PageAct, PageHost, PagePicture, PageSetup, PushAnswer,
    PushAsk,
};

use super::acts::{self, ActMeans};
use super::answered::AnsweredQuestions;
use super::page_view::PageView;
use super::person_agents::PersonAgents;
use super::{notifications, pictures};
use crate::ecosystem_view::EcosystemView;
use crate::observing;

/// Number of events of the history that a page gets if it does not say how many it wants, and the
/// greatest number.
const HISTORY_EVENTS: u32 = 200;
const HISTORY_EVENTS_MAX: u32 = 2_000;

/// The daemon as the host of its page.
pub(super) struct DaemonHost {
    means: Arc<ActMeans>,
    /// The state folder of the daemon, in which cameras put their pictures.
    state: PathBuf,
}

impl DaemonHost {
    /// Creates the host.
    pub(super) fn new(
        view: EcosystemView,
        page: Arc<PageView>,
        agents: Arc<PersonAgents>,
        state: &Path,
    ) -> DaemonHost {
        let answered = AnsweredQuestions::default();
        let means = Arc::new(ActMeans { view, page, agents, answered });
        DaemonHost { means, state: state.to_owned() }
    }

    /// Sets the people of the ecosystem.
    pub(super) fn know_people(&self, accounts: Arc<Accounts>) {
        self.means.agents.know_people(accounts);
    }
}

impl PageHost for DaemonHost {
    fn now(&self) -> Moment {
        observing::now()
    }

    fn read(&self, reader: &mut dyn FnMut(&LiveView)) {
        self.means.page.read(reader);
    }

    fn changes(&self) -> watch::Receiver<u64> {
        self.means.page.changes()
    }

    fn act(&self, person: Person, act: PageAct) -> BoxFuture<ActOutcome> {
        let means = Arc::clone(&self.means);
        Box::pin(async move { acts::carry_out(&means, &person, act).await })
    }

    fn required_right(&self, act: &PageAct) -> Option<PersonRight> {
        let PageAct::Answer { keyboard, question, .. } = act else { return act.right() };
        let (id, now) = (format!("{keyboard}/{question}"), observing::now());
        let is_admission = self.means.page.read(|view| {
            let questions = view.questions(now);
            let asked = questions.iter().find(|row| row.id.as_deref() == Some(id.as_str()));
            asked.is_some_and(|row| acts::is_doorkeeper(&row.from))
        });
        if is_admission { Some(PersonRight::Admit) } else { act.right() }
    }

    fn describe(&self) -> PageSetup {
        // The answer is there for the next call: a page asks when it is opened and when a person
        // begins to build a goal.
        self.means.page.refresh_setup(&self.means.view);
        self.means.page.setup()
    }

    fn picture(&self, agent: &AgentId) -> BoxFuture<Option<PagePicture>> {
        let ecosystem = self.means.view.ecosystem.as_deref();
        let folder = ecosystem.and_then(|known| pictures::folder(known, agent, &self.state));
        let agent = agent.clone();
        Box::pin(async move {
            let folder = folder?;
            let newest = move || pictures::newest(&folder, &agent);
            tokio::task::spawn_blocking(newest).await.ok().flatten()
        })
    }

    fn history(
        &self,
        person: Person,
        parameters: Vec<(String, String)>,
    ) -> BoxFuture<Result<Value, HistoryProblem>> {
        let means = Arc::clone(&self.means);
        Box::pin(async move {
            let query = history_query(&parameters).map_err(HistoryProblem::Parameter);
            let (query, limit) = query?;
            let rows = read_history(&means, query, limit, person.may(PersonRight::Secrets)).await;
            rows.map_err(HistoryProblem::Unavailable)
        })
    }

    fn push(&self, person: Person, ask: PushAsk) -> BoxFuture<Option<PushAnswer>> {
        let ecosystem = self.means.view.ecosystem.as_deref();
        let notifiers = ecosystem.map(notifications::notifiers).unwrap_or_default();
        let state = self.state.clone();
        Box::pin(async move {
            let carry_out = move || notifications::carry_out(&notifiers, &state, &person.name, ask);
            tokio::task::spawn_blocking(carry_out).await.ok().flatten()
        })
    }
}

/// Returns the query of a page, and the number of events that it wants. The parameters are `about`
/// (a name, a fact or a goal), `values` (a fact whose values are wanted), `from` and `to`
/// (milliseconds since 1970) and `limit`.
fn history_query(parameters: &[(String, String)]) -> Result<(HistoryQuery, u32), String> {
    let known = ["about", "values", "from", "to", "limit"];
    if let Some((unknown, _)) = parameters.iter().find(|(name, _)| !known.contains(&name.as_str()))
    {
        return Err(format!("the history has no parameter `{unknown}`: {}", known.join(", ")));
    }
    let find = |wanted: &str| {
        let found = parameters.iter().find(|(name, _)| name == wanted);
        found.map(|(_, value)| value.trim().to_owned()).filter(|value| !value.is_empty())
    };
    let number = |name: &str| match find(name) {
        None => Ok(None),
        Some(text) => text.parse::<u64>().map(Some).map_err(|_| {
            let example = if name == "limit" { "200" } else { "1764460800000" };
            format!("`{name}` must be a whole number, such as {example}, and is {text:?}")
        }),
    };
    let (from_ms, to_ms) = (number("from")?, number("to")?);
    let limit = number("limit")?.map_or(HISTORY_EVENTS, |limit| {
        u32::try_from(limit).unwrap_or(HISTORY_EVENTS_MAX).clamp(1, HISTORY_EVENTS_MAX)
    });
    let query = match find("values") {
        Some(fact) => HistoryQuery::Values { fact, from_ms, to_ms },
        None => HistoryQuery::Events { about: find("about"), kinds: Vec::new(), from_ms, to_ms },
    };
    Ok((query, limit))
}

/// Reads the history, and what is private in it if `reads_private` and the rights of the ecosystem let
/// this daemon's guests read it: the history seals private events to the reader, or withholds them.
async fn read_history(
    means: &ActMeans,
    query: HistoryQuery,
    limit: u32,
    reads_private: bool,
) -> Result<Value, String> {
    let request = Request::ReadHistory(ReadHistory::new(query.clone()));
    let may_read = |agent: &AgentId| means.agents.check_rights(agent, &request);
    let mut reader = means.agents.history_readers().take(&means.view, may_read)?;
    let answer = reader.read(&query, limit, reads_private).await?;
    let event = |event: &HistoryEvent| {
        let mut row = json!(event);
        row["at"] = json!(event.at_ms);
        row
    };
    let events: Vec<_> = answer.page.events.iter().map(event).collect();
    Ok(json!({
        "events": events, "from": answer.from, "withheld": answer.page.withheld,
        "oldest_ms": answer.page.oldest_ms, "differences": answer.differences,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn query(parameters: &[(&str, &str)]) -> Result<(HistoryQuery, u32), String> {
        let owned = |(name, value): &(&str, &str)| ((*name).to_owned(), (*value).to_owned());
        history_query(&parameters.iter().map(owned).collect::<Vec<_>>())
    }

    #[test]
    fn the_parameters_of_a_page_become_a_query() {
        let about = Some("office1".to_owned());
        let (kinds, from_ms, to_ms) = (Vec::new(), Some(5), None);
        let expected = HistoryQuery::Events { about, kinds, from_ms, to_ms };
        assert_eq!(query(&[("about", " office1 "), ("from", "5")]), Ok((expected, 200)));
        let (fact, from_ms) = ("(temperature office1)".to_owned(), None);
        let values = HistoryQuery::Values { fact, from_ms, to_ms };
        let asked = [("values", "(temperature office1)"), ("limit", "99999999999999")];
        assert_eq!(query(&asked), Ok((values, HISTORY_EVENTS_MAX)));
        let wrong = "`limit` must be a whole number, such as 200, and is \"-1\"";
        assert_eq!(query(&[("limit", "-1")]), Err(wrong.to_owned()));
        assert!(query(&[("limits", "1")]).is_err_and(|why| why.contains("`limits`")));
    }
}
