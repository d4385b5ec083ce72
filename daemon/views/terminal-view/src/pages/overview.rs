//! The overview: whether all is well, what is not, the goals, and what happened last.

use live_view::{Concern, ConcernKind, HealthLevel, ViewCounts, ViewSubject};

use super::{PageContext, activity, count, goals, page_of};
use crate::page_data::OverviewData;
use crate::sheet::{RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::text;
use crate::tone::Tone;

/// Lines of activity that the overview has at least, however many goals there are.
const RECENT_MIN: usize = 4;

pub(super) fn sheet(data: &OverviewData, context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    let overview = &data.overview;
    let (sign, tone, word) = match overview.verdict {
        HealthLevel::Well => ("✓", Tone::Good, "All is well"),
        HealthLevel::Attention => ("!", Tone::Warn, "Look at this"),
        HealthLevel::Bad => ("✗", Tone::Bad, "Not all is well"),
    };
    let word = match overview.not_reached_since {
        Some(since) => format!("NOT REACHED since {}", context.clock(since)),
        None => word.to_owned(),
    };
    let verdict = StyledLine::of(&format!("{sign} {word}."), tone);
    sheet.text(
        &verdict.and(&format!(" {}", counts(&overview.counts, context.is_recording)), Tone::Dim),
        2,
    );
    for concern in &overview.concerns {
        row(&mut sheet, concern, context);
    }
    if overview.more_concerns > 0 {
        sheet.nothing(&format!("and {} more", overview.more_concerns));
    }
    sheet.heading("Goals");
    if data.goals.is_empty() && context.is_recording {
        sheet.nothing("No goal that goes on was recorded so far.");
    } else if data.goals.is_empty() {
        sheet.nothing("No goal is pursued now. `g` asks for one.");
    } else {
        goals::table(&data.goals, context).draw(&mut sheet);
    }
    sheet.heading("What happened last");
    if data.recent.is_empty() {
        sheet.nothing("Nothing was observed yet.");
    }
    // As many of the newest as fit on the screen.
    let room = context.rows.saturating_sub(sheet.lines.len()).max(RECENT_MIN);
    let skipped = data.recent.len().saturating_sub(room);
    for entry in &data.recent[skipped..] {
        activity::short_row(&mut sheet, entry, context);
    }
    sheet
}

fn row(sheet: &mut Sheet, concern: &Concern, context: &PageContext) {
    let (sign, tone) = match concern.level {
        HealthLevel::Well => ("✓", Tone::Good),
        HealthLevel::Attention => ("!", Tone::Warn),
        HealthLevel::Bad => ("✗", Tone::Bad),
    };
    let opens = concern.subject.as_ref().map(page_of);
    let about = match &concern.subject {
        Some(ViewSubject::Goal(goal)) => RowSubject::Goal(goal.to_string()),
        Some(ViewSubject::Agent(agent)) => RowSubject::Agent(agent.to_string()),
        _ => RowSubject::Nothing,
    };
    let name = opens.as_ref().and_then(|at| at.name.clone());
    let link = RowLink {
        key: format!("concern {}", concern.text),
        opens,
        copies: name.unwrap_or_else(|| concern.text.clone()),
        about,
        ..RowLink::default()
    };
    let said = context.said(&concern.text);
    let mut line = StyledLine::of(&format!("{sign} "), tone).and(&said, Tone::Plain);
    if concern.kind == ConcernKind::Stopped && !context.is_recording {
        line.push("; `r` releases it", Tone::Dim);
    }
    let word = if concern.level == HealthLevel::Bad { "problem" } else { "attention" };
    let spoken = format!("{word}: {}", text::clean(&said));
    sheet.said_row(&line, 2, spoken, link);
}

/// Returns how many there are of what is of interest.
fn counts(counts: &ViewCounts, is_recording: bool) -> String {
    let daemons = match counts.daemons {
        0 if is_recording => "daemons were not recorded".to_owned(),
        daemons => count(daemons, "daemon"),
    };
    let mut parts = vec![daemons, count(counts.agents, "agent")];
    let mut some = |number: u64, text: String| {
        if number > 0 {
            parts.push(text);
        }
    };
    some(counts.agents_gone, format!("{} gone", counts.agents_gone));
    some(counts.goals, count(counts.goals, "goal"));
    some(counts.goals_scheduled, format!("{} by the clock", counts.goals_scheduled));
    some(counts.steps_running, format!("{} running", count(counts.steps_running, "step")));
    some(counts.facts, count(counts.facts, "fact"));
    some(counts.questions, count(counts.questions, "question"));
    some(counts.stops, format!("{} in force", count(counts.stops, "stop")));
    some(counts.lost, format!("{} not seen", count(counts.lost, "message")));
    parts.join(", ")
}
