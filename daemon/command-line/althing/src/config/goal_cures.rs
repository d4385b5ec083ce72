//! Cures for goals that are written as in other languages: without parentheses, with the comparison
//! between its sides, with units.

use pddl::{Diagnostic, Span};

/// Signs of comparisons, the longer ones first.
const SIGNS: &[&str] = &[">=", "<=", "==", ">", "<", "="];

/// Returns the diagnostics of a goal that cannot be parsed, or a single one with the goal that was
/// probably meant.
pub(crate) fn improved(goal: &str, found: Vec<Diagnostic>) -> Vec<Diagnostic> {
    let whole = Span::new(0, goal.len());
    let single = |message: &str, meant: String| {
        vec![Diagnostic::error(whole, message).with_help(format!("write {meant}"))]
    };
    let trimmed = goal.trim();
    // A sign in the middle may look like an object, so that nothing is wrong with the form.
    if let Some(meant) = prefix_comparison(trimmed) {
        return single("a comparison begins with its sign", meant);
    }
    if !found.iter().any(Diagnostic::is_error) {
        return found;
    }
    if let Some(meant) = with_points(trimmed) {
        return single("a number has a point, not a comma", meant);
    }
    if let Some(meant) = negated(trimmed) {
        return single("the condition that is negated stands in parentheses", meant);
    }
    let wrapped = format!("({trimmed})");
    if !trimmed.starts_with('(') && !trimmed.is_empty() && is_goal(&wrapped) {
        return single("a goal stands in parentheses", wrapped);
    }
    let without_unit = |mut found: Diagnostic| {
        if found.message.starts_with("a comparison ends before") && found.help.is_none() {
            found.help = Some("write the number alone, without a unit".to_owned());
        }
        found
    };
    found.into_iter().map(without_unit).collect()
}

/// Whether a goal that is neither PDDL nor words was probably meant as PDDL in another form: a
/// comparison, or a predicate, whose name has a hyphen unlike any word.
pub(crate) fn has_cure(goal: &str) -> bool {
    let begins_with_name = goal.split_whitespace().next().is_some_and(|word| word.contains('-'));
    let found = improved(goal, pddl::parse_condition(goal).diagnostics);
    let help = found.first().and_then(|first| first.help.as_deref());
    help.is_some_and(|help| help.starts_with("write ("))
        && (begins_with_name || prefix_comparison(goal.trim()).is_some())
}

/// Returns a goal with points in its numbers, for one with commas: `21.5` for `21,5`.
fn with_points(goal: &str) -> Option<String> {
    let letters: Vec<char> = goal.chars().collect();
    let is_digit =
        |at: Option<usize>| at.and_then(|at| letters.get(at)).is_some_and(char::is_ascii_digit);
    let meant: String = letters
        .iter()
        .enumerate()
        .map(|(at, letter)| match letter {
            ',' if is_digit(at.checked_sub(1)) && is_digit(Some(at + 1)) => '.',
            other => *other,
        })
        .collect();
    (meant != goal && is_goal(&meant)).then_some(meant)
}

/// Returns `(not (known hall))` for `(not known hall)`.
fn negated(goal: &str) -> Option<String> {
    let inner = goal.strip_prefix("(not ")?.strip_suffix(')')?.trim();
    let meant = format!("(not ({inner}))");
    (!inner.starts_with('(') && is_goal(&meant)).then_some(meant)
}

/// Whether a text is a goal without mistakes in its form.
fn is_goal(text: &str) -> bool {
    pddl::parse_condition(text).into_result().is_ok()
}

/// Returns a comparison with its sign at the beginning, for one with the sign in the middle:
/// `(>= (temperature hall) 21)` for `(temperature hall) >= 21 °C`.
fn prefix_comparison(goal: &str) -> Option<String> {
    let inner = goal.strip_prefix("((").and_then(|rest| rest.strip_suffix(')'));
    let mut goal = inner.map_or_else(|| goal.to_owned(), |inner| format!("({inner}"));
    // `(temperature hall >= 21)`: the parentheses are around the comparison as a whole.
    let flat = goal.strip_prefix('(').and_then(|rest| rest.strip_suffix(')'));
    if let Some(flat) = flat.filter(|flat| !flat.contains(['(', ')', '?'])) {
        goal = flat.to_owned();
    }
    let (sign, at) = SIGNS.iter().find_map(|sign| Some((*sign, goal.find(sign)?)))?;
    let (left, right) = (goal[..at].trim(), goal[at + sign.len()..].trim());
    let number = right.find(|c: char| !c.is_ascii_digit() && !".,-+".contains(c));
    let number = right[..number.unwrap_or(right.len())].replace(',', ".");
    let left = match left.starts_with('(') {
        true => left.to_owned(),
        false => format!("({left})"),
    };
    let sign = if sign == "==" { "=" } else { sign };
    let meant = format!("({sign} {left} {number})");
    (number.parse::<f64>().is_ok() && is_goal(&meant)).then_some(meant)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[track_caller]
    fn check(goal: &str, message: &str, help: &str) {
        let found = improved(goal, pddl::parse_condition(goal).diagnostics);
        let [only] = found.as_slice() else { panic!("one mistake: {found:#?}") };
        assert_eq!((only.message.as_str(), only.help.as_deref()), (message, Some(help)));
    }

    #[test]
    fn a_goal_of_another_language_yields_the_right_form() {
        let stands = "a goal stands in parentheses";
        check("known-temperature hall", stands, "write (known-temperature hall)");
        check("not (dark hall)", stands, "write (not (dark hall))");
        let sign = "a comparison begins with its sign";
        check("(temperature hall) >= 21", sign, "write (>= (temperature hall) 21)");
        check("((temperature hall) > 20,5 °C)", sign, "write (> (temperature hall) 20.5)");
        check("temperature hall == 21", sign, "write (= (temperature hall) 21)");
        check("(temperature hall >= 21)", sign, "write (>= (temperature hall) 21)");
        let comma = "a number has a point, not a comma";
        check("(>= (temperature hall) 21,5)", comma, "write (>= (temperature hall) 21.5)");
        let negated = "the condition that is negated stands in parentheses";
        check("(not known hall)", negated, "write (not (known hall))");
    }

    #[test]
    fn a_unit_is_left_out() {
        let goal = "(= (temperature hall) 21 C)";
        let found = improved(goal, pddl::parse_condition(goal).diagnostics);
        assert_eq!(found[0].help.as_deref(), Some("write the number alone, without a unit"));
    }

    #[test]
    fn a_right_goal_and_any_other_mistake_are_left_alone() {
        let comparisons = ["(>= (t a) 3)", "(and (>= (t a) 3) (not (k b)))", "(= ?x hall)"];
        for goal in ["(known-temperature hall)", "(known (hall", ""].into_iter().chain(comparisons)
        {
            let found = pddl::parse_condition(goal).diagnostics;
            assert_eq!(improved(goal, found.clone()), found, "{goal}");
        }
    }
}
