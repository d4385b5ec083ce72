//! Answers to those that ask what happened: a page, in which private events are sealed to the one
//! that asks or left out.

use acl::Performative;
use acl::content::{HistoryPage, Outcome, ReadHistory, Reason, Report};
use agent::{Context, Participation};

use crate::HistoryAgent;
use crate::query::QueryAnswer;
use crate::store::HistoryStoreError;

/// A question with its answer.
pub(crate) struct Answered {
    pub(crate) asker: Participation,
    pub(crate) read: Box<ReadHistory>,
    pub(crate) answer: Result<QueryAnswer, HistoryStoreError>,
}

/// What every page says of the history as a whole.
pub(crate) struct PageNotes {
    pub(crate) lost: u64,
    pub(crate) notices: Vec<String>,
}

// === impl Answered ===

impl Answered {
    /// Sends the answer.
    pub(crate) fn send(self, notes: &PageNotes, ctx: &mut Context<HistoryAgent>) {
        let Answered { asker, read, answer } = self;
        let answer = match answer {
            Ok(answer) => answer,
            Err(error) => {
                return ctx.refuse(&asker, Reason::Other, format!("failed to {error}"));
            }
        };
        let may_read = ctx.may_read_private(&asker.initiator);
        let key = read.seal_to.as_deref().filter(|_| may_read);
        let page = page(answer, key, notes);
        let count = page.events.len() + page.sealed.len();
        let mut report = Report::new(Outcome::Done, format!("{count} events"));
        report.history_page = Some(Box::new(page));
        ctx.answer(&asker, Performative::Confirm, &report);
    }
}

/// Returns the page of an answer. Private events are sealed to `key`; without a key they are left
/// out and counted.
fn page(answer: QueryAnswer, key: Option<&str>, notes: &PageNotes) -> HistoryPage {
    let mut page = HistoryPage {
        next: answer.next,
        oldest_ms: answer.oldest_ms,
        lost: notes.lost,
        notices: notes.notices.clone(),
        near: answer.near,
        ..HistoryPage::default()
    };
    for (event, is_cause_kept) in answer.events {
        let event = event.to_message(is_cause_kept);
        if !event.private {
            page.events.push(event);
            continue;
        }
        let text = serde_json::to_string(&event).unwrap_or_default();
        match key.map(|key| credentials::seal_answer(key, &text)) {
            Some(Ok(sealed)) => page.sealed.push(sealed),
            Some(Err(_)) | None => page.withheld += 1,
        }
    }
    page
}

#[cfg(test)]
mod tests {
    use credentials::AnswerKey;

    use super::*;
    use crate::event::test_event;

    #[test]
    fn private_events_are_sealed_or_left_out() {
        let private = crate::RecordedEvent { private: true, ..test_event(2) };
        let answer = QueryAnswer {
            events: vec![(test_event(1), false), (private, false)],
            ..QueryAnswer::default()
        };
        let notes = PageNotes { lost: 3, notices: vec!["full".to_owned()] };
        let open = page(answer.clone(), None, &notes);
        assert_eq!((open.events.len(), open.sealed.len(), open.withheld), (1, 0, 1));
        assert_eq!((open.lost, open.notices.len()), (3, 1));

        let key = AnswerKey::new();
        let sealed = page(answer.clone(), Some(&key.public()), &notes);
        assert_eq!((sealed.events.len(), sealed.withheld), (1, 0));
        let text = key.open(&sealed.sealed[0]).expect("sealed to this key");
        assert!(text.contains("\"number\":2"), "{text}");

        let refused = page(answer, Some("no key"), &notes);
        assert_eq!((refused.sealed.len(), refused.withheld), (0, 1));
    }
}
