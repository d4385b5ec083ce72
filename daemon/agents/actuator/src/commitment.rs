//! The commitment of an actuator to its part of a joint plan: for the time of a lease the actuator
//! acts for the goal of that plan only.
//!
//! - The lease begins with the agreement. Each step for the goal renews it.
//! - The commitment ends when the last step of the part is done, when a step fails or is cancelled,
//!   when the requester rejects the agreement, when a stop concerns the whole agent, or with the
//!   lease.
//! - The commitment belongs to the conversation of the goal, not to the agent that asked: a replica
//!   that takes the goal over goes on in the same conversation, and keeps it.
//!
//! All functions are pure; the actuator gives the time.

use std::time::Duration;

use acl::content::{JointPlanPart, Outcome, PartStep, Reason, Refusal};
use acl::{AgentId, ConversationId, ReplyToken};
use tokio::time::Instant;

/// How long an actuator that has agreed waits for the next step of its part. A longer lease keeps
/// agents from other work after the death of a requester, or after the failure of a plan at another
/// agent. A shorter one ends while another agent of the plan goes through two or three rooms. After the
/// lease the agent still takes the steps of the plan, unless it has agreed to another plan.
pub(crate) const AGREEMENT_LEASE: Duration = Duration::from_secs(10);

/// The commitment of an actuator to its part of one joint plan.
pub(crate) struct Commitment {
    conversation: ConversationId,
    /// The Plan Requester that asked for the agreement.
    requester: AgentId,
    /// The exchange of the agreement.
    exchange: ReplyToken,
    /// Digest of the joint plan.
    digest: String,
    /// The part, without those of its own steps that are known to be done.
    remaining_part: Vec<PartStep>,
    until: Instant,
}

// === impl Commitment ===

impl Commitment {
    /// Returns the commitment of an actuator that agrees to `part` at the time `now`.
    pub(crate) fn new(
        conversation: ConversationId,
        (requester, exchange): (AgentId, ReplyToken),
        part: &JointPlanPart,
        now: Instant,
    ) -> Commitment {
        Commitment {
            conversation,
            requester,
            exchange,
            digest: part.digest.clone(),
            remaining_part: part.steps.clone(),
            until: now + AGREEMENT_LEASE,
        }
    }

    /// Whether the commitment is one to the goal of this conversation.
    pub(crate) fn is_for(&self, conversation: &ConversationId) -> bool {
        self.conversation == *conversation
    }

    /// Whether the agreement was given in this exchange.
    pub(crate) fn is_of_exchange(&self, exchange: &ReplyToken) -> bool {
        self.exchange == *exchange
    }

    /// Whether the lease has ended.
    pub(crate) fn is_over(&self, now: Instant) -> bool {
        now >= self.until
    }

    /// Lets the lease begin anew.
    pub(crate) fn renew(&mut self, now: Instant) {
        self.until = now + AGREEMENT_LEASE;
    }

    /// Records how a step for the goal has ended. Returns whether the commitment goes on; its lease
    /// then begins anew.
    pub(crate) fn step_ended(&mut self, step: &str, outcome: Outcome, now: Instant) -> bool {
        if outcome != Outcome::Done {
            return false;
        }
        if let Some(done) = self.position(step) {
            // What others have changed for it has happened.
            let mut place = 0;
            self.remaining_part.retain(|element| {
                place += 1;
                place > done + 1 || matches!(element, PartStep::Own(_)) && place <= done
            });
        }
        self.renew(now);
        self.remaining_part.iter().any(|element| matches!(element, PartStep::Own(_)))
    }

    /// Returns the part from `step` on, with what others change before that step; empty if the rest of
    /// the part has no such step.
    pub(crate) fn part_from(&self, step: &str) -> Vec<PartStep> {
        let Some(position) = self.position(step) else { return Vec::new() };
        let (before, rest) = self.remaining_part.split_at(position);
        let others = before.iter().filter(|element| matches!(element, PartStep::Others(_)));
        others.chain(rest).cloned().collect()
    }

    fn position(&self, step: &str) -> Option<usize> {
        let is_it = |element: &PartStep| matches!(element, PartStep::Own(known) if known.eq_ignore_ascii_case(step));
        self.remaining_part.iter().position(is_it)
    }

    /// Returns the refusal of what another goal asks for: it names the holder and the rest of the
    /// lease.
    pub(crate) fn refusal(&self, now: Instant) -> Refusal {
        let Commitment { conversation, requester, digest, until, .. } = self;
        let rest = until.saturating_duration_since(now).as_secs_f64();
        let detail = format!(
            "it has agreed to plan {digest} of `{requester}` for the goal `{conversation}`, and is \
             held for {rest:.1} s more, or until its part is done"
        );
        Refusal::new(Reason::Busy, detail)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn commitment(now: Instant) -> Commitment {
        let own = |step: &str| PartStep::Own(step.to_owned());
        let others = PartStep::Others("(open)".to_owned());
        let steps = vec![own("(go robot hall)"), others, own("(go robot lab)")];
        let part = JointPlanPart { digest: "d1".to_owned(), steps };
        let requester = AgentId::new("plan-requester").expect("a name");
        let asked = (requester, ReplyToken::new("x"));
        Commitment::new(ConversationId::new("g1"), asked, &part, now)
    }

    #[test]
    fn the_lease_ends_unless_a_step_renews_it() {
        let start = Instant::now();
        let mut commitment = commitment(start);
        assert!(!commitment.is_over(start + AGREEMENT_LEASE / 2));
        assert!(commitment.is_over(start + AGREEMENT_LEASE));
        let later = start + AGREEMENT_LEASE / 2;
        assert!(commitment.step_ended("(go robot hall)", Outcome::Done, later));
        assert!(!commitment.is_over(start + AGREEMENT_LEASE));
        assert!(commitment.is_over(later + AGREEMENT_LEASE));
    }

    #[test]
    fn the_last_step_and_a_failure_end_the_commitment() {
        let now = Instant::now();
        let mut done = commitment(now);
        assert!(done.step_ended("(go robot hall)", Outcome::Done, now));
        assert!(!done.step_ended("(GO robot lab)", Outcome::Done, now));
        for outcome in [Outcome::Failed, Outcome::Cancelled] {
            assert!(!commitment(now).step_ended("(go robot hall)", outcome, now));
        }
    }

    #[test]
    fn the_rest_of_the_part_begins_with_the_step() {
        let now = Instant::now();
        let mut commitment = commitment(now);
        assert_eq!(commitment.part_from("(go ROBOT hall)").len(), 3);
        assert!(commitment.step_ended("(go robot hall)", Outcome::Done, now));
        assert!(commitment.part_from("(go robot hall)").is_empty(), "it is done");
        let others = PartStep::Others("(open)".to_owned());
        let rest = [others, PartStep::Own("(go robot lab)".to_owned())];
        assert_eq!(commitment.part_from("(go robot lab)"), rest, "the others come before it");
    }

    #[test]
    fn a_refusal_names_the_holder_and_the_rest_of_the_lease() {
        let now = Instant::now();
        let refusal = commitment(now).refusal(now + Duration::from_millis(2_500));
        assert_eq!(refusal.reason, Reason::Busy);
        let told = "it has agreed to plan d1 of `plan-requester` for the goal `g1`, and is held for \
                    7.5 s more, or until its part is done";
        assert_eq!(refusal.detail, told);
    }
}
