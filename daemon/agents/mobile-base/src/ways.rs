//! Ways between places, as a real base has come to know them: how long each takes, and which ones
//! the base could not pass lately.
//!
//! - The cost of a `move` is a value of the base itself, `travel`, in meters at the base's speed.
//!   It begins with the length on the map, and follows the time that driving took. The base's action
//!   model lists the costs, and heartbeats do not: a map has hundreds of ways, and their costs seldom
//!   change.
//! - A way on which the base failed is `blocked` for a while, in both directions, so that the next
//!   plan takes another way. Each further failure doubles the time, and a success ends it.

use std::collections::BTreeMap;
use std::time::Duration;

use pddl::{InitElement, Problem};
use tokio::time::Instant;

/// Share of the last time in what is learned: after five equal times, they outweigh all others.
const LEARNING_RATE: f64 = 0.3;

/// Change of a cost, as a share, from which on it is announced. Smaller ones change no plan that is
/// worth changing, and each is a message to everyone.
const ANNOUNCED_CHANGE: f64 = 0.1;

/// Longest time for which a way is avoided: a closed door is probably open again by then.
const BLOCKED_MAX: Duration = Duration::from_secs(600);

/// The two ends of a way, by the names of the places: from the first to the second.
type PlacePair = (String, String);

/// Ways between places, as one base knows them.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct KnownWays {
    /// Cost of each way, in meters.
    costs: BTreeMap<PlacePair, WayCost>,
    blocked: BTreeMap<PlacePair, BlockedWay>,
    /// How long a way is avoided after the first failure.
    blocked_for: Duration,
}

#[derive(Clone, Debug, PartialEq)]
struct WayCost {
    /// What driving took; `None` if the base has not passed the way yet.
    learned: Option<f64>,
    announced: f64,
}

impl WayCost {
    /// Sets what driving took. The announced cost follows if it differs by enough.
    fn learn(&mut self, meters: f64) {
        self.learned = Some(meters);
        if (meters - self.announced).abs() > ANNOUNCED_CHANGE * self.announced {
            // One decimal is enough, and a cost of zero would make a way free.
            self.announced = ((meters * 10.0).round() / 10.0).max(0.1);
        }
    }
}

#[derive(Clone, Debug, PartialEq)]
struct BlockedWay {
    until: Instant,
    span: Duration,
}

impl KnownWays {
    /// Returns the ways of a map, and those between `poses` and the places beside them. Each costs
    /// its length.
    pub(crate) fn of(
        map: &Problem,
        poses: impl Iterator<Item = (String, String, f64)>,
        blocked_for: Duration,
    ) -> KnownWays {
        let mapped = map.init.iter().filter_map(|element| match element {
            InitElement::Assign(term, meters) if term.function == "distance" => {
                let [from, to] = term.arguments.as_slice() else { return None };
                let way = (from.to_string().to_lowercase(), to.to_string().to_lowercase());
                Some((way, meters.0))
            }
            _ => None,
        });
        let beside = poses.flat_map(|(pose, near, meters)| {
            [((pose.clone(), near.clone()), meters), ((near, pose), meters)]
        });
        let costs = mapped.chain(beside);
        let costs = costs
            .map(|(way, meters)| (way, WayCost { learned: None, announced: meters }))
            .collect();
        KnownWays { costs, blocked: BTreeMap::new(), blocked_for }
    }

    /// Records that the base has driven from one place to another. `meters` is the length of a way
    /// that would take as long at the base's speed.
    pub(crate) fn passed(&mut self, from: &str, to: &str, meters: f64) {
        for way in both(from, to) {
            self.blocked.remove(&way);
        }
        let Some(cost) = self.costs.get_mut(&(from.to_owned(), to.to_owned())) else { return };
        let known = cost.learned.unwrap_or(cost.announced);
        cost.learn(known + LEARNING_RATE * (meters - known));
    }

    /// Sets what an earlier incarnation of the base has learned of a way. A way that does not exist
    /// any more is ignored.
    pub(crate) fn recall(&mut self, from: &str, to: &str, meters: f64) {
        if let Some(cost) = self.costs.get_mut(&(from.to_owned(), to.to_owned())) {
            cost.learn(meters);
        }
    }

    /// Returns the ways that the base has passed, each with its two ends and its cost in meters.
    pub(crate) fn learned(&self) -> impl Iterator<Item = (&str, &str, f64)> {
        let costs = self.costs.iter();
        costs.filter_map(|((from, to), cost)| Some((from.as_str(), to.as_str(), cost.learned?)))
    }

    /// Records that the base did not get from one place to another.
    pub(crate) fn failed(&mut self, from: &str, to: &str, now: Instant) {
        for way in both(from, to) {
            let known = self.blocked.get(&way).map(|blocked| blocked.span * 2);
            let span = known.unwrap_or(self.blocked_for).min(BLOCKED_MAX);
            self.blocked.insert(way, BlockedWay { until: now + span, span });
        }
    }

    /// Returns when the next blocked way is to be tried again; `None` if none is blocked.
    pub(crate) fn next_expiry(&self, now: Instant) -> Option<Instant> {
        self.blocked.values().map(|blocked| blocked.until).filter(|until| *until > now).min()
    }

    /// Returns the costs of all ways for the base `id`, as PDDL facts of its action model.
    pub(crate) fn costs(&self, id: &str) -> String {
        let costs = self.costs.iter();
        costs
            .map(|((from, to), cost)| format!(" (= (travel {id} {from} {to}) {})", cost.announced))
            .collect()
    }

    /// Returns the facts about blocked ways for the base `id`, as PDDL.
    pub(crate) fn facts(&self, id: &str, now: Instant) -> String {
        let blocked = self.blocked.iter().filter(|(_, blocked)| blocked.until > now);
        blocked.map(|((from, to), _)| format!(" (blocked {id} {from} {to})")).collect()
    }
}

fn both(from: &str, to: &str) -> [PlacePair; 2] {
    [(from.to_owned(), to.to_owned()), (to.to_owned(), from.to_owned())]
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    fn ways() -> KnownWays {
        let map = "(define (problem p) (:domain d) (:objects hall lab)
            (:init (= (distance hall lab) 10) (= (distance lab hall) 10)) (:goal (and)))";
        let map = pddl::parse_problem(map).into_result().expect("PDDL");
        KnownWays::of(&map, [("desk".into(), "lab".into(), 1.0)].into_iter(), MINUTE)
    }

    #[test]
    fn a_way_costs_its_length_until_driving_took_another_time() {
        let mut ways = ways();
        let costs = ways.costs("r");
        assert!(costs.contains("(= (travel r hall lab) 10)"), "{costs}");
        assert!(costs.contains("(= (travel r desk lab) 1)"), "{costs}");
        ways.passed("hall", "lab", 10.5);
        assert_eq!(ways.costs("r"), costs, "a small difference is not announced");
        for _ in 0..20 {
            ways.passed("hall", "lab", 30.0);
        }
        let learned = ways.costs[&("hall".to_owned(), "lab".to_owned())].announced;
        assert!((27.0..=30.0).contains(&learned), "{learned}");
        assert!(ways.costs("r").contains("(= (travel r lab hall) 10)"), "the other direction");
        assert_eq!(ways.facts("r", Instant::now()), "", "no heartbeat repeats costs");
    }

    #[test]
    fn only_passed_ways_are_learned_and_recalled_by_the_next_incarnation() {
        let (mut before, mut after) = (ways(), ways());
        before.passed("hall", "lab", 30.0);
        let learned: Vec<_> = before.learned().collect();
        assert_eq!(learned, [("hall", "lab", 16.0)]);
        for (from, to, meters) in learned {
            after.recall(from, to, meters);
        }
        after.recall("hall", "cellar", 5.0);
        assert_eq!(after.costs("r"), before.costs("r"), "the cellar is no place any more");
        assert!(after.costs("r").contains("(= (travel r hall lab) 16)"), "{}", after.costs("r"));
    }

    #[test]
    fn a_way_is_blocked_for_a_while_which_doubles_until_it_is_passed() {
        let (mut ways, now) = (ways(), Instant::now());
        let is_blocked = |ways: &KnownWays, at| {
            let facts = ways.facts("r", at);
            assert_eq!(facts.contains("blocked r hall lab"), facts.contains("blocked r lab hall"));
            facts.contains("blocked")
        };
        assert_eq!(ways.next_expiry(now), None);
        ways.failed("hall", "lab", now);
        assert!(is_blocked(&ways, now) && !is_blocked(&ways, now + MINUTE));
        assert_eq!(ways.next_expiry(now), Some(now + MINUTE));
        ways.failed("hall", "lab", now + MINUTE);
        assert!(is_blocked(&ways, now + MINUTE * 2) && !is_blocked(&ways, now + MINUTE * 3));
        for _ in 0..9 {
            ways.failed("hall", "lab", now);
        }
        assert!(!is_blocked(&ways, now + BLOCKED_MAX));
        ways.passed("lab", "hall", 10.0);
        assert!(!is_blocked(&ways, now));
        ways.failed("hall", "lab", now);
        assert_eq!(ways.next_expiry(now), Some(now + MINUTE), "it begins anew");
    }
}
