//! The answer to “is all well?”.

use acl::content::{ButtonPosition, GoalPhase};

use super::{LiveView, Trouble, daemon_views};
use crate::moment::Moment;
use crate::rows::{
    AgentPresence, Concern, ConcernKind, FactTruth, GoalRow, GoalStage, HealthLevel, Overview,
    ViewCounts, ViewSubject,
};
use crate::text::{duration, plural, plural_verb};

/// Time for which something that is over is a concern.
const RECENT_MS: u64 = 10 * 60_000;

/// Time after the first event, or after the start of a daemon, for which an absent agent is no
/// concern: it may just start.
const ABSENT_AFTER_MS: u64 = 10_000;

/// Maximum number of concerns that are listed.
const CONCERNS_MAX: usize = 50;

/// Returns whether all is well at `now`, and why not.
pub(super) fn overview(view: &LiveView, now: Moment) -> Overview {
    let goals = view.goals(now);
    let mut concerns = Vec::new();
    if view.is_reached == Some(false) {
        let text = "the ecosystem is not reached; this is how it was before";
        concerns.push(concern(HealthLevel::Bad, ConcernKind::NotReached, text.to_owned(), None));
    }
    // A request that was refused, such as one with a mistake in it, is over: nothing is wrong.
    let accepted = goals.iter().filter(|goal| !view.goals.was_refused(&goal.conversation));
    accepted.for_each(|goal| concerns.extend(goal_concerns(goal, now)));
    agent_concerns(view, now, &mut concerns);
    stop_concerns(view, now, &mut concerns);
    question_concerns(view, now, &mut concerns);
    daemon_concerns(view, now, &mut concerns);
    message_concerns(view, now, &mut concerns);
    // A stable sort: concerns of one rank and level keep the order above.
    concerns.sort_by_key(|concern| (rank(concern), std::cmp::Reverse(concern.level)));
    let counts = counts(view, &goals, now);
    let verdict = concerns.iter().map(|concern| concern.level).max().unwrap_or_default();
    let summary = summary(&concerns, &counts);
    let more = concerns.len().saturating_sub(CONCERNS_MAX);
    concerns.truncate(CONCERNS_MAX);
    Overview {
        ecosystem: view.ecosystem.clone(),
        at: now,
        verdict,
        not_reached_since: view.unreached_at,
        summary,
        concerns,
        more_concerns: u64::try_from(more).unwrap_or(u64::MAX),
        counts,
    }
}

fn concern(
    level: HealthLevel,
    kind: ConcernKind,
    text: String,
    subject: Option<ViewSubject>,
) -> Concern {
    Concern { level, kind, text, subject }
}

/// Returns the place of a concern in the list: what endangers people or hides the rest comes first,
/// and goals never push it out of sight.
fn rank(concern: &Concern) -> u8 {
    match concern.kind {
        ConcernKind::NotReached => 0,
        ConcernKind::DaemonSilent => 1,
        ConcernKind::Stopped => 2,
        ConcernKind::AgentGone => 3,
        ConcernKind::StopButton => 4,
        ConcernKind::GoalFailed | ConcernKind::GoalWaits | ConcernKind::StepLate => 5,
        ConcernKind::Question => 6,
        ConcernKind::AgentProblem | ConcernKind::Certificate => 7,
        ConcernKind::Messages | ConcernKind::OutOfTurn | ConcernKind::Lost => 8,
    }
}

fn goal_concerns(goal: &GoalRow, now: Moment) -> Option<Concern> {
    let subject = Some(ViewSubject::Goal(goal.conversation.clone()));
    let name = if goal.goal.is_empty() { goal.conversation.as_str() } else { goal.goal.as_str() };
    match goal.stage {
        GoalStage::Failed => {
            let is_recent = goal.ended_at.is_some_and(|at| now.since(at) < RECENT_MS);
            let text = format!("{name} has {}", goal.text);
            is_recent.then(|| concern(HealthLevel::Bad, ConcernKind::GoalFailed, text, subject))
        }
        // Another goal is planned for first, for a moment.
        GoalStage::Waiting if goal.phase == Some(GoalPhase::Queued) => None,
        GoalStage::Waiting => {
            let text = format!("{name} is {}", goal.text);
            Some(concern(HealthLevel::Attention, ConcernKind::GoalWaits, text, subject))
        }
        GoalStage::Running => {
            let late = goal.late_ms?;
            let what = goal.now.join("; ");
            let text = format!("{what}: {} longer than usual", duration(late));
            Some(concern(HealthLevel::Attention, ConcernKind::StepLate, text, subject))
        }
        _ => None,
    }
}

fn agent_concerns(view: &LiveView, now: Moment, concerns: &mut Vec<Concern>) {
    let began = view.began_at.unwrap_or(now);
    let up_ms = now.since(began).max(daemon_views::longest_uptime(view));
    for (agent, record) in view.agents.iter().filter(|(_, record)| !record.is_guest()) {
        let presence = record.presence(now);
        let subject = || Some(ViewSubject::Agent(agent.clone()));
        let gone = |why: String| {
            let text = format!("{agent} {why}");
            concern(HealthLevel::Attention, ConcernKind::AgentGone, text, subject())
        };
        let gone_ms = record.gone_at.map_or(0, |at| now.since(at));
        match presence {
            AgentPresence::Gone
                if record.is_missed() && (record.is_expected || gone_ms < RECENT_MS) =>
            {
                concerns.push(gone(format!("has been gone for {}", duration(gone_ms))));
            }
            AgentPresence::Silent => {
                let silent_ms = record.beat.as_ref().map_or(0, |beat| now.since(beat.at));
                concerns.push(gone(format!("has sent no heartbeat for {}", duration(silent_ms))));
            }
            AgentPresence::Absent if view.has_directory && up_ms > ABSENT_AFTER_MS => {
                concerns.push(gone("is named in the ecosystem file, and is not here".to_owned()));
            }
            _ => (),
        }
        if let Some(conflict) = record.conflicts.first().filter(|_| record.gone_at.is_none()) {
            let text = format!("{agent}: no plan uses it: {conflict}");
            let kind = ConcernKind::AgentProblem;
            concerns.push(concern(HealthLevel::Attention, kind, text, subject()));
        }
    }
}

fn stop_concerns(view: &LiveView, now: Moment, concerns: &mut Vec<Concern>) {
    for stop in view.stops.in_force(now) {
        let why = if stop.why.is_empty() { String::new() } else { format!(": {}", stop.why) };
        let (level, what) = match stop.scope.as_slice() {
            [] => (HealthLevel::Bad, "everything is".to_owned()),
            [only] => (HealthLevel::Attention, format!("{only} is")),
            names => (HealthLevel::Attention, format!("{} are", names.join(", "))),
        };
        let text = format!("{what} stopped by {}{why}", stop.by);
        concerns.push(concern(level, ConcernKind::Stopped, text, None));
    }
    for (button, position) in view.stops.buttons() {
        let (level, what) = match position {
            ButtonPosition::Pressed => (HealthLevel::Bad, "is pressed"),
            ButtonPosition::Silent => (HealthLevel::Attention, "does not report its position"),
            _ => continue,
        };
        let text = format!("the hardware stop {button} {what}");
        let subject = Some(ViewSubject::Agent(button.clone()));
        concerns.push(concern(level, ConcernKind::StopButton, text, subject));
    }
}

fn question_concerns(view: &LiveView, now: Moment, concerns: &mut Vec<Concern>) {
    for question in view.questions(now) {
        let text = format!("{} asks: {}", question.from, question.text);
        let subject = Some(ViewSubject::Questions);
        concerns.push(concern(HealthLevel::Attention, ConcernKind::Question, text, subject));
    }
}

fn daemon_concerns(view: &LiveView, now: Moment, concerns: &mut Vec<Concern>) {
    let hosted = daemon_views::hosted(view);
    for (daemon, record) in view.daemons.iter() {
        let subject = || Some(ViewSubject::Daemon(daemon.clone()));
        let silent = |level, what: &str| {
            let text = format!("the daemon {daemon} {what}");
            concern(level, ConcernKind::DaemonSilent, text, subject())
        };
        let is_recent = record.seen_at.is_some_and(|at| now.since(at) < RECENT_MS);
        if daemon_views::is_gone(record, hosted.get(daemon).copied()) {
            if record.is_expected || is_recent {
                concerns.push(silent(HealthLevel::Attention, "is gone"));
            }
        } else if record.is_reached == Some(false) {
            concerns.push(silent(HealthLevel::Bad, "does not answer"));
        }
        let days = record.status.as_ref().and_then(|(_, report)| report.certificate_days_left);
        if let Some((days, why)) =
            days.and_then(|days| Some((days, daemon_views::certificate_problem(days)?)))
        {
            let level = if days == 0 { HealthLevel::Bad } else { HealthLevel::Attention };
            let text = format!("the daemon {daemon}: {why}");
            concerns.push(concern(level, ConcernKind::Certificate, text, subject()));
        }
        for problem in daemon_views::message_problems(record) {
            let text = format!("the daemon {daemon}: {problem}");
            let kind = ConcernKind::Messages;
            concerns.push(concern(HealthLevel::Attention, kind, text, subject()));
        }
    }
}

fn message_concerns(view: &LiveView, now: Moment, concerns: &mut Vec<Concern>) {
    let attention = |kind, text, subject| concern(HealthLevel::Attention, kind, text, subject);
    let recent = |trouble: &&Trouble| now.since(trouble.at) < RECENT_MS;
    for (troubles, kind) in
        [(&view.refused, ConcernKind::Messages), (&view.out_of_turn, ConcernKind::OutOfTurn)]
    {
        let count = troubles.iter().filter(recent).count();
        let Some(last) = troubles.back().filter(recent) else { continue };
        let more = match count {
            0 | 1 => String::new(),
            count => format!(" (and {} more within {})", count - 1, duration(RECENT_MS)),
        };
        let subject = Some(ViewSubject::Conversation(last.conversation.clone()));
        concerns.push(attention(kind, format!("{}{more}", last.text), subject));
    }
    if view.unreadable_at.is_some_and(|at| now.since(at) < RECENT_MS) {
        let text = format!("{} could not be read", plural(view.counts.unreadable, "message"));
        concerns.push(attention(ConcernKind::Messages, text, None));
    }
    if view.lost_at.is_some_and(|at| now.since(at) < RECENT_MS) {
        let text = format!("{} not observed", plural(view.counts.lost, "message"));
        concerns.push(attention(ConcernKind::Lost, text, None));
    }
}

fn counts(view: &LiveView, goals: &[GoalRow], now: Moment) -> ViewCounts {
    let count = |number: usize| u64::try_from(number).unwrap_or(u64::MAX);
    let staged = |stage| count(goals.iter().filter(|goal| goal.stage == stage).count());
    let (mut present, mut gone) = (0, 0);
    for (_, record) in view.agents.iter().filter(|(_, record)| !record.is_guest()) {
        match record.presence(now) {
            AgentPresence::Present => present += 1,
            AgentPresence::Silent | AgentPresence::Absent => gone += 1,
            AgentPresence::Gone if record.is_missed() => gone += 1,
            AgentPresence::Gone | AgentPresence::Unknown => (),
        }
    }
    let unknown = view.facts.iter().filter(|(_, fact)| fact.fact.truth == FactTruth::Unknown);
    ViewCounts {
        agents: present,
        agents_gone: gone,
        daemons: count(view.daemons.iter().filter(|(_, record)| record.seen_at.is_some()).count()),
        goals: count(goals.iter().filter(|goal| is_pursued(goal)).count()),
        goals_scheduled: staged(GoalStage::Scheduled),
        goals_holding: staged(GoalStage::Holding),
        goals_running: staged(GoalStage::Running),
        goals_waiting: staged(GoalStage::Waiting),
        goals_planning: staged(GoalStage::Planning),
        steps_running: count(view.goals.running_count()),
        facts: count(view.facts.len()),
        facts_unknown: count(unknown.count()),
        questions: count(view.questions(now).len()),
        stops: count(view.stops.in_force(now).count()),
        messages: view.counts.messages,
        lost: view.counts.lost,
        unreadable: view.counts.unreadable,
        out_of_turn: view.counts.out_of_turn,
    }
}

fn is_pursued(goal: &GoalRow) -> bool {
    !goal.stage.has_ended() && goal.stage != GoalStage::Scheduled
}

fn summary(concerns: &[Concern], counts: &ViewCounts) -> String {
    let of_level = |level| {
        let count = concerns.iter().filter(|concern| concern.level == level).count();
        u64::try_from(count).unwrap_or(u64::MAX)
    };
    let (bad, attention) = (of_level(HealthLevel::Bad), of_level(HealthLevel::Attention));
    let wrong = match bad {
        1 => "1 thing is wrong".to_owned(),
        bad => format!("{bad} things are wrong"),
    };
    let needs = plural_verb(attention, "thing", "need");
    match (bad, attention) {
        (0, 0) => format!("all is well: {}", doings(counts)),
        (0, _) => format!("{needs} attention"),
        (_, 0) => wrong,
        _ => format!("{wrong}, and {needs} attention"),
    }
}

fn doings(counts: &ViewCounts) -> String {
    let mut doings = Vec::new();
    for (count, verb) in [(counts.goals_holding, "hold"), (counts.goals_waiting, "wait")] {
        if count > 0 {
            doings.push(plural_verb(count, "goal", verb));
        }
    }
    if counts.goals_planning > 0 {
        doings.push(format!("{} being planned for", plural(counts.goals_planning, "goal")));
    }
    if counts.goals_running > 0 {
        doings.push(format!("{} being executed", plural(counts.goals_running, "goal")));
    }
    if counts.goals_scheduled > 0 {
        doings.push(format!("{} by the clock", plural(counts.goals_scheduled, "goal")));
    }
    if doings.is_empty() {
        doings.push("no goals".to_owned());
    }
    doings.push(format!("{} here", plural(counts.agents, "agent")));
    doings.join(", ")
}
