//! Named goals: PDDL inside TOML. Mistakes are reported at their place in the text of the goal.
//! Whether the names in a goal are known is checked later, in `review`, when the agents' action
//! models are known.

use std::collections::BTreeMap;

use acl::content::{Achieve, Keep};
use goal_schedule::{Asking, Author, ScheduleError, TimeOptions, read_options};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use keyboard::GoalRequest;
use pddl::{Diagnostic, Span};
use plan_requester::{FileGoal, FileGoals};

use super::Interpreter;
use crate::config::ecosystem::NamedGoals;
use crate::config::goal_cures;
use crate::config::layer::KeyValueSpan;
use crate::config::raw::{RawGoalTimes, RawNamedGoal};
use terminal::report::SourceText;

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Parses each named goal and reports its mistakes. Returns the goals by name, also those with
    /// mistakes; a goal without text is left out. Returns those besides that are asked for by
    /// themselves.
    pub(super) fn goals(&mut self, goals: BTreeMap<String, RawNamedGoal>) -> NamedGoals {
        let mut wishes = BTreeMap::new();
        let time_zone = self.time_zone.clone();
        let zone = self.known_zone(time_zone.as_deref());
        let mut by_themselves = FileGoals { goals: Vec::new(), time_zone };
        for (name, RawNamedGoal { goal, keep, priority, partition, ask, times }) in goals {
            let Some(goal) = goal else {
                self.missing(&format!("goals.{name}"), "goal", "(known-temperature office1)");
                continue;
            };
            let found = goal_cures::improved(&goal, pddl::parse_condition(&goal).diagnostics);
            let is_wrong = found.iter().any(Diagnostic::is_error);
            match self.place(&format!("goals.{name}.goal")) {
                Some((source, place)) => {
                    let moved =
                        found.into_iter().map(|found| relocate(found, &source, place, &goal));
                    self.report.add(&source, moved.collect::<Vec<_>>());
                }
                None => found.into_iter().for_each(|found| self.report.add_general(found)),
            }
            let achieve = Achieve { goal: goal.clone(), keep, priority, partition };
            // What is reported already is not checked once more.
            let goal = if is_wrong { pddl::Condition::always().to_string() } else { goal };
            let asked = (ask.is_some(), options(times));
            by_themselves.goals.extend(self.file_goal(&name, achieve, asked, &zone));
            wishes.insert(name, GoalRequest { goal, keep, priority, partition });
        }
        NamedGoals { named: wishes, by_themselves }
    }

    /// Returns the time zone that the file names, or that of this machine. Reports a name that is not
    /// known.
    fn known_zone(&mut self, name: Option<&str>) -> TimeZone {
        let Some(name) = name else { return TimeZone::system() };
        TimeZone::get(name).unwrap_or_else(|_| {
            self.about_value("ecosystem.time-zone", |span| {
                let message = format!("the time zone `{name}` is not known on this machine");
                let help = "write a name such as \"Europe/Berlin\"; the names come with the \
                            package tzdata";
                Diagnostic::error(span, message).with_help(help)
            });
            TimeZone::system()
        })
    }

    /// Returns a goal that is asked for by itself; `None` if nothing says so. Reports mistakes in its
    /// times.
    fn file_goal(
        &mut self,
        name: &str,
        goal: Achieve,
        (is_always, times): (bool, TimeOptions),
        zone: &TimeZone,
    ) -> Option<FileGoal> {
        if !is_always && times.is_empty() {
            return None;
        }
        let asking = Asking {
            author: Author::File,
            keep: goal.keep,
            zone: zone.clone(),
            now: Timestamp::now(),
        };
        let checked = check_asking(&goal, is_always, &times)
            .and_then(|()| read_options(&times, &asking).map(|_| ()));
        if let Err(ScheduleError { option, message }) = checked {
            self.about_value(&format!("goals.{name}.{option}"), |span| {
                Diagnostic::error(span, message)
            });
            return None;
        }
        self.warn_of_past(name, &times, asking);
        Some(FileGoal { name: name.to_owned(), goal, times, is_always })
    }

    /// Warns about times that are past. They are no error: a file outlives its single times.
    fn warn_of_past(&mut self, name: &str, times: &TimeOptions, asking: Asking) {
        let now = Asking { author: Author::Person, ..asking };
        if let Err(ScheduleError { option, message }) = read_options(times, &now) {
            self.about_value(&format!("goals.{name}.{option}"), |span| {
                let help = "the goal is asked for no more; write a later time, or take it out";
                Diagnostic::warning(span, message).with_help(help)
            });
        }
    }
}

/// Checks that the file says when the goal is asked for, in one way only.
fn check_asking(goal: &Achieve, is_always: bool, times: &TimeOptions) -> Result<(), ScheduleError> {
    let mistake =
        |option, message: &str| Err(ScheduleError { option, message: message.to_owned() });
    if !is_always {
        let is_said = times.at.is_some() || times.every.is_some() || times.between.is_some();
        let given = [("by", &times.by), ("for", &times.lasts), ("until", &times.until)];
        let given = given.into_iter().find(|(_, text)| text.is_some());
        return match given.filter(|_| !is_said) {
            Some((option, _)) => mistake(
                option,
                "nothing says when the goal is asked for; write every = \"day 08:00\", at, \
                 between, or ask = \"always\"",
            ),
            None => Ok(()),
        };
    }
    if goal.keep != Keep::Maintain {
        return mistake("ask", "only a kept goal is asked for always; write keep = \"maintain\"");
    }
    let others = [("at", &times.at), ("every", &times.every), ("between", &times.between)];
    let others = others.into_iter().chain([("by", &times.by), ("for", &times.lasts)]);
    match others.into_iter().find(|(_, text)| text.is_some()) {
        Some((option, _)) => {
            mistake(option, "`ask = \"always\"` asks for the goal at all times; leave one out")
        }
        None => Ok(()),
    }
}

fn options(times: RawGoalTimes) -> TimeOptions {
    let RawGoalTimes { at, by, every, on, between, until, lasts } = times;
    TimeOptions { at, by, every, on, between, until, lasts }
}

/// Moves the spans of a diagnostic about the text of a goal to the places of that text in the
/// ecosystem file.
pub(crate) fn relocate(
    mut found: Diagnostic,
    source: &SourceText,
    place: KeyValueSpan,
    goal: &str,
) -> Diagnostic {
    let written = source.text.get(place.value.range()).unwrap_or("");
    let moved = |span: Span| match content_start(written, goal) {
        Some(start) => {
            let start = place.value.start as usize + start;
            Span::new(start + span.start as usize, start + span.end as usize)
        }
        None => place.value,
    };
    found.span = moved(found.span);
    for note in &mut found.notes {
        note.span = moved(note.span);
    }
    found
}

/// Returns the offset of `content` in `written`, the same string as it is written: behind the
/// quotes in TOML, or 0 in an environment variable, where there are no quotes. Returns `None` if
/// the two differ in more than the quotes, because of escapes.
fn content_start(written: &str, content: &str) -> Option<usize> {
    ["\"\"\"\n", "\"\"\"\r\n", "'''\n", "'''\r\n", "\"\"\"", "'''", "\"", "'", ""]
        .iter()
        .find(|quote| {
            let rest = written.strip_prefix(**quote);
            rest.and_then(|rest| rest.strip_prefix(content))
                .is_some_and(|end| end.chars().all(|c| c == '"' || c == '\''))
        })
        .map(|quote| quote.len())
}
