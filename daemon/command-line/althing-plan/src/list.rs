//! `althing plan --list`: prints the heuristics and the search configurations from the tables that
//! define them.

use std::fmt::Write as _;
use std::process::ExitCode;

use planner::{CONFIGURATIONS, Configuration, HEURISTICS, Heuristic};
use serde_json::{Value, json};
use terminal::{exit, output};

/// Prints the lists of heuristics and search configurations.
pub(crate) fn run(as_json: bool) -> ExitCode {
    if as_json {
        let heuristics: Vec<Value> = HEURISTICS.iter().map(json_heuristic).collect();
        let searches: Vec<Value> = CONFIGURATIONS.iter().map(json_search).collect();
        let all = json!({ "heuristics": heuristics, "searches": searches });
        return output::print_json(&all, exit::DONE);
    }
    let mut text = "Heuristics\n".to_owned();
    for one in HEURISTICS {
        let kind = match (one.admissible, one.consistent) {
            (true, true) => "admissible, consistent",
            (true, false) => "admissible",
            (false, _) => "not admissible",
        };
        entry(&mut text, one.name, kind, one.summary);
    }
    text += "\nSearch configurations (--search), the default first; all are complete\n";
    for one in CONFIGURATIONS {
        let kind = if one.optimal { "first plan is the cheapest" } else { "any plan first" };
        let kind = format!("{kind}; {}", one.heuristics.join(", "));
        entry(&mut text, one.name, &kind, one.summary);
    }
    output::print(text, exit::DONE)
}

fn entry(text: &mut String, name: &str, kind: &str, summary: &str) {
    let _ = writeln!(text, "  {name:<12} {kind}");
    let _ = writeln!(text, "{}", output::folded(&format!("               {summary}"), 15));
}

fn json_heuristic(one: &Heuristic) -> Value {
    json!({
        "name": one.name,
        "summary": one.summary,
        "admissible": one.admissible,
        "consistent": one.consistent,
    })
}

fn json_search(one: &Configuration) -> Value {
    json!({
        "name": one.name,
        "summary": one.summary,
        "heuristics": one.heuristics,
        "optimal": one.optimal,
    })
}
