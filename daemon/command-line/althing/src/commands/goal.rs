//! `althing goal`: requests a goal from a running ecosystem, and follows it to its end.

use std::process::ExitCode;

use acl::ConversationId;
use acl::content::Keep;
use keyboard::{GoalRequest, UserRequest};

use crate::cli::{GoalArgs, WishArgs};
use crate::commands::client;
use crate::commands::user_request::{self, ExchangeOptions, InterruptAction};
use crate::config::{Ecosystem, is_pddl, plain_goal};

/// Runs `althing goal`: requests a goal, or cancels one.
pub(super) fn run(args: &GoalArgs) -> ExitCode {
    let json = args.print.json;
    client::with_link(&args.reach, json, async |link| {
        let said = match said(link.view.ecosystem.as_deref(), &args.wish) {
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
/// parsed.
pub(crate) fn said(ecosystem: Option<&Ecosystem>, args: &WishArgs) -> Result<UserRequest, String> {
    if let Some(id) = &args.cancel {
        return Ok(UserRequest::Cancel(ConversationId::new(id)));
    }
    let asked = args.goal.as_deref().unwrap_or_default();
    let wish = match ecosystem {
        Some(ecosystem) => ecosystem.find_goal(asked)?,
        None if is_pddl(asked) => plain_goal(asked),
        None => {
            return Err(format!(
                "`{asked}` may be a goal of the ecosystem file, which is not known here; write \
                 the goal in PDDL, or name the file with --ecosystem FILE"
            ));
        }
    };
    let wish = readable(wish)?;
    // Options of the command line override the settings in the file.
    let keep = if args.maintain { Keep::Maintain } else { wish.keep };
    let priority = args.priority.unwrap_or(wish.priority);
    let partition = args.partition.map_or(wish.partition, Into::into);
    Ok(UserRequest::RequestGoal(GoalRequest { keep, priority, partition, ..wish }))
}

/// Returns `wish` if its goal can be parsed. Otherwise returns an error message with the mistakes
/// and, if possible, the goal that was probably meant.
pub(super) fn readable(wish: GoalRequest) -> Result<GoalRequest, String> {
    let goal = wish.goal.trim();
    let Err(found) = pddl::parse_condition(goal).into_result() else { return Ok(wish) };
    let meant = format!("({goal})");
    let is_closed = goal.matches('(').count() == goal.matches(')').count();
    if is_closed && !goal.is_empty() && pddl::parse_condition(&meant).into_result().is_ok() {
        return Err(format!("the goal `{goal}` has no parentheses; did you mean `{meant}`?"));
    }
    Err(super::located(&found, goal))
}

#[cfg(test)]
mod tests {
    use expect_test::{Expect, expect};

    use super::*;

    #[track_caller]
    fn check(goal: &str, expected: Expect) {
        expected.assert_eq(&readable(plain_goal(goal)).expect_err("it cannot be read"));
    }

    #[test]
    fn an_unreadable_goal_yields_a_suggestion() {
        check(
            "known hall",
            expect!["the goal `known hall` has no parentheses; did you mean `(known hall)`?"],
        );
        check(
            "not (known hall)",
            expect![
                "the goal `not (known hall)` has no parentheses; did you mean `(not (known hall))`?"
            ],
        );
        check(
            "known(hall)",
            expect!["1:1: error: `known` stands before its parentheses; write `(known hall)`"],
        );
        check(
            "at(r1, hall)",
            expect!["1:1: error: `at` stands before its parentheses; write `(at r1 hall)`"],
        );
        check(
            "known hall)",
            expect![[r#"
            1:1: error: expected a condition, found `known`; write `(known)` [(PREDICATE TERM*) | (not|and|or|imply CONDITION*) | (exists|forall (VARIABLES) CONDITION) | (= TERM TERM) | (COMPARISON EXPRESSION EXPRESSION)]
            1:7: error: one condition is expected, `hall` is more
            1:11: warning: `)` after the end closes nothing; remove it"#]],
        );
        check("(known hall", expect!["1:1: error: unclosed `(`; add `)` at the end"]);
        check(" ", expect!["1:1: error: the text holds no condition"]);
        assert!(readable(plain_goal(" (known hall)")).is_ok());
    }
}
