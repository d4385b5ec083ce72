//! The conversations, and one of them as a sequence diagram.

use acl::Protocol;
use live_view::{ConversationDetail, ConversationRow, MessageRow};

use super::{PageContext, count};
use crate::page::{PageAt, PageName};
use crate::sequence::SequenceLanes;
use crate::sheet::{RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::table::{Table, TableCell, TableColumn};
use crate::text;
use crate::time_words;
use crate::tone::Tone;

pub(super) fn sheet(rows: &[ConversationRow], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if rows.is_empty() {
        sheet
            .nothing("No conversation was observed yet: agents converse when something is wanted.");
    }
    let mut table = Table::new(vec![
        TableColumn::new("ABOUT", 0, 36, 70),
        TableColumn::right("MESSAGES", 2, 8, 8),
        TableColumn::right("AGENTS", 3, 6, 6),
        TableColumn::right("LAST", 1, 6, 10),
        TableColumn::new("OUT OF TURN", 4, 11, 11),
        TableColumn::new("PROTOCOLS", 5, 20, 40),
        TableColumn::new("CONVERSATION", 6, 12, 40),
    ]);
    for row in context.bounded(rows, |row| format!("{} {}", row.subject, row.conversation)) {
        let id = row.conversation.to_string();
        let link = RowLink {
            key: id.clone(),
            opens: Some(PageAt::named(PageName::Conversation, id.as_str())),
            copies: id.clone(),
            about: RowSubject::Nothing,
            ..RowLink::default()
        };
        let protocols: Vec<_> = row.protocols.iter().map(|it| protocol(*it)).collect();
        let broken = match row.out_of_turn {
            0 => String::new(),
            broken => format!("✗ {broken}"),
        };
        let about = match row.subject.as_str() {
            "" => TableCell::of(&id, Tone::Dim),
            subject => TableCell::of(&context.said(subject), Tone::Name),
        };
        let cells = vec![
            about,
            TableCell::of(&row.messages.to_string(), Tone::Plain),
            TableCell::of(&row.participants.to_string(), Tone::Dim),
            TableCell::of(&context.ago(row.last_at), Tone::Dim),
            TableCell::of(&broken, Tone::Bad),
            TableCell::of(&protocols.join(" "), Tone::Dim),
            TableCell::of(&id, Tone::Dim),
        ];
        table.row(cells, link);
    }
    table.draw(&mut sheet);
    context.say_left_out(&mut sheet, rows.len());
    sheet
}

/// Returns the name of a protocol.
fn protocol(protocol: Protocol) -> &'static str {
    match protocol {
        Protocol::Goal => "goal",
        Protocol::Planning => "planning",
        Protocol::ContractNet => "contract-net",
        Protocol::Execution => "execution",
        Protocol::Action => "action",
        Protocol::StateChange => "state-change",
        Protocol::Query => "query",
    }
}

/// Makes the page of one conversation.
pub(super) fn detail(detail: &ConversationDetail, context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    let row = &detail.row;
    let id = row.conversation.to_string();
    let about = if row.subject.is_empty() { &id } else { &row.subject };
    sheet.text(&StyledLine::of(about, Tone::Name), 2);
    let long = time_words::duration(row.last_at.since(row.first_at));
    let mut facts = format!(
        "{} between {} in {long}",
        count(row.messages, "message"),
        count(row.participants, "agent")
    );
    if row.out_of_turn > 0 {
        facts.push_str(&format!(", {} out of turn", row.out_of_turn));
    }
    sheet.text(&StyledLine::of(&facts, Tone::Dim), 2);
    if detail.dropped > 0 {
        sheet.nothing(&format!("{} before these are not kept", count(detail.dropped, "message")));
    }
    sheet.gap();
    let lanes: Vec<&str> = detail.lanes.iter().map(|lane| lane.as_str()).collect();
    let lanes = SequenceLanes::new(&lanes, sheet.columns());
    if let Some(lanes) = &lanes {
        sheet.sticky(lanes.heading());
    }
    for (number, message) in detail.messages.iter().enumerate() {
        message_rows(&mut sheet, message, number, lanes.as_ref(), context);
    }
    sheet
}

/// Appends a message: as an arrow between lanes, or as a sentence where lanes have no room.
fn message_rows(
    sheet: &mut Sheet,
    message: &MessageRow,
    number: usize,
    lanes: Option<&SequenceLanes>,
    context: &PageContext,
) {
    let to: Vec<&str> = message.to.iter().map(|to| to.as_str()).collect();
    let receivers = if to.is_empty() { "all".to_owned() } else { to.join(", ") };
    let performative = message.performative.to_string();
    let from = message.from.as_str();
    let time = context.clock(message.at);
    let words = [performative.as_str(), message.summary.as_str()].join(" ");
    let words = words.trim_end();
    let broken = message.out_of_turn.as_deref();
    let said = broken.map(|why| format!("; out of turn: {why}")).unwrap_or_default();
    let spoken = text::clean(&format!("{time}: {from} to {receivers}: {words}{said}"));
    let link = RowLink {
        key: format!("message {number} {}", message.at.0),
        opens: Some(PageAt::named(PageName::Agent, from)),
        copies: spoken.clone(),
        about: RowSubject::Agent(from.to_owned()),
        ..RowLink::default()
    };
    let tone = if broken.is_some() { Tone::Bad } else { Tone::Plain };
    match lanes {
        Some(lanes) => sheet.row(lanes.message(&time, from, &to, words, tone), spoken, link),
        None => {
            let line = StyledLine::of(&time, Tone::Dim).and(" ", Tone::Plain);
            let line = line.and(from, Tone::Name).and(" → ", Tone::Dim);
            let line = line.and(&receivers, Tone::Name).and(": ", Tone::Dim).and(words, tone);
            sheet.wrapped_row(&line, 2, link);
        }
    }
    if let Some(why) = broken {
        let line = StyledLine::of("         ✗ out of turn: ", Tone::Bad).and(why, Tone::Plain);
        for line in line.wrap(sheet.columns(), 11) {
            sheet.drawing(line);
        }
    }
}
