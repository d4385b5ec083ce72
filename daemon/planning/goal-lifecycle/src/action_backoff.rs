//! Back-off of actions that failed in earlier plans of a goal.

use std::collections::BTreeMap;
use std::time::Duration;

use acl::AgentId;
use acl::content::{Keep, Offers, Reason, Report};

/// Time for which an action is avoided after its first failure. The time doubles with every
/// failure, up to `AVOIDED_MAX`: a loose contact recovers within seconds, but a repair takes
/// minutes.
const AVOIDED_FIRST: Duration = Duration::from_secs(10);
const AVOIDED_MAX: Duration = Duration::from_secs(300);

/// Number of failures after which an action is no longer used for a goal that is to be achieved
/// once. The first attempt is immediate, the second follows after ten seconds and the third after
/// thirty. The third failure is reported to the user.
const TRIES_MAX: u32 = 3;

/// Actions that failed in earlier plans of a goal and are avoided for a while. The key is the agent
/// and the agent's own name for the action.
pub type AvoidedActions = BTreeMap<(AgentId, String), AvoidedAction>;

/// Reason why an action is avoided, and whether the action may be tried again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct AvoidedAction {
    /// Reason why the action is avoided, as text for a person.
    pub why: String,
    /// Whether the action is never tried again for this goal, until its agent offers the action
    /// anew.
    pub is_for_good: bool,
    /// Whether the agent no longer offers the action.
    pub is_withdrawn: bool,
}

/// A failed action of a goal, in the form in which a replica that takes the goal over receives it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FailedAction {
    /// The agent.
    pub agent: AgentId,
    /// The agent's own name for the action.
    pub action: String,
    /// Number of failures so far.
    pub times: u32,
    /// Whether the agent refused the last request for the action with [`Reason::Incapable`].
    pub is_refused: bool,
    /// Reason of the last failure, as text for a person.
    pub why: String,
}

/// Back-off of all failed actions of one goal.
#[derive(Clone, Debug)]
pub struct ActionBackoffs {
    keep: Keep,
    failed: BTreeMap<(AgentId, String), ActionBackoff>,
}

/// Back-off of one failed action of an agent.
#[derive(Clone, Debug)]
struct ActionBackoff {
    until: Duration,
    span: Duration,
    times: u32,
    /// Whether the agent refused the last request for the action with [`Reason::Incapable`].
    is_refused: bool,
    /// Whether the agent no longer offers the action.
    is_withdrawn: bool,
    why: String,
}

impl ActionBackoffs {
    /// Returns the back-off of a goal without failed actions. A goal that is to be achieved once
    /// gives an action up after some failures; a kept goal never does.
    pub fn new(keep: Keep) -> ActionBackoffs {
        ActionBackoffs { keep, failed: BTreeMap::new() }
    }

    /// Records a failure of an action, so that the action is avoided for a while. The time doubles
    /// with each failure.
    pub fn penalize(&mut self, action: (AgentId, String), report: &Report, now: Duration) {
        let backoff = self.failed.entry(action).or_insert_with(|| ActionBackoff {
            until: now,
            span: AVOIDED_FIRST / 2,
            times: 0,
            is_refused: false,
            is_withdrawn: false,
            why: String::new(),
        });
        backoff.span = (backoff.span * 2).min(AVOIDED_MAX);
        backoff.until = now.saturating_add(backoff.span);
        backoff.times += 1;
        backoff.is_refused = report.declined == Some(Reason::Incapable);
        backoff.why.clone_from(&report.detail);
    }

    /// Returns the failed actions, for a replica that takes the goal over.
    pub fn failed_actions(&self) -> Vec<FailedAction> {
        let failed = |((agent, action), backoff): (&(AgentId, String), &ActionBackoff)| {
            let (agent, action, why) = (agent.clone(), action.clone(), backoff.why.clone());
            let ActionBackoff { times, is_refused, .. } = *backoff;
            FailedAction { agent, action, times, is_refused, why }
        };
        self.failed.iter().map(failed).collect()
    }

    /// Restores the failed actions that an earlier replica has recorded. As its clock is not known
    /// here, each action is avoided for the whole time that follows from its number of failures,
    /// counted from `now`.
    pub fn restore(&mut self, failed: impl IntoIterator<Item = FailedAction>, now: Duration) {
        for FailedAction { agent, action, times, is_refused, why } in failed {
            let doubled = 1_u32.checked_shl(times.saturating_sub(1)).unwrap_or(u32::MAX);
            let span = AVOIDED_FIRST.saturating_mul(doubled).min(AVOIDED_MAX);
            let until = now.saturating_add(span);
            let backoff =
                ActionBackoff { until, span, times, is_refused, is_withdrawn: false, why };
            self.failed.insert((agent, action), backoff);
        }
    }

    /// Stops avoiding all actions of an agent, because the agent has announced its action model
    /// anew.
    pub fn reset(&mut self, agent: &AgentId) {
        self.failed.retain(|(avoided, _), _| avoided != agent);
    }

    /// Compares the avoided actions with the present offers. An avoided action without an offer is
    /// marked as withdrawn: its agent has detected the fault. A withdrawn action that is offered
    /// again is no longer avoided.
    pub fn compare_with(&mut self, offers: &Offers) {
        self.failed.retain(|(agent, action), backoff| {
            let is_offered = offers.get(agent).is_some_and(|actions| actions.contains_key(action));
            let is_offered_again = backoff.is_withdrawn && is_offered;
            backoff.is_withdrawn = !is_offered;
            !is_offered_again
        });
    }

    /// Returns the actions that are avoided at the time `now`.
    pub fn avoided(&self, now: Duration) -> AvoidedActions {
        let held = |backoff: &ActionBackoff| AvoidedAction {
            why: backoff.why.clone(),
            is_for_good: self.is_done_with(backoff),
            is_withdrawn: backoff.is_withdrawn,
        };
        self.failed
            .iter()
            .filter(|(_, backoff)| {
                backoff.until > now || backoff.is_withdrawn || self.is_done_with(backoff)
            })
            .map(|(key, backoff)| (key.clone(), held(backoff)))
            .collect()
    }

    /// Whether the action has failed too often, or its agent has declined it as incapable. An
    /// action of this kind is not tried for this goal until its agent offers it again. Always
    /// `false` for a kept goal: its actions are tried any number of times, at growing intervals.
    fn is_done_with(&self, backoff: &ActionBackoff) -> bool {
        self.keep == Keep::Achieve && (backoff.is_refused || backoff.times >= TRIES_MAX)
    }

    /// Returns the earliest time at which a failed action may be tried again; `None` if no failed
    /// action may be tried again.
    pub fn next_chance(&self, now: Duration) -> Option<Duration> {
        self.failed
            .values()
            .filter(|backoff| !backoff.is_withdrawn && !self.is_done_with(backoff))
            .map(|backoff| backoff.until)
            .filter(|until| *until > now)
            .min()
    }
}

#[cfg(test)]
mod tests {
    use acl::content::{Offer, Outcome};

    use super::*;

    fn lamp() -> (AgentId, String) {
        (AgentId::new("lamp").expect("a name"), "light".to_owned())
    }

    fn failed(declined: Option<Reason>) -> Report {
        Report { declined, ..Report::new(Outcome::Failed, "it is dark") }
    }

    #[test]
    fn a_failing_action_is_tried_three_times_and_a_refused_one_once() {
        let now = Duration::from_secs(7);
        let mut silent = ActionBackoffs::new(Keep::Achieve);
        for _ in 0..2 {
            silent.penalize(lamp(), &failed(None), now);
            assert!(silent.next_chance(now).is_some());
        }
        silent.penalize(lamp(), &failed(None), now);
        assert_eq!(silent.next_chance(now), None);
        let year = Duration::from_secs(365 * 24 * 3_600);
        assert!(silent.avoided(now + year).contains_key(&lamp()));
        let mut refused = ActionBackoffs::new(Keep::Achieve);
        refused.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        assert_eq!(refused.next_chance(now), None);
        let mut kept = ActionBackoffs::new(Keep::Maintain);
        kept.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        assert_eq!(kept.next_chance(now), Some(now + AVOIDED_FIRST));
    }

    #[test]
    fn a_withdrawn_action_is_retried_when_it_is_offered_again() {
        let now = Duration::ZERO;
        let mut backoffs = ActionBackoffs::new(Keep::Achieve);
        backoffs.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        let (schema, guard) = ("light".to_owned(), "(offers-light lamp)".to_owned());
        let offer = Offer { schema, guard, method: None, agents: 1 };
        let (agent, action) = lamp();
        let offers: Offers = [(agent.clone(), [(action, offer)].into())].into();
        backoffs.compare_with(&offers);
        assert_eq!(backoffs.next_chance(now), None, "it goes on offering what it refuses");
        backoffs.compare_with(&Offers::new());
        assert_eq!(backoffs.next_chance(now), None, "no agent offers it");
        assert_eq!(backoffs.avoided(now).len(), 1, "the reason is still known");
        backoffs.compare_with(&offers);
        assert!(backoffs.avoided(now).is_empty(), "it is offered again");
        backoffs.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        backoffs.reset(&agent);
        assert!(backoffs.avoided(now).is_empty());
    }

    #[test]
    fn a_replica_that_takes_over_avoids_what_has_failed() {
        let now = Duration::from_secs(7);
        let mut former = ActionBackoffs::new(Keep::Achieve);
        former.penalize(lamp(), &failed(Some(Reason::Incapable)), now);
        let other = (lamp().0, "dim".to_owned());
        former.penalize(other.clone(), &failed(None), now);
        former.penalize(other.clone(), &failed(None), now);
        let mut backoffs = ActionBackoffs::new(Keep::Achieve);
        backoffs.restore(former.failed_actions(), Duration::ZERO);
        assert_eq!(backoffs.failed_actions(), former.failed_actions());
        let avoided = backoffs.avoided(Duration::ZERO);
        assert!(avoided[&lamp()].is_for_good, "a refused action is not tried again");
        assert_eq!(avoided[&other].why, "it is dark");
        assert_eq!(backoffs.next_chance(Duration::ZERO), Some(AVOIDED_FIRST * 2));
        // The next failure is the third one.
        backoffs.penalize(other.clone(), &failed(None), AVOIDED_FIRST * 2);
        assert!(backoffs.avoided(AVOIDED_MAX)[&other].is_for_good);
    }
}
