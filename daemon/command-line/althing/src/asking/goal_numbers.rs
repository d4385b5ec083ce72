//! The numbers by which people name goals: each goal of `althing goals` has one, the same on every
//! machine.

use acl::ConversationId;
use acl::content::GoalStatus;
use agent::Resource;

use crate::ecosystem_view::EcosystemView;

/// Maximum number of goals that an error message lists.
const LISTED_MAX: usize = 8;

/// Returns the number that a person has written, with or without `#`; `None` if the text is no
/// number.
pub(crate) fn number(said: &str) -> Option<u32> {
    let digits = said.trim().strip_prefix('#').unwrap_or(said.trim());
    let is_number = !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit());
    is_number.then(|| digits.parse().ok()).flatten()
}

/// Queries the goals from the leading Plan Requester; `None` if the Plan Requester does not answer.
pub(crate) async fn goals(view: &EcosystemView) -> Option<Vec<GoalStatus>> {
    let requester = &view.roles().plan_requester;
    view.directory(Some(requester)).await;
    let answers = view.ask(Resource::Goals, Some(requester.clone())).await;
    serde_json::from_slice(answers.first()?).ok()
}

/// Returns the conversation of the goal that a person names: by its number, or by the conversation
/// itself.
///
/// # Errors
///
/// Returns an error if no goal has the number. The text is for a person.
pub(crate) async fn conversation(
    view: &EcosystemView,
    said: &str,
) -> Result<ConversationId, String> {
    let Some(number) = number(said) else { return Ok(ConversationId::new(said)) };
    let Some(goals) = goals(view).await else {
        return Err(format!(
            "goal {number} is not known here: no Plan Requester is present that could tell it; \
             `althing agents` shows who is"
        ));
    };
    find(&goals, number).cloned().ok_or_else(|| unknown(&goals, number))
}

fn find(goals: &[GoalStatus], number: u32) -> Option<&ConversationId> {
    let found = goals.iter().find(|goal| goal.number == number);
    found.map(|goal| &goal.conversation)
}

/// Returns the error that no goal has the number, with the numbers that goals have.
fn unknown(goals: &[GoalStatus], number: u32) -> String {
    let mut numbers: Vec<u32> = goals.iter().map(|goal| goal.number).filter(|it| *it > 0).collect();
    numbers.sort_unstable();
    let shown: Vec<_> = numbers.iter().take(LISTED_MAX).map(u32::to_string).collect();
    let known = match (shown.split_last(), numbers.len().saturating_sub(LISTED_MAX)) {
        (None, _) => "no goal is pursued now".to_owned(),
        (Some((only, [])), 0) => format!("the only goal is {only}"),
        (Some((last, rest)), 0) => format!("there are {} and {last}", rest.join(", ")),
        (Some(_), more) => format!("there are {} and {more} more", shown.join(", ")),
    };
    format!("there is no goal {number} now; {known}: `althing goals` lists them")
}

#[cfg(test)]
mod tests {
    use acl::content::GoalPhase;

    use super::*;

    fn goal(number: u32) -> GoalStatus {
        GoalStatus {
            due: None,
            conversation: ConversationId::new(&format!("c{number}")),
            number,
            goal: "(lit hall)".to_owned(),
            keep: Default::default(),
            priority: 0,
            phase: GoalPhase::Holding,
            waits_because: String::new(),
            rounds: 1,
            history: Vec::new(),
        }
    }

    #[test]
    fn a_number_is_digits_alone() {
        let read = ["3", " #3 ", "12", "c3", "", "#", "-3", "3.5", "99999999999"].map(number);
        assert_eq!(read, [Some(3), Some(3), Some(12), None, None, None, None, None, None]);
    }

    #[test]
    fn an_unknown_number_yields_the_known_ones() {
        let goals = [goal(4), goal(1)];
        assert_eq!(find(&goals, 4).map(ConversationId::as_str), Some("c4"));
        assert_eq!(
            unknown(&goals, 3),
            "there is no goal 3 now; there are 1 and 4: `althing goals` lists them"
        );
        assert!(unknown(&[], 3).contains("no goal is pursued now"));
        assert!(unknown(&goals[..1], 3).contains("the only goal is 4"));
        let many: Vec<_> = (1..=12).map(goal).collect();
        assert!(unknown(&many, 30).contains("1, 2, 3, 4, 5, 6, 7, 8 and 4 more"));
    }
}
