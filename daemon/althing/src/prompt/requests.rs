//! The requests of a prompt: numbered for the user, and followed to their final reports.

use std::collections::{BTreeMap, VecDeque};

use acl::ConversationId;
use acl::content::{Outcome, Report};
use keyboard::{Heard, Said};

/// The kind of a request, as far as its end depends on it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Goal,
    Other,
}

#[derive(Debug)]
struct Request {
    number: usize,
    kind: Kind,
    /// Number of final messages that are still to come: a cancelled goal has two, its own and the
    /// answer to the cancellation.
    last_words: usize,
    /// Whether a script may continue: the request has ended, or its goal holds.
    is_settled: bool,
    is_given_up: bool,
}

/// All requests of a prompt.
#[derive(Debug, Default)]
pub(super) struct Requests {
    count: usize,
    /// Requests that have been sent, but have no conversation yet.
    said: VecDeque<Kind>,
    known: BTreeMap<ConversationId, Request>,
    has_failed: bool,
}

impl Requests {
    /// Records a request that is about to be sent.
    pub(super) fn say(&mut self, said: &Said) {
        match said {
            Said::Cancel(conversation) => self.give_up(conversation),
            Said::Wish(_) => self.said.push_back(Kind::Goal),
            Said::Act(_) | Said::Set(_) | Said::Mode(_) | Said::Answer { .. } | Said::Send(_) => {
                self.said.push_back(Kind::Other);
            }
        }
    }

    fn give_up(&mut self, conversation: &ConversationId) {
        if let Some(request) = self.known.get_mut(conversation) {
            request.is_given_up = true;
            request.is_settled = false;
            // For an action that has not ended, its own final report also answers the cancellation.
            request.last_words +=
                usize::from(request.kind == Kind::Goal || request.last_words == 0);
            return;
        }
        let request = self.new_request(Kind::Goal);
        self.known.insert(conversation.clone(), Request { is_given_up: true, ..request });
    }

    fn new_request(&mut self, kind: Kind) -> Request {
        self.count += 1;
        let number = self.count;
        Request { number, kind, last_words: 1, is_settled: false, is_given_up: false }
    }

    /// Records a message. Returns the number of the request that it belongs to.
    pub(super) fn hear(&mut self, heard: &Heard) -> Option<usize> {
        let conversation = heard.conversation()?;
        if matches!(heard, Heard::Asked(_)) && !self.known.contains_key(conversation) {
            let kind = self.said.pop_front().unwrap_or(Kind::Goal);
            let request = self.new_request(kind);
            self.known.insert(conversation.clone(), request);
        }
        let request = self.known.get_mut(conversation)?;
        if heard.is_final() {
            request.last_words = request.last_words.saturating_sub(1);
            request.is_settled |= request.last_words == 0;
            let is_as_asked = request.is_given_up
                && matches!(heard, Heard::Report(_, Report { outcome: Outcome::Cancelled, .. }));
            self.has_failed |= !heard.is_success() && !is_as_asked;
        } else {
            request.is_settled |= heard.is_success();
        }
        Some(request.number)
    }

    /// Returns the conversation of a request's number.
    pub(super) fn find(&self, number: &str) -> Option<ConversationId> {
        let number: usize = number.parse().ok()?;
        let found = self.known.iter().find(|(_, request)| request.number == number);
        found.map(|(conversation, _)| conversation.clone())
    }

    /// Returns the numbers of the requests that have not ended.
    pub(super) fn numbers(&self) -> Vec<String> {
        let open = self.known.values().filter(|request| request.last_words > 0);
        open.map(|request| request.number.to_string()).collect()
    }

    /// Whether a script may continue: all requests have ended, or their goals hold.
    pub(super) fn are_settled(&self) -> bool {
        self.said.is_empty() && self.known.values().all(|request| request.is_settled)
    }

    /// Records that a line could not be carried out.
    pub(super) fn fail(&mut self) {
        self.has_failed = true;
    }

    /// Whether nothing has failed.
    pub(super) fn went_well(&self) -> bool {
        !self.has_failed
    }
}

#[cfg(test)]
mod tests {
    use keyboard::Wish;

    use super::*;

    fn id(name: &str) -> ConversationId {
        ConversationId::new(name)
    }

    fn report(name: &str, outcome: Outcome) -> Heard {
        Heard::Report(id(name), Report::new(outcome, ""))
    }

    fn wish() -> Said {
        Said::Wish(Wish {
            goal: "(on)".into(),
            keep: Default::default(),
            priority: 0,
            partition: Default::default(),
        })
    }

    /// Creates the requests of a prompt after one goal.
    fn one_goal() -> Requests {
        let mut requests = Requests::default();
        requests.say(&wish());
        assert!(!requests.are_settled(), "said, not yet asked");
        assert_eq!(requests.hear(&Heard::Asked(id("g"))), Some(1));
        requests
    }

    #[test]
    fn a_script_goes_on_after_the_last_word_or_when_a_goal_holds() {
        for (outcome, went_well) in
            [(Outcome::Done, true), (Outcome::Holds, true), (Outcome::Failed, false)]
        {
            let mut requests = one_goal();
            requests.hear(&report("g", Outcome::Progress));
            assert!(!requests.are_settled());
            requests.hear(&report("g", outcome));
            assert!(requests.are_settled(), "{outcome:?}");
            assert_eq!(requests.went_well(), went_well, "{outcome:?}");
        }
    }

    #[test]
    fn a_goal_that_is_given_up_has_two_last_words_and_did_not_fail() {
        let mut requests = one_goal();
        requests.say(&Said::Cancel(requests.find("1").expect("the goal")));
        requests.hear(&report("g", Outcome::Cancelled));
        assert!(!requests.are_settled());
        requests.hear(&report("g", Outcome::Cancelled));
        assert!(requests.are_settled() && requests.went_well());
    }

    #[test]
    fn an_action_that_is_given_up_has_one() {
        let mut requests = Requests::default();
        requests.say(&Said::Act("(go)".into()));
        requests.hear(&Heard::Asked(id("a")));
        requests.say(&Said::Cancel(id("a")));
        requests.hear(&report("a", Outcome::Cancelled));
        assert!(requests.are_settled() && requests.went_well());
        assert_eq!(requests.numbers(), [""; 0]);
    }

    #[test]
    fn what_another_keyboard_asked_for_can_be_given_up() {
        let mut requests = Requests::default();
        requests.say(&Said::Cancel(id("theirs")));
        assert!(!requests.are_settled());
        requests.hear(&report("theirs", Outcome::Cancelled));
        assert!(requests.are_settled() && requests.went_well());
    }
}
