//! Named goals: PDDL inside TOML. Mistakes are reported at their place in the text of the goal.
//! Whether the names in a goal are known is checked later, in `review`, when the agents' action
//! models are known.

use std::collections::BTreeMap;

use keyboard::GoalRequest;
use pddl::{Diagnostic, Span};

use super::Interpreter;
use crate::config::layer::KeyValueSpan;
use crate::config::raw::RawNamedGoal;
use terminal::report::SourceText;

// === impl Interpreter ===

impl Interpreter<'_> {
    /// Parses each named goal and reports its mistakes. Returns the goals by name, also those with
    /// mistakes; a goal without text is left out.
    pub(super) fn goals(
        &mut self,
        goals: BTreeMap<String, RawNamedGoal>,
    ) -> BTreeMap<String, GoalRequest> {
        let mut wishes = BTreeMap::new();
        for (name, RawNamedGoal { goal, keep, priority, partition }) in goals {
            let Some(goal) = goal else {
                self.missing(&format!("goals.{name}"), "goal", "(known-temperature office1)");
                continue;
            };
            let found = pddl::parse_condition(&goal).diagnostics;
            match self.place(&format!("goals.{name}.goal")) {
                Some((source, place)) => {
                    let moved =
                        found.into_iter().map(|found| relocate(found, &source, place, &goal));
                    self.report.add(&source, moved.collect::<Vec<_>>());
                }
                None => found.into_iter().for_each(|found| self.report.add_general(found)),
            }
            wishes.insert(name, GoalRequest { goal, keep, priority, partition });
        }
        wishes
    }
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
