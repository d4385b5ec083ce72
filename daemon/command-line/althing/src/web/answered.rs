//! The questions that people have answered on this page, so that whoever comes too late is told who
//! was first.

use std::collections::VecDeque;
use std::sync::{Mutex, PoisonError};

use accounts::PersonName;

/// Maximum number of answers that are remembered. Two people answer one question within seconds.
const REMEMBERED_MAX: usize = 256;

/// The answers of people, oldest first.
#[derive(Debug, Default)]
pub(super) struct AnsweredQuestions(Mutex<VecDeque<(String, PersonName)>>);

/// The person who has answered a question before another one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum EarlierAnswer {
    /// The same person, at another page.
    Own,
    /// Another person.
    Of(PersonName),
    /// Somebody elsewhere, or nobody in time.
    Elsewhere,
}

impl AnsweredQuestions {
    /// Notes that a person answers a question, before it is known whether the answer counts: of two
    /// people that answer at once, the other one is then known.
    pub(super) fn begin(&self, question: &str, person: &PersonName) {
        let mut answers = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        if answers.len() >= REMEMBERED_MAX {
            answers.pop_front();
        }
        answers.push_back((question.to_owned(), person.clone()));
    }

    /// Takes the newest note about an answer back that did not count, and returns who was earlier.
    pub(super) fn late(&self, question: &str, person: &PersonName) -> EarlierAnswer {
        let mut answers = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let is_own = |(of, by): &(String, PersonName)| of == question && by == person;
        if let Some(own) = answers.iter().rposition(is_own) {
            answers.remove(own);
        }
        let mut others = answers.iter().filter(|(of, by)| of == question && by != person);
        match others.next() {
            Some((_, by)) => EarlierAnswer::Of(by.clone()),
            None if answers.iter().any(is_own) => EarlierAnswer::Own,
            None => EarlierAnswer::Elsewhere,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whoever_is_late_is_told_who_was_first() {
        let name = |text| PersonName::new(text).expect("a name");
        let (ada, ben, answers) = (name("ada"), name("ben"), AnsweredQuestions::default());
        answers.begin("hall/1", &ada);
        answers.begin("hall/1", &ben);
        assert_eq!(answers.late("hall/1", &ben), EarlierAnswer::Of(ada.clone()));
        answers.begin("hall/1", &ada);
        assert_eq!(answers.late("hall/1", &ada), EarlierAnswer::Own);
        answers.begin("hall/2", &ben);
        assert_eq!(answers.late("hall/2", &ben), EarlierAnswer::Elsewhere);
        (0..2 * REMEMBERED_MAX).for_each(|number| answers.begin(&number.to_string(), &ada));
        assert_eq!(answers.late("hall/1", &ben), EarlierAnswer::Elsewhere, "it is forgotten");
    }
}
