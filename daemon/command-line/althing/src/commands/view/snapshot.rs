//! One page of a running ecosystem, printed once.

use std::collections::BTreeSet;
use std::process::ExitCode;
use std::sync::Arc;
use std::time::Duration;

use agent::Resource;
use live_view::{LiveView, ViewEvent, ViewLimits};
use terminal_view::{PageAt, PageName};
use tokio::task::JoinSet;
use tokio::time::Instant;

use super::page_output::PageForm;
use super::view_inbox::ViewInbox;
use crate::cli::ReachArgs;
use crate::commands::client::{self, ClientLink};
use crate::observing::{self, POLLS};

/// How long the messages of the ecosystem are observed for the pages that are made of them: two
/// heartbeats of an agent.
const OBSERVED_FOR: Duration = Duration::from_secs(2);

/// Prints a page.
pub(super) fn run(reach: &ReachArgs, page: &PageAt, form: &PageForm) -> ExitCode {
    let json = *form == PageForm::Json;
    client::with_link(reach, json, async |link| {
        let view = match observe(&link, page.page).await {
            Ok(view) => view,
            Err(problem) => return (link, client::unavailable(&problem, json)),
        };
        let code = form.print(&view, page, observing::now(), None);
        (link, code)
    })
}

/// Queries everything once, and observes the messages for a while if the page is made of them.
async fn observe(link: &ClientLink, page: PageName) -> Result<LiveView, String> {
    let mut view = LiveView::new(link.view.name.clone(), ViewLimits::default());
    let mut observe = |event| view.observe(observing::now(), event);
    observe(ViewEvent::Reached(true));
    observe(observing::expected(link.view.ecosystem.as_deref()));
    for event in answers(link).await {
        observe(event);
    }
    if matches!(page, PageName::Activity | PageName::Conversations | PageName::Conversation) {
        let inbox = Arc::<ViewInbox>::default();
        let listening = observing::listen(&link.node, &inbox, &Arc::default());
        let _listening = listening.map_err(|error| error.to_string())?;
        tokio::time::sleep(OBSERVED_FOR).await;
        for event in inbox.take_all(Instant::now().into_std()).observed.events {
            view.observe(event.at, event.into_event());
        }
    }
    Ok(view)
}

/// Queries all resources and all daemons. Returns the events in the order of the queries.
async fn answers(link: &ClientLink) -> Vec<ViewEvent> {
    // The daemons know all agents; the new link may not have reported all of them yet.
    let (mut events, _) = observing::query(&link.view, Resource::Directory).await;
    let places = events.iter().flat_map(|event| match event {
        ViewEvent::Directory(places) => places.as_slice(),
        _ => &[],
    });
    let own = link.view.router.daemon();
    let daemons = places.map(|place| place.daemon.clone()).filter(|daemon| daemon != own);
    let daemons: BTreeSet<_> = daemons.collect();
    let mut queries = JoinSet::new();
    for (order, poll) in POLLS.into_iter().enumerate() {
        let view = link.view.clone();
        queries.spawn(async move { (order, observing::query(&view, poll.resource).await.0) });
    }
    for daemon in daemons {
        let view = link.view.clone();
        queries.spawn(async move { (POLLS.len(), observing::round_trip(&view, &daemon).await) });
    }
    let mut answers = queries.join_all().await;
    answers.sort_by_key(|(order, _)| *order);
    events.extend(answers.into_iter().flat_map(|(_, events)| events));
    events
}
