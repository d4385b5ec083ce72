//! One goal: its plans as Gantt charts, the bids of its calls, its history.

use acl::content::{Keep, Outcome};
use live_view::{
    BidRow, BidState, CallDetail, GoalDetail, GoalStage, Moment, PlanDetail, StepRow, StepState,
};

use super::{PageContext, agent_link, goals};
use crate::page::{PageAt, PageName};
use crate::sheet::{RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::time_bar::{BarState, TimeBar};
use crate::time_words;
use crate::tone::Tone;

/// Rounds whose calls for proposals are shown.
const CALLS_MAX: usize = 4;

pub(super) fn sheet(detail: &GoalDetail, context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    head(&mut sheet, detail, context);
    for (index, plan) in detail.plans.iter().enumerate() {
        plan_part(&mut sheet, plan, index == 0, context);
    }
    if detail.plans.is_empty() && detail.row.stage != GoalStage::Scheduled {
        sheet.gap();
        let had_plan = detail.row.rounds > 0
            || detail.history.iter().any(|event| event.text.contains("a plan "));
        sheet.nothing(match (had_plan, context.is_recording) {
            (true, true) => "The plan was made before this recording began.",
            (true, false) => "The plan was made before this view began.",
            (false, _) => "No plan of this goal was observed.",
        });
    }
    for (number, call) in detail.calls.iter().take(CALLS_MAX).enumerate() {
        call_part(&mut sheet, call, number, context);
    }
    if !detail.history.is_empty() {
        sheet.heading("History");
    }
    for (number, event) in detail.history.iter().enumerate() {
        let tone = event.outcome.map_or(Tone::Plain, outcome_tone);
        let line = StyledLine::of(&format!("{}  ", context.clock(event.at)), Tone::Dim);
        let conversation = detail.row.conversation.to_string();
        let link = RowLink {
            key: format!("history {number}"),
            opens: Some(PageAt::named(PageName::Conversation, conversation)),
            copies: event.text.clone(),
            about: RowSubject::Nothing,
            ..RowLink::default()
        };
        sheet.wrapped_row(&line.and(&context.said(&event.text), tone), 10, link);
    }
    sheet
}

/// Says what is wanted, by whom, and how it stands.
fn head(sheet: &mut Sheet, detail: &GoalDetail, context: &PageContext) {
    let row = &detail.row;
    let link = RowLink {
        key: "goal".to_owned(),
        opens: Some(PageAt::named(PageName::Conversation, row.conversation.to_string())),
        copies: row.conversation.to_string(),
        about: RowSubject::Goal(row.conversation.to_string()),
        ..RowLink::default()
    };
    sheet.wrapped_row(&goals::title(row, context), 2, link);
    let mut stands = goals::stage(row.stage);
    let (text, outlook) = (context.said(&row.text), goals::outlook(row, context));
    for text in [text.as_str(), outlook.as_str()] {
        // Often the reason is the word of the stage again.
        if !text.is_empty() && text != stands.spoken() {
            stands.push("  ", Tone::Plain);
            stands.push(text, Tone::Plain);
        }
    }
    sheet.text(&stands, 2);
    let mut asked = String::new();
    if row.is_of_file {
        asked = "asked for by the ecosystem file".to_owned();
    } else if let Some(requester) = &row.requester {
        asked = format!("asked for by {requester}");
    }
    if let Some(at) = row.asked_at {
        asked.push_str(&format!(" {} ago", context.ago(at)));
    }
    if row.keep == Some(Keep::Maintain) {
        asked.push_str(", to be kept");
    }
    if row.priority != 0 {
        asked.push_str(&format!(", priority {}", row.priority));
    }
    let asked = asked.trim_start_matches([',', ' ']);
    if !asked.is_empty() {
        sheet.text(&StyledLine::of(asked, Tone::Dim), 2);
    }
}

/// Draws a plan as a Gantt chart.
fn plan_part(sheet: &mut Sheet, plan: &PlanDetail, is_newest: bool, context: &PageContext) {
    let steps = plan.steps.len() as u64 + plan.more_steps;
    let mut title = format!("Plan {}: {}", plan.round, super::count(steps, "step"));
    if let Some(cost) = plan.cost {
        title.push_str(&format!(", cost {cost}"));
    }
    if let Some(late) = plan.late_ms {
        title.push_str(&format!(", {} late", time_words::duration(late)));
    }
    match plan.outcome {
        Some(Outcome::Done) => title.push_str(", done"),
        Some(Outcome::Failed) => title.push_str(", failed"),
        Some(Outcome::Cancelled) => title.push_str(", cancelled"),
        Some(Outcome::Progress | Outcome::Holds) | None => (),
    }
    sheet.heading(&title);
    if !plan.ended_because.is_empty() && plan.outcome != Some(Outcome::Done) {
        sheet.text(&StyledLine::of(&context.said(&plan.ended_because), Tone::Warn), 2);
    }
    let axis = TimeAxis { begins: plan.begins_at, ends: plan.ends_at, now: context.now };
    let span = time_words::duration(plan.ends_at.since(plan.begins_at));
    let title = format!("{} + {span}", context.clock(plan.begins_at));
    let mut table = Table::new(vec![
        TableColumn::new("STEP", 0, 18, (context.columns / 2).clamp(18, 60)),
        TableColumn::right("TIME", 2, 6, 10),
        TableColumn::right("LATE", 3, 6, 10),
        TableColumn::bar(&title, 1, 12),
    ]);
    for step in &plan.steps {
        table.row(step_cells(step, &axis, plan.ended_at.is_some()), step_link(plan, step));
    }
    table.draw(sheet);
    if plan.more_steps > 0 {
        sheet.nothing(&format!("and {} more", super::count(plan.more_steps, "step")));
    }
    for step in plan.steps.iter().filter(|step| is_problem(step.state)) {
        if !step.detail.is_empty() {
            let line = StyledLine::of(&format!("✗ {}: ", step.text), Tone::Bad);
            sheet.text(&line.and(&context.said(&step.detail), Tone::Plain), 2);
        }
    }
    if is_newest && context.columns >= 40 {
        let legend = "█ done  ▓ running  ▒ beyond the usual time  ░ expected  │ now";
        sheet.drawing(StyledLine::of(legend, Tone::Dim).fit(sheet.columns()));
    }
}

fn is_problem(state: StepState) -> bool {
    matches!(state, StepState::Failed | StepState::Refused)
}

fn step_cells(step: &StepRow, axis: &TimeAxis, has_ended: bool) -> Vec<TableCell> {
    let (sign, tone) = match step.state {
        StepState::Next => ("·", Tone::Dim),
        StepState::Running => ("▶", Tone::Busy),
        StepState::Done => ("✓", Tone::Good),
        StepState::Failed | StepState::Refused => ("✗", Tone::Bad),
        StepState::Cancelled => ("–", Tone::Dim),
    };
    let text = if step.text.is_empty() { &step.step } else { &step.text };
    let words = if step.state == StepState::Next { Tone::Plain } else { Tone::Name };
    let words = if step.state == StepState::Cancelled { Tone::Dim } else { words };
    let took = match (step.started_at, step.ended_at) {
        (Some(start), Some(end)) => Some(end.since(start)),
        (Some(start), None) if step.state == StepState::Running => Some(axis.now.since(start)),
        _ => None,
    };
    let time = match took {
        Some(took) => time_words::duration(took),
        None if has_ended => String::new(),
        None => step
            .usual_ms
            .map(|usual| format!("~{}", time_words::duration(usual)))
            .unwrap_or_default(),
    };
    vec![
        TableCell::Line(StyledLine::of(&format!("{sign} "), tone).and(text, words)),
        TableCell::of(&time, if took.is_some() { Tone::Plain } else { Tone::Dim }),
        super::duration_cell(step.late_ms, Tone::Warn),
        TableCell::Bar(bar(step, axis, has_ended)),
    ]
}

fn step_link(plan: &PlanDetail, step: &StepRow) -> RowLink {
    let agent = step.agent.as_ref().map(ToString::to_string);
    RowLink {
        key: format!("step {} {} {}", plan.term, plan.round, step.number),
        opens: agent.map(|agent| PageAt::named(PageName::Agent, agent)),
        copies: step.step.clone(),
        about: RowSubject::Statement(step.step.clone()),
        ..RowLink::default()
    }
}

/// The time axis of a plan.
struct TimeAxis {
    begins: Moment,
    ends: Moment,
    now: Moment,
}

impl TimeAxis {
    /// Returns where a moment is on the axis, from 0 to 1 if it is on it.
    fn share(&self, moment: Moment) -> f64 {
        let whole = self.ends.since(self.begins).max(1) as f64;
        let passed = if moment >= self.begins {
            moment.since(self.begins) as f64
        } else {
            -(self.begins.since(moment) as f64)
        };
        passed / whole
    }
}

fn bar(step: &StepRow, axis: &TimeAxis, has_ended: bool) -> TimeBar {
    let now = axis.share(axis.now);
    let on_axis = (!has_ended && (0.0..=1.0).contains(&now)).then_some(now);
    let (state, word) = match step.state {
        StepState::Next => (BarState::Next, "next"),
        StepState::Running => (BarState::Running, "running"),
        StepState::Done => (BarState::Done, "done"),
        StepState::Failed => (BarState::Failed, "failed"),
        StepState::Refused => (BarState::Failed, "refused"),
        StepState::Cancelled => (BarState::Failed, "cancelled"),
    };
    let start = step.started_at.or(step.expected_start);
    let end = match step.state {
        StepState::Running => Some(axis.now),
        StepState::Next => step.expected_end,
        _ => step.ended_at.or(step.started_at),
    };
    let (Some(start), Some(end)) = (start, end) else {
        return TimeBar { spoken: word.to_owned(), ..TimeBar::empty(on_axis) };
    };
    let usual_end = match (step.state, step.expected_end, step.usual_ms) {
        (StepState::Running, Some(end), _) => Some(end),
        (_, _, Some(usual)) => Some(start.plus(usual)),
        _ => None,
    };
    TimeBar {
        state,
        from: axis.share(start),
        to: axis.share(end),
        usual_end: usual_end.map(|end| axis.share(end)),
        now: on_axis,
        spoken: word.to_owned(),
    }
}

/// Draws a call for proposals, with the bids.
fn call_part(sheet: &mut Sheet, call: &CallDetail, number: usize, context: &PageContext) {
    let asked = context.said(&call.conjuncts.join(" "));
    let decided = match call.decided_at {
        Some(at) => format!("decided after {}", time_words::duration(at.since(call.at))),
        None => "not decided".to_owned(),
    };
    sheet.heading(&format!("Call at {}, {decided}", context.clock(call.at)));
    if !asked.is_empty() {
        let together = if call.together { "together: " } else { "" };
        sheet.text(&StyledLine::of(together, Tone::Plain).and(&asked, Tone::Dim), 2);
    }
    if call.bids.is_empty() {
        sheet.nothing("No agent has answered.");
    }
    let mut table = Table::new(vec![
        TableColumn::new("AGENT", 0, 10, 24),
        TableColumn::new("BID", 1, 9, 10),
        TableColumn::right("COST", 2, 4, 8),
        TableColumn::right("AFTER", 4, 6, 8),
        TableColumn::new("WHY", 3, 30, 80),
    ]);
    for bid in &call.bids {
        let mut link = agent_link(bid.agent.as_str());
        link.key = format!("bid {number} {}", bid.agent);
        table.row(bid_cells(bid, context), link);
    }
    table.draw(sheet);
    if call.more_bids > 0 {
        sheet.nothing(&format!("and {} more", super::count(call.more_bids, "bid")));
    }
}

fn bid_cells(bid: &BidRow, context: &PageContext) -> Vec<TableCell> {
    let (word, tone) = match bid.state {
        BidState::Offered => ("◌ offers", Tone::Busy),
        BidState::Won => ("✓ won", Tone::Good),
        BidState::Lost => ("– lost", Tone::Dim),
        BidState::Declined => ("✗ declined", Tone::Warn),
    };
    let best = bid.proposals.iter().find(|proposal| proposal.is_chosen).or(bid.proposals.first());
    let cost = best.map(|proposal| proposal.cost.to_string()).unwrap_or_default();
    let covers = best.map(|proposal| proposal.covers.join(" ")).unwrap_or_default();
    let parts = [covers.as_str(), bid.detail.as_str()];
    let parts: Vec<_> = parts.into_iter().filter(|part| !part.is_empty()).collect();
    vec![
        TableCell::of(bid.agent.as_str(), Tone::Name),
        TableCell::of(word, tone),
        TableCell::of(&cost, Tone::Plain),
        TableCell::of(&time_words::duration(bid.after_ms), Tone::Dim),
        TableCell::of(&context.said(&parts.join("; ")), Tone::Plain),
    ]
}

fn outcome_tone(outcome: Outcome) -> Tone {
    match outcome {
        Outcome::Done | Outcome::Holds => Tone::Good,
        Outcome::Failed => Tone::Bad,
        Outcome::Progress | Outcome::Cancelled => Tone::Plain,
    }
}
