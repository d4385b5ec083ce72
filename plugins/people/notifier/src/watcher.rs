//! Makes notices out of the messages of an ecosystem and the presence of its agents. The watcher
//! has no clock and no effect: time is a parameter, and notices are taken by its owner.
//!
//! **Invariants:** The content of an answer is never read, nor is the text of a report, which may
//! repeat what a person said. Tables are bounded; the oldest entry gives way.

mod absences;
mod stop_trace;
#[cfg(test)]
mod tests;

use acl::content::{
    Achieve, GoalLateness, GoalStatus, Outcome, Question, Reason, Refusal, Report, Request, Stop,
};
use acl::{
    AgentId, ConversationId, Incarnation, Message, MessageId, Performative, Protocol, ReplyToken,
};
use agent::Presence;

use self::absences::Absences;
use self::stop_trace::StopTrace;
use crate::notice::{Notice, NoticeKind, NoticeTime, shortened};
use crate::recent_table::RecentTable;

/// Maximum numbers of what is remembered.
const GOALS_MAX: usize = 4_096;
const QUESTIONS_MAX: usize = 1_024;
const MESSAGES_MAX: usize = 8_192;
const BEATS_MAX: usize = 20_000;

/// Maximum number of notices that wait to be taken; the owner takes them after each batch.
const NOTICES_MAX: usize = 1_024;

/// Longest identifier of a conversation, an exchange or a message, in bytes, that is remembered.
const IDENTIFIER_BYTES_MAX: usize = 256;

/// Time for which a question without a deadline counts as open, in milliseconds.
const WITHOUT_DEADLINE_MS: u64 = 3_600_000;

/// What the owner of a watcher learns.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum WatchedNews {
    /// People are to be told.
    Noticed(Notice),
    /// A question has got an answer or was withdrawn, and is not to be told any more.
    Settled(String),
}

#[derive(Debug)]
struct FollowedQuestion {
    id: String,
    from: AgentId,
    text: String,
    ends_steady_ms: u64,
}

/// Watches an ecosystem.
#[derive(Debug)]
pub(crate) struct NoticeWatcher {
    /// The texts of goals that have not ended.
    goals: RecentTable<ConversationId, String>,
    /// Goals of which a loss was noticed.
    lost_goals: RecentTable<ConversationId, ()>,
    /// Goals that were told as late, or as probably late.
    late_goals: RecentTable<(ConversationId, NoticeKind), ()>,
    questions: RecentTable<ReplyToken, FollowedQuestion>,
    stops: StopTrace,
    absences: Absences,
    /// The newest heartbeat of each agent: an older one may come after it.
    beats: RecentTable<AgentId, (Incarnation, u64)>,
    /// Identifiers of messages that were heard: a retry has the same one.
    heard: RecentTable<MessageId, ()>,
    news: Vec<WatchedNews>,
}

// === impl NoticeWatcher ===

impl NoticeWatcher {
    /// Creates a watcher. An agent is gone when it is away for longer than `gone_after_ms`.
    pub(crate) fn new(gone_after_ms: u64) -> NoticeWatcher {
        NoticeWatcher {
            goals: RecentTable::new(GOALS_MAX),
            lost_goals: RecentTable::new(GOALS_MAX),
            late_goals: RecentTable::new(GOALS_MAX),
            questions: RecentTable::new(QUESTIONS_MAX),
            stops: StopTrace::new(),
            absences: Absences::new(gone_after_ms),
            beats: RecentTable::new(BEATS_MAX),
            heard: RecentTable::new(MESSAGES_MAX),
            news: Vec::new(),
        }
    }

    /// Takes what was noticed since the last call.
    pub(crate) fn take_news(&mut self) -> Vec<WatchedNews> {
        std::mem::take(&mut self.news)
    }

    /// Takes a message. `is_start` states whether the watcher begins: stops that agents repeat then
    /// were in force before.
    pub(crate) fn hear(&mut self, message: &Message, is_start: bool, now: NoticeTime) {
        if !has_short_names(message) {
            return;
        }
        if message.protocol.is_none() && message.performative == Performative::Inform {
            return self.hear_announcement(message, is_start, now);
        }
        if self.heard.contains(&message.id) {
            return;
        }
        self.heard.insert(message.id.clone(), ());
        match message.protocol {
            Some(Protocol::Goal) => self.hear_goal(message, now),
            Some(Protocol::StateChange) => self.hear_change(message, now),
            Some(Protocol::Query) => self.hear_query(message, now),
            _ => (),
        }
    }

    /// Takes a change of presence. `is_start` states whether the watcher begins.
    pub(crate) fn presence(&mut self, presence: &Presence, is_start: bool, now: NoticeTime) {
        self.absences.presence(presence, is_start, now.steady_ms);
    }

    /// Takes the status of a goal that was asked for before the watcher began.
    pub(crate) fn goal_known(&mut self, status: &GoalStatus) {
        let id = &status.conversation;
        if id.as_str().len() <= IDENTIFIER_BYTES_MAX && !self.goals.contains(id) {
            self.goals.insert(id.clone(), shortened(&status.goal));
        }
    }

    /// Notices what is due now: agents that are away for long, and those that are back.
    pub(crate) fn tick(&mut self, now: NoticeTime) {
        for notice in self.absences.due(now) {
            self.notice(notice);
        }
    }

    /// Returns the next time at which [`NoticeWatcher::tick`] has something to do, on the steady
    /// clock.
    pub(crate) fn next_due_ms(&self) -> Option<u64> {
        self.absences.next_due_ms()
    }

    fn notice(&mut self, notice: Notice) {
        if self.news.len() < NOTICES_MAX {
            self.news.push(WatchedNews::Noticed(notice));
        }
    }

    // === goals ===

    fn hear_goal(&mut self, message: &Message, now: NoticeTime) {
        let id = &message.conversation_id;
        match message.performative {
            Performative::Request => {
                let Ok(request) = message.content_as::<Request>() else { return };
                let Some(Achieve { goal, .. }) = request.goal() else { return };
                self.goals.insert(id.clone(), shortened(goal));
            }
            Performative::Confirm => {
                let Ok(report) = message.content_as::<Report>() else { return };
                match report.outcome {
                    Outcome::Failed => self.goal_lost(id, now),
                    Outcome::Done | Outcome::Cancelled => {
                        self.goals.remove(id);
                    }
                    Outcome::Progress => self.goal_late(id, report.lateness, now),
                    Outcome::Holds => (),
                }
            }
            Performative::Refuse => {
                let Ok(refusal) = message.content_as::<Refusal>() else { return };
                if is_loss(refusal.reason) && self.goals.contains(id) {
                    self.goal_lost(id, now);
                }
            }
            _ => (),
        }
    }

    fn goal_lost(&mut self, id: &ConversationId, now: NoticeTime) {
        let goal = self.goals.remove(id).unwrap_or_default();
        if self.lost_goals.contains(id) {
            return;
        }
        self.lost_goals.insert(id.clone(), ());
        let notice = Notice::new(NoticeKind::GoalLost, id.as_str(), now.wall_ms);
        let notice = Notice { conversation: Some(id.clone()), ..notice };
        self.notice(notice.with_text(&goal));
    }

    fn goal_late(&mut self, id: &ConversationId, lateness: Option<GoalLateness>, now: NoticeTime) {
        let kind = match lateness {
            Some(GoalLateness::Late) => NoticeKind::GoalLate,
            Some(GoalLateness::Expected) => NoticeKind::GoalLateSoon,
            Some(GoalLateness::Other) | None => return,
        };
        let key = (id.clone(), kind);
        if self.late_goals.contains(&key) {
            return;
        }
        self.late_goals.insert(key, ());
        let goal = self.goals.get_mut(id).cloned().unwrap_or_default();
        let notice = Notice::new(kind, id.as_str(), now.wall_ms);
        let notice = Notice { conversation: Some(id.clone()), ..notice };
        self.notice(notice.with_text(&goal));
    }

    // === questions ===

    fn hear_query(&mut self, message: &Message, now: NoticeTime) {
        let Some(token) = message.exchange() else { return };
        match message.performative {
            Performative::QueryRef => {
                let Ok(question) = message.content_as::<Question>() else { return };
                self.question_asked(message, token, &question, now);
            }
            // Only the fact of an answer counts; its content is not looked at.
            Performative::Inform | Performative::Cancel => self.question_settled(token, now),
            _ => (),
        }
    }

    fn question_asked(
        &mut self,
        message: &Message,
        token: &ReplyToken,
        question: &Question,
        now: NoticeTime,
    ) {
        let (from, text) = (message.sender.clone(), shortened(&question.text));
        let within = message.reply_within.map(u64::from);
        let ends_steady_ms = now.steady_ms.saturating_add(within.unwrap_or(WITHOUT_DEADLINE_MS));
        // The same question is asked of each keyboard that comes later, in an exchange of its own.
        let same = self.questions.iter().map(|(_, open)| open).find(|open| {
            open.from == from && open.text == text && open.ends_steady_ms > now.steady_ms
        });
        let known = same.map(|open| open.id.clone());
        let mut notice = Notice::new(NoticeKind::Question, &format!("{from} {token}"), now.wall_ms);
        notice.ends_ms = within.map(|within| now.wall_ms.saturating_add(within));
        let notice = notice.with_text(&text).with_agents(vec![from.clone()]);
        let id = known.clone().unwrap_or_else(|| notice.id.clone());
        self.questions.insert(token.clone(), FollowedQuestion { id, from, text, ends_steady_ms });
        if known.is_none() {
            self.notice(notice);
        }
    }

    fn question_settled(&mut self, token: &ReplyToken, now: NoticeTime) {
        let Some(settled) = self.questions.remove(token) else { return };
        let is_open =
            |open: &FollowedQuestion| open.id == settled.id && open.ends_steady_ms > now.steady_ms;
        // Another exchange about the same question goes on until its own end.
        let goes_on = self.questions.iter().any(|(_, open)| is_open(open));
        if !goes_on && self.news.len() < NOTICES_MAX {
            self.news.push(WatchedNews::Settled(settled.id));
        }
    }

    // === stops and heartbeats ===

    fn hear_change(&mut self, message: &Message, now: NoticeTime) {
        if message.performative != Performative::Request {
            return;
        }
        match message.content_as::<Request>() {
            Ok(Request::Stop(stop)) => {
                let is_new = self.stops.requested(&stop);
                if is_new {
                    self.stop_noticed(&stop, now);
                }
            }
            Ok(Request::ReleaseStops(release)) => {
                let released = self.stops.released(&release.ids);
                self.release_noticed(&released, Some(&message.sender), now);
            }
            _ => (),
        }
    }

    fn hear_announcement(&mut self, message: &Message, is_start: bool, now: NoticeTime) {
        let sender = &message.sender;
        match message.content.get("of").and_then(serde_json::Value::as_str) {
            Some("heartbeat" | "model") => {
                let number = message.content.get("sequence").and_then(serde_json::Value::as_u64);
                let beat = (message.incarnation, number.unwrap_or_default());
                if self.beats.get_mut(sender).is_some_and(|newest| beat < *newest) {
                    return;
                }
                self.beats.insert(sender.clone(), beat);
                let stops = message.content.get("stops");
                let stops: Vec<Stop> = stops
                    .and_then(|stops| serde::Deserialize::deserialize(stops).ok())
                    .unwrap_or_default();
                self.absences.heard(sender, now.steady_ms);
                let (new, gone) = self.stops.repeated(sender, &stops);
                for stop in new.iter().filter(|_| !is_start) {
                    self.stop_noticed(stop, now);
                }
                self.release_noticed(&gone, None, now);
            }
            Some("epoch") => {
                let Ok(change) = message.content_as::<acl::content::EpochChange>() else {
                    return;
                };
                self.absences.changed(&change.left, &change.joined, now.steady_ms);
            }
            _ => (),
        }
    }

    fn stop_noticed(&mut self, stop: &Stop, now: NoticeTime) {
        let notice = Notice::new(NoticeKind::Stop, &stop.id, now.wall_ms);
        let scope = stop.scope.iter().take(stop_trace::NAMES_MAX);
        let notice = Notice { scope: scope.map(|name| shortened(name)).collect(), ..notice };
        self.notice(notice.with_text(&stop.why).with_agents(vec![stop.by.clone()]));
    }

    fn release_noticed(&mut self, ids: &[String], by: Option<&AgentId>, now: NoticeTime) {
        if ids.is_empty() {
            return;
        }
        let notice = Notice::new(NoticeKind::Release, &ids.join(" "), now.wall_ms);
        self.notice(notice.with_agents(by.into_iter().cloned().collect()));
    }
}

/// Whether a goal that is refused for this reason is lost. A goal that cannot be read is a mistake of
/// whoever wrote it, who is told; a replica that stands by or is busy is asked again.
fn is_loss(reason: Reason) -> bool {
    matches!(reason, Reason::Unreachable | Reason::Incapable | Reason::Conflict | Reason::Stopped)
}

/// Whether the identifiers of a message are short enough to be remembered.
fn has_short_names(message: &Message) -> bool {
    let tokens = [&message.reply_with, &message.in_reply_to];
    let tokens = tokens.into_iter().flatten().map(ReplyToken::as_str);
    let names = [message.id.as_str(), message.conversation_id.as_str()];
    names.into_iter().chain(tokens).all(|name| name.len() <= IDENTIFIER_BYTES_MAX)
}
