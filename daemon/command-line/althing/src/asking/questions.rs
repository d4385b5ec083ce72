//! The questions that agents ask people: lists them, and finds the one that a person means.

use acl::content::OpenQuestion;
use agent::Resource;
use keyboard::UserRequest;

use crate::ecosystem_view::EcosystemView;

/// Returns the request that answers a question with `text`. `id` is the number of the question or,
/// with its keyboard, `KEYBOARD/NUMBER`.
///
/// # Errors
///
/// Returns an error message if `id` names no open question, or several.
pub(crate) async fn said(
    view: &EcosystemView,
    id: &str,
    text: String,
) -> Result<UserRequest, String> {
    meant(view, id).await.map(|question| reply(question, text))
}

/// Returns the request that answers this question with `text`.
pub(crate) fn reply(
    OpenQuestion { keyboard, question, seal_to, .. }: OpenQuestion,
    text: String,
) -> UserRequest {
    UserRequest::Answer { keyboard, question, text, seal_to }
}

/// Returns the open question that `id` names.
///
/// # Errors
///
/// Returns an error message if `id` names no open question, or several.
pub(crate) async fn meant(view: &EcosystemView, id: &str) -> Result<OpenQuestion, String> {
    let open = questions(view).await;
    let is_meant = |open: &&OpenQuestion| match id.split_once('/') {
        Some((keyboard, number)) => {
            open.keyboard.as_str() == keyboard && open.question.to_string() == number
        }
        None => open.question.to_string() == id,
    };
    let meant: Vec<_> = open.iter().filter(is_meant).collect();
    let ids = |open: &[&OpenQuestion]| {
        let ids: Vec<_> =
            open.iter().map(|open| format!("{}/{}", open.keyboard, open.question)).collect();
        ids.join(", ")
    };
    match meant[..] {
        [one] => Ok(one.clone()),
        [] if open.is_empty() => Err(format!("no question is open, neither `{id}` nor another")),
        [] => {
            let all: Vec<_> = open.iter().collect();
            Err(format!("no question `{id}` is open; open: {}", ids(&all)))
        }
        _ => Err(format!("several keyboards have a question {id}: choose {}", ids(&meant))),
    }
}

/// Returns the open questions of all keyboards.
pub(crate) async fn questions(view: &EcosystemView) -> Vec<OpenQuestion> {
    view.directory(None).await;
    let answers = view.ask(Resource::Questions, None).await;
    let read = answers.iter().filter_map(|answer| serde_json::from_slice(answer).ok());
    let mut open: Vec<OpenQuestion> = read.flat_map(|open: Vec<OpenQuestion>| open).collect();
    open.sort_by(|a, b| (&a.keyboard, a.question).cmp(&(&b.keyboard, b.question)));
    open
}
