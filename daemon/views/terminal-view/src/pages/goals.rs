//! The goals: how each stands.

use acl::content::Keep;
use live_view::{GoalRow, GoalStage};

use super::{PageContext, duration_cell, goal_link};
use crate::sheet::{RowLink, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::time_words;
use crate::tone::Tone;

pub(super) fn sheet(goals: &[GoalRow], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if goals.is_empty() && context.is_recording {
        sheet.nothing("No goal was recorded so far.");
    } else if goals.is_empty() {
        sheet.nothing("No goal was asked for since this view began. `g` asks for one.");
    }
    table(goals, context).draw(&mut sheet);
    sheet
}

/// Makes the table of goals.
pub(super) fn table(goals: &[GoalRow], context: &PageContext) -> Table {
    let mut table = Table::new(vec![
        TableColumn::new("GOAL", 0, 28, 60),
        TableColumn::new("STATE", 1, 11, 12),
        TableColumn::new("NOW", 2, 22, 70),
        TableColumn::right("STEPS", 3, 5, 7),
        TableColumn::right("LATE", 4, 6, 10),
        TableColumn::right("SINCE", 5, 6, 10),
        TableColumn::new("BY", 6, 6, 16),
        TableColumn::right("ROUND", 7, 5, 5),
        TableColumn::right("COST", 8, 4, 6),
    ]);
    for goal in goals {
        let steps = match goal.steps {
            0 => String::new(),
            steps => format!("{}/{steps}", goal.steps_done),
        };
        let since = goal.ended_at.or(goal.asked_at).unwrap_or(goal.changed_at);
        let requester = match &goal.requester {
            _ if goal.is_of_file => "the file".to_owned(),
            requester => requester.as_ref().map(ToString::to_string).unwrap_or_default(),
        };
        let round = if goal.rounds > 1 { goal.rounds.to_string() } else { String::new() };
        let cost = goal.cost.map(|cost| format!("{cost}")).unwrap_or_default();
        let cells = vec![
            TableCell::Line(title(goal, context)),
            TableCell::Line(stage(goal.stage)),
            TableCell::of(&context.said(&now(goal)), Tone::Plain),
            TableCell::of(&steps, Tone::Plain),
            duration_cell(goal.late_ms, Tone::Warn),
            TableCell::of(&context.ago(since), Tone::Dim),
            TableCell::of(&requester, Tone::Dim),
            TableCell::of(&round, Tone::Dim),
            TableCell::of(&cost, Tone::Dim),
        ];
        let link = goal_link(goal.conversation.as_str());
        table.row(cells, RowLink { pddl: goal.goal.clone(), ..link });
    }
    table
}

/// Returns the goal's number and text, with a sign if it is kept.
pub(super) fn title(goal: &GoalRow, context: &PageContext) -> StyledLine {
    let kept = goal.keep == Some(Keep::Maintain);
    let number = goal.number.map(|number| format!("{number} ")).unwrap_or_default();
    let line = StyledLine::of(&number, Tone::Dim).and(if kept { "∞ " } else { "" }, Tone::Dim);
    match goal.goal.as_str() {
        "" => line.and(&format!("goal {}", goal.conversation), Tone::Dim),
        text => line.and(&context.said(text), Tone::Name),
    }
}

/// Returns what is done now, or why nothing is.
fn now(goal: &GoalRow) -> String {
    if goal.now.is_empty() { goal.text.clone() } else { goal.now.join("; ") }
}

/// Returns the sign and word of a stage.
pub(super) fn stage(stage: GoalStage) -> StyledLine {
    let (text, tone) = match stage {
        GoalStage::Unknown => ("? unknown", Tone::Dim),
        GoalStage::Scheduled => ("· by clock", Tone::Dim),
        GoalStage::Waiting => ("… waits", Tone::Warn),
        GoalStage::Planning => ("◌ planning", Tone::Busy),
        GoalStage::Running => ("▶ running", Tone::Busy),
        GoalStage::Holding => ("✓ holds", Tone::Good),
        GoalStage::Done => ("✓ done", Tone::Good),
        GoalStage::Failed => ("✗ failed", Tone::Bad),
        GoalStage::Cancelled => ("– cancelled", Tone::Dim),
    };
    StyledLine::of(text, tone)
}

/// Returns the sentence about a goal's lateness, its expected end and its limits by the clock.
pub(super) fn outlook(goal: &GoalRow, context: &PageContext) -> String {
    let mut parts = Vec::new();
    if let Some(late) = goal.late_ms {
        parts.push(format!("{} later than usual", time_words::duration(late)));
    }
    if let Some(end) = goal.expected_end.filter(|_| !goal.stage.has_ended()) {
        let left = end.since(context.now);
        parts.push(match left {
            0 => format!("was expected to end at {}", context.clock(end)),
            _ => format!("ends in about {}", time_words::duration(left)),
        });
    }
    if let Some(by) = goal.due.as_ref().and_then(|due| due.reach_by) {
        parts.push(format!("to be reached by {}", context.clock(by)));
    }
    if let Some(at) = goal.due.as_ref().and_then(|due| due.given_up_at) {
        parts.push(format!("given up at {}", context.clock(at)));
    }
    parts.join(", ")
}
