//! The question of the Doorkeeper about discovered agents: composing its text, and parsing answers
//! to it.

use agent::Applicant;

/// Maximum number of agents that a question lists by name; further agents are only counted.
const NAMED_MAX: usize = 12;

/// Returns the text of the question about the agents in `about`. The text begins with the mistake
/// in the last answer if there was one.
pub(crate) fn question_text(about: &[(Applicant, String)], mistake: Option<&str>) -> String {
    let named: Vec<_> = about
        .iter()
        .take(NAMED_MAX)
        .map(|(applicant, about)| format!("`{}` ({about})", applicant.name))
        .collect();
    let more = match about.len().saturating_sub(NAMED_MAX) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    let begins = mistake.map(|mistake| format!("{mistake}. ")).unwrap_or_default();
    let named = named.join(", ");
    match about {
        [_] => format!("{begins}{named} has appeared, and no file names it. Let it in? yes, no"),
        _ => format!(
            "{begins}{named}{more} have appeared, and no file names them. Let them in? yes, no, or \
             the names of those that may"
        ),
    }
}

/// Parses an answer. Returns for each agent that the answer decides about whether it may take part.
/// `yes` or `no` before names decides about these agents alone; the others are asked about again.
///
/// # Errors
///
/// Returns the mistake in the answer, as text for the next question.
pub(crate) fn parse_answer(
    answer: &str,
    about: &[(Applicant, String)],
) -> Result<Vec<(Applicant, bool)>, String> {
    let all = |is_in| Ok(about.iter().map(|(applicant, _)| (applicant.clone(), is_in)).collect());
    match answer.trim().to_lowercase().as_str() {
        "yes" | "y" | "all" => return all(true),
        "no" | "n" | "none" => return all(false),
        _ => (),
    }
    let mut names: Vec<_> = answer
        .split(|symbol: char| symbol == ',' || symbol.is_whitespace())
        .map(|name| name.trim_matches('`'))
        .filter(|name| !name.is_empty())
        .collect();
    let only = match names.first().map(|first| first.to_lowercase()).as_deref() {
        Some("yes") => Some(true),
        Some("no") => Some(false),
        _ => None,
    };
    if only.is_some() {
        names.remove(0);
    }
    let known = || about.iter().map(|(applicant, _)| applicant.name.as_str());
    if names.is_empty() {
        return Err("An answer is missing".to_owned());
    }
    if let Some(unknown) = names.iter().find(|name| !known().any(|known| known == **name)) {
        return Err(format!("`{unknown}` is none of them"));
    }
    let is_named = |applicant: &Applicant| names.contains(&applicant.name.as_str());
    let applicants = about.iter().map(|(applicant, _)| applicant);
    Ok(match only {
        Some(is_in) => {
            applicants.filter(|one| is_named(one)).map(|one| (one.clone(), is_in)).collect()
        }
        None => applicants.map(|one| (one.clone(), is_named(one))).collect(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn about(names: &[&str]) -> Vec<(Applicant, String)> {
        let applicant =
            |name: &&str| Applicant { by: "zigbee".to_owned(), name: (*name).to_owned() };
        names.iter().map(|name| (applicant(name), "zigbee, office1".to_owned())).collect()
    }

    #[test]
    fn a_question_lists_the_new_agents() {
        assert_eq!(
            question_text(&about(&["t-1"]), None),
            "`t-1` (zigbee, office1) has appeared, and no file names it. Let it in? yes, no"
        );
        let many: Vec<_> = (0..20).map(|number| format!("t-{number}")).collect();
        let many: Vec<_> = many.iter().map(String::as_str).collect();
        let text = question_text(&about(&many), Some("`x` is none of them"));
        assert!(text.starts_with("`x` is none of them. `t-0` (zigbee, office1), `t-1`"), "{text}");
        assert!(text.contains(" and 8 more have appeared"), "{text}");
    }

    #[test]
    fn answers_yes_no_and_names_are_parsed() {
        let about = about(&["t-1", "t-2", "t-3"]);
        let said = |answer: &str| {
            parse_answer(answer, &about)
                .map(|answers| answers.iter().map(|(_, is_in)| *is_in).collect::<Vec<_>>())
        };
        assert_eq!(said(" Yes "), Ok(vec![true, true, true]));
        assert_eq!(said("none"), Ok(vec![false, false, false]));
        assert_eq!(said("t-3, t-1"), Ok(vec![true, false, true]));
        assert_eq!(said("`t-2`"), Ok(vec![false, true, false]));
        assert_eq!(said("yes t-2"), Ok(vec![true]), "the others are asked about again");
        assert_eq!(said("No t-1, t-3"), Ok(vec![false, false]));
        assert_eq!(said("yes t-4"), Err("`t-4` is none of them".to_owned()));
        assert_eq!(said("t-4"), Err("`t-4` is none of them".to_owned()));
        assert_eq!(said("  "), Err("An answer is missing".to_owned()));
    }
}
