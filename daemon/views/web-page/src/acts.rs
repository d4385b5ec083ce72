//! Acts of people: held against the rights of the person, counted, carried out by the host, and
//! logged.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::{Duration, Instant};

use accounts::{Person, PersonRight};
use axum::http::StatusCode;
use tokio::time::timeout;

use crate::act_limits::ActKind;
use crate::answer::Refused;
use crate::caller::Caller;
use crate::host::{ActOutcome, PageAct};
use crate::server_state::{FloodKind, ServerState};

/// How long the host may take for an act: a planner has half a minute, and agents answer within
/// seconds.
const ACT_WITHIN: Duration = Duration::from_secs(60);

/// Maximum length of a text of an act in the log, in characters.
const LOGGED_CHARS_MAX: usize = 500;

impl PageAct {
    /// Returns the right that a person needs for the act; `None` if signing in is enough.
    pub fn right(&self) -> Option<PersonRight> {
        match self {
            PageAct::Goal { .. }
            | PageAct::DryRun { .. }
            | PageAct::CancelGoal { .. }
            | PageAct::Action { .. }
            | PageAct::Answer { .. } => Some(PersonRight::Ask),
            PageAct::Set { .. } => Some(PersonRight::Change),
            PageAct::Admit { .. } => Some(PersonRight::Admit),
            PageAct::Release { .. } => Some(PersonRight::Stop),
            PageAct::Stop { .. } => None,
        }
    }

    /// Describes the act for the log, without the text of an answer.
    pub fn described(&self) -> String {
        let text = match self {
            PageAct::Goal { goal, mode, .. } => format!("goal ({mode}): {goal}"),
            PageAct::DryRun { goal, mode } => format!("dry run of a goal ({mode}): {goal}"),
            PageAct::CancelGoal { conversation } => format!("cancel the goal {conversation}"),
            PageAct::Action { agent, action } => format!("action of {agent}: {action}"),
            PageAct::Set { fact } => format!("set {fact}"),
            PageAct::Answer { keyboard, question, .. } => {
                format!("answer to the question {keyboard}/{question}")
            }
            PageAct::Admit { agent, allow: true } => format!("admit {agent}"),
            PageAct::Admit { agent, allow: false } => format!("forbid {agent}"),
            PageAct::Stop { names, because } => {
                let names = if names.is_empty() { "everything".into() } else { names.join(", ") };
                let why = if because.is_empty() { String::new() } else { format!(": {because}") };
                format!("stop {names}{why}")
            }
            PageAct::Release { ids } => format!("release the stops {}", ids.join(", ")),
        };
        text.chars().take(LOGGED_CHARS_MAX).collect()
    }
}

/// Carries out an act of a caller.
///
/// # Errors
///
/// Returns a refusal if the person may not, has asked too often, or if the host does not answer in
/// time.
pub(crate) async fn carry_out(
    state: &Arc<ServerState>,
    caller: &Caller,
    from: IpAddr,
    act: PageAct,
) -> Result<ActOutcome, Refused> {
    let person = caller.person().clone();
    let mut what = act.described();
    let is_stop = matches!(act, PageAct::Stop { .. });
    let kind = if is_stop { ActKind::Stop } else { ActKind::Other };
    state.limits.take(caller.key(), kind, Instant::now()).map_err(|after| {
        let problem = "you ask for more than the ecosystem can follow; wait a moment";
        let refused = Refused::new(StatusCode::TOO_MANY_REQUESTS, problem).again_after(after);
        let (name, told) = (person.name.clone(), outcome_of(&refused));
        state.record_flood(FloodKind::Acts, Some(name), from, what.clone(), told);
        refused
    })?;
    let right = state.host.required_right(&act);
    if let (PageAct::Answer { .. }, Some(PersonRight::Admit)) = (&act, right) {
        what += ", which admits agents or forbids them";
    }
    let allowed = match &person.screen {
        Some(agent) => check_screen(state, agent, &act),
        None => right.map_or(Ok(()), |right| caller.require(right)),
    };
    allowed.inspect_err(|refused| {
        state.record(Some(person.name.clone()), from, what.clone(), outcome_of(refused));
    })?;
    // A stop waits for nothing that others have asked for.
    let permit = Arc::clone(&state.acts).try_acquire_owned().ok();
    if permit.is_none() && !is_stop {
        let problem = "too many requests of other people are being carried out; try again";
        let refused = Refused::new(StatusCode::SERVICE_UNAVAILABLE, problem);
        let told = outcome_of(&refused);
        state.record_flood(FloodKind::Acts, Some(person.name), from, what, told);
        return Err(refused);
    }
    // What was begun is carried out and logged, although the page may go away meanwhile.
    let state = Arc::clone(state);
    let carried_out = tokio::spawn(async move {
        let _permit = permit;
        ask_host(&state, person, from, what, act).await
    });
    carried_out.await.unwrap_or_else(|error| {
        tracing::error!(%error, "an act of a person has failed");
        let problem = "the daemon has failed to carry this out; its log says more";
        Err(Refused::new(StatusCode::INTERNAL_SERVER_ERROR, problem))
    })
}

/// Checks that the screen of an agent stops this agent alone, or answers one of its questions.
fn check_screen(state: &ServerState, agent: &str, act: &PageAct) -> Result<(), Refused> {
    let is_allowed = match act {
        PageAct::Stop { names, .. } => matches!(names.as_slice(), [name] if name == agent),
        PageAct::Answer { keyboard, question, .. } => {
            let (id, now, mut is_asked) =
                (format!("{keyboard}/{question}"), state.host.now(), false);
            state.host.read(&mut |view| {
                let questions = view.questions(now);
                is_asked = questions.iter().any(|row| {
                    row.id.as_deref() == Some(id.as_str()) && row.from.as_str() == agent
                });
            });
            is_asked
        }
        _ => false,
    };
    if is_allowed {
        return Ok(());
    }
    let problem = match act {
        PageAct::Answer { .. } => {
            format!("{agent} does not ask this any more; its screen answers its own questions only")
        }
        _ => {
            format!("the screen of {agent} stops {agent}, and answers its questions; sign in first")
        }
    };
    Err(Refused::new(StatusCode::FORBIDDEN, problem))
}

async fn ask_host(
    state: &ServerState,
    person: Person,
    from: IpAddr,
    what: String,
    act: PageAct,
) -> Result<ActOutcome, Refused> {
    let name = person.name.clone();
    let answered = timeout(ACT_WITHIN, state.host.act(person, act)).await.map_err(|_| {
        let problem = "there is no answer yet; look at the activity for what has come of it";
        Refused::new(StatusCode::GATEWAY_TIMEOUT, problem)
    });
    let outcome = match &answered {
        Ok(outcome) if outcome.ok => format!("done: {}", outcome.sentence),
        Ok(outcome) => format!("not done: {}", outcome.sentence),
        Err(refused) => refused.problem().to_owned(),
    };
    state.record(Some(name), from, what, outcome.chars().take(LOGGED_CHARS_MAX).collect());
    answered
}

fn outcome_of(refused: &Refused) -> String {
    format!("refused: {}", refused.problem())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_description_has_the_text_of_an_answer() {
        let act = PageAct::Answer { keyboard: "hall".into(), question: 3, text: "2718".into() };
        assert_eq!(act.described(), "answer to the question hall/3");
        let act = PageAct::Stop { names: Vec::new(), because: "x".repeat(10_000) };
        assert_eq!(act.described().chars().count(), LOGGED_CHARS_MAX);
        assert_eq!(act.right(), None, "signing in is enough to stop");
    }
}
