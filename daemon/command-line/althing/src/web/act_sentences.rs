//! How an act has ended, as a sentence and as a message of the page's catalogues, which have it in
//! every language.

use acl::content::{Outcome, Report};
use keyboard::UserEvent;
use serde_json::{Value, json};
use web_page::{ActOutcome, PageMessage};

use super::answered::EarlierAnswer;
use super::person_agents::FollowedRequest;

/// Returns an outcome whose sentence is no message: it comes from an agent, or tells a mistake.
pub(super) fn outcome(ok: bool, sentence: impl Into<String>) -> ActOutcome {
    ActOutcome { ok, sentence: sentence.into(), ..ActOutcome::default() }
}

/// Returns an outcome whose sentence is the message `key` with these values.
pub(super) fn fixed(
    ok: bool,
    key: &str,
    values: &[(&str, Value)],
    sentence: impl Into<String>,
) -> ActOutcome {
    let values = values.iter().map(|(name, value)| ((*name).to_owned(), value.clone()));
    let message = PageMessage { key: key.to_owned(), values: values.collect() };
    ActOutcome { message: Some(message), ..outcome(ok, sentence) }
}

/// Returns the outcome of a request from the answers to it. `waiting` is the key of the message and
/// the sentence if no answer has come.
pub(super) fn followed(followed: FollowedRequest, waiting: (&str, &str)) -> ActOutcome {
    let FollowedRequest { conversation, answer } = followed;
    let done = match answer {
        Some(UserEvent::Report(_, report)) => told(&report),
        Some(UserEvent::Refused(_, refusal)) => {
            outcome(false, format!("refused: {}", refusal.detail))
        }
        Some(UserEvent::Unanswered(_, why)) => outcome(false, why),
        Some(_) | None => fixed(true, waiting.0, &[], waiting.1),
    };
    let conversation = conversation.map(|conversation| conversation.to_string());
    ActOutcome { conversation, ..done }
}

/// Returns the outcome that a report tells: success, progress, or neither.
fn told(report: &Report) -> ActOutcome {
    let Report { outcome: end, detail, .. } = report;
    let ok = matches!(end, Outcome::Progress | Outcome::Done | Outcome::Holds);
    match detail.is_empty() {
        true => outcome(ok, end.to_string()),
        false => outcome(ok, format!("{end}: {detail}")),
    }
}

/// Returns the outcome of an answer to a question that is not open any more.
pub(super) fn late(earlier: &EarlierAnswer) -> ActOutcome {
    match earlier {
        EarlierAnswer::Of(person) => {
            let sentence = format!("{person} answered this already");
            fixed(false, "answer.late", &[("person", json!(person.as_str()))], sentence)
        }
        EarlierAnswer::Own => fixed(false, "answer.twice", &[], "you have answered this already"),
        EarlierAnswer::Elsewhere => fixed(
            false,
            "answer.over",
            &[],
            "this question is not open any more: it was answered elsewhere, or its time is over",
        ),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_refusal_is_no_success() {
        let done = told(&Report::new(Outcome::Done, "so"));
        assert_eq!((done.ok, done.sentence.as_str()), (true, "done: so"));
        assert!(!told(&Report::new(Outcome::Failed, "not so")).ok);
        let waiting = followed(FollowedRequest::default(), ("act.waits", "no answer yet"));
        assert!(waiting.ok && waiting.sentence == "no answer yet");
        assert_eq!(waiting.message.map(|message| message.key).as_deref(), Some("act.waits"));
    }
}
