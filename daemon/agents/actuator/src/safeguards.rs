//! Safeguards of actions: a person has to allow an action each time, or it is limited in its rate.

use std::collections::BTreeMap;
use std::io;
use std::time::{Duration, SystemTime};

use acl::AgentId;
use agent::StateFolder;
use tokio::time::Instant;

use crate::begun_actions::BegunActions;

/// Greatest number of times that a limit may allow in its span of time. All these beginnings are
/// written to disk each time.
pub const BEGINNINGS_MAX: u32 = 1_000;

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
    /// The maximum number of times; at most [`BEGINNINGS_MAX`].
    pub at_most: u32,
    /// The span of time.
    pub per: Duration,
}

/// The safeguards of one agent, and when its limited actions began lately.
#[derive(Debug, Default)]
pub(crate) struct SafeguardedActions {
    safeguards: BTreeMap<String, ActionSafeguard>,
    begun: BegunActions,
}

impl SafeguardedActions {
    /// Returns the safeguards of the agent `own`; none if the host has none. The file with the
    /// beginnings of its limited actions is in `folder`; with `None` nothing outlives the process.
    pub(crate) fn of(
        safeguards: Option<&Safeguards>,
        own: &AgentId,
        folder: Option<&StateFolder>,
    ) -> SafeguardedActions {
        let safeguards = safeguards.and_then(|all| all.0.get(own)).cloned().unwrap_or_default();
        let is_limited = safeguards.values().any(|safeguard| safeguard.limit.is_some());
        let begun = BegunActions::open(own, folder.filter(|_| is_limited));
        SafeguardedActions { safeguards, begun }
    }

    /// Takes over how often the limited actions have begun in earlier incarnations. `time` is the time
    /// of day at the moment `now`.
    pub(crate) fn resume(&mut self, time: SystemTime, now: Instant) {
        let limited = self.safeguards.iter().filter_map(|(action, safeguard)| {
            Some((action.as_str(), usize::try_from(safeguard.limit?.at_most).ok()?))
        });
        self.begun.resume(&limited.collect(), time, now);
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

    /// Checks that people are asked about no action of `private`. A question about it would name it.
    ///
    /// # Errors
    ///
    /// Returns the first such name.
    pub(crate) fn check_none_of(&self, private: &[String]) -> Result<(), String> {
        let mut asked = self.safeguards.iter().filter(|(_, it)| it.asks_people.is_some());
        match asked.find(|(name, _)| private.contains(name)) {
            Some((name, _)) => Err(format!(
                "`{name}` is private to it (privacy = \"agents\"), and people would be asked about \
                 it by name; safeguard the public action that it serves"
            )),
            None => Ok(()),
        }
    }

    /// Returns the time limit for the answer of a person; `None` if the action needs no consent.
    pub(crate) fn asks_people(&self, action: &str) -> Option<Duration> {
        self.safeguards.get(action)?.asks_people
    }

    /// Returns why the action may not begin at the time `now`; `None` if it may.
    pub(crate) fn objection(&self, action: &str, now: Instant) -> Option<String> {
        let BeginLimit { at_most, per } = self.safeguards.get(action)?.limit?;
        // The oldest of the last `at_most` beginnings.
        let elapsed = self.begun.nth_last(action, usize::try_from(at_most).ok()?, now)?;
        let rest = per.saturating_sub(elapsed);
        // Whole seconds, rounded up: at the stated time the action may begin.
        let rest = Duration::from_secs(rest.as_secs_f64().ceil() as u64);
        (!rest.is_zero()).then(|| {
            let (per, rest) = (humantime::format_duration(per), humantime::format_duration(rest));
            let times = if at_most == 1 { "once" } else { &format!("{at_most} times") };
            format!("`{action}` may begin at most {times} in {per}; again in {rest}")
        })
    }

    /// Records that an action begins. `time` is the time of day at the moment `now`. Returns a function
    /// that writes this to disk, which must succeed before the action begins; `None` if the action has
    /// no limit.
    pub(crate) fn begins(
        &mut self,
        action: &str,
        time: SystemTime,
        now: Instant,
    ) -> Option<impl FnOnce() -> io::Result<()> + Send + use<>> {
        let BeginLimit { at_most, .. } = self.safeguards.get(action)?.limit?;
        let at_most = usize::try_from(at_most).unwrap_or(usize::MAX);
        Some(self.begun.begins(action, at_most, time, now))
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    const MINUTE: Duration = Duration::from_secs(60);

    /// Time of day at the start of each test.
    fn noon() -> SystemTime {
        SystemTime::UNIX_EPOCH + Duration::from_secs(1_800_000_000)
    }

    fn safeguarded(at_most: u32, folder: Option<&Path>) -> SafeguardedActions {
        let limit = Some(BeginLimit { at_most, per: MINUTE });
        let safeguard = ActionSafeguard { asks_people: None, limit };
        let own = AgentId::new("heater").expect("a name");
        let of = [("switch-on".to_owned(), safeguard)].into();
        let folder = folder.map(|folder| StateFolder(folder.to_owned()));
        let all = Safeguards([(own.clone(), of)].into());
        SafeguardedActions::of(Some(&all), &own, folder.as_ref())
    }

    /// Returns the heater after a restart at this time of day.
    fn restarted(folder: &Path, time: SystemTime, now: Instant) -> SafeguardedActions {
        let mut heater = safeguarded(2, Some(folder));
        heater.resume(time, now);
        heater
    }

    fn switch_on(heater: &mut SafeguardedActions, time: SystemTime, now: Instant) {
        let record = heater.begins("switch-on", time, now).expect("it has a limit");
        record().expect("written");
    }

    #[test]
    fn an_action_may_begin_as_often_as_its_limit_allows_in_any_span() {
        let (mut heater, start) = (safeguarded(2, None), Instant::now());
        let at = |seconds| start + Duration::from_secs(seconds);
        for second in [0, 50] {
            assert_eq!(heater.objection("switch-on", at(second)), None);
            switch_on(&mut heater, noon(), at(second));
        }
        assert_eq!(
            heater.objection("switch-on", at(59)).as_deref(),
            Some("`switch-on` may begin at most 2 times in 1m; again in 1s")
        );
        // The span slides: the second beginning still counts.
        assert_eq!(heater.objection("switch-on", at(60)), None);
        switch_on(&mut heater, noon(), at(60));
        assert!(heater.objection("switch-on", at(109)).is_some());
        assert_eq!(heater.objection("switch-on", at(110)), None);
        assert_eq!(heater.objection("switch-off", at(59)), None, "it has no limit");
    }

    #[test]
    fn a_limit_of_once_is_said_so() {
        let (mut heater, start) = (safeguarded(1, None), Instant::now());
        switch_on(&mut heater, noon(), start);
        let why = heater.objection("switch-on", start).expect("too early");
        assert_eq!(why, "`switch-on` may begin at most once in 1m; again in 1m");
    }

    #[test]
    fn a_restart_allows_no_more() {
        let (folder, start) = (tempfile::tempdir().expect("a folder"), Instant::now());
        let mut heater = restarted(folder.path(), noon(), start);
        switch_on(&mut heater, noon(), start);
        let second = Duration::from_secs(20);
        let mut heater = restarted(folder.path(), noon() + second, start);
        assert_eq!(heater.objection("switch-on", start), None, "it began once");
        switch_on(&mut heater, noon() + second, start);
        let third = Duration::from_secs(45);
        let heater = restarted(folder.path(), noon() + third, start);
        assert_eq!(
            heater.objection("switch-on", start).as_deref(),
            Some("`switch-on` may begin at most 2 times in 1m; again in 15s")
        );
        // Of the two beginnings, one is a minute ago.
        let mut heater = restarted(folder.path(), noon() + MINUTE, start);
        assert_eq!(heater.objection("switch-on", start), None);
        switch_on(&mut heater, noon() + MINUTE, start);
        assert!(heater.objection("switch-on", start).is_some());
    }

    #[test]
    fn a_clock_that_was_put_back_allows_no_more() {
        let (folder, start) = (tempfile::tempdir().expect("a folder"), Instant::now());
        let mut heater = restarted(folder.path(), noon(), start);
        (0..2).for_each(|_| switch_on(&mut heater, noon(), start));
        let heater = restarted(folder.path(), SystemTime::UNIX_EPOCH, start);
        let why = heater.objection("switch-on", start).expect("too often");
        assert!(why.ends_with("again in 1m"), "{why}");
        assert_eq!(heater.objection("switch-on", start + MINUTE), None, "and no longer than that");
    }

    #[test]
    fn an_unreadable_file_counts_as_the_whole_limit_and_is_set_aside() {
        for garbage in ["{\"switch-on\": [17", "[]", ""] {
            let (folder, start) = (tempfile::tempdir().expect("a folder"), Instant::now());
            let path = folder.path().join("heater.begun");
            std::fs::write(&path, garbage).expect("written");
            let heater = restarted(folder.path(), noon(), start);
            assert!(heater.objection("switch-on", start).is_some(), "{garbage}");
            assert_eq!(heater.objection("switch-on", start + MINUTE), None, "{garbage}");
            let aside = std::fs::read_to_string(path.with_extension("begun.unread"));
            assert_eq!(aside.expect("it is kept"), garbage);
        }
    }

    /// Two beginnings follow each other so quickly that the later one is written first.
    #[test]
    fn an_older_content_does_not_replace_a_newer_one() {
        let (folder, start) = (tempfile::tempdir().expect("a folder"), Instant::now());
        let mut heater = restarted(folder.path(), noon(), start);
        let first = heater.begins("switch-on", noon(), start).expect("it has a limit");
        let second = heater.begins("switch-on", noon(), start).expect("it has a limit");
        second().expect("written");
        first().expect("there is nothing to write");
        assert!(restarted(folder.path(), noon(), start).objection("switch-on", start).is_some());
    }

    #[test]
    fn an_action_whose_beginning_cannot_be_written_does_not_begin() {
        let (folder, start) = (tempfile::tempdir().expect("a folder"), Instant::now());
        let mut heater = restarted(folder.path(), noon(), start);
        // A folder at the path of the file makes the write fail, as a full disk would.
        std::fs::create_dir(folder.path().join("heater.begun.new")).expect("made");
        let record = heater.begins("switch-on", noon(), start).expect("it has a limit");
        record().expect_err("nothing can be written");
    }
}
