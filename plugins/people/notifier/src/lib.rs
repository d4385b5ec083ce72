//! The notifier: tells people elsewhere of questions, lost and late goals, agents that are gone,
//! and stops (docs/notifications.md).
//!
//! - The agent overhears all messages. `watcher` makes notices out of them, without a clock.
//! - Each channel has a `notice_queue`: quiet hours, a rate, an end, and pauses after failures. A
//!   channel that is down keeps nothing else waiting.
//! - `webhook`, `ntfy`, `mail` and `web_push` send; `sentences` has the texts, `http` and `trust`
//!   the connections.
//! - Of several replicas the leader sends. A standby remembers the notices of the last moments and
//!   those that wait for the end of quiet hours, and sends them if the leader dies; both give a
//!   notice the same identifier.

mod address;
#[cfg(test)]
mod agent_tests;
mod channel;
mod channel_rules;
mod channel_secret;
mod config;
#[cfg(test)]
mod deliveries;
mod http;
mod mail;
mod notice;
mod notice_queue;
mod ntfy;
mod quiet_hours;
#[cfg(test)]
mod receiver;
mod recent_table;
mod saved_queues;
mod send_failure;
mod sentences;
mod trust;
mod watcher;
mod web_push;
mod webhook;

use std::collections::{HashMap, VecDeque};
use std::path::PathBuf;
use std::time::{Duration, UNIX_EPOCH};

use acl::content::{GoalStatus, OpenQuestion};
use agent::{
    Agent, Blueprint, BuildError, Callbacks, Context, LaunchableAgent, OverheardBatch, PluginEntry,
    Presence, Resource, ResourceQuery, StateFolder, TimerId, WorkHandle,
};
use jiff::tz::TimeZone;
use tokio::time::Instant;

use crate::channel::NotifierChannel;
use crate::notice::{Notice, NoticeKind, NoticeTime, shortened};
use crate::notice_queue::{NoticeQueue, QueueStep};
use crate::saved_queues::SavedQueues;
use crate::send_failure::SendFailure;
use crate::watcher::{NoticeWatcher, WatchedNews};
pub use crate::web_push::push_store::{PushKeys, PushStore, PushStoreError, PushSubscription};

/// Maximum number of overheard messages that wait for the agent; further ones are lost.
const OVERHEARD_MAX: usize = 8_192;

/// Time after the start in which agents and stops that appear were there before.
const START: Duration = Duration::from_secs(2);

/// Time for which a standby remembers notices: a leader's death is noticed within it, and what the
/// leader has sent in it arrives twice.
const REMEMBERED: Duration = Duration::from_secs(20);

/// Maximum number of notices that a standby remembers.
const REMEMBERED_MAX: usize = 256;

/// Time limit of the search for the number of a question. Without it a notice has no buttons.
const NUMBER_WITHIN: Duration = Duration::from_millis(500);

/// Time before that search in which the question reaches the keyboards.
const NUMBER_AFTER: Duration = Duration::from_millis(50);

/// Maximum number of such searches at a time; further questions are told without a number.
const NUMBERS_MAX: usize = 32;

/// Longest wait before a queue is looked at again: the clock of the machine may be set.
const WAIT_MAX: Duration = Duration::from_secs(60);

/// Shortest wait before a queue is looked at again: its times are rounded to milliseconds.
const WAIT_MIN: Duration = Duration::from_millis(1);

/// How often losses are logged.
const LOGGED_EVERY: Duration = Duration::from_secs(60);

/// Time between two writes of the queues.
const SAVED_EVERY: Duration = Duration::from_secs(1);

/// The entry of the notifier in the daemon's table of plugins.
pub const PLUGIN: PluginEntry = PluginEntry {
    name: "notifier",
    about: "tells people elsewhere of questions, lost or late goals, missing agents, and stops",
    drivers: &[],
    has_replicas: true,
    build,
};

fn build(blueprint: Blueprint) -> Result<Box<dyn LaunchableAgent>, BuildError> {
    let settings = config::settings(&blueprint)?;
    let folder = blueprint.host.resources.get::<StateFolder>();
    let file = folder.map(|folder| folder.0.join(format!("{}.notices.json", blueprint.id)));
    let gone_after_ms = u64::try_from(settings.gone_after.as_millis()).unwrap_or(u64::MAX);
    Ok(Box::new(NotifierAgent {
        channels: settings.channels.into_iter().map(ChannelState::new).collect(),
        watcher: NoticeWatcher::new(gone_after_ms),
        began: None,
        is_leading: false,
        remembered: VecDeque::new(),
        due: None,
        goals_query: None,
        numbers: HashMap::new(),
        missed: 0,
        saved: SavedQueues::new(file),
    }))
}

/// The agent.
struct NotifierAgent {
    channels: Vec<ChannelState>,
    watcher: NoticeWatcher,
    /// Time of the activation.
    began: Option<Instant>,
    is_leading: bool,
    /// The notices of the last moments, while another replica leads.
    remembered: VecDeque<(u64, Notice)>,
    /// Timer of what the watcher waits for.
    due: Option<TimerId>,
    goals_query: Option<WorkHandle>,
    /// Questions that wait for their numbers, by notice.
    numbers: HashMap<String, NumberSearch>,
    /// Messages that were lost or could not be read, since they were logged last.
    missed: u64,
    saved: SavedQueues,
}

/// The search for the number of a question.
struct NumberSearch {
    notice: Notice,
    query: Option<WorkHandle>,
}

/// A channel, with its queue and what is under way.
struct ChannelState {
    channel: NotifierChannel,
    queue: NoticeQueue,
    sending: Option<WorkHandle>,
    timer: Option<TimerId>,
}

// === impl ChannelState ===

impl ChannelState {
    fn new(channel: NotifierChannel) -> ChannelState {
        let queue = NoticeQueue::new(channel.rules.clone(), TimeZone::system());
        ChannelState { channel, queue, sending: None, timer: None }
    }
}

impl Agent for NotifierAgent {
    fn callbacks(&self) -> Callbacks<Self> {
        Callbacks::new()
    }

    fn activated(&mut self, ctx: &mut Context<Self>) {
        self.began = Some(ctx.now());
        for state in &mut self.channels {
            state.channel.form.ecosystem = ctx.ecosystem().as_str().to_owned();
        }
        if let Err(error) = ctx.overhear(OVERHEARD_MAX, Self::heard) {
            tracing::error!(%error, "nobody is notified: the messages cannot be heard");
        }
        self.fetch_goals(ctx);
        self.prepare_files(ctx);
        ctx.after(LOGGED_EVERY, Self::log_losses);
        ctx.after(SAVED_EVERY, Self::save);
    }

    fn leadership_changed(&mut self, is_leading: bool, ctx: &mut Context<Self>) {
        self.is_leading = is_leading;
        if !is_leading {
            // The new leader has noticed the same.
            return;
        }
        let now = self.now(ctx);
        self.channels.iter_mut().for_each(|state| state.queue.take_over(now));
        for (_, notice) in std::mem::take(&mut self.remembered) {
            self.channels.iter_mut().for_each(|state| state.queue.add(notice.clone(), now));
        }
        self.pump_all(ctx);
    }

    fn presence(&mut self, presence: &Presence, ctx: &mut Context<Self>) {
        let now = self.now(ctx);
        let is_start = self.is_start(now);
        self.watcher.presence(presence, is_start, now);
        self.take_news(ctx);
    }

    fn drain(&mut self, ctx: &mut Context<Self>) -> bool {
        self.pump_all(ctx);
        // Quiet hours and a receiver that is away are not waited for; what waits is on disk.
        let is_done = !self.is_leading || self.channels.iter().all(|it| it.queue.is_at_rest());
        is_done && self.saved.is_written(&mut self.channels, ctx)
    }
}

impl NotifierAgent {
    fn now(&self, ctx: &Context<Self>) -> NoticeTime {
        let steady = self.began.map(|began| ctx.now() - began).unwrap_or_default();
        let wall = ctx.wall_clock().duration_since(UNIX_EPOCH).unwrap_or_default();
        NoticeTime { steady_ms: millis(steady), wall_ms: millis(wall) }
    }

    fn is_start(&self, now: NoticeTime) -> bool {
        now.steady_ms < millis(START)
    }

    // === what happens ===

    fn heard(&mut self, batch: OverheardBatch, ctx: &mut Context<Self>) {
        self.missed += batch.lost + batch.unreadable;
        let now = self.now(ctx);
        let is_start = self.is_start(now);
        for heard in &batch.messages {
            self.watcher.hear(&heard.message, is_start, now);
        }
        self.take_news(ctx);
    }

    /// Asks for the goals that are pursued already.
    fn fetch_goals(&mut self, ctx: &mut Context<Self>) {
        let query = ResourceQuery { daemon: None, resource: Resource::Goals, agent: None };
        let asked = ctx.query(query);
        self.goals_query = Some(ctx.run(asked, |notifier: &mut Self, answers, _| {
            for answer in answers {
                let goals: Vec<GoalStatus> = serde_json::from_slice(&answer).unwrap_or_default();
                goals.iter().for_each(|goal| notifier.watcher.goal_known(goal));
            }
        }));
    }

    /// Takes what the watcher has noticed, and waits for what is due later.
    fn take_news(&mut self, ctx: &mut Context<Self>) {
        let now = self.now(ctx);
        self.watcher.tick(now);
        let news = self.watcher.take_news();
        let has_news = !news.is_empty();
        for news in news {
            match news {
                WatchedNews::Settled(id) => {
                    self.numbers.remove(&id);
                    self.remembered.retain(|(_, notice)| notice.id != id);
                    self.channels.iter_mut().for_each(|state| state.queue.settle(&id));
                }
                WatchedNews::Noticed(notice) if notice.kind == NoticeKind::Question => {
                    self.find_number(notice, ctx);
                }
                WatchedNews::Noticed(notice) => self.tell(notice, ctx),
            }
        }
        if has_news {
            self.pump_all(ctx);
        }
        if let Some(due) = self.due.take() {
            ctx.cancel_timer(due);
        }
        self.due = self.watcher.next_due_ms().map(|due_ms| {
            let wait = Duration::from_millis(due_ms.saturating_sub(now.steady_ms).max(1));
            ctx.after(wait, |notifier: &mut Self, ctx| {
                notifier.due = None;
                notifier.take_news(ctx);
            })
        });
    }

    /// Finds the keyboard and the number by which a question is answered, and tells people then.
    fn find_number(&mut self, notice: Notice, ctx: &mut Context<Self>) {
        if !self.is_leading || self.numbers.len() >= NUMBERS_MAX {
            return self.tell(notice, ctx);
        }
        let id = notice.id.clone();
        self.numbers.insert(id.clone(), NumberSearch { notice, query: None });
        ctx.after(NUMBER_AFTER, move |notifier: &mut Self, ctx| {
            // The question may have been answered already.
            let Some(search) = notifier.numbers.get_mut(&id) else { return };
            let query = ResourceQuery { daemon: None, resource: Resource::Questions, agent: None };
            let asked = ctx.query(query);
            let asked =
                async move { tokio::time::timeout(NUMBER_WITHIN, asked).await.unwrap_or_default() };
            search.query = Some(ctx.run(asked, move |notifier: &mut Self, answers, ctx| {
                let Some(NumberSearch { notice, .. }) = notifier.numbers.remove(&id) else {
                    return;
                };
                notifier.tell(numbered(notice, &answers), ctx);
                notifier.pump_all(ctx);
            }));
        });
    }

    /// Adds a notice to each channel. While another replica leads, remembers it for some moments, and
    /// keeps it for channels where it waits for the end of quiet hours.
    fn tell(&mut self, notice: Notice, ctx: &mut Context<Self>) {
        let now = self.now(ctx);
        if self.is_leading {
            return self.channels.iter_mut().for_each(|state| state.queue.add(notice.clone(), now));
        }
        for state in &mut self.channels {
            state.queue.keep_for_leader(notice.clone(), REMEMBERED, now);
        }
        let oldest_ms = now.steady_ms.saturating_sub(millis(REMEMBERED));
        self.remembered.retain(|(at_ms, _)| *at_ms >= oldest_ms);
        if self.remembered.len() >= REMEMBERED_MAX {
            self.remembered.pop_front();
        }
        self.remembered.push_back((now.steady_ms, notice));
    }

    // === channels ===

    fn pump_all(&mut self, ctx: &mut Context<Self>) {
        for index in 0..self.channels.len() {
            self.pump(index, ctx);
        }
    }

    /// Sends what a channel may send now, or waits until it may.
    fn pump(&mut self, index: usize, ctx: &mut Context<Self>) {
        if !self.is_leading {
            return;
        }
        let now = self.now(ctx);
        let Some(state) = self.channels.get_mut(index) else { return };
        if let Some(timer) = state.timer.take() {
            ctx.cancel_timer(timer);
        }
        match state.queue.next(now) {
            QueueStep::Rest => (),
            QueueStep::Wait(wait) => {
                let wait = wait.clamp(WAIT_MIN, WAIT_MAX);
                state.timer = Some(ctx.after(wait, move |notifier: &mut Self, ctx| {
                    notifier.pump(index, ctx);
                }));
            }
            QueueStep::Send(delivery) => {
                let (target, form) = (state.channel.target.clone(), state.channel.form.clone());
                let sent = target.send(delivery, form);
                state.sending = Some(ctx.run(sent, move |notifier: &mut Self, outcome, ctx| {
                    notifier.sent(index, outcome, ctx);
                }));
            }
        }
    }

    fn sent(&mut self, index: usize, outcome: Result<(), SendFailure>, ctx: &mut Context<Self>) {
        let now = self.now(ctx);
        let Some(state) = self.channels.get_mut(index) else { return };
        state.sending = None;
        let channel = &state.channel.name;
        match outcome {
            Ok(()) => state.queue.delivered(),
            Err(SendFailure::Later { why, pause }) => {
                // Logged once; the channel is tried again until it works.
                if state.queue.failed(pause, now) {
                    tracing::warn!(channel, "failed to {why}; its notices wait");
                }
            }
            Err(SendFailure::Never(why)) => {
                tracing::warn!(channel, "failed to {why}; the notice is dropped");
                state.queue.refused();
            }
        }
        self.pump(index, ctx);
    }

    fn log_losses(&mut self, ctx: &mut Context<Self>) {
        if !self.is_leading {
            let now = self.now(ctx);
            self.channels.iter_mut().for_each(|state| state.queue.forget_kept(now));
        }
        let missed = std::mem::take(&mut self.missed);
        if missed > 0 {
            tracing::warn!(missed, "messages were missed: people may not be told of something");
        }
        for state in &mut self.channels {
            let dropped = state.queue.take_dropped();
            if dropped > 0 {
                tracing::warn!(channel = %state.channel.name, dropped, "notices were dropped");
            }
        }
        ctx.after(LOGGED_EVERY, Self::log_losses);
    }

    // === files ===

    /// Reads what waited in an earlier process, and prepares the store of subscriptions.
    fn prepare_files(&mut self, ctx: &mut Context<Self>) {
        let pushes: Vec<_> = self.channels.iter().filter_map(|it| it.channel.push()).collect();
        let file = self.saved.file().map(PathBuf::from);
        let prepared = ctx.run_blocking(move || {
            for push in pushes {
                if let Err(error) = push.prepare() {
                    tracing::error!("no browser can subscribe: failed to {error}");
                }
            }
            file.map(|file| saved_queues::read(&file)).unwrap_or_default()
        });
        self.saved.work = Some(ctx.run(prepared, |notifier: &mut Self, saved, ctx| {
            notifier.saved.work = None;
            for (name, waiting) in saved.unwrap_or_default() {
                let state = notifier.channels.iter_mut().find(|it| it.channel.name == name);
                if let Some(state) = state {
                    state.queue.restore(waiting);
                }
            }
            notifier.pump_all(ctx);
        }));
    }

    fn save(&mut self, ctx: &mut Context<Self>) {
        self.saved.is_written(&mut self.channels, ctx);
        ctx.after(SAVED_EVERY, Self::save);
    }
}

/// Returns the notice of a question with the keyboard and the number by which it is answered, if the
/// answers to a query for open questions have it.
fn numbered(notice: Notice, answers: &[impl AsRef<[u8]>]) -> Notice {
    let lists = answers.iter().map(|answer| serde_json::from_slice(answer.as_ref()));
    let open = lists.filter_map(Result::<Vec<OpenQuestion>, _>::ok).flatten();
    let mut same = open
        .filter(|open| notice.agents.contains(&open.from) && shortened(&open.text) == notice.text);
    let asked_at = same.next().map(|open| (open.keyboard, open.question));
    Notice { asked_at, ..notice }
}

fn millis(time: Duration) -> u64 {
    u64::try_from(time.as_millis()).unwrap_or(u64::MAX)
}
