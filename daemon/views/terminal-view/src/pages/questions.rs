//! The questions to people, as cards.

use live_view::QuestionRow;

use super::PageContext;
use crate::sheet::{AskedQuestion, RowLink, RowSubject, Sheet};
use crate::styled_line::StyledLine;
use crate::time_words;
use crate::tone::Tone;

pub(super) fn sheet(questions: &[QuestionRow], context: &PageContext) -> Sheet {
    let mut sheet = context.sheet();
    if questions.is_empty() {
        sheet.nothing("Nobody is asked anything now. Questions of agents to people appear here.");
    }
    for (number, question) in questions.iter().enumerate() {
        card(&mut sheet, question, number);
    }
    sheet
}

fn card(sheet: &mut Sheet, question: &QuestionRow, number: usize) {
    let id = question.id.clone().unwrap_or_default();
    let link = RowLink {
        key: if id.is_empty() { format!("question {number}") } else { id.clone() },
        opens: None,
        copies: id.clone(),
        about: RowSubject::Question(asked(question)),
        ..RowLink::default()
    };
    let mut line = StyledLine::of("? ", Tone::Warn).and(question.from.as_str(), Tone::Name);
    line.push(" asks: ", Tone::Dim);
    line.push(&question.text, Tone::Plain);
    let shown = sheet.lines.len();
    sheet.wrapped_row(&line, 2, link);
    if sheet.lines.len() == shown {
        return;
    }
    let mut more = Vec::new();
    if let Some(left) = question.remaining_ms {
        more.push(format!("{} left", time_words::duration(left)));
    }
    if question.is_secret {
        more.push("the answer is secret: it is typed hidden, and encrypted".to_owned());
    }
    match id.as_str() {
        "" => more.push("its number is not known yet".to_owned()),
        id => more.push(format!("althing answer {id}")),
    }
    let line = StyledLine::of("  ", Tone::Plain).and(&more.join("; "), Tone::Dim);
    sheet.text(&line, 2);
    sheet.gap();
}

/// Returns a question as it can be answered.
pub(crate) fn asked(question: &QuestionRow) -> AskedQuestion {
    AskedQuestion {
        id: question.id.clone(),
        from: question.from.to_string(),
        text: question.text.clone(),
        is_secret: question.is_secret,
    }
}
