//! The tables of transitions that `docs/goals.md` shows are those of the code. `UPDATE_EXPECT=1
//! cargo test -p tests transitions` writes them there.

use std::collections::BTreeMap;
use std::fmt::{Debug, Write as _};

use acl::content::GoalPhase;
use goal_lifecycle::PhaseSet;

use crate::root;
use crate::source::read;

const END: &str = "<!-- end of the drawing -->\n";

/// Returns the name of a phase as messages have it.
fn name(phase: GoalPhase) -> String {
    let json = serde_json::to_string(&phase).expect("an enum without fields");
    json.trim_matches('"').to_owned()
}

fn names(phases: impl IntoIterator<Item = GoalPhase>) -> String {
    phases.into_iter().map(name).collect::<Vec<_>>().join(", ")
}

/// Returns a name in the words of the docs: `PlanFound` as “plan found”.
fn words(name: &impl Debug) -> String {
    let mut text = String::new();
    for letter in format!("{name:?}").chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push(' ');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

/// Returns the diagram of a goal: all transitions between phases in which the goal goes on.
fn goal_diagram() -> String {
    let node = |phase| name(phase).replace('-', "_");
    let mut edges: BTreeMap<(GoalPhase, GoalPhase), Vec<String>> = BTreeMap::new();
    for row in goal_lifecycle::TRANSITIONS {
        for from in row.from.phases() {
            let others = row.to.iter().filter(|to| **to != from && **to != GoalPhase::Ended);
            for to in others {
                edges.entry((from, *to)).or_default().push(words(&row.event));
            }
        }
    }
    let mut text = String::from("```mermaid\nstateDiagram-v2\n    [*] --> queued\n");
    for ((from, to), events) in edges {
        let _ = writeln!(text, "    {} --> {}: {}", node(from), node(to), events.join(" / "));
    }
    text.push_str("```\n");
    text
}

fn goal_table() -> String {
    let mut text = String::from("| event | in the phases | leads to |\n|---|---|---|\n");
    for row in goal_lifecycle::TRANSITIONS {
        let from = match row.from {
            PhaseSet::AllBut([]) => "all".to_owned(),
            PhaseSet::AllBut(others) => format!("all but {}", names(others.iter().copied())),
            PhaseSet::Only(phases) => names(phases.iter().copied()),
        };
        let to = match (row.to, row.may_stay) {
            ([], _) => "the same phase".to_owned(),
            (to, true) => format!("{}, or the same phase", names(to.iter().copied())),
            (to, false) => names(to.iter().copied()),
        };
        let _ = writeln!(text, "| {} | {from} | {to} |", words(&row.event));
    }
    text
}

fn execution_table() -> String {
    let mut text = String::from("| event | in the phase | leads to |\n|---|---|---|\n");
    for row in plan_execution::TRANSITIONS {
        let to: Vec<_> = row.to.iter().map(words).collect();
        let (event, from) = (words(&row.event), words(&row.from));
        let _ = writeln!(text, "| {event} | {from} | {} |", to.join(", "));
    }
    text
}

/// Returns the page with `drawing` after the mark of the crate.
fn drawn(page: &str, of: &str, drawing: &str) -> String {
    let mark = format!("<!-- drawn from TRANSITIONS in {of} -->\n");
    let (head, rest) = page.split_once(&mark).expect("the page has the mark");
    let (_, tail) = rest.split_once(END).expect("the page has the second mark");
    format!("{head}{mark}\n{drawing}\n{END}{tail}")
}

#[test]
fn the_docs_show_the_tables_of_transitions() {
    let path = root().join("docs/goals.md");
    let page = read(&path);
    let goal = format!("{}\n{}", goal_diagram(), goal_table());
    let expected = drawn(&page, "goal-lifecycle", &goal);
    let expected = drawn(&expected, "plan-execution", &execution_table());
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(&path, &expected).expect("the page can be written");
    }
    assert_eq!(page, expected, "run again with UPDATE_EXPECT=1");
}
