//! The paths for what is to be seen, and for what people ask for.

use std::net::IpAddr;
use std::sync::Arc;
use std::time::Duration;

use accounts::PersonRight;
use acl::AgentId;
use axum::Extension;
use axum::body::Body;
use axum::extract::{FromRequestParts, Path, RawQuery, State};
use axum::http::header::{self, HeaderName, HeaderValue};
use axum::http::request::Parts;
use axum::http::{HeaderMap, StatusCode};
use axum::response::Response;
use bytes::Bytes;
use live_view::{LiveView, Moment};
use phrases::Language;
use serde_json::json;
use tokio::time::{Instant, timeout};

use crate::act_limits::ActKind;
use crate::acts;
use crate::answer::{Refused, json_answer};
use crate::caller::Caller;
use crate::connection::PageClient;
use crate::event_stream::{EventBody, EventSource};
use crate::host::{HistoryProblem, PageAct};
use crate::moments;
use crate::png;
use crate::query;
use crate::server_state::{FloodKind, ServerState};
use crate::topic_name::{self, TopicName};

/// How long a camera, or the history, may take to answer.
const ANSWERED_WITHIN: Duration = Duration::from_secs(20);

/// Maximum length of a picture, in bytes.
const PICTURE_BYTES_MAX: usize = 16 << 20;

/// Media type of pictures that no browser shows, and that are sent as PNG.
const PPM: &str = "image/x-portable-pixmap";

/// Number of requests of the log that a page shows.
const LOG_MAX: usize = 500;

/// The parts of a request that say from which page and person it comes.
pub(crate) type FromPage = (State<Arc<ServerState>>, Extension<PageClient>, HeaderMap);

/// The last part of a path: the name of a thing.
pub(crate) struct PathName(pub(crate) String);

impl<S: Send + Sync> FromRequestParts<S> for PathName {
    type Rejection = Refused;

    async fn from_request_parts(parts: &mut Parts, state: &S) -> Result<PathName, Refused> {
        let path = Path::<String>::from_request_parts(parts, state).await;
        let Path(name) =
            path.map_err(|_| Refused::new(StatusCode::BAD_REQUEST, "the path is not UTF-8"))?;
        Ok(PathName(name))
    }
}

/// Returns the caller of a request, if it has a right.
pub(crate) fn caller(
    (State(state), Extension(client), headers): &FromPage,
    right: PersonRight,
) -> Result<Caller, Refused> {
    let caller = Caller::of(state, headers, client)?;
    caller.require(right)?;
    Ok(caller)
}

/// Describes the ecosystem to those that build goals.
pub(crate) async fn setup(from: FromPage) -> Result<Response, Refused> {
    caller(&from, PersonRight::Look)?;
    Ok(json_answer(StatusCode::OK, &from.0.host.describe()))
}

/// Returns one goal with its plans.
pub(crate) async fn goal(PathName(id): PathName, from: FromPage) -> Result<Response, Refused> {
    let goal = topic_name::conversation(&id);
    detail(&from, |view, now| {
        goal.as_ref().and_then(|goal| view.goal(goal, now)).map(|it| moments::detail(&it, now))
    })
}

/// Returns one agent with everything that is known about it.
pub(crate) async fn agent(PathName(id): PathName, from: FromPage) -> Result<Response, Refused> {
    let agent = AgentId::new(&id).ok();
    detail(&from, |view, now| {
        agent.as_ref().and_then(|agent| view.agent(agent, now)).map(|it| moments::detail(&it, now))
    })
}

/// Returns one conversation with its messages.
pub(crate) async fn conversation(
    PathName(id): PathName,
    from: FromPage,
) -> Result<Response, Refused> {
    let of = topic_name::conversation(&id);
    detail(&from, |view, now| {
        of.as_ref().and_then(|of| view.conversation(of)).map(|it| moments::detail(&it, now))
    })
}

fn detail(
    from: &FromPage,
    find: impl Fn(&LiveView, Moment) -> Option<serde_json::Value>,
) -> Result<Response, Refused> {
    caller(from, PersonRight::Look)?;
    let (now, mut found) = (from.0.host.now(), None);
    from.0.host.read(&mut |view| found = find(view, now));
    let unknown = || Refused::new(StatusCode::NOT_FOUND, "nothing of this name is known");
    Ok(json_answer(StatusCode::OK, &found.ok_or_else(unknown)?))
}

/// Returns the caller of a request that has the daemon ask others.
///
/// # Errors
///
/// Returns a refusal if the caller may not look, or asks too often.
fn fetcher(from: &FromPage) -> Result<Caller, Refused> {
    let caller = caller(from, PersonRight::Look)?;
    let taken = from.0.limits.take(caller.key(), ActKind::Fetch, std::time::Instant::now());
    taken.map_err(|after| {
        let problem = "you look at more than the daemon can fetch; wait a moment";
        Refused::new(StatusCode::TOO_MANY_REQUESTS, problem).again_after(after)
    })?;
    Ok(caller)
}

/// Returns the newest picture of a camera.
pub(crate) async fn camera(PathName(id): PathName, from: FromPage) -> Result<Response, Refused> {
    fetcher(&from)?;
    let none = || Refused::new(StatusCode::NOT_FOUND, "there is no picture of this agent");
    let agent = AgentId::new(&id).map_err(|_| none())?;
    let picture = timeout(ANSWERED_WITHIN, from.0.host.picture(&agent)).await;
    let late = |_| Refused::new(StatusCode::GATEWAY_TIMEOUT, "the camera does not answer");
    let picture = picture.map_err(late)?.ok_or_else(none)?;
    if picture.bytes.len() > PICTURE_BYTES_MAX {
        return Err(Refused::new(
            StatusCode::BAD_GATEWAY,
            "the picture of the camera is too large",
        ));
    }
    // Nothing that a browser would run, whatever a camera sends.
    let (media_type, bytes) = match picture.media_type.as_str() {
        "image/jpeg" => ("image/jpeg", picture.bytes),
        "image/png" => ("image/png", picture.bytes),
        PPM => {
            let converted = tokio::task::spawn_blocking(move || png::of_ppm(&picture.bytes)).await;
            ("image/png", Bytes::from(converted.ok().flatten().ok_or_else(none)?))
        }
        _ => return Err(none()),
    };
    let mut response = Response::new(Body::from(bytes));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static(media_type));
    let taken_at = HeaderName::from_static("x-althing-taken-at");
    headers.insert(taken_at, HeaderValue::from(picture.at.0));
    Ok(response)
}

/// Returns rows of the history.
pub(crate) async fn history(RawQuery(text): RawQuery, from: FromPage) -> Result<Response, Refused> {
    let person = fetcher(&from)?.person().clone();
    let parameters = query::parse(text.as_deref().unwrap_or_default())?;
    let rows = timeout(ANSWERED_WITHIN, from.0.host.history(person, parameters)).await;
    let late = |_| Refused::new(StatusCode::GATEWAY_TIMEOUT, "the history does not answer");
    let rows = rows.map_err(late)?;
    let refused = |problem| match problem {
        HistoryProblem::Parameter(why) => Refused::new(StatusCode::BAD_REQUEST, why),
        HistoryProblem::Unavailable(why) => Refused::new(StatusCode::NOT_FOUND, why),
    };
    Ok(json_answer(StatusCode::OK, &rows.map_err(refused)?))
}

/// Says goals and facts, given in PDDL as `of`, in the words of a language.
pub(crate) async fn words(RawQuery(text): RawQuery, from: FromPage) -> Result<Response, Refused> {
    caller(&from, PersonRight::Look)?;
    let parameters = query::parse(text.as_deref().unwrap_or_default())?;
    let value = |wanted: &str| parameters.iter().find(|(name, _)| name == wanted);
    let tag = value("language").map_or("en", |(_, tag)| tag.as_str());
    let unknown = || Refused::new(StatusCode::NOT_FOUND, "there are no words in this language");
    let language = Language::from_tag(tag).ok_or_else(unknown)?;
    let books = &from.0.books;
    let book = books.iter().find(|book| book.language() == language).ok_or_else(unknown)?;
    let pddl = parameters.iter().filter(|(name, _)| name == "of").map(|(_, of)| of.as_str());
    let said: Vec<_> = pddl.map(|pddl| book.print_pddl(pddl)).collect();
    Ok(json_answer(StatusCode::OK, &json!({ "said": said })))
}

/// Returns the requests of people, the newest of them, oldest first.
pub(crate) async fn log(from: FromPage) -> Result<Response, Refused> {
    caller(&from, PersonRight::Admit)?;
    let none = || Refused::new(StatusCode::NOT_FOUND, "this daemon keeps no log of requests");
    let requests = from.0.recent_requests(LOG_MAX).ok_or_else(none)?;
    Ok(json_answer(StatusCode::OK, &json!({ "requests": requests })))
}

/// Sends what is to be seen as server-sent events, as long as the page is open.
pub(crate) async fn events(RawQuery(text): RawQuery, from: FromPage) -> Result<Response, Refused> {
    let (State(state), Extension(client), headers) = from;
    let caller = Caller::of(&state, &headers, &client)?;
    let parameters = query::parse(text.as_deref().unwrap_or_default())?;
    let topics = parameters.into_iter().find(|(name, _)| name == "topics").map(|(_, it)| it);
    let topics = TopicName::list(&topics.unwrap_or_default());
    // Whoever may not look learns no more than that.
    caller.check_topics(topics.as_deref().unwrap_or_default())?;
    let topics = topics.map_err(|problem| Refused::new(StatusCode::BAD_REQUEST, problem))?;
    let too_many = |problem: String| Refused::new(StatusCode::TOO_MANY_REQUESTS, problem);
    let place = state.stream_place(caller.key());
    let place = place.ok_or_else(|| too_many("you have too many pages open; close some".into()))?;
    let last = headers.get("last-event-id").and_then(|id| id.to_str().ok());
    let reader = state.topics.subscribe(topics, last).map_err(too_many)?;
    let people = state.accounts.changes();
    let looked_at = Instant::now();
    let source = EventSource { state, caller, reader, looked_at, people, _place: place };
    let mut response = Response::new(Body::new(EventBody::new(source)));
    let headers = response.headers_mut();
    headers.insert(header::CONTENT_TYPE, HeaderValue::from_static("text/event-stream"));
    // A proxy that buffers would hold events back.
    let buffering = HeaderName::from_static("x-accel-buffering");
    headers.insert(buffering, HeaderValue::from_static("no"));
    Ok(response)
}

/// Checks that a page of this server has made a request that changes something, and logs a request
/// of another page; `what` is what it asked for.
///
/// # Errors
///
/// Returns a refusal if another page may have made the request.
pub(crate) fn check_csrf(
    state: &ServerState,
    caller: &Caller,
    (headers, from): (&HeaderMap, IpAddr),
    what: &str,
) -> Result<(), Refused> {
    caller.check_csrf(headers).inspect_err(|refused| {
        let name = caller.person().name.clone();
        let outcome = format!("refused: {}", refused.problem());
        state.record_flood(FloodKind::Forged, Some(name), from, what.to_owned(), outcome);
    })
}

/// Carries out what a person asks for.
pub(crate) async fn act(from: FromPage, body: Body) -> Result<Response, Refused> {
    let (State(state), Extension(client), headers) = from;
    let caller = Caller::of(&state, &headers, &client)?;
    check_csrf(&state, &caller, (&headers, client.from), "ask for an act")?;
    let act: PageAct = crate::body::json(&headers, body).await?;
    let outcome = acts::carry_out(&state, &caller, client.from, act).await?;
    Ok(json_answer(StatusCode::OK, &outcome))
}
