//! Safeguards of actions: a person has to allow an action each time, or it is limited in its rate.

use std::collections::{BTreeMap, VecDeque};
use std::time::Duration;

use acl::AgentId;
use tokio::time::Instant;

/// Resource of a host: the safeguards of its agents' actions, by agent and by the name of the
/// action. Agents that no file names, such as those of a gateway, may have safeguards, too.
#[derive(Clone, Debug, Default)]
pub struct Safeguards(pub BTreeMap<AgentId, BTreeMap<String, ActionSafeguard>>);

/// The safeguard of one action.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct ActionSafeguard {
    /// Time limit for the answer of a person; `None` if the action needs no person's consent.
    pub asks_people: Option<Duration>,
    /// How often the action may begin; `None` without a limit.
    pub limit: Option<BeginLimit>,
}

/// Maximum number of times that an action may begin in any span of time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BeginLimit {
    /// The maximum number of times.
    pub at_most: u32,
    /// The span of time.
    pub per: Duration,
}

/// The safeguards of one agent, and when its limited actions began lately.
#[derive(Debug, Default)]
pub(crate) struct SafeguardedActions {
    safeguards: BTreeMap<String, ActionSafeguard>,
    begun: BTreeMap<String, VecDeque<Instant>>,
}

impl SafeguardedActions {
    /// Returns the safeguards of the agent `own`; none if the host has none.
    pub(crate) fn of(safeguards: Option<&Safeguards>, own: &AgentId) -> SafeguardedActions {
        let safeguards = safeguards.and_then(|all| all.0.get(own)).cloned().unwrap_or_default();
        SafeguardedActions { safeguards, begun: BTreeMap::new() }
    }

    /// Checks that each safeguarded action is one of `actions`, the actions of the agent. A misspelled
    /// name would safeguard nothing. The check passes if `actions` is empty, because the actions of
    /// some agents are not known before they run.
    ///
    /// # Errors
    ///
    /// Returns the first name that is not offered, with those that are.
    pub(crate) fn check_names(&self, actions: &[String]) -> Result<(), String> {
        let unknown = self.safeguards.keys().find(|name| !actions.contains(name));
        let Some(unknown) = unknown.filter(|_| !actions.is_empty()) else { return Ok(()) };
        let near = pddl::nearest(unknown, actions.iter().map(String::as_str));
        let hint = match near {
            Some(near) => format!("did you mean `{near}`?"),
            None => format!("it has {}", actions.join(", ")),
        };
        Err(format!("`{unknown}` is no action of it; {hint}"))
    }

    /// Returns the time limit for the answer of a person; `None` if the action needs no consent.
    pub(crate) fn asks_people(&self, action: &str) -> Option<Duration> {
        self.safeguards.get(action)?.asks_people
    }

    /// Returns why the action may not begin at the time `now`; `None` if it may.
    pub(crate) fn objection(&self, action: &str, now: Instant) -> Option<String> {
        let BeginLimit { at_most, per } = self.safeguards.get(action)?.limit?;
        let begun = self.begun.get(action)?;
        // The oldest of the last `at_most` beginnings.
        let first = begun.iter().rev().nth(usize::try_from(at_most).ok()?.checked_sub(1)?)?;
        let rest = (*first + per).saturating_duration_since(now);
        // Whole seconds, rounded up: at the stated time the action may begin.
        let rest = Duration::from_secs(rest.as_secs_f64().ceil() as u64);
        (!rest.is_zero()).then(|| {
            let (per, rest) = (humantime::format_duration(per), humantime::format_duration(rest));
            let times = if at_most == 1 { "once" } else { &format!("{at_most} times") };
            format!("`{action}` may begin at most {times} in {per}; again in {rest}")
        })
    }

    /// Records that an action begins.
    pub(crate) fn begins(&mut self, action: &str, now: Instant) {
        let Some(BeginLimit { at_most, .. }) = self.safeguards.get(action).and_then(|it| it.limit)
        else {
            return;
        };
        let begun = self.begun.entry(action.to_owned()).or_default();
        begun.push_back(now);
        let surplus = begun.len().saturating_sub(usize::try_from(at_most).unwrap_or(usize::MAX));
        begun.drain(..surplus);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    fn safeguarded(at_most: u32) -> SafeguardedActions {
        let limit = Some(BeginLimit { at_most, per: MINUTE });
        let safeguard = ActionSafeguard { asks_people: None, limit };
        let own = AgentId::new("heater").expect("a name");
        let of = [("switch-on".to_owned(), safeguard)].into();
        SafeguardedActions::of(Some(&Safeguards([(own.clone(), of)].into())), &own)
    }

    #[test]
    fn an_action_may_begin_as_often_as_its_limit_allows_in_any_span() {
        let (mut heater, start) = (safeguarded(2), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        for second in [0, 50] {
            assert_eq!(heater.objection("switch-on", at(second)), None);
            heater.begins("switch-on", at(second));
        }
        assert_eq!(
            heater.objection("switch-on", at(59)).as_deref(),
            Some("`switch-on` may begin at most 2 times in 1m; again in 1s")
        );
        // The span slides: the second beginning still counts.
        assert_eq!(heater.objection("switch-on", at(60)), None);
        heater.begins("switch-on", at(60));
        assert!(heater.objection("switch-on", at(109)).is_some());
        assert_eq!(heater.objection("switch-on", at(110)), None);
        assert_eq!(heater.objection("switch-off", at(59)), None, "it has no limit");
    }

    #[test]
    fn a_limit_of_once_is_said_so() {
        let (mut heater, start) = (safeguarded(1), Instant::now());
        heater.begins("switch-on", start);
        let why = heater.objection("switch-on", start).expect("too early");
        assert_eq!(why, "`switch-on` may begin at most once in 1m; again in 1m");
    }
}
