//! The paths of the server, and the checks that all requests pass.

use std::sync::Arc;

use axum::Router;
use axum::extract::{Request, State};
use axum::http::{HeaderMap, Method, StatusCode};
use axum::middleware::{self, Next};
use axum::response::{IntoResponse, Response};
use axum::routing::{get, post};

use crate::answer::{self, Refused};
use crate::assets::INDEX;
use crate::connection::PageClient;
use crate::server_state::{FloodKind, ServerState};
use crate::{api, notifications, origin, signing};

/// The paths of pages: each is the same file, which shows what its path names.
const PAGES: &[&str] = &[
    "/",
    "/goals",
    "/goals/{id}",
    "/agents",
    "/agents/{id}",
    "/world",
    "/floor",
    "/questions",
    "/activity",
    "/conversations",
    "/conversations/{id}",
    "/daemons",
    "/inbox",
    "/ask",
    "/history",
    "/robot/{id}",
    "/sign-in",
    "/people",
];

/// Maximum length of the target of a request, in bytes.
const TARGET_BYTES_MAX: usize = 6 << 10;

/// Maximum length of a path in the log, in characters.
const LOGGED_CHARS_MAX: usize = 100;

/// Returns the paths with their handlers.
pub(crate) fn router(state: Arc<ServerState>) -> Router {
    let mut router = Router::new();
    for path in PAGES {
        router = router.route(path, get(page));
    }
    router
        .route("/assets/{*path}", get(asset))
        .route("/api/sign-in", post(signing::sign_in))
        .route("/api/sign-out", post(signing::sign_out))
        .route("/api/screen", post(signing::screen))
        .route("/api/me", get(signing::me))
        .route("/api/setup", get(api::setup))
        .route("/api/goals/{id}", get(api::goal))
        .route("/api/agents/{id}", get(api::agent))
        .route("/api/conversations/{id}", get(api::conversation))
        .route("/api/cameras/{id}", get(api::camera))
        .route("/api/history", get(api::history))
        .route("/api/words", get(api::words))
        .route("/api/log", get(api::log))
        .route("/api/events", get(api::events))
        .route("/api/acts", post(api::act))
        .route("/api/push", get(notifications::key).post(notifications::subscribe))
        .route("/api/push/remove", post(notifications::remove))
        .fallback(no_path)
        .method_not_allowed_fallback(no_method)
        .layer(middleware::from_fn_with_state(Arc::clone(&state), check))
        .with_state(state)
}

/// Checks what holds for every request, and adds the headers of every answer.
async fn check(State(state): State<Arc<ServerState>>, request: Request, next: Next) -> Response {
    let mut response = match checked(&state, &request) {
        Ok(()) => next.run(request).await,
        Err(refused) => {
            note_forged(&state, &request, &refused);
            refused.into_response()
        }
    };
    answer::secure(response.headers_mut(), state.is_encrypted);
    response
}

/// Logs a request for a change that no page of this server has made.
fn note_forged(state: &ServerState, request: &Request, refused: &Refused) {
    let client = request.extensions().get::<PageClient>();
    if let (&Method::POST, Some(client)) = (request.method(), client) {
        let what: String = request.uri().path().chars().take(LOGGED_CHARS_MAX).collect();
        let outcome = format!("refused: {}", refused.problem());
        state.record_flood(FloodKind::Forged, None, client.from, what, outcome);
    }
}

fn checked(state: &ServerState, request: &Request) -> Result<(), Refused> {
    let (uri, headers) = (request.uri(), request.headers());
    origin::check_target(uri)?;
    if uri.path_and_query().map_or(0, |target| target.as_str().len()) > TARGET_BYTES_MAX {
        let problem = format!("the path is longer than {TARGET_BYTES_MAX} bytes");
        return Err(Refused::new(StatusCode::URI_TOO_LONG, problem));
    }
    let host = origin::check_host(headers, &state.names)?;
    // A page may be opened by a link of any other, such as that of a mail; it then asks by itself.
    let reads_page =
        !uri.path().starts_with("/api/") && matches!(*request.method(), Method::GET | Method::HEAD);
    // A program shows its token, which no browser sends by itself.
    let is_program = headers.contains_key(axum::http::header::AUTHORIZATION);
    if reads_page || is_program {
        return Ok(());
    }
    origin::check_origin(request.method(), headers, host, state.is_encrypted)
}

async fn page(State(state): State<Arc<ServerState>>, headers: HeaderMap) -> Response {
    state.assets.answer(INDEX, &headers).await
}

async fn asset(
    State(state): State<Arc<ServerState>>,
    api::PathName(path): api::PathName,
    headers: HeaderMap,
) -> Response {
    state.assets.answer(&path, &headers).await
}

/// Answers for paths that are no page: a person is shown the page that says so.
async fn no_path(State(state): State<Arc<ServerState>>, request: Request) -> Response {
    let path = request.uri().path();
    let is_person = !path.starts_with("/api/") && request.method() == Method::GET;
    if !is_person {
        return Refused::new(StatusCode::NOT_FOUND, "there is no such path").into_response();
    }
    let mut response = state.assets.answer(INDEX, &HeaderMap::new()).await;
    *response.status_mut() = StatusCode::NOT_FOUND;
    response
}

async fn no_method(method: Method) -> Refused {
    let problem = format!("this path does not take {method}");
    Refused::new(StatusCode::METHOD_NOT_ALLOWED, problem)
}
