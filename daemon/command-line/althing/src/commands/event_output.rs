//! Formats the outputs of a Keyboard Agent to its person: as lines for people, or as JSON objects
//! for programs.

use std::process::ExitCode;

use acl::content::{Inform, OpenQuestion, Outcome, Refusal, Report};
use acl::{Message, Performative};
use keyboard::{RequestRef, UserEvent};
use serde_json::{Value, json};
use terminal::output::Color;
use terminal::styled::Styled;
use terminal::{exit, output};

use crate::speech;

/// Prints an output of a Keyboard Agent, and returns the exit code of printing.
pub(crate) fn print(heard: &UserEvent, json: bool) -> ExitCode {
    if json {
        return output::print_json(&object(heard), exit::DONE);
    }
    let text: Styled = lines(heard).into_iter().map(|line| line.folded(9).end()).collect();
    output::print_styled(&text, exit::DONE)
}

/// Formats an output of a Keyboard Agent as lines for people.
pub(crate) fn lines(heard: &UserEvent) -> Vec<Styled> {
    match heard {
        UserEvent::Sent(about) => vec![line(Color::Dim, "asked", about.conversation.as_str())],
        UserEvent::Report(_, report) => of_report(report),
        UserEvent::Refused(_, refusal) => {
            block(Color::Red, "refused", &speech::sentence(&refusal.detail))
        }
        UserEvent::Unanswered(_, why) => block(Color::Red, "no reply", &speech::sentence(why)),
        UserEvent::Answered(_, message) => vec![of_message(message)],
        UserEvent::Question(open) => {
            let OpenQuestion { question, from, text, remaining: left, .. } = open;
            let left = super::brief(left.0);
            vec![
                line(Color::Yellow, "asks", &format!("{from}: {text}")),
                Styled::line(&format!("           answer {question} TEXT     within {left}")),
            ]
        }
        UserEvent::QuestionClosed(question, why) => {
            vec![line(Color::Dim, "closed", &format!("question {question}: {why}"))]
        }
    }
}

fn line(color: Color, word: &str, rest: &str) -> Styled {
    Styled::painted(color, &format!("{word:<8}")).and(" ").and(rest)
}

/// Formats a text of several lines. All lines after the first are indented, so that none looks like
/// a line of this program.
fn block(color: Color, word: &str, text: &str) -> Vec<Styled> {
    let mut parts = text.lines();
    let first = line(color, word, parts.next().unwrap_or_default());
    std::iter::once(first)
        .chain(parts.map(|part| Styled::line(&format!("         {part}"))))
        .collect()
}

fn of_report(report: &Report) -> Vec<Styled> {
    let color = match report.outcome {
        Outcome::Progress => Color::Plain,
        Outcome::Holds | Outcome::Done => Color::Green,
        Outcome::Failed | Outcome::Cancelled => Color::Red,
    };
    let detail = speech::sentence(&report.detail);
    let mut lines = block(color, &report.outcome.to_string(), &detail);
    let steps = report.plan.iter().flat_map(|plan| plan.lines());
    lines.extend(
        steps
            .filter(|line| line.starts_with('('))
            .map(|line| Styled::line(&format!("           {line}"))),
    );
    lines
}

/// Formats an agent's answer to a message that the user wrote (`althing send`), as a line for
/// people.
fn of_message(message: &Message) -> Styled {
    let (from, act) = (&message.sender, message.performative);
    let said = match act {
        Performative::Confirm => message
            .content_as::<Report>()
            .map(|report| format!("{}: {}", report.outcome, report.detail)),
        Performative::Refuse | Performative::NotUnderstood => {
            message.content_as::<Refusal>().map(|refusal| refusal.detail)
        }
        Performative::Inform => message.content_as::<Inform>().map(|inform| match inform {
            Inform::Answer(answer) => answer.text,
            _ => message.content.to_string(),
        }),
        _ => Ok(message.content.to_string()),
    };
    let said = said.unwrap_or_else(|_| message.content.to_string());
    Styled::line(&format!("{:<8} {from}: {said}", act.as_str()))
}

/// Formats an output of a Keyboard Agent as a JSON object for programs.
pub(crate) fn object(heard: &UserEvent) -> Value {
    match heard {
        UserEvent::Sent(RequestRef { conversation, .. }) => {
            json!({ "event": "asked", "conversation": conversation })
        }
        UserEvent::Report(RequestRef { conversation, .. }, report) => {
            json!({ "event": "report", "conversation": conversation, "report": report })
        }
        UserEvent::Refused(RequestRef { conversation, .. }, refusal) => {
            json!({ "event": "refused", "conversation": conversation, "refusal": refusal })
        }
        UserEvent::Unanswered(RequestRef { conversation, .. }, why) => {
            json!({ "event": "unanswered", "conversation": conversation, "problem": why })
        }
        UserEvent::Answered(_, message) => json!({ "event": "answered", "message": message }),
        UserEvent::Question(open) => json!({ "event": "question", "question": open }),
        UserEvent::QuestionClosed(question, why) => {
            json!({ "event": "question-closed", "question": question, "detail": why })
        }
    }
}
