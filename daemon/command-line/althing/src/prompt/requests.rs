//! The requests of a prompt. Each has a number for the user, and is followed until its final
//! report.

use std::collections::BTreeMap;

use acl::ConversationId;
use acl::content::{GoalStatus, Outcome, Report};
use keyboard::{RequestId, UserEvent, UserRequest};

/// The kind of a request. Goals end in another way than the other requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum RequestKind {
    Goal,
    Other,
}

#[derive(Debug)]
struct PromptRequest {
    number: usize,
    kind: RequestKind,
    /// Number of final messages that are still to come. A cancelled goal has two: the final report
    /// of the goal, and the answer to the cancellation.
    final_reports_due: usize,
    /// Whether a script may continue after this request: the request has ended, or its goal holds.
    is_settled: bool,
    is_given_up: bool,
}

/// All requests that were made at a prompt.
#[derive(Debug, Default)]
pub(super) struct PromptRequests {
    count: usize,
    /// The requests that have been sent, but to which no conversation has been assigned yet.
    without_conversation: BTreeMap<RequestId, RequestKind>,
    known: BTreeMap<ConversationId, PromptRequest>,
    has_failed: bool,
}

impl PromptRequests {
    /// Records the request `said`, which the prompt is about to send with the identifier `id`.
    pub(super) fn say(&mut self, id: RequestId, said: &UserRequest) {
        let kind = match said {
            UserRequest::Cancel(conversation) => return self.give_up(conversation),
            UserRequest::RequestGoal(_) | UserRequest::ScheduleGoal(..) => RequestKind::Goal,
            UserRequest::Act(_)
            | UserRequest::Set(_)
            | UserRequest::Mode(_)
            | UserRequest::Answer { .. }
            | UserRequest::Send(_) => RequestKind::Other,
        };
        self.without_conversation.insert(id, kind);
    }

    fn give_up(&mut self, conversation: &ConversationId) {
        if let Some(request) = self.known.get_mut(conversation) {
            request.is_given_up = true;
            request.is_settled = false;
            // The final report of an action that has not ended also answers the cancellation.
            request.final_reports_due +=
                usize::from(request.kind == RequestKind::Goal || request.final_reports_due == 0);
            return;
        }
        let request = self.new_request(RequestKind::Goal);
        self.known.insert(conversation.clone(), PromptRequest { is_given_up: true, ..request });
    }

    fn new_request(&mut self, kind: RequestKind) -> PromptRequest {
        self.count += 1;
        let number = self.count;
        PromptRequest { number, kind, final_reports_due: 1, is_settled: false, is_given_up: false }
    }

    /// Records a received message. Returns the number of the request to which the message belongs;
    /// `None` if it belongs to no request of this prompt.
    pub(super) fn hear(&mut self, heard: &UserEvent) -> Option<usize> {
        let conversation = heard.conversation()?;
        let kind = heard.request().and_then(|id| self.without_conversation.remove(&id));
        // A goal that was requested before the prompt opened gets its number from this notice.
        let earlier = matches!(heard, UserEvent::Sent(_)).then_some(RequestKind::Goal);
        if let Some(kind) = kind.or(earlier)
            && !self.known.contains_key(conversation)
        {
            let request = self.new_request(kind);
            self.known.insert(conversation.clone(), request);
        }
        let request = self.known.get_mut(conversation)?;
        if heard.is_final() {
            request.final_reports_due = request.final_reports_due.saturating_sub(1);
            request.is_settled |= request.final_reports_due == 0;
            let is_as_asked = request.is_given_up
                && matches!(
                    heard,
                    UserEvent::Report(_, Report { outcome: Outcome::Cancelled, .. })
                );
            self.has_failed |= !heard.is_success() && !is_as_asked;
        } else {
            request.is_settled |= heard.is_success();
        }
        Some(request.number)
    }

    /// Returns the conversation of the request that has this number.
    pub(super) fn find(&self, number: &str) -> Option<ConversationId> {
        let number: usize = number.parse().ok()?;
        let found = self.known.iter().find(|(_, request)| request.number == number);
        found.map(|(conversation, _)| conversation.clone())
    }

    /// Returns the name by which the user of this prompt refers to a goal: `[2]` for a goal that was
    /// requested here, `#5` for another one.
    pub(super) fn label(&self, goal: &GoalStatus) -> String {
        match self.known.get(&goal.conversation) {
            Some(request) => format!("[{}]", request.number),
            None => format!("#{}", goal.number),
        }
    }

    /// Returns the numbers of the requests that have not ended.
    pub(super) fn numbers(&self) -> Vec<String> {
        let open = self.known.values().filter(|request| request.final_reports_due > 0);
        open.map(|request| request.number.to_string()).collect()
    }

    /// Whether a script may continue: each request has ended, or its goal holds.
    pub(super) fn are_settled(&self) -> bool {
        self.without_conversation.is_empty()
            && self.known.values().all(|request| request.is_settled)
    }

    /// Records that a line of the user could not be carried out.
    pub(super) fn fail(&mut self) {
        self.has_failed = true;
    }

    /// Whether no request and no line has failed so far.
    pub(super) fn went_well(&self) -> bool {
        !self.has_failed
    }
}

#[cfg(test)]
mod tests {
    use keyboard::{GoalRequest, RequestRef, Terminal};

    use super::*;

    fn id(name: &str) -> ConversationId {
        ConversationId::new(name)
    }

    fn about(id: Option<RequestId>, name: &str) -> RequestRef {
        RequestRef { id, conversation: ConversationId::new(name) }
    }

    fn report(name: &str, outcome: Outcome) -> UserEvent {
        UserEvent::Report(about(None, name), Report::new(outcome, ""))
    }

    /// Returns the numbers that a terminal gives to `N` requests.
    fn numbers<const N: usize>() -> [RequestId; N] {
        let (terminal, _peer) = Terminal::open();
        std::array::from_fn(|_| terminal.requests.try_send(wish()).expect("the channel is open"))
    }

    fn wish() -> UserRequest {
        UserRequest::RequestGoal(GoalRequest {
            goal: "(on)".into(),
            keep: Default::default(),
            priority: 0,
            partition: Default::default(),
        })
    }

    /// Returns the requests of a prompt at which one goal has been requested.
    fn one_goal() -> PromptRequests {
        let mut requests = PromptRequests::default();
        let [goal] = numbers();
        requests.say(goal, &wish());
        assert!(!requests.are_settled(), "said, not yet asked");
        assert_eq!(requests.hear(&UserEvent::Sent(about(Some(goal), "g"))), Some(1));
        requests
    }

    #[test]
    fn a_script_continues_after_the_final_report_or_when_a_goal_holds() {
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
    fn a_cancelled_goal_has_two_final_reports_and_does_not_fail() {
        let mut requests = one_goal();
        let [_, cancellation] = numbers();
        let goal = requests.find("1").expect("the goal");
        requests.say(cancellation, &UserRequest::Cancel(goal));
        requests.hear(&report("g", Outcome::Cancelled));
        assert!(!requests.are_settled());
        requests.hear(&report("g", Outcome::Cancelled));
        assert!(requests.are_settled() && requests.went_well());
    }

    #[test]
    fn a_cancelled_action_has_one_final_report() {
        let mut requests = PromptRequests::default();
        let [action, cancellation] = numbers();
        requests.say(action, &UserRequest::Act("(go)".into()));
        requests.hear(&UserEvent::Sent(about(Some(action), "a")));
        requests.say(cancellation, &UserRequest::Cancel(id("a")));
        requests.hear(&report("a", Outcome::Cancelled));
        assert!(requests.are_settled() && requests.went_well());
        assert_eq!(requests.numbers(), [""; 0]);
    }

    #[test]
    fn a_goal_of_another_keyboard_can_be_cancelled() {
        let mut requests = PromptRequests::default();
        let [cancellation] = numbers();
        requests.say(cancellation, &UserRequest::Cancel(id("theirs")));
        assert!(!requests.are_settled());
        requests.hear(&report("theirs", Outcome::Cancelled));
        assert!(requests.are_settled() && requests.went_well());
    }

    /// The notice that the goal was sent is lost; the action is still known as an action.
    #[test]
    fn a_lost_notice_changes_no_other_request() {
        let mut requests = PromptRequests::default();
        let [goal, action, cancellation] = numbers();
        requests.say(goal, &wish());
        requests.say(action, &UserRequest::Act("(go)".into()));
        requests.hear(&UserEvent::Sent(about(Some(action), "a")));
        requests.say(cancellation, &UserRequest::Cancel(id("a")));
        requests.hear(&report("a", Outcome::Cancelled));
        assert_eq!(requests.numbers(), [""; 0], "one report ends an action");
        assert!(!requests.are_settled(), "the goal is still to come");
        let end = UserEvent::Report(about(Some(goal), "g"), Report::new(Outcome::Done, ""));
        assert_eq!(requests.hear(&end), Some(2));
        assert!(requests.are_settled() && requests.went_well());
    }
}
