//! Named goals: PDDL inside TOML, with mistakes shown at their very place.

use std::collections::BTreeMap;

use keyboard::Wish;
use pddl::{Diagnostic, Severity, Span};

use super::Meaning;
use super::files::Files;
use crate::config::ecosystem::AgentEntry;
use crate::config::raw::RawGoal;

// === impl Meaning ===

impl Meaning<'_> {
    /// Parses each goal, and checks it against the ontology and the map where they can be read.
    pub(super) fn goals(
        &mut self,
        goals: BTreeMap<String, RawGoal>,
        files: Option<&Files>,
        agents: &[AgentEntry],
    ) -> BTreeMap<String, Wish> {
        let mut wishes = BTreeMap::new();
        for (name, RawGoal { goal, keep, priority, partition }) in goals {
            let Some(goal) = goal else {
                self.missing(&format!("goals.{name}"), "goal", "(known-temperature office1)");
                continue;
            };
            for diagnostic in diagnose(&goal, files, agents) {
                self.about_goal(&name, &goal, diagnostic);
            }
            wishes.insert(name, Wish { goal, keep, priority, partition });
        }
        wishes
    }

    /// Moves a place of the goal's text to where that text stands.
    fn about_goal(&mut self, name: &str, goal: &str, mut found: Diagnostic) {
        let Some((source, place)) = self.place(&format!("goals.{name}.goal")) else {
            self.report.add_general(found);
            return;
        };
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
        self.report.add(&source, [found]);
    }
}

/// Everything wrong with a goal. What only an agent can know is no error here: agents bring types,
/// predicates and objects of their own when they join.
fn diagnose(goal: &str, files: Option<&Files>, agents: &[AgentEntry]) -> Vec<Diagnostic> {
    let parsed = pddl::parse_condition(goal);
    let mut all = parsed.diagnostics;
    let is_sound = !all.iter().any(Diagnostic::is_error);
    let sound_files = files.filter(|files| files.are_sound && is_sound);
    let (Some(condition), Some(files)) = (parsed.value, sound_files) else { return all };
    let names_an_agent = |found: &Diagnostic| {
        let word = goal.get(found.span.range()).unwrap_or("");
        agents.iter().any(|agent| agent.name.as_str().eq_ignore_ascii_case(word))
    };
    let checked = pddl::check_condition(&files.domain, &files.problem, &condition);
    all.extend(checked.into_iter().filter(|found| !names_an_agent(found)).map(softened));
    all
}

/// A word that the ontology does not have, and nothing in it resembles, may be an agent's.
fn softened(mut found: Diagnostic) -> Diagnostic {
    if found.message.starts_with("unknown ") && found.help.is_none() {
        found.severity = Severity::Warning;
        found.help = Some("only an agent that brings it can make this goal reachable".to_owned());
    }
    found
}

/// Where in a TOML string as written its content begins; `None` where escapes make the two differ.
/// What stands in the environment has no quotes.
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
