//! `althing goal`: requests a goal from a running ecosystem, and follows it to its end. A dry run
//! tells what would be done for it.

use std::fmt::Write as _;
use std::process::ExitCode;
use std::time::Duration;

use acl::content::Keep;
use goal_schedule::{Asking, Author, read_options};
use jiff::Timestamp;
use jiff::tz::TimeZone;
use keyboard::{GoalRequest, UserRequest};
use plan_requester::{DryRunResult, ThreatenedGoal};
use terminal::render::plural;
use terminal::visible::line;
use terminal::{exit, output};

use crate::asking::known_names::known_names;
use crate::asking::{dry_run, goal_numbers, wishes};
use crate::cli::{GoalArgs, WishArgs};
use crate::commands::client::{self, EcosystemView};
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};
use crate::config::Ecosystem;
use crate::speech;

/// Runs `althing goal`: requests a goal, or cancels one.
pub(super) fn run(args: &GoalArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        if args.wish.dry_run {
            let code = print_dry_run(&link.view, &args.wish, json).await;
            return (link, code);
        }
        let said = match said(&link.view, &args.wish).await {
            Ok(said) => said,
            Err(problem) => return (link, super::wrong(&problem, json)),
        };
        let interrupt = match args.wish.cancel {
            Some(_) => InterruptAction::Leave("cancelling it was requested".to_owned()),
            None => InterruptAction::LeaveGoal(client::reach_words(&args.reach)),
        };
        let to = Some(link.view.roles().plan_requester.clone());
        let manner = ExchangeOptions { to, json, interrupt };
        let code = user_request::send_and_follow(&link, said, manner).await;
        (link, code)
    })
}

/// Returns the user's request for a goal, after finding the goal and checking that it can be
/// parsed; or the request to cancel a goal, which is named by its number or its conversation.
pub(crate) async fn said(view: &EcosystemView, args: &WishArgs) -> Result<UserRequest, String> {
    if let Some(id) = &args.cancel {
        return goal_numbers::conversation(view, id).await.map(UserRequest::Cancel);
    }
    let wish = wish(view, args).await?;
    let options = args.times.options();
    if options.is_empty() {
        return Ok(UserRequest::RequestGoal(wish));
    }
    let zone = view.ecosystem.as_deref().map_or_else(TimeZone::system, Ecosystem::time_zone);
    let asking = Asking { author: Author::Person, keep: wish.keep, zone, now: Timestamp::now() };
    let times = read_options(&options, &asking)
        .map_err(|mistake| format!("--{}: {mistake}", mistake.option))?;
    Ok(UserRequest::ScheduleGoal(wish, Box::new(times)))
}

/// Returns the goal that the arguments describe.
async fn wish(view: &EcosystemView, args: &WishArgs) -> Result<GoalRequest, String> {
    let asked = args.goal.as_deref().unwrap_or_default();
    let wish = match wishes::is_in_words(view.ecosystem.as_deref(), asked) {
        true => wishes::in_words(asked, &known_names(view).await),
        false => wishes::goal(view.ecosystem.as_deref(), asked),
    }?;
    // Options of the command line override the settings in the file.
    let keep = if args.maintain { Keep::Maintain } else { wish.keep };
    let priority = args.priority.unwrap_or(wish.priority);
    let partition = args.partition.map_or(wish.partition, Into::into);
    Ok(GoalRequest { keep, priority, partition, ..wish })
}

/// Prints what would be done for a goal, without requesting it.
pub(crate) async fn print_dry_run(view: &EcosystemView, args: &WishArgs, json: bool) -> ExitCode {
    let wish = match wish(view, args).await {
        Ok(wish) => wish,
        Err(problem) => return super::wrong(&problem, json),
    };
    let keep = wish.keep;
    let found = match dry_run::dry_run(view, &wish).await {
        Ok(found) => found,
        Err(problem) => return client::unavailable(&problem, json),
    };
    let code = if found.problem.is_some() { user_request::FAILED } else { exit::DONE };
    match json {
        true => output::print_json(&serde_json::json!(found), code),
        false => output::print(described(&found, keep), code),
    }
}

/// Describes the result of a dry run for people.
fn described(found: &DryRunResult, keep: Keep) -> String {
    let aim = match keep {
        Keep::Achieve => "to be reached",
        Keep::Maintain => "to be kept",
    };
    let goal = speech::say(&found.goal);
    let mut text = format!("{}\n  {aim}; a dry run: nothing is asked for\n", line(&goal));
    if found.holds {
        text += "  it holds already\n";
    }
    if let Some(problem) = &found.problem {
        let problem = speech::sentence(problem);
        problem.lines().for_each(|problem| text += &format!("  no plan: {}\n", line(problem)));
    }
    if let Some(cost) = found.cost {
        let steps = plural(found.plan.len(), "step");
        let _ = writeln!(text, "  a plan of {steps}, cost {cost}:");
    }
    for (at, step) in found.plan.iter().enumerate() {
        let after: Vec<_> = step.after.iter().map(|step| (step + 1).to_string()).collect();
        let after = match after.is_empty() {
            true => "at once".to_owned(),
            false => format!("after {}", after.join(", ")),
        };
        let limit = step.limit.map(|limit| super::brief(Duration::from_millis(limit)));
        let limit = limit.map(|limit| format!(", at most {limit}")).unwrap_or_default();
        let _ = writeln!(text, "  {:>4}  {:<44} {after}{limit}", at + 1, line(&step.step));
    }
    if !found.undoes.is_empty() {
        let said = found.undoes.iter().map(|fact| speech::say(fact));
        let undone: Vec<_> = said.map(|fact| line(&fact).to_string()).collect();
        let _ = writeln!(text, "  no longer true after it: {}", undone.join(", "));
    }
    for ThreatenedGoal { goal, conjunct, .. } in &found.threatens {
        let (goal, conjunct) = (speech::say(goal), speech::say(conjunct));
        let (goal, conjunct) = (line(&goal), line(&conjunct));
        let _ = writeln!(text, "  it undoes {conjunct}, which is wanted: {goal}");
    }
    text
}

#[cfg(test)]
mod tests {
    use acl::ConversationId;
    use expect_test::expect;
    use plan_requester::DryRunStep;

    use super::*;

    fn step(text: &str, after: &[usize]) -> DryRunStep {
        let (agent, after, limit) = ("r1".to_owned(), after.to_vec(), Some(60_000));
        DryRunStep { step: text.to_owned(), agent, after, limit, start: None, duration: None }
    }

    #[test]
    fn a_dry_run_is_described() {
        let found = DryRunResult {
            goal: "(known lab)".to_owned(),
            plan: vec![step("(move r1 hall lab)", &[]), step("(measure r1 lab)", &[0])],
            cost: Some(4.5),
            undoes: vec!["(at r1 hall)".to_owned()],
            threatens: vec![ThreatenedGoal {
                conversation: ConversationId::new("c"),
                goal: "(at r1 hall)".to_owned(),
                conjunct: "(at r1 hall)".to_owned(),
            }],
            ..DryRunResult::default()
        };
        expect![[r#"
            (known lab)
              to be kept; a dry run: nothing is asked for
              a plan of 2 steps, cost 4.5:
                 1  (move r1 hall lab)                           at once, at most 60 s
                 2  (measure r1 lab)                             after 1, at most 60 s
              no longer true after it: r1 at hall
              it undoes r1 at hall, which is wanted: r1 at hall
        "#]]
        .assert_eq(&described(&found, Keep::Maintain));
    }
}
