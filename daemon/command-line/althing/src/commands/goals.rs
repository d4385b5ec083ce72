//! `althing goals`: shows all goals of a running ecosystem and the state of each, or one goal with
//! its history.

use std::fmt::Write as _;
use std::process::ExitCode;

use acl::content::{DueStatus, GoalPhase, GoalStatus, HistoryEntry, Keep};
use jiff::Zoned;
use serde_json::json;
use terminal::render::plural;
use terminal::{exit, output, visible};

use crate::asking::goal_numbers;
use crate::cli::GoalsArgs;
use crate::commands::client::{self, EcosystemView};
use crate::commands::leaders;
use crate::commands::moments::{CLOCK_COLUMNS, age, clock};
use crate::speech;

pub(super) use crate::asking::goal_numbers::goals as ask;

/// Columns before the text of a goal: its name, its state, the time of its last event, and the age
/// of that event.
const NAME_COLUMNS: usize = 3;
const STATE_COLUMNS: usize = 12;
const TIME_COLUMNS: usize = CLOCK_COLUMNS;
const AGE_COLUMNS: usize = 7;
const GOAL_COLUMN: usize = NAME_COLUMNS + STATE_COLUMNS + TIME_COLUMNS + AGE_COLUMNS + 8;
/// Column in which the remarks below a goal begin.
const REMARK_COLUMN: usize = NAME_COLUMNS + 2;

/// A function that returns the name by which the user refers to a goal.
pub(crate) type GoalLabel<'l> = &'l (dyn Fn(&GoalStatus) -> String + Sync);

/// Runs `althing goals`: prints a table of all goals, or one goal.
pub(super) fn run(args: &GoalsArgs) -> ExitCode {
    client::with_view(&args.ask, async |view, json| match &args.goal {
        Some(said) => print_one(view, said, json).await,
        None => print_with(view, json, &|goal| goal.number.to_string()).await,
    })
}

/// Prints a table of all goals, each with its `label`.
pub(crate) async fn print_with(view: &EcosystemView, json: bool, label: GoalLabel<'_>) -> ExitCode {
    let Some(mut goals) = ask(view).await else { return without_requester(json) };
    if json {
        return output::print_json(&json!({ "goals": goals }), exit::DONE);
    }
    goals.sort_by_key(|goal| goal.number);
    let replicas = leaders::replicas(view).await;
    let leader = replicas.get(&view.roles().plan_requester).map(leaders::ReplicaHosts::in_words);
    let leader = leader.filter(|words| !words.is_empty()).or_else(|| only_host(view));
    let leader = leader.map(|words| format!("; `{}` leads {words}", view.roles().plan_requester));
    let now = Zoned::now();
    let mut text = format!(
        "{} of `{}` at {}{}\n",
        plural(goals.len(), "goal"),
        view.name,
        now.strftime("%H:%M:%S"),
        leader.unwrap_or_default()
    );
    text = output::folded(text.trim_end(), 0) + "\n";
    text += &match goals.last() {
        None => next_without_goals(view),
        Some(last) => table(&goals, &now, label) + &next(&label(last)),
    };
    output::print(text, exit::DONE)
}

/// Prints one goal with its history.
async fn print_one(view: &EcosystemView, said: &str, json: bool) -> ExitCode {
    let conversation = match goal_numbers::conversation(view, said).await {
        Ok(conversation) => conversation,
        Err(problem) => return super::wrong(&problem, json),
    };
    let Some(goals) = ask(view).await else { return without_requester(json) };
    match goals.into_iter().find(|goal| goal.conversation == conversation) {
        Some(goal) if json => output::print_json(&json!({ "goals": [goal] }), exit::DONE),
        Some(goal) => output::print(whole(&goal, &Zoned::now()), exit::DONE),
        None => {
            let problem = format!("there is no goal `{said}` now; `althing goals` lists them");
            super::wrong(&problem, json)
        }
    }
}

/// Returns where the Plan Requester is, as its daemon reports no replicas of it.
fn only_host(view: &EcosystemView) -> Option<String> {
    let directory = view.router.directory();
    let requester = directory.find(&view.roles().plan_requester)?;
    Some(format!("at {}", requester.daemon))
}

fn without_requester(json: bool) -> ExitCode {
    let problem = "reach a Plan Requester, which takes goals: none is present; `althing agents` \
                   shows who is, `althing doctor` what is wrong";
    client::unavailable(problem, json)
}

// === the table ===

fn table(goals: &[GoalStatus], now: &Zoned, label: GoalLabel<'_>) -> String {
    let mut text = format!(
        "\n{:>NAME_COLUMNS$}  {:<STATE_COLUMNS$}  {:<TIME_COLUMNS$}  {:<AGE_COLUMNS$}  GOAL\n",
        "NO", "STATE", "SINCE", "AGO"
    );
    for goal in goals {
        let last = goal.history.last();
        let (at, ago) = match last {
            Some(event) => (clock(event.at_ms, now), age(event.at_ms, now)),
            None => (String::new(), String::new()),
        };
        let line = format!(
            "{:>NAME_COLUMNS$}  {:<STATE_COLUMNS$}  {at:<TIME_COLUMNS$}  {ago:<AGE_COLUMNS$}  {}",
            label(goal),
            state_word(goal),
            visible::line(&speech::say(&one_line(&goal.goal))),
        );
        let _ = writeln!(text, "{}", output::folded(&line, GOAL_COLUMN));
        for remark in remarks(goal) {
            let line = format!("{:REMARK_COLUMN$}{}", "", visible::line(&remark));
            let _ = writeln!(text, "{}", output::folded(&line, REMARK_COLUMN));
        }
    }
    text
}

/// Returns when a goal by the clock is asked for next: `next: Thursday 08:00 (every day 08:00)`.
fn due_line(due: &DueStatus) -> String {
    let next = match &due.next {
        Some(next) => format!("next: {next} ({})", due.words),
        None => format!("asked for: {}", due.words),
    };
    let pursued = due.pursued.as_ref().map(|id| format!("; now pursued as {id}"));
    let line = format!("{next}{}", pursued.unwrap_or_default());
    visible::line(&line).to_string()
}

/// Returns the state of a goal in one or two words.
fn state_word(goal: &GoalStatus) -> &'static str {
    if goal.waits_for_its_time() {
        return "by clock";
    }
    match goal.phase {
        GoalPhase::Queued | GoalPhase::WaitingForAgents | GoalPhase::WaitingForChange => "waiting",
        GoalPhase::FetchingDomain
        | GoalPhase::Planning
        | GoalPhase::CollectingProposals
        | GoalPhase::Explaining => "planning",
        GoalPhase::Executing => "executing",
        GoalPhase::Preempted => "giving way",
        GoalPhase::Cancelling => "cancelling",
        GoalPhase::Verifying => "checking",
        GoalPhase::Holding => "holds",
        GoalPhase::Ended => "ended",
    }
}

/// Returns what is said of a goal below its line: how it is wanted, its asker and, unless it holds,
/// why it waits or what happened last.
fn remarks(goal: &GoalStatus) -> Vec<String> {
    let keep = match goal.keep {
        Keep::Achieve => "to be reached",
        Keep::Maintain => "to be kept",
    };
    let priority = match goal.priority {
        0 => String::new(),
        priority => format!(", priority {priority}"),
    };
    let mut remarks = vec![format!("{keep}{priority}; asked for by {}", asker(goal))];
    if let Some(due) = &goal.due {
        remarks.push(due_line(due));
    }
    let because = match goal.phase {
        _ if goal.waits_for_its_time() => None,
        GoalPhase::Holding | GoalPhase::Ended => None,
        _ if !goal.waits_because.is_empty() => Some(speech::sentence(&goal.waits_because)),
        GoalPhase::Queued => Some("another goal comes first".to_owned()),
        _ => goal.history.last().map(|event| speech::sentence(&one_line(&event.text))),
    };
    remarks.extend(because);
    remarks
}

/// Returns the author of a goal: an agent, or the ecosystem file.
fn asker(goal: &GoalStatus) -> &str {
    goal.conversation.opener().unwrap_or("the ecosystem file")
}

/// Returns what a person may do next, with the goal `label` as the example.
fn next(label: &str) -> String {
    let number = label.trim_matches(['[', ']']);
    match label.starts_with(['[', '#']) {
        // At the prompt.
        true => format!("\n`cancel {number}` gives it up, `watch {number}` shows its messages\n"),
        false => format!(
            "\nalthing goals {number}            what happened to it\n\
             althing why {number}              what caused it\n\
             althing goal --cancel {number}    gives it up\n"
        ),
    }
}

/// Returns how to ask for a goal: one of the file, if the file is known.
fn next_without_goals(view: &EcosystemView) -> String {
    let names = view.ecosystem.iter().flat_map(|ecosystem| ecosystem.goals.keys());
    let names: Vec<_> = names.map(|name| visible::line(name).into_owned()).collect();
    match names.first() {
        Some(first) => {
            format!("\nalthing goal {first}    asks for a goal of the file: {}\n", names.join(", "))
        }
        None => {
            "\nalthing goal \"(…)\"    asks for one; `althing domain` shows the words\n".to_owned()
        }
    }
}

// === one goal ===

/// Returns all that is known of a goal.
fn whole(goal: &GoalStatus, now: &Zoned) -> String {
    let GoalStatus { number, conversation, rounds, history, priority, keep, .. } = goal;
    let keep = match keep {
        Keep::Achieve => "to be reached",
        Keep::Maintain => "to be kept",
    };
    let said = speech::say(&one_line(&goal.goal));
    let mut text = format!("goal {number}  {}\n", visible::line(&said));
    let mut add = |line: &str| {
        let _ = writeln!(text, "{}", output::folded(&format!("  {}", visible::line(line)), 4));
    };
    match goal.due.as_deref().filter(|_| goal.waits_for_its_time()) {
        Some(due) => add(&due_line(due)),
        None => add(&goal.phase_text()),
    }
    add(&format!("{keep}, priority {priority}, {} so far", plural(*rounds as usize, "plan")));
    add(&format!("asked for by {}", asker(goal)));
    add(&format!("conversation {conversation}"));
    text.push('\n');
    for HistoryEntry { at_ms, outcome, text: event } in history {
        let outcome = outcome.map(|outcome| format!("{outcome}: ")).unwrap_or_default();
        let event = speech::sentence(event);
        let line = format!("  {:<TIME_COLUMNS$}  {outcome}{event}", clock(*at_ms, now));
        let line = visible::line(&line).into_owned();
        let _ = writeln!(text, "{}", output::folded(&line, TIME_COLUMNS + 4));
    }
    let _ = write!(
        text,
        "\nalthing why {number}                     what caused it\n\
         althing watch --conversation {number}    its messages\n\
         althing goal --cancel {number}           gives it up\n"
    );
    text
}

fn one_line(text: &str) -> String {
    text.split_whitespace().collect::<Vec<_>>().join(" ")
}

#[cfg(test)]
mod tests {
    use acl::ConversationId;
    use acl::content::Outcome;
    use expect_test::expect;
    use jiff::Timestamp;
    use jiff::tz::TimeZone;

    use super::*;

    fn goal(number: u32, goal: &str, phase: GoalPhase, history: &[(u64, &str)]) -> GoalStatus {
        let entry = |(ago_s, text): &(u64, &str)| HistoryEntry {
            at_ms: (NOW_S - ago_s) * 1_000,
            outcome: Some(Outcome::Progress),
            text: (*text).to_owned(),
        };
        GoalStatus {
            due: None,
            conversation: ConversationId::new("keyboard-desk-7.1795888861322709.1"),
            number,
            goal: goal.to_owned(),
            keep: Keep::Maintain,
            priority: 0,
            phase,
            waits_because: String::new(),
            rounds: 1,
            history: history.iter().map(entry).collect(),
        }
    }

    /// 2026-11-28, 10:00 UTC.
    const NOW_S: u64 = 1_795_860_000;

    fn now() -> Zoned {
        let now = Timestamp::from_second(NOW_S as i64).expect("a time");
        now.to_zoned(TimeZone::UTC)
    }

    #[test]
    fn the_table_tells_the_state_of_each_goal() {
        let waiting = GoalStatus {
            waits_because: "nobody offers `mop`".to_owned(),
            priority: 3,
            ..goal(12, "(swept hall)", GoalPhase::WaitingForChange, &[(90, "no plan")])
        };
        let goals = [
            goal(1, "(known\n  hall)", GoalPhase::Holding, &[(90_000, "asked"), (9, "it holds")]),
            goal(2, "(lit hall)", GoalPhase::Executing, &[(200, "arrived at hall")]),
            waiting,
        ];
        let text = table(&goals, &now(), &|goal| goal.number.to_string());
        expect![[r#"
            goals
             NO  STATE         SINCE       AGO      GOAL
              1  holds         09:59:51    9 s      (known hall)
                 to be kept; asked for by keyboard-desk-7
              2  executing     09:56:40    3 min    light in hall on
                 to be kept; asked for by keyboard-desk-7
                 arrived at hall
             12  waiting       09:58:30    90 s     hall swept
                 to be kept, priority 3; asked for by keyboard-desk-7
                 nobody offers `mop`
        "#]]
        .assert_eq(&format!("goals{text}"));
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    }

    #[test]
    fn goals_of_the_file_are_asked_for_by_the_file() {
        let of = |conversation: &str| {
            let conversation = ConversationId::new(conversation);
            GoalStatus { conversation, ..goal(1, "(lit hall)", GoalPhase::Holding, &[]) }
        };
        let file = "asked for by the ecosystem file";
        for (conversation, expected) in [
            ("goals.warm", file),
            ("goals.warm@20261128T080000Z", file),
            ("goals.1795888861322709.1", "asked for by goals"),
            ("plan-requester.7.2", "asked for by plan-requester"),
            ("goals", "asked for by goals"),
        ] {
            let remarks = remarks(&of(conversation));
            assert!(remarks[0].ends_with(expected), "{conversation}: {remarks:?}");
        }
    }

    #[test]
    fn one_goal_is_shown_with_its_history() {
        let goal = goal(2, "(lit hall)", GoalPhase::Executing, &[(90_000, "asked"), (9, "begun")]);
        let text = whole(&goal, &now());
        expect![[r#"
            goal 2  light in hall on
              executing
              to be kept, priority 0, 1 plan so far
              asked for by keyboard-desk-7
              conversation keyboard-desk-7.1795888861322709.1

              Fri 09:00   progress: asked
              09:59:51    progress: begun

            althing why 2                     what caused it
            althing watch --conversation 2    its messages
            althing goal --cancel 2           gives it up
        "#]]
        .assert_eq(&text);
        assert!(text.lines().all(|line| line.chars().count() <= 80), "{text}");
    }
}
