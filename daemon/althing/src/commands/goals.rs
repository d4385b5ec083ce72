//! `althing goals`: what is wanted, how it stands, and what has happened.

use std::fmt::Write as _;
use std::process::ExitCode;

use acl::AgentId;
use acl::content::{GoalStatus, Keep};
use agent::Resource;
use serde_json::json;
use terminal::{exit, output, visible};

use crate::cli::AskArgs;
use crate::commands::client::{self, View};

/// Lines of a goal's history that are shown; `--json` has them all.
const HISTORY_LINES: usize = 6;

/// Prints a paragraph per goal.
pub(super) fn run(args: &AskArgs) -> ExitCode {
    client::with_view(args, print)
}

pub(crate) async fn print(view: &View, json: bool) -> ExitCode {
    let requester = AgentId::new("plan-requester").ok();
    view.directory(requester.as_ref()).await;
    let answers = view.ask(Resource::Goals, requester).await;
    let goals = answers.first().map(|bytes| serde_json::from_slice::<Vec<GoalStatus>>(bytes));
    match goals {
        Some(Ok(goals)) if json => output::print_json(&json!({ "goals": goals }), exit::DONE),
        Some(Ok(goals)) if goals.is_empty() => output::print("nobody wants anything\n", exit::DONE),
        Some(Ok(goals)) => output::print(paragraphs(&goals), exit::DONE),
        _ => client::unavailable("hear from a Plan Requester: none is here", json),
    }
}

fn paragraphs(goals: &[GoalStatus]) -> String {
    let mut text = String::new();
    for GoalStatus { conversation, goal, keep, priority, phase, rounds, history } in goals {
        let keep = match keep {
            Keep::Achieve => "to be reached",
            Keep::Maintain => "to be kept",
        };
        let plans = if *rounds == 1 { "plan" } else { "plans" };
        let goal = goal.split_whitespace().collect::<Vec<_>>().join(" ");
        let _ = writeln!(text, "{}", visible::line(&goal));
        let _ = writeln!(text, "  {phase}; {keep}, priority {priority}, {rounds} {plans}");
        let _ = writeln!(text, "  {}", visible::line(conversation.as_str()));
        let older = history.len().saturating_sub(HISTORY_LINES);
        if older > 0 {
            let _ = writeln!(text, "    … {older} earlier");
        }
        for line in history.iter().skip(older) {
            let _ = writeln!(text, "    {}", visible::line(line));
        }
    }
    text
}
