//! `althing goals`: shows all goals of a running ecosystem, the state of each, and its history.

use std::fmt::Write as _;
use std::process::ExitCode;

use acl::content::{GoalStatus, HistoryEntry, Keep};
use agent::Resource;
use jiff::{Timestamp, Zoned};
use serde_json::json;
use terminal::{exit, output, visible};

use crate::cli::AskArgs;
use crate::commands::client::{self, EcosystemView};

/// Number of lines of a goal's history that are shown to people; `--json` shows all lines.
const HISTORY_LINES: usize = 6;

/// Runs `althing goals`: prints a paragraph per goal.
pub(super) fn run(args: &AskArgs) -> ExitCode {
    client::with_view(args, print)
}

pub(crate) async fn print(view: &EcosystemView, json: bool) -> ExitCode {
    match ask(view).await {
        Some(goals) if json => output::print_json(&json!({ "goals": goals }), exit::DONE),
        Some(goals) if goals.is_empty() => output::print("no goals\n", exit::DONE),
        Some(goals) => output::print(paragraphs(&goals, &Zoned::now()), exit::DONE),
        None => client::unavailable("reach a Plan Requester: none is present", json),
    }
}

/// Queries the goals from the leading Plan Requester; `None` if the Plan Requester does not answer.
pub(super) async fn ask(view: &EcosystemView) -> Option<Vec<GoalStatus>> {
    let requester = &view.roles().plan_requester;
    view.directory(Some(requester)).await;
    let answers = view.ask(Resource::Goals, Some(requester.clone())).await;
    serde_json::from_slice(answers.first()?).ok()
}

fn paragraphs(goals: &[GoalStatus], now: &Zoned) -> String {
    let mut text = String::new();
    for status in goals {
        let GoalStatus { conversation, goal, keep, priority, rounds, history, .. } = status;
        let phase = status.phase_text();
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
        for HistoryEntry { at_ms, outcome, text: line } in history.iter().skip(older) {
            let at = clock_time(*at_ms, now);
            let outcome = outcome.map(|outcome| format!("{outcome}: ")).unwrap_or_default();
            let _ = writeln!(text, "    {at}  {outcome}{}", visible::line(line));
        }
    }
    text
}

/// Formats the time `unix_ms` as a time of day in the time zone of `now`, with the date if it is
/// not the day of `now`.
fn clock_time(unix_ms: u64, now: &Zoned) -> String {
    let known = i64::try_from(unix_ms).ok().and_then(|ms| Timestamp::from_millisecond(ms).ok());
    let Some(at) = known.map(|at| at.to_zoned(now.time_zone().clone())) else {
        return "?".to_owned();
    };
    let format = if at.date() == now.date() { "%H:%M:%S" } else { "%Y-%m-%d %H:%M:%S" };
    at.strftime(format).to_string()
}

#[cfg(test)]
mod tests {
    use jiff::tz::TimeZone;

    use super::*;

    #[test]
    fn times_of_today_have_no_date() {
        let at = |text: &str| text.parse::<Timestamp>().expect("a time");
        let now = at("2026-11-26T01:30:00Z").to_zoned(TimeZone::fixed(jiff::tz::offset(2)));
        let shown = |text: &str| clock_time(at(text).as_millisecond() as u64, &now);
        assert_eq!(shown("2026-11-26T01:02:03Z"), "03:02:03");
        assert_eq!(shown("2026-11-25T22:00:00Z"), "00:00:00");
        assert_eq!(shown("2026-11-25T21:59:59Z"), "2026-11-25 23:59:59");
        assert_eq!(clock_time(u64::MAX, &now), "?");
    }
}
