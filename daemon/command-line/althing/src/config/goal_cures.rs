//! Cures for goals that are written as in other languages: without parentheses, with the comparison
//! between its sides, with units.

use pddl::{Diagnostic, Span};

/// Signs of comparisons, the longer ones first.
const SIGNS: &[&str] = &[">=", "<=", "==", ">", "<", "="];

/// Returns the diagnostics of a goal that cannot be parsed, or a single one with the goal that was
/// probably meant.
pub(crate) fn improved(goal: &str, found: Vec<Diagnostic>) -> Vec<Diagnostic> {
    if !found.iter().any(Diagnostic::is_error) {
        return found;
    }
    let whole = Span::new(0, goal.len());
    let single = |message: &str, meant: String| {
        vec![Diagnostic::error(whole, message).with_help(format!("write {meant}"))]
    };
    let trimmed = goal.trim();
    if let Some(meant) = prefix_comparison(trimmed) {
        return single("a comparison begins with its sign", meant);
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

/// Whether a text is a goal without mistakes in its form.
fn is_goal(text: &str) -> bool {
    pddl::parse_condition(text).into_result().is_ok()
}

/// Returns a comparison with its sign at the beginning, for one with the sign in the middle:
/// `(>= (temperature hall) 21)` for `(temperature hall) >= 21 °C`.
fn prefix_comparison(goal: &str) -> Option<String> {
    let inner = goal.strip_prefix("((").and_then(|rest| rest.strip_suffix(')'));
    let goal = inner.map_or_else(|| goal.to_owned(), |inner| format!("({inner}"));
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
    }

    #[test]
    fn a_unit_is_left_out() {
        let goal = "(= (temperature hall) 21 C)";
        let found = improved(goal, pddl::parse_condition(goal).diagnostics);
        assert_eq!(found[0].help.as_deref(), Some("write the number alone, without a unit"));
    }

    #[test]
    fn a_right_goal_and_any_other_mistake_are_left_alone() {
        for goal in ["(known-temperature hall)", "(known (hall", "", "(>= (t a) 3)"] {
            let found = pddl::parse_condition(goal).diagnostics;
            assert_eq!(improved(goal, found.clone()), found, "{goal}");
        }
    }
}
