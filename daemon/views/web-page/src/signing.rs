//! Signing in and out, and the question of a page which person has signed in.

use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use accounts::{Person, SignInRefusal};
use axum::Extension;
use axum::body::Body;
use axum::extract::State;
use axum::http::header;
use axum::http::{HeaderMap, StatusCode};
use axum::response::{IntoResponse, Response};
use serde::Deserialize;
use serde_json::{Value, json};

use crate::act_limits::ActKind;
use crate::answer::{Refused, json_answer};
use crate::caller::{self, Caller};
use crate::caller_key::CallerKey;
use crate::connection::PageClient;
use crate::server_state::{FloodKind, ServerState};

/// The name and the password of a person.
#[derive(Deserialize)]
struct Credentials {
    name: String,
    password: String,
}

/// The token of a screen.
#[derive(Deserialize)]
struct ScreenToken {
    token: String,
}

/// Signs a person in.
pub(crate) async fn sign_in(
    State(state): State<Arc<ServerState>>,
    Extension(client): Extension<PageClient>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Refused> {
    let Credentials { name, password } = crate::body::json(&headers, body).await?;
    let accounts = Arc::clone(&state.accounts);
    let signed_in = tokio::task::spawn_blocking(move || {
        accounts.sign_in(&name, &password, client.from, SystemTime::now())
    });
    let failed = |_| SignInRefusal::Unavailable("the daemon has failed".to_owned());
    let signed_in = signed_in.await.map_err(failed).and_then(|signed_in| signed_in);
    // The typed name is not logged: now and then it is a password.
    let session = signed_in.map_err(|refusal| {
        let (what, outcome) = ("sign in".to_owned(), format!("refused: {refusal}"));
        match refusal {
            SignInRefusal::Wrong => state.record(None, client.from, what, outcome),
            _ => state.record_flood(FloodKind::SignIn, None, client.from, what, outcome),
        }
        caller::refusal_of(&refusal)
    })?;
    // The session of before, in the same browser, ends.
    if let Some(former) = state.cookies.session(&headers) {
        state.accounts.sign_out(former);
    }
    let person = &session.signed_in.person;
    state.record(Some(person.name.clone()), client.from, "sign in".to_owned(), "done".to_owned());
    let cookie = state.cookies.set_session(Some(&session.secret));
    let cookie = cookie.ok_or_else(|| {
        let problem = "the daemon has made a session that no cookie can hold";
        Refused::new(StatusCode::INTERNAL_SERVER_ERROR, problem)
    })?;
    let (csrf, ends_at) = (&session.signed_in.csrf, session.signed_in.ends_at);
    let me = described(&state, person, Some(csrf), Some(ends_at));
    let mut response = json_answer(StatusCode::OK, &me);
    response.headers_mut().insert(header::SET_COOKIE, cookie);
    Ok(response)
}

/// Signs a person out.
pub(crate) async fn sign_out(
    State(state): State<Arc<ServerState>>,
    Extension(client): Extension<PageClient>,
    headers: HeaderMap,
) -> Result<Response, Refused> {
    let caller = Caller::of(&state, &headers, &client)?;
    crate::api::check_csrf(&state, &caller, (&headers, client.from), "sign out")?;
    if let Caller::Screen { person, .. } = &caller {
        let problem = format!(
            "no person has signed in at this screen; `althing people remove {}` ends it",
            person.name
        );
        return Err(Refused::new(StatusCode::FORBIDDEN, problem));
    }
    // A program has no session that could end.
    if let (Caller::Session(_), Some(secret)) = (&caller, state.cookies.session(&headers)) {
        state.accounts.sign_out(secret);
        let name = caller.person().name.clone();
        state.record(Some(name), client.from, "sign out".to_owned(), "done".to_owned());
    }
    let mut response = StatusCode::NO_CONTENT.into_response();
    if let Some(cookie) = state.cookies.set_session(None) {
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    Ok(response)
}

/// Says which person has signed in, and what that person may do.
pub(crate) async fn me(
    State(state): State<Arc<ServerState>>,
    Extension(client): Extension<PageClient>,
    headers: HeaderMap,
) -> Result<Response, Refused> {
    let caller = Caller::of(&state, &headers, &client)?;
    let ends_at = match &caller {
        Caller::Session(signed_in) => Some(signed_in.ends_at),
        Caller::Program { .. } | Caller::Screen { .. } => None,
    };
    let me = described(&state, caller.person(), caller.csrf().as_deref(), ends_at);
    let mut response = json_answer(StatusCode::OK, &me);
    if let Caller::Screen { token, .. } = &caller
        && let Some(cookie) = state.cookies.set_screen(token)
    {
        // A screen that is used keeps its cookie.
        response.headers_mut().insert(header::SET_COOKIE, cookie);
    }
    Ok(response)
}

/// Makes a browser the screen of an agent: gives it a cookie with the token of the screen, which the
/// page has read from its address.
pub(crate) async fn screen(
    State(state): State<Arc<ServerState>>,
    Extension(client): Extension<PageClient>,
    headers: HeaderMap,
    body: Body,
) -> Result<Response, Refused> {
    let ScreenToken { token } = crate::body::json(&headers, body).await?;
    let what = || "begin a screen".to_owned();
    let (accounts, text) = (Arc::clone(&state.accounts), token.clone());
    let looked = tokio::task::spawn_blocking(move || {
        // The screen may have been added a moment ago; `accounts` logs a file with mistakes itself.
        let _ = accounts.refresh();
        accounts.program(&text, client.from, SystemTime::now())
    });
    let failed = |_| SignInRefusal::Unavailable("the daemon has failed".to_owned());
    let person = looked.await.map_err(failed).and_then(|person| person);
    let person = person.map_err(|refusal| {
        let refused = match refusal {
            SignInRefusal::Wrong => {
                let problem = "the link of this screen is not valid any more; \
                               `althing people add-screen` makes another";
                Refused::new(StatusCode::UNAUTHORIZED, problem)
            }
            other => caller::refusal_of(&other),
        };
        let outcome = format!("refused: {}", refused.problem());
        state.record_flood(FloodKind::SignIn, None, client.from, what(), outcome);
        refused
    })?;
    if person.screen.is_none() {
        let problem = "this token is that of a program, and not of a screen";
        return Err(Refused::new(StatusCode::FORBIDDEN, problem));
    }
    let key = CallerKey::Program(person.name.clone());
    state.limits.take(key, ActKind::Other, Instant::now()).map_err(|after| {
        let problem = "this screen begins too often; wait a moment";
        Refused::new(StatusCode::TOO_MANY_REQUESTS, problem).again_after(after)
    })?;
    let cookie = state.cookies.set_screen(&token).ok_or_else(|| {
        let problem = "the token cannot be kept in a cookie";
        Refused::new(StatusCode::BAD_REQUEST, problem)
    })?;
    state.record(Some(person.name.clone()), client.from, what(), "done".to_owned());
    let mut response = StatusCode::NO_CONTENT.into_response();
    response.headers_mut().insert(header::SET_COOKIE, cookie);
    Ok(response)
}

fn described(
    state: &ServerState,
    person: &Person,
    csrf: Option<&str>,
    ends_at: Option<SystemTime>,
) -> Value {
    let millis = |at: SystemTime| {
        let since = at.duration_since(UNIX_EPOCH).ok()?;
        u64::try_from(since.as_millis()).ok()
    };
    let setup = state.host.describe();
    json!({
        "person": person.name.as_str(),
        "rights": person.rights,
        "screen": person.screen,
        "csrf": csrf,
        "ends_at": ends_at.and_then(millis),
        "certificate_ends_at": state.certificate_ends_at().and_then(millis),
        "ecosystem": setup.ecosystem,
        "daemon": setup.daemon,
        "version": state.assets.version(),
    })
}
