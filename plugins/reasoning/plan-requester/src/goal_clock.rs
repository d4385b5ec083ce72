//! Asks for goals when their times have come (docs/goals.md, “Goals by the clock”).
//!
//! The leader looks at its clock when something is due, and every [`CLOCK_CHECK`], because clocks jump
//! and machines sleep. For an occurrence it sends itself the request of an ordinary goal. The time of
//! the occurrence is part of the goal's conversation, so a new leader that asks for the same
//! occurrence asks for the same goal. Deadlines and ends of goals are looked at here, too.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::content::{
    GoalLateness, GoalPhase, GoalTimes, Outcome, Reason, Refusal, Report, Request, ScheduleGoal,
    value,
};
use acl::{ConversationId, Message, Performative, Protocol};
use agent::{Context, ExchangeEvent, ExchangeOpening, Participation, TimerId};
use goal_schedule::{DueOccurrence, MissedTimes, Schedule};
use jiff::Timestamp;
use jiff::tz::TimeZone;

use crate::PlanRequester;
use crate::due_goal::{DueGoal, GoalLimits, is_passing, occurrence_id, parent_of, timestamp};
use crate::due_records::EndedDueGoals;
use crate::file_goals::{FileGoal, FileGoals};

/// Maximum number of goals by the clock; further ones are refused. A building has tens of them.
const DUE_GOALS_MAX: usize = 256;

/// Longest time between two looks at the clock: a jump of the clock is noticed within it.
const CLOCK_CHECK: Duration = Duration::from_secs(10);

/// Shortest time between two looks at the clock, so that an instant that is rounded down does not keep
/// the agent busy.
const CLOCK_STEP: Duration = Duration::from_millis(10);

/// How long the goal of an occurrence may be pursued: a year, as a kept goal may hold that long.
const PURSUED_MAX: Duration = Duration::from_secs(366 * 24 * 3_600);

/// The goals by the clock of a Plan Requester.
pub(crate) struct GoalClock {
    pub(crate) goals: BTreeMap<ConversationId, DueGoal>,
    pub(crate) ended: EndedDueGoals,
    pub(crate) file: FileGoals,
    /// Whether the goals of the file have been compared with the records since this replica leads.
    pub(crate) has_read_file: bool,
    timer: Option<TimerId>,
}

// === impl GoalClock ===

impl GoalClock {
    pub(crate) fn new(file: FileGoals) -> GoalClock {
        let in_file = file.goals.iter().map(FileGoal::conversation).collect();
        GoalClock {
            goals: BTreeMap::new(),
            ended: EndedDueGoals::new(in_file),
            file,
            has_read_file: false,
            timer: None,
        }
    }

    /// Returns the time zone of the times; that of the ecosystem if they name none.
    ///
    /// # Errors
    ///
    /// Returns a sentence for a person if this machine does not know the time zone.
    pub(crate) fn zone(&self, times: &GoalTimes) -> Result<TimeZone, String> {
        let Some(name) = times.time_zone.as_ref().or(self.file.time_zone.as_ref()) else {
            return Ok(TimeZone::system());
        };
        TimeZone::get(name).map_err(|_| {
            format!(
                "the time zone `{name}` is not known on this machine; names are such as \
                 Europe/Berlin, and come with the package tzdata"
            )
        })
    }

    /// Removes and returns all goals, because another replica takes them over.
    pub(crate) fn take_all(&mut self) -> BTreeMap<ConversationId, DueGoal> {
        self.has_read_file = false;
        std::mem::take(&mut self.goals)
    }
}

impl PlanRequester {
    // === requests ===

    /// Takes a goal by the clock, or one that is asked for at once and has a deadline or an end.
    pub(crate) fn schedule_requested(
        &mut self,
        message: Message,
        scheduled: ScheduleGoal,
        ctx: &mut Context<Self>,
    ) {
        let participation = Participation::of(&message);
        let id = participation.conversation.clone();
        let ScheduleGoal { goal: asked, times } = scheduled;
        if let Some(known) = self.clock.goals.get(&id) {
            let is_same = known.initiator == participation.initiator
                && (&known.asked, &known.times) == (&asked, &times);
            return match is_same {
                true => self.confirm_schedule(&participation, "accepted before", ctx),
                false => ctx.refuse(
                    &participation,
                    Reason::OutOfTurn,
                    "this conversation is about another goal",
                ),
            };
        }
        if let Some(report) = self.clock.ended.report_of(&id) {
            return ctx.answer(&participation, Performative::Confirm, &report);
        }
        let now = timestamp(ctx.wall_clock());
        let read = self.clock.zone(&times).and_then(|zone| {
            Schedule::read(&times, zone).map_err(|error| format!("`{}`: {error}", error.option))
        });
        let schedule = match read {
            Ok(schedule) => schedule,
            Err(mistake) => return ctx.refuse(&participation, Reason::BadContent, mistake),
        };
        if schedule.is_at_once() {
            let limits = GoalLimits::of(&schedule, schedule.occurrence(now));
            return self.take_goal(&message, asked, Some(limits), ctx);
        }
        if let Err((reason, detail)) = self.admissible(&asked, &participation) {
            return ctx.refuse(&participation, reason, detail);
        }
        if self.clock.goals.len() >= DUE_GOALS_MAX {
            let detail = format!("{DUE_GOALS_MAX} goals wait for their times already; cancel some");
            return ctx.refuse(&participation, Reason::Busy, detail);
        }
        let mut due = DueGoal::new(participation.initiator.clone(), asked, times, schedule);
        // A time that passed before the request arrived is not missed, but due.
        if due.due(now).now.is_none() {
            due.seen.settled = Some(now);
        }
        if due.is_over(now) {
            let detail = format!("no time is left to ask for it: {}", due.times.words);
            return ctx.refuse(&participation, Reason::BadContent, detail);
        }
        due.number = self.numbers.next();
        due.add_history(now, format!("scheduled: {}", due.times.words));
        tracing::info!(conversation = %id, goal = due.asked.goal, times = due.times.words, "a goal by the clock");
        let has_number = due.number != 0;
        self.clock.goals.insert(id.clone(), due);
        match has_number {
            true => self.replicate_new_due(&id, participation, ctx),
            false => self.early.add_schedule(participation),
        }
        self.look_at_clock(ctx);
    }

    /// Confirms that a goal by the clock is accepted; `how` says where it is kept.
    pub(crate) fn confirm_schedule(
        &mut self,
        participation: &Participation,
        how: &str,
        ctx: &mut Context<Self>,
    ) {
        let now = timestamp(ctx.wall_clock());
        let due = self.clock.goals.get(&participation.conversation);
        let next = due.and_then(|due| due.status(&participation.conversation, now).due?.next);
        let next = next.map(|next| format!("; next: {next}")).unwrap_or_default();
        let report = Report::new(Outcome::Done, format!("{how}{next}"));
        ctx.answer(participation, Performative::Confirm, &report);
    }

    /// Ends a goal by the clock, and cancels the goal that is pursued for it.
    pub(crate) fn end_due(
        &mut self,
        id: &ConversationId,
        outcome: Outcome,
        detail: &str,
        ctx: &mut Context<Self>,
    ) {
        self.end_due_then(id, Report::new(outcome, detail), ctx, |_| ());
    }

    /// Like [`PlanRequester::end_due`]; calls `then` when the end is recorded.
    fn end_due_then(
        &mut self,
        id: &ConversationId,
        report: Report,
        ctx: &mut Context<Self>,
        then: impl FnOnce(&mut Context<Self>) + Send + 'static,
    ) {
        let Some(due) = self.clock.goals.remove(id) else { return };
        let detail = &report.detail;
        tracing::info!(conversation = %id, detail, "a goal by the clock has ended");
        if let Some(pursued) = due.pursued_conversation(id)
            && self.goals.contains_key(&pursued)
        {
            self.cancel(&pursued, ctx);
            self.replicate_cancellation(&pursued, ctx, |_| ());
        }
        self.replicate_ended_due(id, due, report, ctx, then);
    }

    /// Whether a `cancel` of this conversation ends a goal by the clock: its own conversation, or that
    /// of a goal of the file that is always pursued.
    pub(crate) fn is_due_goal(&self, id: &ConversationId) -> bool {
        let goals = &self.clock.goals;
        goals.contains_key(id) || self.always_of(id).is_some()
    }

    fn always_of(&self, id: &ConversationId) -> Option<ConversationId> {
        let parent = parent_of(id)?;
        let due = self.clock.goals.get(&parent)?;
        let is_it = due.is_always() && due.pursued_conversation(&parent).as_ref() == Some(id);
        is_it.then_some(parent)
    }

    /// Cancels a goal by the clock, for a person.
    pub(crate) fn due_cancelled(
        &mut self,
        id: &ConversationId,
        asker: Option<Participation>,
        ctx: &mut Context<Self>,
    ) {
        let id = self.always_of(id).unwrap_or_else(|| id.clone());
        let report = Report::new(Outcome::Cancelled, "cancelled as asked");
        self.end_due_then(&id, report, ctx, move |ctx| {
            let report = Report::new(Outcome::Cancelled, "it is not asked for any more");
            asker.iter().for_each(|asker| ctx.answer(asker, Performative::Confirm, &report));
        });
    }

    /// Returns the limits of a goal that this agent has asked itself for; `None` if no goal by the
    /// clock has asked for it.
    pub(crate) fn limits_of(&self, conversation: &ConversationId) -> Option<GoalLimits> {
        let due = self.clock.goals.get(&parent_of(conversation)?)?;
        let limits = due.limits(due.schedule.occurrence(due.pursued?));
        (!limits.is_empty()).then_some(limits)
    }

    // === looking at the clock ===

    /// Does what is due, and looks at the clock again when something else is.
    pub(crate) fn look_at_clock(&mut self, ctx: &mut Context<Self>) {
        if !self.journal_client.is_leading() {
            return;
        }
        let now = timestamp(ctx.wall_clock());
        let ids: Vec<_> = self.clock.goals.keys().cloned().collect();
        ids.iter().for_each(|id| self.look_at_due(id, now, ctx));
        self.look_at_limits(now, ctx);
        self.set_clock_timer(now, ctx);
    }

    fn set_clock_timer(&mut self, now: Timestamp, ctx: &mut Context<Self>) {
        let dues = self.clock.goals.values().map(|due| due.due(now).next);
        let limits =
            self.goals.values().map(|goal| goal.limits.as_ref().and_then(GoalLimits::next));
        let has_limits = |limits: &GoalLimits| !limits.is_empty();
        let has_any = !self.clock.goals.is_empty()
            || self.goals.values().any(|goal| goal.limits.as_ref().is_some_and(has_limits));
        let next = dues.chain(limits).flatten().min();
        let former = self.clock.timer.take();
        former.into_iter().for_each(|former| ctx.cancel_timer(former));
        if !has_any {
            return;
        }
        let wait = next.and_then(|next| Duration::try_from(next.duration_since(now)).ok());
        let is_past = next.is_some_and(|next| next <= now);
        let wait = if is_past { CLOCK_STEP } else { wait.unwrap_or(CLOCK_CHECK) };
        let wait = wait.clamp(CLOCK_STEP, CLOCK_CHECK);
        self.clock.timer = Some(ctx.after(wait, |requester: &mut Self, ctx| {
            requester.clock.timer = None;
            requester.look_at_clock(ctx);
        }));
    }

    fn look_at_due(&mut self, id: &ConversationId, now: Timestamp, ctx: &mut Context<Self>) {
        let Some(due) = self.clock.goals.get_mut(id) else { return };
        let found = due.due(now);
        if let Some(missed) = found.missed {
            let text = match due.is_refused(missed.last) && missed.count == 1 {
                true => {
                    let last = due.schedule.clock_text(missed.last, now);
                    format!("{last}: missed: it was refused until it was too late")
                }
                false => missed_text(&due.schedule, missed, now),
            };
            tracing::warn!(conversation = %id, text, "a goal by the clock");
            due.seen.settled = Some(missed.last);
            due.add_history(now, text);
            self.replicate_due(id, ctx);
        }
        let Some(due) = self.clock.goals.get_mut(id) else { return };
        let Some(occurrence) = found.now else {
            if due.is_over(now) {
                self.end_due(id, Outcome::Done, "it is not asked for again", ctx);
            }
            return;
        };
        let pursued = due.pursued_conversation(id);
        let Some(pursued) = pursued.filter(|pursued| self.goals.contains_key(pursued)) else {
            return self.ask_for(id, occurrence, ctx);
        };
        let time = due.schedule.clock_text(occurrence.due, now);
        due.seen.settled = Some(occurrence.due);
        due.add_history(now, format!("{time}: not asked for, as {pursued} is still pursued"));
        self.replicate_due(id, ctx);
    }

    /// Asks for the goal of an occurrence: sends this agent itself the request.
    pub(crate) fn ask_for(
        &mut self,
        id: &ConversationId,
        occurrence: DueOccurrence,
        ctx: &mut Context<Self>,
    ) {
        let now = timestamp(ctx.wall_clock());
        let Some(due) = self.clock.goals.get_mut(id) else { return };
        let time = occurrence.due;
        let opening = ExchangeOpening {
            to: Some(ctx.id().clone()),
            performative: Performative::Request,
            protocol: Protocol::Goal,
            conversation: occurrence_id(id, time),
            content: value(&Request::Achieve(due.asked.clone())),
        };
        if due.pursued == Some(time) {
            let spoken = due.schedule.clock_text(time, now);
            due.add_history(now, format!("{spoken}: asked for again by a new leader"));
        } else if !due.is_refused(time) {
            due.add_history(now, asked_text(due, time, now));
        }
        (due.seen.asked, due.pursued) = (due.seen.asked.max(Some(time)), Some(time));
        let about = id.clone();
        let token = ctx.open(opening, PURSUED_MAX, move |requester: &mut Self, answer, ctx| {
            requester.occurrence_answered(&about, time, answer, ctx);
        });
        let former = due.exchange.replace(token);
        former.into_iter().for_each(|former| ctx.close(&former));
        self.replicate_due(id, ctx);
    }

    /// Handles a report about the goal of an occurrence.
    fn occurrence_answered(
        &mut self,
        id: &ConversationId,
        time: Timestamp,
        answer: ExchangeEvent,
        ctx: &mut Context<Self>,
    ) {
        let now = timestamp(ctx.wall_clock());
        let is_known = self.goals.contains_key(&occurrence_id(id, time));
        let Some(due) = self.clock.goals.get_mut(id).filter(|due| due.pursued == Some(time)) else {
            return;
        };
        let spoken = due.schedule.clock_text(time, now);
        let text = match answer {
            ExchangeEvent::Message(message) => match message.content_as::<Report>() {
                Ok(report) if !report.outcome.is_final() => {
                    if due.accepted(time) {
                        let text = asked_text(due, time, now);
                        due.add_history(now, text);
                        self.replicate_due(id, ctx);
                    }
                    return;
                }
                Ok(report) => {
                    if report.outcome == Outcome::Done {
                        due.learn(now);
                    }
                    due.rest(now);
                    let ends = due.schedule.occurrence(time).ends;
                    match report.outcome {
                        Outcome::Cancelled if ends.is_some_and(|ends| ends <= now) => {
                            format!("{spoken}: its time is over")
                        }
                        outcome => format!("{spoken}: {outcome}: {}", report.detail),
                    }
                }
                Err(_) => {
                    let refusal = message.content_as::<Refusal>().ok();
                    let why = refusal.as_ref().map(|why| why.detail.clone()).unwrap_or_default();
                    if refusal.is_some_and(|why| is_passing(why.reason)) {
                        let text = format!("{spoken}: refused: {why}; it is asked for again");
                        return self.occurrence_refused(id, time, text, ctx);
                    }
                    due.rest(now);
                    format!("{spoken}: refused: {why}")
                }
            },
            // The goal goes on; only its reports do not come here any more.
            ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) if is_known => {
                due.exchange = None;
                return;
            }
            ExchangeEvent::TimedOut | ExchangeEvent::Undelivered(_) => {
                let text = format!("{spoken}: could not be asked for; it is asked for again");
                return self.occurrence_refused(id, time, text, ctx);
            }
        };
        due.add_history(now, text);
        self.replicate_due(id, ctx);
        self.look_at_clock(ctx);
    }

    /// Handles that the goal of an occurrence is not taken for the time being: it is asked for again
    /// after a rest. Only the first of several refusals is told and recorded.
    fn occurrence_refused(
        &mut self,
        id: &ConversationId,
        time: Timestamp,
        text: String,
        ctx: &mut Context<Self>,
    ) {
        let now = timestamp(ctx.wall_clock());
        let Some(due) = self.clock.goals.get_mut(id) else { return };
        if due.take_back(time, now) {
            due.add_history(now, text);
            self.replicate_due(id, ctx);
        }
        self.look_at_clock(ctx);
    }

    // === deadlines and ends ===

    /// Tells of goals that are late, and gives up those whose time is over.
    fn look_at_limits(&mut self, now: Timestamp, ctx: &mut Context<Self>) {
        let now_ms = now.as_millisecond();
        let is_due = |limits: &GoalLimits| limits.next().is_some_and(|next| next <= now);
        let due = self.goals.iter().filter(|(_, goal)| goal.limits.as_ref().is_some_and(is_due));
        let due: Vec<_> = due.map(|(id, _)| id.clone()).collect();
        for id in due {
            let Some(goal) = self.goals.get_mut(&id) else { continue };
            let phase = goal.state.phase();
            let Some(limits) = &mut goal.limits else { continue };
            let is_start = limits.start_ms().is_some_and(|start| start <= now_ms);
            let usual = if is_start { limits.usual_ms.take() } else { None };
            let holds = phase == GoalPhase::Holding;
            let is_late = limits.by_ms.take_if(|by| *by <= now_ms).is_some() && !holds;
            let is_over = limits.ends_ms.take_if(|ends| *ends <= now_ms).is_some();
            let by = limits.by_text.clone();
            let is_under_way = phase.is_running() || holds;
            let told = match usual.filter(|_| !is_under_way && !is_over) {
                _ if is_late => {
                    Some((GoalLateness::Late, format!("not reached by {by}; it goes on")))
                }
                Some(usual) => {
                    let takes = brief(usual);
                    let detail = format!(
                        "it will probably not be reached by {by}: it usually takes {takes}"
                    );
                    Some((GoalLateness::Expected, detail))
                }
                None => None,
            };
            if let Some((lateness, detail)) = told {
                let report = Report::new(Outcome::Progress, detail);
                self.send_report(&id, Report { lateness: Some(lateness), ..report }, ctx);
            }
            if is_over {
                if let Some(goal) = self.goals.get_mut(&id) {
                    goal.add_history(ctx.wall_clock(), None, "its time is over");
                }
                self.cancel(&id, ctx);
                self.replicate_cancellation(&id, ctx, |_| ());
            }
        }
    }
}

/// Returns the text for people about an occurrence that is asked for.
fn asked_text(due: &DueGoal, time: Timestamp, now: Timestamp) -> String {
    let spoken = due.schedule.clock_text(time, now);
    match now.duration_since(time).as_secs() {
        ..60 => format!("{spoken}: asked for"),
        late => format!("{spoken}: asked for, {} min late", late / 60),
    }
}

/// Formats a duration for people: `40 s`, `12 min`.
fn brief(ms: i64) -> String {
    match ms / 1_000 {
        seconds @ ..120 => format!("{seconds} s"),
        seconds => format!("{} min", seconds / 60),
    }
}

/// Returns the text for people about occurrences that were missed.
fn missed_text(schedule: &Schedule, missed: MissedTimes, now: Timestamp) -> String {
    let last = schedule.clock_text(missed.last, now);
    let why = "no leader ran then, its machine slept, or its clock was set";
    match missed.count {
        1 => format!("{last}: missed: {why}"),
        count => format!("{count} times missed, the last {last}: {why}"),
    }
}
