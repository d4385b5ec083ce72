//! The requests that people write as text (goals, actions, facts), checked before they are sent.

use acl::content::ChangeState;
use keyboard::{GoalRequest, UserRequest};
use pddl::Condition;
use phrases::{KnownNames, NotUnderstood};

use crate::config::{Ecosystem, is_pddl, plain_goal};
use crate::speech;

/// Returns the goal that a person has written: PDDL, words, or a name of the ecosystem file.
///
/// # Errors
///
/// Returns an error message if the goal is not known or cannot be parsed.
pub(crate) fn goal(ecosystem: Option<&Ecosystem>, asked: &str) -> Result<GoalRequest, String> {
    if is_in_words(ecosystem, asked) {
        return in_words(asked, &KnownNames::default());
    }
    let wish = match ecosystem {
        Some(ecosystem) => ecosystem.find_goal(asked)?,
        None if is_pddl(asked) => plain_goal(asked),
        None => {
            return Err(format!(
                "`{asked}` may be a goal of the ecosystem file, which is not known here; write \
                 the goal in words or in PDDL, or name the file with --ecosystem FILE"
            ));
        }
    };
    readable(wish)
}

/// Whether a person has written a goal in words, correct or not, as opposed to PDDL or a name of the
/// ecosystem file.
pub(crate) fn is_in_words(ecosystem: Option<&Ecosystem>, asked: &str) -> bool {
    let asked = asked.trim();
    let is_named = ecosystem.is_some_and(|ecosystem| ecosystem.goals.contains_key(asked));
    if is_named || !asked.contains(char::is_whitespace) {
        return false;
    }
    if asked.starts_with('(') {
        let is_pddl = pddl::parse_condition(asked).into_result().is_ok();
        return !is_pddl && speech::read(asked, &KnownNames::default()).is_ok();
    }
    // A word right before its parentheses is PDDL written as in other languages.
    let mut before = ' ';
    for character in asked.chars() {
        if character == '(' && before.is_alphanumeric() {
            return false;
        }
        before = character;
    }
    true
}

/// Returns the goal that a person has written in words.
///
/// # Errors
///
/// Returns an error message with the place that is not understood, and the nearest text that is.
pub(crate) fn in_words(asked: &str, names: &KnownNames) -> Result<GoalRequest, String> {
    let goal = speech::read(asked, names).map_err(|wrong| misunderstood(&wrong, asked, names))?;
    Ok(plain_goal(&goal))
}

/// Formats the answer to words that are not understood. PDDL without its parentheses is answered with
/// the parentheses, unless a phrase is nearer.
fn misunderstood(wrong: &NotUnderstood, asked: &str, names: &KnownNames) -> String {
    let meant = format!("({})", asked.trim());
    let first = asked.split_whitespace().next().unwrap_or_default();
    let is_pddl = names.declares(first) && pddl::parse_condition(&meant).into_result().is_ok();
    match is_pddl && !wrong.is_near {
        true => format!("the goal `{asked}` has no parentheses; did you mean `{meant}`?"),
        false => wrong.diagnostic().located(asked),
    }
}

/// Returns the request for one action.
///
/// # Errors
///
/// Returns an error message if the action cannot be parsed.
pub(crate) fn action(action: &str) -> Result<UserRequest, String> {
    pddl::parse_step(action).into_result().map_err(|found| located(&found, action))?;
    Ok(UserRequest::Act(action.to_owned()))
}

/// Returns the change that makes the facts known, or, with `is_retraction`, no longer true.
///
/// # Errors
///
/// Returns an error message if the facts cannot be parsed.
pub(crate) fn change(facts: &str, is_retraction: bool) -> Result<ChangeState, String> {
    let facts = facts_in_pddl(facts)?;
    let read = pddl::parse_init_elements(&facts).into_result();
    read.map_err(|found| located(&found, &facts))?;
    Ok(match is_retraction {
        true => ChangeState { retract: facts, ..ChangeState::default() },
        false => ChangeState { believe: facts, ..ChangeState::default() },
    })
}

/// Returns facts in PDDL; those in words stand on a line each.
fn facts_in_pddl(facts: &str) -> Result<String, String> {
    let is_in_words = |line: &str| {
        let line = line.trim();
        line.contains(' ') && !line.starts_with(['(', ')', ';']) && !line.contains(")(")
    };
    if !facts.lines().all(is_in_words) {
        return Ok(facts.to_owned());
    }
    let mut read = Vec::new();
    for line in facts.lines() {
        let names = KnownNames::default();
        let goal = speech::read(line, &names).map_err(|wrong| wrong.diagnostic().located(line))?;
        // A conjunction of facts is several facts.
        match pddl::parse_condition(&goal).value {
            Some(Condition::And(parts)) => read.extend(parts.iter().map(ToString::to_string)),
            _ => read.push(goal),
        }
    }
    Ok(read.join("\n"))
}

/// Returns `wish` if its goal can be parsed.
///
/// # Errors
///
/// Returns an error message with the mistakes and, if possible, the goal that was probably meant.
pub(crate) fn readable(wish: GoalRequest) -> Result<GoalRequest, String> {
    let goal = wish.goal.trim();
    let Err(found) = pddl::parse_condition(goal).into_result() else { return Ok(wish) };
    let meant = format!("({goal})");
    let is_closed = goal.matches('(').count() == goal.matches(')').count();
    if is_closed && !goal.is_empty() && pddl::parse_condition(&meant).into_result().is_ok() {
        return Err(format!("the goal `{goal}` has no parentheses; did you mean `{meant}`?"));
    }
    Err(located(&found, goal))
}

/// Formats the mistakes in `text`, each with its line and column.
pub(crate) fn located(found: &[pddl::Diagnostic], text: &str) -> String {
    let lines: Vec<_> = found.iter().map(|mistake| mistake.located(text)).collect();
    lines.join("\n")
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
    fn a_goal_is_written_in_words() {
        let goal_of = |asked: &str| goal(None, asked).map(|wish| wish.goal);
        let known = "(known-temperature office1)";
        assert_eq!(goal_of("temperature of office1 known").as_deref(), Ok(known));
        assert_eq!(goal_of("Temperatur von office1 bekannt").as_deref(), Ok(known));
        assert_eq!(goal_of(known).as_deref(), Ok(known));
        assert_eq!(goal_of("(a) and (b)").as_deref(), Ok("(and (a) (b))"));
        let wrong = goal_of("temperature of office1 konwn").expect_err("a slip");
        let expected = expect![
            "1:24: error: `temperature of office1 konwn` is not understood; did you mean `temperature of office1 known`?"
        ];
        expected.assert_eq(&wrong);
    }

    #[test]
    fn facts_are_written_in_words() {
        let facts = |text: &str| change(text, false).map(|change| change.believe);
        let read = facts("temperature of office1 is 21 °C\noffice2 swept and no motion in hall");
        let expected = "(= (temperature office1) 21)\n(swept office2)\n(not (motion hall))";
        assert_eq!(read.as_deref(), Ok(expected));
        assert!(facts("temperature of office1 above 21 °C").is_err(), "that is no fact");
        assert!(facts("office1 swpet").expect_err("a slip").contains("`office1 swept`"));
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
