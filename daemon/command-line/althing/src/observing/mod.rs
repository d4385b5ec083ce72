//! What is observed of a running ecosystem in order to show it: the messages, the presence of
//! agents, and the answers of daemons to queries. A command observes as a guest; the web page of a
//! daemon is fed inside the daemon.

mod event_queue;
mod poll_schedule;
mod resource_events;

use std::collections::BTreeSet;
use std::sync::Arc;
use std::time::{Duration, SystemTime};

use acl::DaemonId;
use agent::{Directory, Presence, Resource, ResourceQuery};
use bytes::Bytes;
use live_view::{ExpectedAgent, Moment, ViewEvent};
use substrate::{OverhearToken, SendError};
use tokio::sync::broadcast::error::RecvError;
use tokio::task::JoinSet;
use tokio::time::{Instant, MissedTickBehavior, interval};

use crate::config::Ecosystem;
use crate::ecosystem_view::EcosystemView;
use crate::hosting::DaemonNode;

pub(crate) use event_queue::{EventQueue, TimedEvent};
use poll_schedule::PollSchedule;
pub(crate) use poll_schedule::{POLLS, PollHints};

/// How long daemons may take to answer a query. The answers of the others are shown then.
const ANSWERED_WITHIN: Duration = Duration::from_secs(5);

/// Interval between two measurements of the round trips to all daemons.
const MEASURED_EVERY: Duration = Duration::from_secs(10);

/// How long a daemon may take to answer when its round trip is measured. On a network of a building
/// a round trip takes milliseconds.
const ROUND_TRIP_MAX: Duration = Duration::from_secs(2);

/// Maximum number of daemons whose round trips are measured at a time; the others follow.
const MEASURED_MAX: usize = 64;

/// How long no daemon may be seen until the link is opened again, to other daemons if there are
/// some.
const UNSEEN_FOR: Duration = Duration::from_secs(3);

/// How long no daemon may be seen until the view says so.
const UNSEEN_SAID_AFTER: Duration = Duration::from_millis(500);

/// Size of an event without large contents, in bytes, for the bound of the queue.
const SMALL: usize = 256;

/// Receives what is observed. Neither function may wait: the thread of the transport calls them.
pub(crate) trait EventSink: Send + Sync + 'static {
    /// Takes a waiting event.
    fn push(&self, event: TimedEvent);

    /// Whether what was taken has not been shown for so long that nobody seems to look.
    fn is_unread(&self) -> bool {
        false
    }
}

/// The reason why an observer stops.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum FollowEnd {
    /// No daemon is seen any more.
    Unseen,
    /// Nobody looks at what is observed.
    Unread,
}

/// The position of an observer in the ecosystem.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum ObserverPlace {
    /// The observer is a guest, and depends on a link to a daemon.
    Guest,
    /// The observer is in a daemon, which is a part of the ecosystem itself.
    Daemon,
}

/// Returns the time now, by the clock of this machine.
pub(crate) fn now() -> Moment {
    let since = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    Moment(u64::try_from(since.as_millis()).unwrap_or(u64::MAX))
}

/// Returns the agents that the ecosystem file names.
pub(crate) fn expected(ecosystem: Option<&Ecosystem>) -> ViewEvent {
    let entries = ecosystem.into_iter().flat_map(|ecosystem| &ecosystem.agents);
    let expected = entries
        .map(|entry| ExpectedAgent { agent: entry.name.clone(), daemons: entry.daemons.clone() });
    ViewEvent::Expected(expected.collect())
}

/// Queues all messages of the ecosystem that a node receives, as long as the returned token lives.
///
/// # Errors
///
/// Returns an error if the substrate is closed.
pub(crate) fn listen(
    node: &DaemonNode,
    sink: &Arc<impl EventSink>,
    hints: &Arc<PollHints>,
) -> Result<OverhearToken, SendError> {
    let (sink, hints) = (Arc::clone(sink), Arc::clone(hints));
    node.overhear(move |message| {
        hints.note(&message.destination);
        sink.push(TimedEvent::of_payload(now(), message.payload));
    })
}

/// Observes the ecosystem. A guest observes it until no daemon is seen any more, or until nobody
/// looks; a daemon until its router closes.
pub(crate) async fn follow(
    view: &EcosystemView,
    place: ObserverPlace,
    hints: &PollHints,
    sink: &Arc<impl EventSink>,
) -> FollowEnd {
    let (directory, mut changes) = view.router.presence_changes();
    push_directory(&**sink, &directory);
    let (mut schedule, mut work) = (PollSchedule::new(), JoinSet::new());
    let mut measuring = interval(MEASURED_EVERY);
    measuring.set_missed_tick_behavior(MissedTickBehavior::Delay);
    let (mut measured, mut unseen_since) = (0, None::<Instant>);
    let (mut had_daemon, mut is_said) = (false, false);
    // The daemons are asked once the link knows them.
    view.directory(None).await;
    loop {
        for resource in schedule.due(Instant::now(), hints) {
            work.spawn(poll(view.clone(), resource, Arc::clone(sink)));
        }
        let next = schedule.next().unwrap_or_else(Instant::now);
        tokio::select! {
            change = changes.recv() => {
                if !push_change(&**sink, view, change) {
                    return FollowEnd::Unseen;
                }
            }
            () = tokio::time::sleep_until(next) => (),
            () = hints.changed() => (),
            Some(_) = work.join_next() => (),
            _ = measuring.tick() => {
                measured += 1;
                work.spawn(measure(view.clone(), place, measured, Arc::clone(sink)));
            }
            () = until(unseen_since.filter(|_| !is_said), UNSEEN_SAID_AFTER) => {
                is_said = true;
                push(&**sink, ViewEvent::Reached(false));
            }
            () = until(unseen_since, UNSEEN_FOR) => return FollowEnd::Unseen,
        }
        if sink.is_unread() {
            return FollowEnd::Unread;
        }
        if place == ObserverPlace::Daemon {
            continue;
        }
        // Guests are processes of commands: they tell nothing once the daemons are gone.
        let sees_daemon = daemons(view, place).any(|daemon| !daemon.is_guest());
        had_daemon |= sees_daemon;
        let is_seen = sees_daemon || !had_daemon && daemons(view, place).next().is_some();
        if is_seen && std::mem::take(&mut is_said) {
            push(&**sink, ViewEvent::Reached(true));
        }
        unseen_since = match unseen_since {
            _ if is_seen => None,
            None => Some(Instant::now()),
            since => since,
        };
    }
}

/// Waits until no daemon has been seen for this time.
async fn until(unseen_since: Option<Instant>, time: Duration) {
    match unseen_since {
        Some(since) => tokio::time::sleep_until(since + time).await,
        None => std::future::pending().await,
    }
}

/// Queues a change of presence. Returns `false` if no change can come any more.
fn push_change(
    sink: &impl EventSink,
    view: &EcosystemView,
    change: Result<Presence, RecvError>,
) -> bool {
    match change {
        Ok(Presence::Joined(resident)) => {
            push(sink, ViewEvent::Joined(resource_events::place(resident)));
        }
        Ok(Presence::Left(resident)) => {
            push(sink, ViewEvent::Left(resource_events::place(resident)));
        }
        Err(RecvError::Lagged(_)) => push_directory(sink, &view.router.directory()),
        Err(RecvError::Closed) => return false,
    }
    true
}

/// Queues a small event that happens now.
pub(crate) fn push(sink: &impl EventSink, event: ViewEvent) {
    sink.push(TimedEvent::of_event(now(), event, SMALL));
}

fn push_directory(sink: &impl EventSink, directory: &Directory) {
    let places: Vec<_> = directory.iter().cloned().map(resource_events::place).collect();
    let bytes = SMALL.saturating_mul(places.len());
    sink.push(TimedEvent::of_event(now(), ViewEvent::Directory(places), bytes));
}

/// Returns the daemons that host agents, without this process if it is a guest.
fn daemons(view: &EcosystemView, place: ObserverPlace) -> impl Iterator<Item = DaemonId> {
    let directory = view.router.directory();
    let daemons: BTreeSet<_> = directory.iter().map(|resident| resident.daemon.clone()).collect();
    let own = view.router.daemon().clone();
    let is_shown = move |daemon: &DaemonId| place == ObserverPlace::Daemon || *daemon != own;
    daemons.into_iter().filter(is_shown)
}

/// Queries one resource, and queues the answers.
async fn poll(view: EcosystemView, resource: Resource, sink: Arc<impl EventSink>) {
    let asked_at = now();
    let (events, bytes) = query(&view, resource).await;
    let each = bytes / events.len().max(1) + SMALL;
    for event in events {
        sink.push(TimedEvent::of_event(now().max(asked_at), event, each));
    }
}

/// Queries one resource. Returns the events of the answers, and their size.
pub(crate) async fn query(view: &EcosystemView, resource: Resource) -> (Vec<ViewEvent>, usize) {
    let agent = resource_events::agent_asked(resource, view.roles());
    let query = ResourceQuery { daemon: None, resource, agent };
    let answers = view.router.ask(query, ANSWERED_WITHIN).await;
    let bytes = answers.iter().map(Bytes::len).sum();
    (resource_events::events(resource, &answers), bytes)
}

/// Measures the round trips to the daemons, and queues them with the daemons' reports.
async fn measure(
    view: EcosystemView,
    place: ObserverPlace,
    round: usize,
    sink: Arc<impl EventSink>,
) {
    let all: Vec<_> = daemons(&view, place).collect();
    let first = round.wrapping_sub(1).wrapping_mul(MEASURED_MAX) % all.len().max(1);
    let chosen = all.iter().cycle().skip(first).take(MEASURED_MAX.min(all.len()));
    for daemon in chosen {
        for event in round_trip(&view, daemon).await {
            push(&*sink, event);
        }
    }
}

/// Measures the round trip to one daemon by a query for its report.
pub(crate) async fn round_trip(view: &EcosystemView, daemon: &DaemonId) -> Vec<ViewEvent> {
    let (resource, asked) = (Resource::Daemon, Instant::now());
    let query = ResourceQuery { daemon: Some(daemon.clone()), resource, agent: None };
    let answers = view.router.ask(query, ROUND_TRIP_MAX).await;
    let micros = u64::try_from(asked.elapsed().as_micros()).unwrap_or(u64::MAX);
    let Some(answer) = answers.first() else {
        return vec![ViewEvent::NoAnswer(daemon.clone())];
    };
    let report = serde_json::from_slice(answer).ok().map(ViewEvent::Daemon);
    let round_trip = ViewEvent::RoundTrip { daemon: daemon.clone(), micros };
    std::iter::once(round_trip).chain(report).collect()
}
