//! The notices that wait for one channel: which goes next, and when. The queue has no clock and no
//! connection: its owner sends, and tells how that ended.
//!
//! - In quiet hours everything waits but stops, unless `quiet-stops` says that they wait, too.
//! - A channel sends at most so many notices in an hour; twice as many if they are about stops.
//! - What had to wait goes as one summary, but questions, which need an answer each.
//! - A replica that stands by keeps what quiet hours hold back, until the leader has sent it.
//! - A notice that is too old, and a question whose deadline has passed, are dropped.

use std::collections::VecDeque;
use std::time::Duration;

use jiff::Timestamp;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};

use crate::channel_rules::ChannelRules;
use crate::notice::{Notice, NoticeDelivery, NoticeKind, NoticeTime, notice_id};

/// Maximum number of notices that wait for a channel. The oldest gives way, and is counted.
const WAITING_MAX: usize = 256;

/// Age at which a notice is dropped: it is no news any more, and all quiet hours are over.
const GIVEN_UP_AFTER_MS: u64 = 24 * HOUR_MS;

/// Time to which the limit of a rate refers.
const HOUR_MS: u64 = 3_600_000;

/// Pause after the first failure; each further one doubles it.
const PAUSE_FIRST: Duration = Duration::from_secs(1);

/// Greatest pause between two attempts. A receiver that is back is noticed within this time.
const PAUSE_MAX: Duration = Duration::from_secs(300);

/// Greatest pause that a receiver may ask for.
const ASKED_PAUSE_MAX: Duration = Duration::from_secs(3_600);

/// Factor by which stops may exceed the rate of a channel.
const URGENT_FACTOR: usize = 2;

/// What the owner of a queue does next.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum QueueStep {
    /// Sends this, and tells the outcome.
    Send(NoticeDelivery),
    /// Asks again after this time, or when a notice is added.
    Wait(Duration),
    /// Nothing waits, or something is under way.
    Rest,
}

/// A notice that waits.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct WaitingNotice {
    notice: Notice,
    /// Whether quiet hours, the rate or a failure have kept the notice back.
    is_held: bool,
    /// Time of day, in milliseconds since 1970-01-01 UTC, until which this replica keeps the notice for
    /// the leader, which has it, too; `None` if this replica is to send it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    kept_until_ms: Option<u64>,
}

/// The notices that wait for one channel.
#[derive(Debug)]
pub(crate) struct NoticeQueue {
    rules: ChannelRules,
    zone: TimeZone,
    waiting: VecDeque<WaitingNotice>,
    /// What is under way.
    sent: Option<NoticeDelivery>,
    /// Times of the last sendings, by the steady clock, oldest first.
    sent_at: VecDeque<u64>,
    pause: Option<Duration>,
    /// Time before which nothing is sent, by the steady clock.
    not_before_ms: u64,
    dropped: u64,
    /// Whether the queue differs from the one that was saved last.
    is_changed: bool,
}

// === impl NoticeQueue ===

impl NoticeQueue {
    pub(crate) fn new(rules: ChannelRules, zone: TimeZone) -> NoticeQueue {
        NoticeQueue {
            rules,
            zone,
            waiting: VecDeque::new(),
            sent: None,
            sent_at: VecDeque::new(),
            pause: None,
            not_before_ms: 0,
            dropped: 0,
            is_changed: false,
        }
    }

    /// Adds a notice, if the channel is for it and it is not there.
    pub(crate) fn add(&mut self, notice: Notice, now: NoticeTime) {
        self.put(notice, None, now);
    }

    fn put(&mut self, notice: Notice, kept_until_ms: Option<u64>, now: NoticeTime) {
        let is_known = self.waiting.iter().any(|waiting| waiting.notice.id == notice.id);
        if is_known || !self.rules.events.contains(&notice.kind.event()) || self.has_ended(now) {
            return;
        }
        let is_held = self.is_quiet_for(notice.kind, now)
            || self.rate_pause(notice.kind, now).is_some()
            || self.pause.is_some();
        if self.waiting.len() >= WAITING_MAX {
            self.drop_oldest();
        }
        self.waiting.push_back(WaitingNotice { notice, is_held, kept_until_ms });
        self.is_changed = true;
    }

    /// Keeps a notice that another replica, which leads, holds back until quiet hours end: that one may
    /// die until then. It is kept for the time `longer` beyond their end. Other notices are not kept.
    pub(crate) fn keep_for_leader(&mut self, notice: Notice, longer: Duration, now: NoticeTime) {
        if !self.is_quiet_for(notice.kind, now) {
            return;
        }
        let kept = self.until_loud(now).saturating_add(longer);
        let kept_ms = u64::try_from(kept.as_millis()).unwrap_or(u64::MAX);
        self.put(notice, Some(now.wall_ms.saturating_add(kept_ms)), now);
    }

    /// Drops what was kept for the leader and has been sent by it meanwhile.
    pub(crate) fn forget_kept(&mut self, now: NoticeTime) {
        let before = self.waiting.len();
        self.waiting
            .retain(|waiting| waiting.kept_until_ms.is_none_or(|until| until > now.wall_ms));
        self.is_changed |= self.waiting.len() != before;
    }

    /// Sends from now on what was kept for the leader, as this replica leads.
    pub(crate) fn take_over(&mut self, now: NoticeTime) {
        self.forget_kept(now);
        for waiting in &mut self.waiting {
            self.is_changed |= waiting.kept_until_ms.take().is_some();
        }
    }

    /// Drops what was settled before it was sent.
    pub(crate) fn settle(&mut self, id: &str) {
        let before = self.waiting.len();
        let is_sent = |id: &str| {
            self.sent.iter().flat_map(|sent| &sent.notices).any(|notice| notice.id == id)
        };
        if !is_sent(id) {
            self.waiting.retain(|waiting| waiting.notice.id != id);
        }
        self.is_changed |= self.waiting.len() != before;
    }

    /// Returns what to do now.
    pub(crate) fn next(&mut self, now: NoticeTime) -> QueueStep {
        self.expire(now);
        if self.sent.is_some() || self.waiting.is_empty() {
            return QueueStep::Rest;
        }
        if now.steady_ms < self.not_before_ms {
            return QueueStep::Wait(millis(self.not_before_ms - now.steady_ms));
        }
        for position in 0..self.waiting.len() {
            if self.is_quiet_for(self.waiting[position].notice.kind, now) {
                self.waiting[position].is_held = true;
            }
        }
        let Some(first) = self.first(now) else {
            return QueueStep::Wait(self.until_loud(now));
        };
        if let Some(pause) = self.rate_pause(first.kind, now) {
            self.waiting.iter_mut().for_each(|waiting| waiting.is_held = true);
            return QueueStep::Wait(pause);
        }
        let delivery = self.delivery(first, now);
        self.sent_at.push_back(now.steady_ms);
        self.sent = Some(delivery.clone());
        QueueStep::Send(delivery)
    }

    /// Notes that what was under way has arrived.
    pub(crate) fn delivered(&mut self) {
        self.take_sent();
        self.pause = None;
    }

    /// Notes that what was under way will never be taken.
    pub(crate) fn refused(&mut self) {
        self.dropped += self.take_sent();
    }

    /// Notes that the receiver is away or busy, and may ask for a pause. Returns whether this is
    /// the first failure in a row.
    pub(crate) fn failed(&mut self, asked: Option<Duration>, now: NoticeTime) -> bool {
        self.sent = None;
        self.sent_at.pop_back();
        let is_first = self.pause.is_none();
        let pause = self.pause.map_or(PAUSE_FIRST, |pause| (pause * 2).min(PAUSE_MAX));
        self.pause = Some(pause);
        let pause = asked.map_or(pause, |asked| asked.min(ASKED_PAUSE_MAX).max(pause));
        let pause_ms = u64::try_from(pause.as_millis()).unwrap_or(u64::MAX);
        self.not_before_ms = now.steady_ms.saturating_add(pause_ms);
        is_first
    }

    /// Returns the number of notices that were dropped since the last call.
    pub(crate) fn take_dropped(&mut self) -> u64 {
        std::mem::take(&mut self.dropped)
    }

    /// Whether nothing is under way.
    pub(crate) fn is_at_rest(&self) -> bool {
        self.sent.is_none()
    }

    /// Returns all that waits if it has changed since the last call.
    pub(crate) fn take_changed(&mut self) -> Option<Vec<WaitingNotice>> {
        std::mem::take(&mut self.is_changed).then(|| self.waiting.iter().cloned().collect())
    }

    /// Adds what has waited in an earlier process, before all else.
    pub(crate) fn restore(&mut self, saved: Vec<WaitingNotice>) {
        for waiting in saved.into_iter().take(WAITING_MAX).rev() {
            let is_known = self.waiting.iter().any(|known| known.notice.id == waiting.notice.id);
            if !is_known && self.waiting.len() < WAITING_MAX {
                self.waiting.push_front(waiting);
            }
        }
    }

    fn take_sent(&mut self) -> u64 {
        let sent = self.sent.take().map(|sent| sent.notices).unwrap_or_default();
        self.waiting.retain(|waiting| !sent.iter().any(|sent| sent.id == waiting.notice.id));
        self.is_changed = true;
        u64::try_from(sent.len()).unwrap_or(u64::MAX)
    }

    /// Returns the notice that goes next: stops first, then the oldest that may be sent.
    fn first(&self, now: NoticeTime) -> Option<Notice> {
        let loud = || {
            let notices = self.waiting.iter().map(|waiting| &waiting.notice);
            notices.filter(|notice| !self.is_quiet_for(notice.kind, now))
        };
        loud().find(|notice| notice.kind.is_urgent()).or_else(|| loud().next()).cloned()
    }

    /// Returns the notice alone, or with all others that were held back.
    fn delivery(&self, first: Notice, now: NoticeTime) -> NoticeDelivery {
        let is_summed_up = |notice: &Notice| {
            !notice.kind.is_urgent()
                && notice.kind != NoticeKind::Question
                && !self.is_quiet_for(notice.kind, now)
        };
        let held = self.waiting.iter().filter(|it| it.is_held && is_summed_up(&it.notice));
        let held: Vec<_> = held.map(|it| it.notice.clone()).collect();
        if held.len() < 2 || !held.iter().any(|notice| notice.id == first.id) {
            return NoticeDelivery { id: first.id.clone(), notices: vec![first] };
        }
        let ids: Vec<_> = held.iter().map(|notice| notice.id.as_str()).collect();
        NoticeDelivery { id: notice_id("summary", &ids.join("\n")), notices: held }
    }

    fn is_quiet_for(&self, kind: NoticeKind, now: NoticeTime) -> bool {
        let is_exempt = kind.is_urgent() && !self.rules.are_stops_quiet;
        let quiet = self.rules.quiet.filter(|_| !is_exempt);
        quiet.is_some_and(|quiet| quiet.is_quiet(timestamp(now.wall_ms), &self.zone))
    }

    /// Returns the time until the quiet hours end.
    fn until_loud(&self, now: NoticeTime) -> Duration {
        let at = timestamp(now.wall_ms);
        let end = self.rules.quiet.map_or(at, |quiet| quiet.end(at, &self.zone));
        Duration::try_from(end.duration_since(at)).unwrap_or_default()
    }

    /// Returns the time for which the rate forbids a notice of this kind; `None` if it allows one.
    fn rate_pause(&self, kind: NoticeKind, now: NoticeTime) -> Option<Duration> {
        let factor = if kind.is_urgent() { URGENT_FACTOR } else { 1 };
        let sent_max = usize::try_from(self.rules.per_hour).unwrap_or(usize::MAX) * factor;
        // The sending that has to be an hour ago, so that another one is allowed.
        let before = self.sent_at.len().checked_sub(sent_max)?;
        let free_ms = self.sent_at.get(before)?.saturating_add(HOUR_MS);
        free_ms.checked_sub(now.steady_ms).filter(|left| *left > 0).map(millis)
    }

    fn has_ended(&self, now: NoticeTime) -> bool {
        self.rules.until.is_some_and(|until| timestamp(now.wall_ms) >= until)
    }

    fn expire(&mut self, now: NoticeTime) {
        while self.sent_at.front().is_some_and(|at| at.saturating_add(HOUR_MS) <= now.steady_ms) {
            self.sent_at.pop_front();
        }
        if self.sent.is_some() {
            return;
        }
        let before = self.waiting.len();
        if self.has_ended(now) {
            self.waiting.clear();
        }
        self.waiting.retain(|waiting| waiting.notice.ends_ms.is_none_or(|end| end > now.wall_ms));
        let is_young = |at_ms: u64| now.wall_ms < at_ms.saturating_add(GIVEN_UP_AFTER_MS);
        let useful = self.waiting.len();
        self.waiting.retain(|waiting| is_young(waiting.notice.at_ms));
        // A question whose deadline has passed, and the end of a channel, are no losses.
        self.dropped += u64::try_from(useful - self.waiting.len()).unwrap_or(u64::MAX);
        self.is_changed |= self.waiting.len() != before;
    }

    /// Drops the oldest notice; stops are dropped last.
    fn drop_oldest(&mut self) {
        let sent = self.sent.iter().flat_map(|sent| &sent.notices).map(|notice| &notice.id);
        let sent: Vec<_> = sent.collect();
        let may_go = |waiting: &WaitingNotice| !sent.contains(&&waiting.notice.id);
        let calm = self.waiting.iter().position(|it| may_go(it) && !it.notice.kind.is_urgent());
        let oldest = calm.or_else(|| self.waiting.iter().position(may_go)).unwrap_or(0);
        self.waiting.remove(oldest);
        self.dropped += 1;
    }
}

fn millis(milliseconds: u64) -> Duration {
    Duration::from_millis(milliseconds)
}

/// Returns a time of day; the last one that can be expressed if it is later.
fn timestamp(wall_ms: u64) -> Timestamp {
    let ms = i64::try_from(wall_ms).unwrap_or(i64::MAX);
    Timestamp::from_millisecond(ms).unwrap_or(Timestamp::MAX)
}

#[cfg(test)]
mod tests;
