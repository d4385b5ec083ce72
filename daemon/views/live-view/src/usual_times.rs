//! The usual time of each action of each agent: the median of its last runs.

use std::collections::VecDeque;

use crate::bounded::BoundedMap;
use crate::text::GroundStep;

/// Number of runs of one action whose times are kept.
const RUNS_KEPT: usize = 15;

/// A run counts as late if it takes longer than usual by this many milliseconds and by a part of the
/// usual time, because no run takes exactly as long as another one.
const TOLERANCE_MS: u64 = 250;

/// The times of the runs of one action.
#[derive(Clone, Debug, Default)]
pub(crate) struct ActionTimes {
    /// The times of the last successful runs, in milliseconds, the oldest first.
    last: VecDeque<u64>,
    pub(crate) runs: u64,
    pub(crate) failures: u64,
}

impl ActionTimes {
    fn add(&mut self, took_ms: Option<u64>, succeeded: bool) {
        self.runs += 1;
        self.failures += u64::from(!succeeded);
        if let Some(took_ms) = took_ms.filter(|_| succeeded) {
            self.last.push_back(took_ms);
            if self.last.len() > RUNS_KEPT {
                self.last.pop_front();
            }
        }
    }

    /// Returns the median of the last successful runs.
    pub(crate) fn usual_ms(&self) -> Option<u64> {
        median(self.last.iter().copied())
    }
}

/// Returns the median of some numbers, the lower one of two; `None` if there are none.
pub(crate) fn median(numbers: impl Iterator<Item = u64>) -> Option<u64> {
    let mut sorted: Vec<_> = numbers.collect();
    sorted.sort_unstable();
    sorted.get(sorted.len().checked_sub(1)? / 2).copied()
}

/// The usual time of a step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct UsualTime {
    pub(crate) ms: u64,
    /// Whether the same step was run before, and not only the same action with other arguments.
    pub(crate) is_exact: bool,
}

impl UsualTime {
    /// Returns how much longer than usual a run takes, in milliseconds; `None` if it is not late.
    pub(crate) fn lateness(self, taken_ms: u64) -> Option<u64> {
        let late = taken_ms.saturating_sub(self.ms);
        // With other arguments, an action may well take twice as long: to the next room but one.
        let tolerated = if self.is_exact { self.ms / 4 } else { self.ms };
        (late > TOLERANCE_MS.saturating_add(tolerated)).then_some(late)
    }
}

/// The times of all actions, by agent and action, and by step.
#[derive(Clone, Debug)]
pub(crate) struct UsualTimes {
    actions: BoundedMap<(String, String), ActionTimes>,
    steps: BoundedMap<String, ActionTimes>,
}

impl UsualTimes {
    pub(crate) fn new(actions_max: usize) -> UsualTimes {
        UsualTimes { actions: BoundedMap::new(actions_max), steps: BoundedMap::new(actions_max) }
    }

    /// Takes the time of a run that has ended, in milliseconds. Only successful runs count for the
    /// usual time; `None` if the begin of the run was not observed.
    pub(crate) fn add(&mut self, step: &GroundStep, took_ms: Option<u64>, succeeded: bool) {
        let Some(agent) = step.arguments.first() else { return };
        let key = (agent.clone(), step.action.clone());
        entry(&mut self.actions, key).add(took_ms, succeeded);
        entry(&mut self.steps, step.to_pddl()).add(took_ms, succeeded);
    }

    pub(crate) fn of(&self, agent: &str, action: &str) -> Option<&ActionTimes> {
        self.actions.get(&(agent.to_owned(), action.to_owned()))
    }

    /// Returns the usual time of a step: that of its own earlier runs, or else that of the same
    /// action of the agent with other arguments.
    pub(crate) fn usual(&self, step: &GroundStep) -> Option<UsualTime> {
        if let Some(ms) = self.steps.get(&step.to_pddl()).and_then(ActionTimes::usual_ms) {
            return Some(UsualTime { ms, is_exact: true });
        }
        let ms = self.of(step.arguments.first()?, &step.action)?.usual_ms()?;
        Some(UsualTime { ms, is_exact: false })
    }
}

fn entry<K: Ord + Clone>(map: &mut BoundedMap<K, ActionTimes>, key: K) -> &mut ActionTimes {
    if !map.contains(&key) {
        map.insert(key.clone(), ActionTimes::default());
    }
    map.get_mut(&key).expect("invariant: it was inserted above if it was not there")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn step(text: &str) -> GroundStep {
        GroundStep::parse(text)
    }

    #[test]
    fn the_usual_time_is_the_median_of_successful_runs() {
        let mut times = UsualTimes::new(2);
        let moves = step("(move r a b)");
        assert_eq!(times.usual(&moves), None);
        for (took, succeeded) in [(100, true), (900, true), (300, true), (5, false)] {
            times.add(&moves, Some(took), succeeded);
        }
        times.add(&moves, None, true);
        assert_eq!(times.usual(&moves), Some(UsualTime { ms: 300, is_exact: true }));
        let other = times.usual(&step("(move r b c)"));
        assert_eq!(other, Some(UsualTime { ms: 300, is_exact: false }));
        assert_eq!(times.usual(&step("(move s a b)")), None);
        let known = times.of("r", "move").expect("it has run");
        assert_eq!((known.runs, known.failures), (5, 1));
        times.add(&step("(dock r)"), Some(1), true);
        times.add(&step("(scan r)"), Some(1), true);
        assert!(times.of("r", "move").is_none(), "the limit is two");
    }

    #[test]
    fn a_run_is_late_beyond_the_tolerance() {
        let exact = UsualTime { ms: 1_000, is_exact: true };
        assert_eq!(exact.lateness(1_500), None);
        assert_eq!(exact.lateness(1_501), Some(501));
        assert_eq!(exact.lateness(10), None);
        let vague = UsualTime { ms: 1_000, is_exact: false };
        assert_eq!(vague.lateness(2_250), None);
        assert_eq!(vague.lateness(2_251), Some(1_251));
    }
}
