//! The view that a page shows: takes the observed events in batches, and counts the batches that
//! change it.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use acl::content::Snapshot;
use agent::Resource;
use live_view::{LiveView, ViewEvent, ViewLimits};
use tokio::sync::{Notify, watch};
use web_page::PageSetup;

use super::setup;
use crate::ecosystem_view::EcosystemView;
use crate::observing::{self, EventQueue, EventSink, TimedEvent};

/// How long events are gathered before the view takes them together. An eye does not notice it, and
/// a busy ecosystem takes the lock fifty times a second at most.
const GATHERED_FOR: Duration = Duration::from_millis(20);

/// Shortest interval between two queries of the domain for the setup. The answer of a large building
/// takes milliseconds, and many people may open the page at once.
const SETUP_ASKED_EVERY: Duration = Duration::from_secs(2);

/// Number of events that the view takes under one lock. Pages that read wait for it meanwhile, some
/// milliseconds.
const BATCH: usize = 256;

/// The queue between the transport and the view.
#[derive(Default)]
pub(super) struct PageInbox {
    queue: Mutex<EventQueue>,
    arrived: Notify,
}

/// The view, and the parts of the ecosystem that goals can be about.
pub(super) struct PageView {
    view: Mutex<LiveView>,
    batches: watch::Sender<u64>,
    setup: Mutex<PageSetup>,
    /// Epoch of the domain that `setup` describes; `None` before the first one. Facts change without
    /// an epoch, and are no part of the setup.
    described: Mutex<Option<u64>>,
    /// Time at which the domain was last queried for the setup; `None` before the first time.
    asked_at: Mutex<Option<Instant>>,
}

impl EventSink for PageInbox {
    fn push(&self, event: TimedEvent) {
        lock(&self.queue).push(event);
        self.arrived.notify_one();
    }
}

fn lock<T>(of: &Mutex<T>) -> MutexGuard<'_, T> {
    of.lock().unwrap_or_else(PoisonError::into_inner)
}

// === impl PageView ===

impl PageView {
    /// Creates the view of an ecosystem, before the first event.
    pub(super) fn new(view: &EcosystemView) -> PageView {
        let mut live = LiveView::new(view.name.clone(), ViewLimits::default());
        // A daemon is a part of the ecosystem, so that it reaches the ecosystem always.
        live.observe(observing::now(), ViewEvent::Reached(true));
        live.observe(observing::now(), observing::expected(view.ecosystem.as_deref()));
        let setup = PageSetup {
            ecosystem: view.name.clone(),
            daemon: view.router.daemon().clone(),
            types: Vec::new(),
            objects: Vec::new(),
            predicates: Vec::new(),
            actions: Vec::new(),
        };
        PageView {
            view: Mutex::new(live),
            batches: watch::Sender::new(0),
            setup: Mutex::new(setup),
            described: Mutex::default(),
            asked_at: Mutex::default(),
        }
    }

    /// Calls `reader` with the view, under its lock.
    pub(super) fn read<T>(&self, reader: impl FnOnce(&LiveView) -> T) -> T {
        reader(&lock(&self.view))
    }

    /// Returns a receiver of the number of batches that have changed the view otherwise than with
    /// time.
    pub(super) fn changes(&self) -> watch::Receiver<u64> {
        self.batches.subscribe()
    }

    /// Returns the parts of the ecosystem that goals can be about, as far as they are known.
    pub(super) fn setup(&self) -> PageSetup {
        lock(&self.setup).clone()
    }

    /// Queries the domain anew, unless that was done a moment ago: the view queries it seldom, and
    /// a person that begins to build a goal wants the agents that have come meanwhile.
    pub(super) fn refresh_setup(self: &Arc<Self>, view: &EcosystemView) {
        let now = Instant::now();
        let mut asked = lock(&self.asked_at);
        if asked.is_some_and(|asked| now.duration_since(asked) < SETUP_ASKED_EVERY) {
            return;
        }
        *asked = Some(now);
        drop(asked);
        let (page, view) = (Arc::clone(self), view.clone());
        tokio::spawn(async move {
            let (events, _) = observing::query(&view, Resource::Domain).await;
            for event in &events {
                if let ViewEvent::Domain(snapshot) = event {
                    page.describe(snapshot);
                }
            }
        });
    }

    /// Describes the domain of a snapshot, if it differs from the last one.
    fn describe(self: &Arc<Self>, snapshot: &Snapshot) {
        if lock(&self.described).replace(snapshot.epoch) == Some(snapshot.epoch) {
            return;
        }
        let (page, snapshot) = (Arc::clone(self), snapshot.clone());
        // Parsing the domain of a large building takes some milliseconds.
        tokio::task::spawn_blocking(move || {
            let empty = page.setup();
            if let Some(setup) = setup::describe(&snapshot, empty) {
                *lock(&page.setup) = setup;
            }
        });
    }

    fn take(self: &Arc<Self>, events: Vec<TimedEvent>, lost: u64) {
        // Messages are decoded before the lock is taken.
        let events: Vec<_> =
            events.into_iter().map(|event| (event.at, event.into_event())).collect();
        for (_, event) in &events {
            if let ViewEvent::Domain(snapshot) = event {
                self.describe(snapshot);
            }
        }
        let mut view = lock(&self.view);
        let before = view.revision();
        events.into_iter().for_each(|(at, event)| view.observe(at, event));
        if lost > 0 {
            view.observe(observing::now(), ViewEvent::Lost(lost));
        }
        let is_changed = view.revision() != before;
        drop(view);
        // Most batches are heartbeats without news.
        if is_changed {
            self.batches.send_modify(|count| *count = count.wrapping_add(1));
        }
    }
}

/// Passes the observed events to the view. Never returns.
pub(super) async fn feed(inbox: Arc<PageInbox>, page: Arc<PageView>) {
    loop {
        inbox.arrived.notified().await;
        tokio::time::sleep(GATHERED_FOR).await;
        let EventQueue { mut events, mut lost, .. } = std::mem::take(&mut *lock(&inbox.queue));
        while !events.is_empty() || lost > 0 {
            let batch = events.drain(..events.len().min(BATCH)).collect();
            page.take(batch, std::mem::take(&mut lost));
            // Other tasks of this thread go on between two batches.
            tokio::task::yield_now().await;
        }
    }
}
