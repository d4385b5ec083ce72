//! The questions to people that have no answer yet. The answers are never kept.

use acl::content::{OpenQuestion, Question};
use acl::{AgentId, Millis, ReplyToken};

use crate::bounded::BoundedMap;
use crate::moment::Moment;
use crate::rows::QuestionRow;
use crate::text::cut;

/// Longest time that a query of the questions takes: a younger question may have come meanwhile.
const QUERY_MS_MAX: u64 = 5_000;

/// Time for which a question without a deadline is kept.
const WITHOUT_DEADLINE_MS: u64 = 3_600_000;

#[derive(Clone, Debug)]
struct QuestionRecord {
    keyboard: Option<AgentId>,
    number: Option<u64>,
    from: AgentId,
    text: String,
    is_secret: bool,
    asked_at: Moment,
    ends_at: Option<Moment>,
}

/// The questions that messages tell, and those that a query has listed. The list of a query
/// replaces all others, because it has the numbers that an answer needs.
#[derive(Clone, Debug)]
pub(crate) struct QuestionStore {
    asked: BoundedMap<ReplyToken, QuestionRecord>,
    listed: Vec<QuestionRecord>,
    questions_max: usize,
    text_bytes: usize,
}

impl QuestionStore {
    pub(crate) fn new(questions_max: usize, text_bytes: usize) -> QuestionStore {
        QuestionStore {
            asked: BoundedMap::new(questions_max),
            listed: Vec::new(),
            questions_max,
            text_bytes,
        }
    }

    pub(crate) fn asked(
        &mut self,
        at: Moment,
        token: &ReplyToken,
        (from, to): (&AgentId, Option<&AgentId>),
        (question, within): (&Question, Option<Millis>),
    ) {
        let record = QuestionRecord {
            keyboard: to.cloned(),
            number: None,
            from: from.clone(),
            text: cut(&question.text, self.text_bytes),
            is_secret: question.seal_to.is_some(),
            asked_at: at,
            ends_at: within.map(|within| at.plus(u64::from(within))),
        };
        self.asked.insert(token.clone(), record);
    }

    /// Takes the end of a question: an answer, a withdrawal, or a refusal of its only receiver.
    pub(crate) fn ended(&mut self, token: &ReplyToken, is_refusal: bool) {
        if is_refusal && self.asked.get(token).is_some_and(|record| record.keyboard.is_none()) {
            return;
        }
        let Some(ended) = self.asked.remove(token) else { return };
        self.listed.retain(|listed| listed.from != ended.from || listed.text != ended.text);
    }

    /// Takes all open questions that have a number, as a query has found them. An older question that
    /// is not among them is over, and its end was not observed.
    pub(crate) fn listed(&mut self, at: Moment, questions: &[OpenQuestion]) {
        let questions = questions.iter().take(self.questions_max);
        let records = questions.map(|open| QuestionRecord {
            keyboard: Some(open.keyboard.clone()),
            number: Some(open.question),
            from: open.from.clone(),
            text: cut(&open.text, self.text_bytes),
            is_secret: open.seal_to.is_some(),
            asked_at: at,
            ends_at: Some(at.plus(u64::from(open.remaining))),
        });
        self.listed = records.collect();
        let is_old = |record: &QuestionRecord| at.since(record.asked_at) > QUERY_MS_MAX;
        let over: Vec<ReplyToken> = self
            .asked
            .iter()
            .filter(|(_, record)| is_old(record) && !self.is_listed(record))
            .map(|(token, _)| token.clone())
            .collect();
        for token in over {
            self.asked.remove(&token);
        }
    }

    fn is_listed(&self, asked: &QuestionRecord) -> bool {
        self.listed.iter().any(|listed| listed.from == asked.from && listed.text == asked.text)
    }

    /// Returns the open questions, those with the least remaining time first.
    pub(crate) fn rows(&self, now: Moment) -> Vec<QuestionRow> {
        let asked = self.asked.newest_first().map(|(_, record)| record);
        let asked = asked.filter(|record| !self.is_listed(record));
        let open = self.listed.iter().chain(asked).filter(|record| record.is_open(now));
        let mut rows: Vec<_> = open.map(|record| record.row(now)).collect();
        rows.sort_by_key(|row| (row.remaining_ms.unwrap_or(u64::MAX), row.id.clone()));
        rows
    }
}

impl QuestionRecord {
    fn is_open(&self, now: Moment) -> bool {
        now < self.ends_at.unwrap_or(self.asked_at.plus(WITHOUT_DEADLINE_MS))
    }

    fn row(&self, now: Moment) -> QuestionRow {
        let id = self.keyboard.as_ref().zip(self.number);
        QuestionRow {
            id: id.map(|(keyboard, number)| format!("{keyboard}/{number}")),
            keyboard: self.keyboard.clone(),
            from: self.from.clone(),
            text: self.text.clone(),
            is_secret: self.is_secret,
            remaining_ms: self.ends_at.map(|end| end.since(now)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn name(text: &str) -> AgentId {
        AgentId::new(text).expect("a name")
    }

    #[test]
    fn a_listed_question_replaces_the_overheard_one() {
        let mut store = QuestionStore::new(10, 100);
        let (door, token) = (name("door"), ReplyToken::new("t"));
        let question = Question { text: "PIN?".to_owned(), seal_to: Some("00".to_owned()) };
        store.asked(Moment(0), &token, (&door, None), (&question, Some(Millis::from(10_000))));
        let rows = store.rows(Moment(1_000));
        assert_eq!((rows.len(), rows[0].id.clone(), rows[0].is_secret), (1, None, true));
        assert_eq!(rows[0].remaining_ms, Some(9_000));
        let open = OpenQuestion {
            keyboard: name("hall"),
            question: 3,
            from: door,
            text: "PIN?".to_owned(),
            remaining: Millis::from(8_000),
            seal_to: question.seal_to,
        };
        store.listed(Moment(2_000), &[open]);
        let rows = store.rows(Moment(2_000));
        assert_eq!((rows.len(), rows[0].id.as_deref()), (1, Some("hall/3")));
        store.ended(&token, true);
        assert_eq!(store.rows(Moment(2_000)).len(), 1, "another keyboard may answer");
        store.ended(&token, false);
        assert!(store.rows(Moment(2_000)).is_empty());
    }

    #[test]
    fn a_question_whose_end_was_not_observed_ends_with_the_next_query() {
        let mut store = QuestionStore::new(10, 100);
        let (door, token) = (name("door"), ReplyToken::new("t"));
        let question = Question { text: "PIN?".to_owned(), seal_to: None };
        store.asked(Moment(0), &token, (&door, None), (&question, None));
        store.listed(Moment(1_000), &[]);
        assert_eq!(store.rows(Moment(1_000)).len(), 1, "the query may have been answered before");
        store.listed(Moment(10_000), &[]);
        assert!(store.rows(Moment(10_000)).is_empty());
    }

    #[test]
    fn a_question_ends_with_its_deadline() {
        let mut store = QuestionStore::new(10, 100);
        let question = Question::new("Well?");
        let asked = (&question, Some(Millis::from(5)));
        store.asked(Moment(0), &ReplyToken::new("t"), (&name("a"), None), asked);
        assert_eq!(store.rows(Moment(4)).len(), 1);
        assert!(store.rows(Moment(5)).is_empty());
    }
}
