//! The table of transitions is the one that `docs/goals.md` shows. `UPDATE_EXPECT=1 cargo test -p
//! goal-lifecycle` writes it there.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::PathBuf;

use acl::content::GoalPhase;
use goal_lifecycle::TRANSITIONS;

const BEGIN: &str = "<!-- drawn from TRANSITIONS in goal-lifecycle -->\n";
const END: &str = "<!-- end of the drawing -->\n";

/// Returns the name of a phase as messages have it.
fn name(phase: GoalPhase) -> String {
    let json = serde_json::to_string(&phase).expect("an enum without fields");
    json.trim_matches('"').to_owned()
}

/// Returns the name of a phase as an identifier of the diagram.
fn node(phase: GoalPhase) -> String {
    name(phase).replace('-', "_")
}

/// Returns an event's name in the words of the docs: `PlanFound` as “plan found”.
fn words(event: &impl std::fmt::Debug) -> String {
    let mut text = String::new();
    for letter in format!("{event:?}").chars() {
        if letter.is_uppercase() && !text.is_empty() {
            text.push(' ');
        }
        text.extend(letter.to_lowercase());
    }
    text
}

/// Returns the diagram: all transitions between phases in which the goal goes on.
fn diagram() -> String {
    let mut edges: BTreeMap<(GoalPhase, GoalPhase), Vec<String>> = BTreeMap::new();
    for row in TRANSITIONS {
        for from in row.from {
            let others = row.to.iter().filter(|to| *to != from && **to != GoalPhase::Ended);
            for to in others {
                edges.entry((*from, *to)).or_default().push(words(&row.event));
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

/// Returns the table, one line per row of `TRANSITIONS`.
fn table() -> String {
    let list = |phases: &[GoalPhase]| {
        phases.iter().map(|phase| name(*phase)).collect::<Vec<_>>().join(", ")
    };
    let alive = GoalPhase::ALL.len() - 1;
    let mut text = String::from("| event | in the phases | leads to |\n|---|---|---|\n");
    for row in TRANSITIONS {
        let from = if row.from.len() == alive { "all".to_owned() } else { list(row.from) };
        let to = match (row.to, row.may_stay) {
            ([], _) => "the same phase".to_owned(),
            (to, true) => format!("{}, or the same phase", list(to)),
            (to, false) => list(to),
        };
        let _ = writeln!(text, "| {} | {from} | {to} |", words(&row.event));
    }
    text
}

#[test]
fn the_docs_show_the_table_of_transitions() {
    let path = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../../../docs/goals.md");
    let page = std::fs::read_to_string(&path).expect("the page is there");
    let (head, rest) = page.split_once(BEGIN).expect("the page has the mark");
    let (_, tail) = rest.split_once(END).expect("the page has the second mark");
    let expected = format!("{head}{BEGIN}\n{}\n{}\n{END}{tail}", diagram(), table());
    if std::env::var_os("UPDATE_EXPECT").is_some() {
        std::fs::write(&path, &expected).expect("the page can be written");
    }
    assert_eq!(page, expected, "run again with UPDATE_EXPECT=1");
}
