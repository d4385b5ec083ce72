//! What happened, in sentences.

use live_view::{ActivityEntry, ActivityLevel};

use super::PageContext;
use crate::page::{PageAt, PageName};
use crate::sheet::{ROWS_MAX, RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::text;
use crate::tone::Tone;

pub(super) fn sheet(entries: &[ActivityEntry], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if entries.is_empty() {
        sheet.nothing("Nothing was observed yet. What agents do appears here, newest last.");
    }
    for entry in shown(entries) {
        row(&mut sheet, entry, context);
    }
    sheet
}

/// Returns the newest entries.
fn shown(entries: &[ActivityEntry]) -> &[ActivityEntry] {
    &entries[entries.len().saturating_sub(ROWS_MAX)..]
}

/// Appends an entry, in as many lines as it needs.
pub(super) fn row(sheet: &mut Sheet, entry: &ActivityEntry, context: &PageContext) {
    let (line, spoken, link) = parts(entry, context);
    sheet.said_row(&line, 11, spoken, link);
}

/// Appends an entry, cut to one line.
pub(super) fn short_row(sheet: &mut Sheet, entry: &ActivityEntry, context: &PageContext) {
    let (line, spoken, link) = parts(entry, context);
    sheet.row(line.fit(sheet.columns()), spoken, link);
}

/// Returns the line of an entry, what is said of it, and what can be done with it.
fn parts(entry: &ActivityEntry, context: &PageContext) -> (StyledLine, String, RowLink) {
    let (sign, tone) = match entry.level {
        ActivityLevel::Routine => (" ", Tone::Dim),
        ActivityLevel::Notable => ("•", Tone::Plain),
        ActivityLevel::Problem => ("✗", Tone::Bad),
    };
    let agent = entry.agent.as_ref().map(ToString::to_string);
    let conversation = entry.conversation.as_ref().map(ToString::to_string);
    let opens = match (&conversation, &agent) {
        (Some(conversation), _) => {
            Some(PageAt::named(PageName::Conversation, conversation.as_str()))
        }
        (None, Some(agent)) => Some(PageAt::named(PageName::Agent, agent.as_str())),
        (None, None) => None,
    };
    let link = RowLink {
        key: format!("activity {}", entry.number),
        opens,
        copies: entry.text.clone(),
        about: agent.map_or(RowSubject::Nothing, RowSubject::Agent),
        pddl: entry.text.clone(),
    };
    let words = if entry.level == ActivityLevel::Routine { Tone::Dim } else { Tone::Plain };
    let said = context.said(&entry.text);
    let line = StyledLine::of(&context.clock(entry.at), Tone::Dim)
        .and(&format!(" {sign} "), tone)
        .and(&said, words);
    let level = if entry.level == ActivityLevel::Problem { "problem: " } else { "" };
    let spoken = format!("{} {level}{}", context.clock(entry.at), text::clean(&said));
    (line, spoken, link)
}
