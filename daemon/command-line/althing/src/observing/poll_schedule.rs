//! When a view queries which resource: at the start, seldom after that, and soon after a message
//! that shows that the answer has changed. An open view costs the daemons little.

use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Duration;

use acl::Performative;
use agent::Resource;
use substrate::{Destination, Subject};
use tokio::sync::Notify;
use tokio::time::Instant;

/// A resource that a view queries, and how often.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Poll {
    pub(crate) resource: Resource,
    /// Interval between two queries if nothing shows that the answer has changed.
    period: Duration,
    /// Shortest interval between two queries.
    least: Duration,
}

/// Resources that show what people wait for: goals, questions, stops. If a message is missed, the
/// screen is right again after this time.
const OFTEN: Duration = Duration::from_secs(10);

/// Resources that change when something is installed, or that are long. What changes in the state
/// between two queries is in the heartbeats of the agents.
const SELDOM: Duration = Duration::from_secs(60);

/// Models are announced to all when they change: one query at the start is enough, and more are a
/// precaution.
const ONCE: Duration = Duration::from_secs(900);

/// Shortest interval between two queries of a short resource, of a long one, and of the composite
/// domain. A daemon of a thousand agents takes milliseconds to answer the long ones.
const SHORT: Duration = Duration::from_millis(500);
const LONG: Duration = Duration::from_secs(5);
const LONGEST: Duration = Duration::from_secs(30);

/// All resources that a view queries. Who is present is not queried: the link tells it.
pub(crate) const POLLS: [Poll; 8] = [
    Poll { resource: Resource::Model, period: ONCE, least: ONCE },
    Poll { resource: Resource::Domain, period: SELDOM, least: LONGEST },
    Poll { resource: Resource::State, period: SELDOM, least: LONG },
    Poll { resource: Resource::Goals, period: OFTEN, least: SHORT },
    Poll { resource: Resource::Questions, period: OFTEN, least: SHORT },
    Poll { resource: Resource::Stops, period: OFTEN, least: LONG },
    Poll { resource: Resource::Mailbox, period: OFTEN, least: LONG },
    Poll { resource: Resource::Discovered, period: SELDOM, least: LONG },
];

/// The usual names of the agents that take goals, and that keep the state. If they have other names,
/// their messages give no hints, and they are queried after [`OFTEN`].
const PLAN_REQUESTER: &str = "plan-requester";
const DOMAIN_MAINTAINER: &str = "domain-maintainer";

/// The times at which the resources are queried next.
#[derive(Debug)]
pub(crate) struct PollSchedule {
    /// For each of [`POLLS`], the time of the last query; `None` before the first one.
    asked: [Option<Instant>; POLLS.len()],
    /// Bits of the resources whose answer has changed since the last query.
    wanted: u32,
}

/// Hints that the answers to queries have changed. The thread of the transport gives them.
#[derive(Debug, Default)]
pub(crate) struct PollHints {
    wanted: AtomicU32,
    changed: Notify,
}

impl PollHints {
    /// Takes a hint from the destination of a message. The message itself is not decoded.
    pub(crate) fn note(&self, destination: &Destination) {
        use Performative::{Cancel, Inform, QueryRef, Request};
        let changed: &[Resource] = match destination {
            // A question to a person, or the answer to one. The Doorkeeper asks about agents that
            // were discovered.
            Destination::To(_, Subject::Message(QueryRef | Inform))
            | Destination::All(_, QueryRef) => &[Resource::Questions, Resource::Discovered],
            Destination::To(agent, Subject::Message(Request | Cancel))
                if agent.as_str() == PLAN_REQUESTER =>
            {
                &[Resource::Goals]
            }
            Destination::To(_, Subject::Message(Request)) => &[Resource::Stops],
            Destination::All(sender, Inform) if sender.as_str() == DOMAIN_MAINTAINER => {
                &[Resource::State, Resource::Domain]
            }
            _ => return,
        };
        let bits = POLLS.iter().enumerate().filter(|(_, poll)| changed.contains(&poll.resource));
        let bits = bits.fold(0, |bits, (at, _)| bits | 1 << at);
        if self.wanted.fetch_or(bits, Ordering::Relaxed) & bits != bits {
            self.changed.notify_one();
        }
    }

    /// Waits for the next hint.
    pub(crate) async fn changed(&self) {
        self.changed.notified().await;
    }
}

impl PollSchedule {
    pub(crate) fn new() -> PollSchedule {
        PollSchedule { asked: [None; POLLS.len()], wanted: 0 }
    }

    /// Returns the resources to query now, and notes that they are queried.
    pub(crate) fn due(&mut self, now: Instant, hints: &PollHints) -> Vec<Resource> {
        self.wanted |= hints.wanted.swap(0, Ordering::Relaxed);
        let mut due = Vec::new();
        for (at, poll) in POLLS.iter().enumerate() {
            if self.next_of(at).is_none_or(|next| next <= now) {
                self.asked[at] = Some(now);
                self.wanted &= !(1 << at);
                due.push(poll.resource);
            }
        }
        due
    }

    /// Returns the time of the next query; `None` if it is now.
    pub(crate) fn next(&self) -> Option<Instant> {
        let times: Option<Vec<_>> = (0..POLLS.len()).map(|at| self.next_of(at)).collect();
        times?.into_iter().min()
    }

    /// Returns the time of the next query of one resource; `None` if it was never queried.
    fn next_of(&self, at: usize) -> Option<Instant> {
        let Poll { period, least, .. } = POLLS[at];
        let is_wanted = self.wanted & 1 << at != 0;
        self.asked[at].map(|asked| asked + if is_wanted { least } else { period })
    }
}

#[cfg(test)]
mod tests {
    use acl::AgentId;

    use super::*;

    #[test]
    fn everything_is_queried_at_the_start_and_then_seldom() {
        let (mut schedule, hints, now) =
            (PollSchedule::new(), PollHints::default(), Instant::now());
        assert_eq!(schedule.due(now, &hints).len(), POLLS.len());
        assert!(schedule.due(now + SHORT, &hints).is_empty());
        let mut count = 0;
        for second in 1..=60 {
            count += schedule.due(now + Duration::from_secs(second), &hints).len();
        }
        assert!(count < 60, "{count} queries in a minute");
    }

    #[test]
    fn a_message_makes_a_query_due_but_not_at_once_again() {
        let (mut schedule, hints, now) =
            (PollSchedule::new(), PollHints::default(), Instant::now());
        schedule.due(now, &hints);
        let requester = AgentId::new(PLAN_REQUESTER).expect("a name");
        for _ in 0..1_000 {
            hints.note(&Destination::To(requester.clone(), Subject::Message(Performative::Cancel)));
        }
        assert!(schedule.due(now + SHORT / 2, &hints).is_empty());
        assert_eq!(schedule.next(), Some(now + SHORT));
        assert_eq!(schedule.due(now + SHORT, &hints), [Resource::Goals]);
        assert!(schedule.due(now + SHORT * 2, &hints).is_empty(), "it was answered");
    }
}
